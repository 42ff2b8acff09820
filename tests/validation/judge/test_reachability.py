"""The small parts of the search for a way past, each on its own: profiles, one layer of driving, boxes that overlap."""

import math

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc
from sidestep.plant_models.road.widths import Widths
from sidestep.validation.judge import feasibility
from sidestep.validation.judge.feasibility import MARGIN, REACTION_TIME
from sidestep.validation.judge.reachability import LAYER, SUBSTEPS, _advance, _curvature_limit, _hits
from sidestep.validation.scenarios.scenario import parse_scenario

STRAIGHT = """
speed = 15.0
duration = 20.0
[road]
width_left = 4.0
width_right = 4.0
segments = [{ type = "line", length = 300.0 }]
"""
BEND = ReferencePath.from_segments([Arc(150.0, 0.02)])
CAR = (2.2, 2.4, 0.85)
"""Front, rear, half width, in [m]."""


def test_the_distance_of_a_profile_is_the_area_under_it():
    scene = parse_scenario(STRAIGHT, "scene")
    times, travelled = feasibility._distances(scene, feasibility._Profile(5.0, REACTION_TIME, 6.0))
    _, speeds, _ = feasibility._speeds(scene, feasibility._Profile(5.0, REACTION_TIME, 6.0))
    braking = -np.diff(speeds).min() / np.diff(times)[0]
    expected = 15.0 * REACTION_TIME + (15.0**2 - 5.0**2) / (2.0 * braking)
    expected += 5.0 * (times[-1] - REACTION_TIME - 10.0 / braking)
    assert travelled[-1] == pytest.approx(expected, abs=0.02)  # the kinks lie between samples
    assert travelled[0] == 0.0


def test_a_share_of_the_speed_is_driven_no_longer_than_it_takes(monkeypatch):
    asked = []
    monkeypatch.setattr(feasibility, "_search", lambda scene, profile, clearance: asked.append(profile))
    scene = parse_scenario(STRAIGHT, "scene")
    feasibility._through(scene, MARGIN, 1.0)
    feasibility._through(scene, MARGIN, 0.5)
    feasibility._through(scene, MARGIN, 0.5, True)
    assert [profile.target for profile in asked] == [15.0, 7.5, 7.5]
    assert [profile.begin for profile in asked] == [math.inf, REACTION_TIME, REACTION_TIME]
    assert [profile.horizon for profile in asked] == [1.0, 1.0, 20.0]  # an empty road; to its end or for the duration


@pytest.mark.parametrize("offset", [-2.0, 1.0, 3.0])
def test_a_constant_curvature_on_a_bend_is_a_circle_in_the_world(offset):
    """Beside the reference, and not along it: the station grows by 1 / (1 - kappa l)."""
    own, speed = 0.005, 15.0
    speeds, limits = np.full(SUBSTEPS + 1, speed), np.full(SUBSTEPS + 1, 8.0)
    move = (own - 0.02) / _curvature_limit(speed, 8.0, 0.2)  # on top of the road's, and what it has already
    trace = np.zeros((SUBSTEPS + 1, 4))
    trace[0] = 20.0, offset, 0.1, own
    widths = Widths.constant(9.0, 9.0)
    arguments = speeds, limits, np.zeros((0, SUBSTEPS + 1, 4)), np.zeros((0, 6)), BEND.table, BEND.period, CAR
    assert _advance(trace, 0, move, *arguments, (widths.table, widths.spacing), 0.2)
    s, l, heading, _ = trace[-1]  # noqa: E741
    x, y = BEND.to_cartesian(20.0, offset)
    yaw, turn = BEND.heading(20.0) + 0.1, own * speed * LAYER
    x += (math.sin(yaw + turn) - math.sin(yaw)) / own
    y -= (math.cos(yaw + turn) - math.cos(yaw)) / own
    assert BEND.to_cartesian(s, l) == pytest.approx((x, y), abs=1e-3)
    assert BEND.heading(s) + heading == pytest.approx(yaw + turn, abs=1e-3)


def test_boxes_overlap_where_shapely_says_so():
    rng, seen = np.random.default_rng(0), {True: 0, False: 0}
    for _ in range(400):
        s, l, heading = rng.uniform(30.0, 60.0), rng.uniform(-3.0, 3.0), rng.uniform(-0.6, 0.6)  # noqa: E741
        station, beside, turned = s + rng.uniform(-7.0, 7.0), l + rng.uniform(-4.0, 4.0), rng.uniform(-3.0, 3.0)
        length, width = rng.uniform(0.3, 8.0), rng.uniform(0.3, 3.0)
        x, y = BEND.to_cartesian(station, beside)
        pose = np.array([x, y, turned, station])
        box = np.array([station, beside, length, width, turned, 0.0])
        theirs = translate(rotate(shapely.box(-0.5 * length, -0.5 * width, 0.5 * length, 0.5 * width), turned,
                                  origin=(0, 0), use_radians=True), x, y)  # fmt: skip
        car = rotate(shapely.box(-CAR[1], -CAR[2], CAR[0], CAR[2]), BEND.heading(s) + heading, origin=(0, 0),
                     use_radians=True)  # fmt: skip
        apart = translate(car, *BEND.to_cartesian(s, l)).distance(theirs)
        overlap = bool(_hits(s, l, heading, pose, box, BEND.table, BEND.period, CAR))
        seen[overlap] += 1
        assert overlap == (apart == 0.0)
    assert min(seen.values()) > 100
