"""What FMI costs: a plant's step. The exported controller's is in component.py.

Run it: python benchmarks/plants/fmi_cost.py

Steps of 20 ms. The ways are timed in turn in many short batches, and the fastest batch of each counts: what other
programs on the machine add is left out. "C core" makes as many steps in one call, without Python between them.
"""

import gc
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter_ns

import fmpy
from fmpy.fmi3 import FMU3Slave
from fmpy.simulation import instantiate_fmu

from sidestep.fmu.description.plants import MODELS
from sidestep.fmu.importing.mapping import OUTPUTS
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.scenarios.scenario import load_scenario

DT = 0.02
BATCHES, STEPS = 300, 50
SCENE = load_scenario("double-obstacle")


def main() -> None:
    gc.disable()
    for model in MODELS:
        core, bare, plant = plant_costs(model)
        print(
            f"{model:13} FmuPlant {plant:5.1f} us; bare fmpy loop {bare:5.1f} us, ratio {plant / bare:.2f}; "
            f"C core {core:5.1f} us, ratio {plant / core:.2f}"
        )


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


if __name__ == "__main__":
    main()
