"""Whatever comes in, whenever it is saved, restored or reset: the controller answers with numbers, within its limits.

`python tests/properties/test_hostile_steps.py 20000` does more of it than the test, and says what it saw.
"""

import math
import sys
from collections import Counter

import numpy as np
import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import Arc, Line, ReferencePath
from sidestep.plant_models.signals import Status, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(60.0), Arc(60.0, 0.02), Line(60.0)])
SCENE = (
    Obstacle(40.0, 0.0, 4.5, 1.8), Obstacle(70.0, 1.0, 4.5, 1.8, speed=-8.0), Obstacle(20.0, -1.0, 4.5, 1.8, speed=5.0),
    Obstacle(110.0, 0.0, 1.0, 12.0),
)  # fmt: skip
SETTINGS = (
    {}, {"solver": "active-set"}, {"input_delay_steps": 3}, {"body_roll": True}, {"tyre_model": "linear"},
    {"formulation": "paper"},
)  # fmt: skip
USUAL = np.array([0.0, 60.0, 0.0, 0.1, 15.0, 0.2, 0.1, 0.02])
SPREAD = np.array([0.0, 60.0, 2.0, 0.4, 8.0, 0.5, 0.3, 0.1])


def hostile_state(random: np.random.Generator, time: float) -> VehicleState:
    """Mostly a car, sometimes any bits that a float can have."""
    values = USUAL + SPREAD * random.normal(size=8)
    values[0] = time
    if random.random() < 0.3:
        i = random.integers(8)
        values[i] = random.integers(0, 2**64, dtype=np.uint64).view(np.float64)
    if random.random() < 0.1:
        values[random.integers(8)] *= 10.0 ** random.uniform(0.0, 308.0)
    return VehicleState(*values.tolist())


def numbers(plan) -> np.ndarray:
    arrays = [np.ravel(value) for value in plan if isinstance(value, np.ndarray)]
    figures = (
        plan.time,
        plan.primal_residual,
        plan.dual_residual,
        plan.slack_corridor,
        plan.slack_slip,
        plan.target_speed,
    )
    return np.concatenate([*arrays, figures])


def torment(steps: int, seed: int, settings: dict) -> Counter:
    """Step, save, restore and reset in any order; what the commands were."""
    random, config = np.random.default_rng(seed), ControllerConfig(**settings)
    controller, seen, time, last, saved = SteeringController(BMW, ROAD, SCENE, config), Counter(), 0.0, None, None
    for _ in range(steps):
        with np.errstate(all="ignore"):
            time += random.choice([0.02, 0.02, 0.02, 0.0, -0.5, 0.3, 1e-9])
            state = hostile_state(random, time)
        command = controller.step(state)
        seen[command.status] += 1
        assert math.isfinite(command.steer_angle + command.target_speed + command.time)
        assert abs(command.steer_angle) <= BMW.steer_limit
        assert command.target_speed >= 0.0 or command.status is not Status.FAULT
        if last is not None and config.formulation != "paper":  # which knows no bound of the rate
            assert abs(command.steer_angle - last) <= BMW.steer_rate_limit * config.period * (1.0 + 1e-9)
        last = command.steer_angle
        assert np.isfinite(numbers(controller.plan)).all()
        match random.integers(40):
            case 0:
                controller.reset()
                last = None
            case 1:
                saved = controller.save()
            case 2 if saved:
                controller.restore(saved)
                last = controller.command.steer_angle
    return seen


@pytest.mark.closed_loop
@pytest.mark.parametrize("settings", SETTINGS, ids=lambda settings: "-".join(map(str, settings.values())) or "default")
def test_no_step_raises_or_answers_nonsense(settings):
    seen = torment(400, 1, settings)
    assert seen[Status.TRACKING] + seen[Status.DEGRADED] + seen[Status.BLOCKED] > 40  # it was not only refused


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    for number, chosen in enumerate(SETTINGS):
        print(chosen or "default", dict(torment(count // len(SETTINGS) + 1, number, chosen)))
