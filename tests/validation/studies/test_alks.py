import math

import pytest

from sidestep.validation.judge.careful_driver import DRIVERS, Sight, smallest_gap
from sidestep.validation.scenarios.scenario import parse_scenario

SCENE = """
speed = {speed}
duration = 12.0
plant = {{ kind = "linear" }}
road = {{ width_left = 6.0, width_right = 6.0, segments = [{{ type = "line", length = 400.0 }}] }}
"""


def gap(driver, speed, *obstacles):
    scenario = parse_scenario(SCENE.format(speed=speed), "test", [f"obstacles=[{', '.join(obstacles)}]"])
    return smallest_gap(scenario, DRIVERS[driver])


def stopping_distance(speed, driver):
    """Way from the moment of risk to standstill: delay, build-up of braking, full braking."""
    late = speed - driver.release * driver.delay
    way = 0.5 * (speed + late) * driver.delay
    build = (driver.braking - driver.release) / driver.jerk if math.isfinite(driver.jerk) else 0.0
    after = late - 0.5 * (driver.release + driver.braking) * build
    way += late * build - driver.release * build**2 / 2.0 - driver.jerk * build**3 / 6.0 if build else 0.0
    return way + after**2 / (2.0 * driver.braking)


@pytest.mark.parametrize("speed", [8.0, 12.0])
def test_the_careful_driver_stops_as_its_numbers_say(speed):
    driver = DRIVERS["careful"]
    left = 2.0 * speed - stopping_distance(speed, driver)
    assert left > 0.0
    assert gap("careful", speed, "{s=60, l=0, length=4, width=2}") == pytest.approx(left, abs=0.3)


def test_too_fast_for_two_seconds_it_collides():
    speed = 20.0
    assert 2.0 * speed < stopping_distance(speed, DRIVERS["careful"])
    assert gap("careful", speed, "{s=200, l=0, length=4, width=2}") == 0.0


def test_what_is_beside_the_lane_is_passed():
    assert gap("careful", 20.0, "{s=100, l=3, length=4, width=2}") == pytest.approx(3.0 - 1.0 - 1.61 / 2.0, abs=0.01)
    assert gap("careful", 20.0) == math.inf


def test_hard_braking_is_seen_at_once():
    brakes = (
        "{length=4, width=2, trajectory={t=[0, 2, 3, 4, 5, 12], s=[30, 60, 72, 78, 78.5, 78.5], l=[0, 0, 0, 0, 0, 0]}}"
    )
    assert DRIVERS["careful"].sees_risk(Sight(40.0, -1.0, 15.0, 12.0, 0.0, 6.0))
    assert not DRIVERS["careful"].sees_risk(Sight(40.0, -1.0, 15.0, 12.0, 0.0, 1.0))
    assert gap("careful", 15.0, brakes) > 0.0


def test_the_requirement_for_cut_ins_is_its_formula():
    driver = DRIVERS["performance"]
    limit = 6.0 / 12.0 + 0.45
    for factor, risk in ((1.01, False), (0.99, True)):
        assert driver.sees_risk(Sight(factor * limit * 6.0, 0.4, 16.0, 10.0, 1.0, 0.0)) is risk
    assert not driver.sees_risk(Sight(1.0, 0.6, 16.0, 10.0, 1.0, 0.0))


def test_rss_keeps_its_distance_along_and_across():
    driver = DRIVERS["RSS"]
    along = 10.0 * 0.75 + 1.5 * 0.75**2 + ((10.0 + 2.25) ** 2 - 25.0) / 12.0
    assert driver.sees_risk(Sight(along - 0.01, -1.0, 10.0, 5.0, 0.0, 0.0))
    assert not driver.sees_risk(Sight(along + 0.01, -1.0, 10.0, 5.0, 0.0, 0.0))
    assert not driver.sees_risk(Sight(1.0, 0.3 + 0.375 * 0.75 + 0.75**2 / 2.0 + 0.01, 10.0, 5.0, 0.0, 0.0))
