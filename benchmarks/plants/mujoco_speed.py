"""What the MuJoCo car costs: its step beside MuJoCo's own of the same model, real time, threads.

What is compared is timed in turns, and of each the least time counts: what the work takes when nothing disturbs it.
The ratios carry from machine to machine, the times do not; two threads need two idle cores.
"""

import ctypes
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
from numba import njit

from sidestep.plant_models.mujoco.library import load_own_copy
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario

START, BEND = VehicleState(v_x=15.0), SteeringCommand(0.0, 0.02, 15.0)
PERIOD, STEPS = 0.02, 20  # of the controller [s], and of the plant in it


def in_turns(kernels: dict[str, Callable[[], object]], turns: int) -> dict[str, tuple[float, float]]:
    """Least and median time of each, in [us]."""
    times = {name: np.empty(turns) for name in kernels}
    for k in range(turns):
        for name, kernel in kernels.items():
            began = time.perf_counter_ns()
            kernel()
            times[name][k] = (time.perf_counter_ns() - began) / 1000.0
    return {name: (float(of.min()), float(np.median(of))) for name, of in times.items()}


def car() -> MujocoPlant:
    plant = MujocoPlant(VehicleParameters.preset("bmw-320i"))
    plant.reset(START)
    plant.step(BEND, PERIOD)
    return plant


def steps() -> dict[str, tuple[float, float]]:
    """The plant's steps and MuJoCo's alone, without its clock and with it, of cars of their own.

    Without: in a copy of the library, as the plant steps.
    """
    own, bare = car(), car()
    model, data, step = bare.model._address, bare.data._address, load_own_copy().mj_step
    step.argtypes, step.restype = [ctypes.c_ssize_t, ctypes.c_ssize_t], None

    @njit
    def without_clock():
        for _ in range(STEPS):
            step(model, data)

    kernels = {
        "own": lambda: own.step(BEND, PERIOD),
        "bare": without_clock,
        "clock": lambda: mujoco.mj_step(bare.model, bare.data, STEPS),
    }
    return in_turns(kernels, 3000)


def threads() -> float:
    """How much faster two cars are driven by two threads than by one."""
    cars = [car(), car()]

    def drive(plant: MujocoPlant) -> None:
        for _ in range(10):
            plant.step(BEND, PERIOD)

    with ThreadPoolExecutor(2) as pool:
        found = in_turns({"one": lambda: list(map(drive, cars)), "two": lambda: list(pool.map(drive, cars))}, 500)
    return found["one"][0] / found["two"][0]


def real_time_factor(passes: int = 8) -> float:
    """Of the double scene, whole loop with the controller at 50 Hz; of every period the least time of the passes."""
    scenario = load_scenario("double-obstacle", ["plant.kind=mujoco", f"controller.period={PERIOD}"])
    controller = open_controller(scenario)
    clocks: list[list[int]] = []
    with open_plant(scenario) as plant:
        for _ in range(passes):
            clocks.append([])
            cosimulate(controller, plant, scenario, progress=lambda _: clocks[-1].append(time.perf_counter_ns()))
    periods = np.diff(clocks, axis=1).min(axis=0) / 1e9  # the same bits every time
    return PERIOD / float(periods.mean())


def main() -> None:
    found = steps()
    for name, (least, median) in found.items():
        print(f"{name:5s} step of 1 ms: {least / STEPS:.1f} us, median {median / STEPS:.1f} us")
    print(f"own over bare: {found['own'][0] / found['bare'][0]:.2f}, over bare with its clock: ", end="")
    print(f"{found['own'][0] / found['clock'][0]:.2f}")
    print(f"car alone: {1e6 * PERIOD / found['own'][0]:.0f} x real time")
    print(f"with the controller at 50 Hz: {real_time_factor():.0f} x real time")
    print(f"two threads: {threads():.2f} x one")


if __name__ == "__main__":
    main()
