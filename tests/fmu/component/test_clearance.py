"""Distance to the nearest obstacle, held against the judge's."""

import numpy as np
import pytest

from sidestep.controller.records import STATE, record
from sidestep.fmu.component.clearance import NOTHING_NEAR, box_distance, clearance
from sidestep.fmu.component.records import SETUP
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.validation.geometry import boxes, signed_clearance


def test_distances_are_those_of_the_judge():
    random = np.random.default_rng(7)
    for _ in range(40):
        places = random.uniform([-6, -6, -4], [6, 6, 4], (3, 3))
        car = boxes(np.zeros(1), np.zeros(1), np.array([0.4]), 2.5, 1.5, 1.8)
        others = [boxes(np.array([x]), np.array([y]), np.array([yaw]), 1.0, 1.0, 3.0) for x, y, yaw in places]
        expected = max(min(float(signed_clearance(car, other)[0]) for other in others), 0.0)
        middle = 0.5 * np.cos(0.4), 0.5 * np.sin(0.4)
        found = min(box_distance(*middle, 0.4, 2.0, 0.9, x, y, yaw, 1.0, 1.5) for x, y, yaw in places)
        assert found == pytest.approx(expected, abs=1e-9)


def test_it_follows_an_obstacle_along_the_road():
    road, setup, state = ReferencePath.from_segments([Line(100.0)]), record(SETUP), record(STATE)
    setup["half_length"], setup["half_width"], setup["ahead"] = 2.0, 0.9, 0.5
    moving = np.array([[30.0, 0.0, 4.0, 2.0, 0.0, 5.0]])
    gaps = []
    for time in (0.0, 1.0):
        state["time"] = time
        gaps.append(clearance(setup, np.array(road.table), moving, state))
    assert gaps == pytest.approx([30.0 - 2.0 - 2.5, 30.0 - 2.0 - 2.5 + 5.0], abs=1e-9)
    assert clearance(setup, np.array(road.table), moving[:0], state) == NOTHING_NEAR
