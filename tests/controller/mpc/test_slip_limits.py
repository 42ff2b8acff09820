"""Lines of the slip limits against the slip angles that the tyres of a rolling car have."""

import numpy as np
import pytest

from sidestep.controller import ControllerConfig
from sidestep.controller.mpc.car_model import slip_angles
from sidestep.controller.mpc.limits.slip import slip
from sidestep.controller.mpc.prediction import linearise
from sidestep.controller.mpc.roll import roll_effects
from sidestep.controller.records import MOVES, NODES, STATES, WORK, filled
from sidestep.controller.settings import settings_of
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
SETTINGS = settings_of(BMW, ControllerConfig(body_roll=True))
LIMITS, SPEED, ROLL = (0.08, 0.05), 20.0, (0.03, 0.4)


def rolling_car():
    """Work space of a car whose body leans and leans farther, in some motion at every node."""
    random = np.random.default_rng(0)
    work = filled(WORK, {
        "speed": np.full(NODES, SPEED), "group_speed": np.full(NODES, SPEED), "slip_limits": LIMITS,
        "before_roll": np.tile(ROLL, (NODES + 1, 1)), "free": random.uniform(-0.3, 0.3, (NODES, STATES)),
        "response": random.uniform(-0.1, 0.1, (NODES, STATES, MOVES)),
    })  # fmt: skip
    linearise(work[0], SETTINGS[0])
    return work[0]


def test_both_axles_have_their_own_limit_and_the_roll_that_their_tyres_feel():
    """From a bound it is as far as the tyres, moved sideways under a body that rolls, are from their limit."""
    w, grid, body = rolling_car(), SETTINGS[0]["grid"], SETTINGS[0]["car"]["body"]
    assert slip(0, w, SETTINGS[0]) == 2 * grid["slips"]
    roll_slip = roll_effects(*ROLL, body)[0]
    assert roll_slip / SPEED > 5e-3
    for n in range(grid["slips"]):
        state = w["free"][grid["slip_nodes"][n]]
        angles = slip_angles(state[2] + roll_slip / SPEED, state[3], state[4], SPEED, SETTINGS[0]["car"])
        for axle in range(2):
            i = 2 * n + axle
            assert w["high"][i] - w["lines"][i] == pytest.approx(LIMITS[axle] - angles[axle])
            assert w["lines"][i] - w["low"][i] == pytest.approx(LIMITS[axle] + angles[axle])
            assert w["slack"][i] == 1


def test_slopes_are_what_a_move_does_to_the_lines():
    w, moves = rolling_car(), SETTINGS[0]["grid"]["moves"]
    count = slip(0, w, SETTINGS[0])
    lines, slopes = w["lines"].copy(), w["slopes"].copy()
    for q in range(moves):
        moved = rolling_car()
        moved["free"][:] += moved["response"][:, :, q]
        slip(0, moved, SETTINGS[0])
        assert (moved["lines"] - lines)[:count] == pytest.approx(slopes[:count, q])
