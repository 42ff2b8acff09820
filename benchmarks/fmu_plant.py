"""Cost of one 20 ms step of the native single-track FMU: command in, vehicle state out."""

from time import perf_counter_ns

import numpy as np

from sidestep.fmu.fmu_plant import FmuPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle import VehicleParameters


def measure(steps: int = 20_000) -> dict[str, float]:
    """Median and 99th percentile of `FmuPlant.step` in a slalom at 15 m/s, in [us]."""
    commands = [SteeringCommand(0.0, angle, 15.0) for angle in 0.05 * np.sin(0.06 * np.arange(steps))]
    elapsed = np.empty(steps)
    with FmuPlant.native(VehicleParameters.preset("bmw-320i")) as plant:
        plant.reset(VehicleState(v_x=15.0))
        for k, command in enumerate(commands):
            start = perf_counter_ns()
            plant.step(command, 0.02)
            elapsed[k] = perf_counter_ns() - start
    return {"median": float(np.median(elapsed)) * 1e-3, "p99": float(np.percentile(elapsed, 99)) * 1e-3}


if __name__ == "__main__":
    print(measure())
