"""Cost of the MuJoCo car: control periods of 20 ms in a swerve, per 1 ms step of the simulation."""

import math
from time import perf_counter_ns

import numpy as np

from sidestep.plant_models.mujoco_plant import MujocoPlant
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle import VehicleParameters

PERIOD = 20  # [ms]


def measure(plant: Plant | None = None, periods: int = 2000) -> dict[str, float]:
    """Median and 99th percentile of `Plant.step` over 20 ms, in [us] per simulated millisecond."""
    plant = plant or MujocoPlant(VehicleParameters.preset("bmw-320i"))
    elapsed = np.empty(periods)
    plant.reset(VehicleState(v_x=15.0))
    for k in range(periods):
        command = SteeringCommand(0.0, 0.04 * math.sin(0.05 * k), 15.0)
        start = perf_counter_ns()
        plant.step(command, PERIOD * 1e-3)
        elapsed[k] = perf_counter_ns() - start
    elapsed = elapsed[10:] * 1e-3 / PERIOD  # without the warm-up
    return {"median": float(np.median(elapsed)), "p99": float(np.percentile(elapsed, 99))}


if __name__ == "__main__":
    print(measure())
