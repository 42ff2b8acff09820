"""What FMI costs: a plant's step, the round trip to the exported controller, an export.

Run it: python benchmarks/plants/fmi_cost.py

Steps of 20 ms. The ways are timed in turn in many short batches, and the fastest batch of each counts: what other
programs on the machine add is left out. "C core" makes as many steps in one call, without Python between them.
The echo is the controller's FMU with another server in it: it sends back what it gets, after the time that a controller
would take.
"""

import gc
import os
import shutil
import statistics
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from time import perf_counter, perf_counter_ns

import fmpy
from fmpy.fmi3 import FMU3Slave
from fmpy.simulation import instantiate_fmu

from sidestep.controller import SteeringController
from sidestep.fmu.description.plants import MODELS
from sidestep.fmu.exporting.controller_variables import STATE
from sidestep.fmu.exporting.export import export_controller
from sidestep.fmu.importing.instance import FmuInstance
from sidestep.fmu.importing.mapping import OUTPUTS
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.scenarios.scenario import load_scenario

DT = 0.02
BATCHES, STEPS = 300, 50
PASSES, DRIVE = 10, 200
SCENE = load_scenario("double-obstacle")
ECHO = """
import socket, struct, time
head = struct.Struct("=qQ")
with socket.socket(fileno=3) as channel:
    while request := channel.recv(head.size, socket.MSG_WAITALL):
        size = head.unpack(request)[1]
        values = channel.recv(size, socket.MSG_WAITALL) if size else b""
        until = time.perf_counter() + {seconds}
        while time.perf_counter() < until:
            pass
        channel.sendall(head.pack(0, size) + values)
"""


def main() -> None:
    gc.disable()
    for model in MODELS:
        core, bare, plant = plant_costs(model)
        print(
            f"{model:13} FmuPlant {plant:5.1f} us; bare fmpy loop {bare:5.1f} us, ratio {plant / bare:.2f}; "
            f"C core {core:5.1f} us, ratio {plant / core:.2f}"
        )
    for fmi in (2, 3):
        own, more, echo = controller_costs(fmi)
        print(f"{'controller':13} FMI {fmi}: {own:.0f} us by its own clock, {more:.1f} us more to its caller", end="")
        print(f"; an echo in its place {echo:.1f} us, ratio {more / echo:.2f}")
    cold, warm = export_costs()
    print(f"{'export':13} {cold:.2f} s with an empty cache, {warm:.2f} s when its binary is there")


def plant_costs(model: str) -> list[float]:
    """Of a step in the C core, in a loop over fmpy's methods and in `FmuPlant`, in [us]."""
    command, clock = SteeringCommand(0.0, 0.02, 15.0), {"core": 0.0, "bare": 0.0}
    with (
        instantiated(build_fmu(model)) as (core, _),
        instantiated(build_fmu(model)) as (bare, references),
        native_plant(SCENE.vehicle, model=model) as plant,
    ):
        inputs = [references["steer_angle_command"], references["target_speed"]]
        outputs = [references[name] for name in OUTPUTS]
        core.setFloat64(inputs, [0.02, 15.0])
        plant.reset(VehicleState(v_x=15.0))

        def in_core() -> None:
            core.doStep(clock["core"], STEPS * DT)
            clock["core"] += STEPS * DT

        def in_fmpy() -> None:
            for _ in range(STEPS):
                bare.setFloat64(inputs, [0.02, 15.0])
                bare.doStep(clock["bare"], DT)
                bare.getFloat64(outputs)
                clock["bare"] += DT

        def in_plant() -> None:
            for _ in range(STEPS):
                plant.step(command, DT)

        return fastest((in_core, in_fmpy, in_plant))


@contextmanager
def instantiated(file: Path) -> Iterator[tuple[FMU3Slave, dict[str, int]]]:
    """An instance between steps, by fmpy alone, and the value references of its variables by name."""
    description, folder = fmpy.read_model_description(file), fmpy.extract(file)
    slave = instantiate_fmu(folder, description, "CoSimulation")
    assert isinstance(slave, FMU3Slave)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    yield slave, {variable.name: variable.valueReference for variable in description.modelVariables}
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)


def fastest(ways: Sequence[Callable[[], None]]) -> list[float]:
    """Time of a step in the fastest batch of each way, in [us]."""
    best = [float("inf")] * len(ways)
    for _ in range(BATCHES):
        for index, way in enumerate(ways):
            began = perf_counter_ns()
            way()
            best[index] = min(best[index], (perf_counter_ns() - began) / STEPS / 1e3)
    return best


def controller_costs(fmi: int) -> tuple[float, float, float]:
    """Medians over a drive, in [us].

    A step's time as the controller in the FMU says, what its caller waits longer, and the same of an echo that takes
    300 us. Of each step the fastest of several passes; controller and echo drive in turns.
    """
    states, file, pause = drive(), exported(fmi), 3e-4
    own, more, echo = ([float("inf")] * DRIVE for _ in range(3))
    with tempfile.TemporaryDirectory() as folder:
        fmus = [FmuInstance(file), FmuInstance(with_server(file, ECHO.format(seconds=pause), Path(folder, "echo.fmu")))]
    for _ in range(PASSES):
        for k, (waited, took) in enumerate(waits(fmus[0], states)):
            own[k], more[k] = min(own[k], took), min(more[k], waited - took)
        for k, (waited, _) in enumerate(waits(fmus[1], states)):
            echo[k] = min(echo[k], waited - 1e6 * pause)
    for fmu in fmus:
        fmu.close()
    return statistics.median(own[1:]), statistics.median(more[1:]), statistics.median(echo[1:])  # the first starts it


def waits(fmu: FmuInstance, states: Sequence[VehicleState]) -> Iterator[tuple[float, float]]:
    """What the caller of each step waits, and what the controller says that it took, in [us]."""
    inputs, outputs = fmu.port([name for name, *_ in STATE]), fmu.port(["steer_angle_command", "step_time"])
    fmu.start(0.0, {})
    for state in states:
        inputs.values[:] = astuple(state)[1:]
        began = perf_counter_ns()
        fmu.set(inputs)
        fmu.step(state.time, DT)
        fmu.get(outputs)
        yield (perf_counter_ns() - began) / 1e3, 1e6 * outputs.values[1]


def with_server(file: Path, server: str, out: Path) -> Path:
    """The exported controller with another program in its process."""
    with zipfile.ZipFile(file) as whole, zipfile.ZipFile(out, "w") as other:
        for entry in whole.infolist():
            is_server = entry.filename == "resources/server.py"
            other.writestr(entry, server if is_server else whole.read(entry))
    return out


def drive() -> list[VehicleState]:
    controller, plant = fresh_controller(), LinearPlant(SCENE.vehicle)
    states = [plant.reset(SCENE.start)]
    while len(states) < DRIVE:
        states.append(plant.step(controller.step(states[-1]), DT))
    return states


def fresh_controller() -> SteeringController:
    return bare_controller(SCENE)


def exported(fmi: int) -> Path:
    return export_controller(SCENE.name, SCENE.vehicle, SCENE.path, SCENE.obstacles, SCENE.controller, SCENE.start, fmi)


def export_costs() -> list[float]:
    """Time of the first and of a second export, in [s]."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for fmi in (2, 3):
            began = perf_counter()
            exported(fmi)
            times.append(perf_counter() - began)
    return times


if __name__ == "__main__":
    main()
