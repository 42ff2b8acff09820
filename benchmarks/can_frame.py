"""Cost of one steering command over the virtual bus: build, protect, send, receive, check, decode."""

from time import perf_counter_ns

import numpy as np

from sidestep.controller.can_port.port import SteeringPort
from sidestep.plant_models.signals import SteeringCommand


def measure(frames: int = 20_000) -> dict[str, float]:
    """Median and 99th percentile of `SteeringPort.transmit`, in [us]."""
    command = SteeringCommand(0.0, 0.1, 15.0)
    elapsed = np.empty(frames)
    with SteeringPort("virtual:benchmark") as port:
        for k in range(frames):
            start = perf_counter_ns()
            port.transmit(command)
            elapsed[k] = perf_counter_ns() - start
    return {"median": float(np.median(elapsed)) * 1e-3, "p99": float(np.percentile(elapsed, 99)) * 1e-3}


if __name__ == "__main__":
    print(measure())
