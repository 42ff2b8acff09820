"""The compiled controller beside the one in this process: a step's time, the size, many instances.

Run it: python benchmarks/plants/component.py

A drive of double-obstacle and one of moose are stepped again and again, in turns: `SteeringController.step` with the
active set, the FMU's doStep alone, the same with setting the state and reading the command by fmpy, and the C function.
Of each step the fastest of the passes counts, and the median and the 99th percentile of these over the drive.
"""

import ctypes
import gc
import resource
import statistics
from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from time import perf_counter, perf_counter_ns

import numpy as np

from sidestep.controller import SteeringController
from sidestep.controller.records import COMMAND, STATE
from sidestep.fmu.compiling.cache import cache_folder
from sidestep.fmu.component.build import shared_library
from sidestep.fmu.component.records import obstacle_rows, setup_of
from sidestep.fmu.exporting.controller_variables import STATE as INPUTS
from sidestep.fmu.exporting.export import export_controller
from sidestep.fmu.importing.instance import FmuInstance
from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.scenarios.scenario import Scenario, load_scenario

PASSES, DT, MANY, AGAIN = 15, 0.02, 1000, 10_000
WAYS = ("in this process", "C function", "doStep", "set, doStep, get by fmpy")


def main() -> None:
    gc.disable()
    folder = scratch_folder("build", cache_folder())
    try:
        file = folder / "libsidestep.so"
        file.write_bytes(shared_library())
        library = loaded(file)
        print(f"{file.stat().st_size / 2**10:.0f} KiB of shared library")
        for name in ("double-obstacle", "moose"):
            scene = load_scenario(name, ["controller.solver=active-set"])
            report(name, scene, library)
        instances(scene, library)
    finally:
        discard(folder)


def report(name: str, scene: Scenario, library: ctypes.CDLL) -> None:
    times = step_times(scene, library)
    own = statistics.median(times[0])
    for way, row in zip(WAYS, times, strict=True):
        median = statistics.median(row)
        print(f"{name:16} {way:26} {median:6.1f} us, 99 % {np.quantile(row, 0.99):6.1f} us, ratio {median / own:.2f}")


def step_times(scene: Scenario, library: ctypes.CDLL) -> list[list[float]]:
    """Of every step in each of `WAYS`, in [us]."""
    controller = bare_controller(scene)
    states = drive(scene, controller)
    component, answer = created(library, scene), np.zeros(1, COMMAND)
    boxes, rows = obstacle_rows(scene.obstacles), np.array([astuple(state) for state in states])
    fmus = [FmuInstance(exported(scene)) for _ in range(2)]
    ports = [(fmu.port([row[0] for row in INPUTS]), fmu.port(["steer_angle_command", "target_speed"])) for fmu in fmus]
    best = [[float("inf")] * len(states) for _ in WAYS]
    assert STATE.itemsize == rows[0].nbytes

    def in_fmu(which: int, k: int) -> int:
        fmu, (given, got) = fmus[which], ports[which]
        began = perf_counter_ns()
        given.values[:] = astuple(states[k])[1:]
        fmu.set(given)
        begin_step = perf_counter_ns()
        fmu.step(states[k].time, DT)
        end_step = perf_counter_ns()
        fmu.get(got)
        return perf_counter_ns() - began if which else end_step - begin_step

    for _ in range(PASSES):
        controller.reset()
        library.sidestep_reset(component)
        for fmu in fmus:
            fmu.start(0.0, {})
        for k, state in enumerate(states):
            at, seen, out = rows[k].ctypes.data, boxes.ctypes.data, answer.ctypes.data
            ways: tuple[Callable[[], object], ...] = (
                lambda state=state: controller.step(state),
                lambda at=at, seen=seen, out=out: library.sidestep_step(component, at, seen, len(boxes), out),
            )
            spent = [timed(way) for way in ways] + [in_fmu(0, k), in_fmu(1, k)]
            for row, time in zip(best, spent, strict=True):
                row[k] = min(row[k], time / 1e3)
            assert answer["steer_angle"][0] == controller.command.steer_angle
    for fmu in fmus:
        fmu.close()
    library.sidestep_free(component)
    return [row[1:] for row in best]  # the FMU's first answer belongs to its initialisation


def timed(way: Callable[[], object]) -> int:
    began = perf_counter_ns()
    way()
    return perf_counter_ns() - began


def drive(scene: Scenario, controller: SteeringController) -> Sequence[VehicleState]:
    plant = LinearPlant(scene.vehicle)
    states = [plant.reset(scene.start)]
    while len(states) < 200:
        states.append(plant.step(controller.step(states[-1]), DT))
    return states


def exported(scene: Scenario) -> Path:
    return export_controller(
        scene.name, scene.vehicle, scene.path, scene.obstacles, scene.controller, replace(scene.start)
    )


def loaded(file: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(file))
    library.sidestep_create.restype = ctypes.c_void_p
    library.sidestep_instance_size.restype = ctypes.c_size_t
    for name in ("free", "reset", "instance_size"):
        getattr(library, f"sidestep_{name}").argtypes = [ctypes.c_void_p]
    library.sidestep_create.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_void_p]
    library.sidestep_step.argtypes = [ctypes.c_void_p] * 3 + [ctypes.c_size_t, ctypes.c_void_p]
    return library


def created(library: ctypes.CDLL, scene: Scenario) -> int:
    setup = setup_of(scene.vehicle, scene.path, scene.controller)
    return library.sidestep_create(setup, len(setup), None)


def instances(scene: Scenario, library: ctypes.CDLL) -> None:
    """Many at once, and many one after the other."""
    setup = setup_of(scene.vehicle, scene.path, scene.controller)
    many = [library.sidestep_create(setup, len(setup), None) for _ in range(MANY)]
    print(f"{MANY} instances of {library.sidestep_instance_size(many[0]) / 2**10:.0f} KiB each")
    for one in many:
        library.sidestep_free(one)
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, perf_counter()
    for _ in range(AGAIN):
        library.sidestep_free(library.sidestep_create(setup, len(setup), None))
    took = 1e6 * (perf_counter() - began) / AGAIN
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(f"{AGAIN} created and freed, {took:.0f} us each, the process grown by {grown} KiB")


if __name__ == "__main__":
    main()
