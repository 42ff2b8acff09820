"""Where the car will be when its next command takes effect."""

import math
from dataclasses import astuple

import pytest

from sidestep.controller import ControllerConfig
from sidestep.controller.memory import empty
from sidestep.controller.perception.locate import locate
from sidestep.controller.records import STATE, WORK, record
from sidestep.controller.settings import settings_of
from sidestep.plant_models.road.reference_path import Arc, Line, ReferencePath
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
PERIOD = 0.02


def located(road, state, delay=0, memory=None):
    """Work space and memory after one look at a state."""
    memory, work, now = empty(math.nan) if memory is None else memory, record(WORK), record(STATE)
    settings = settings_of(BMW, ControllerConfig(input_delay_steps=delay))
    now[0] = astuple(state)
    locate(memory[0], work[0], settings[0], (road.table, road.period), now[0])
    return work[0], memory


@pytest.mark.parametrize("delay", [0, 1, 10])
def test_a_car_that_goes_straight_on_is_so_much_farther_when_its_command_arrives(delay):
    road, passed = ReferencePath.from_segments([Line(200.0)]), delay * PERIOD
    w, _ = located(road, VehicleState(time=3.0, x=40.0, y=0.5, yaw=0.02, v_x=15.0), delay)
    assert w["time"] == pytest.approx(3.0 + passed)
    assert w["station"] == pytest.approx(40.0 + 15.0 * math.cos(0.02) * passed, abs=1e-9)
    assert w["x0"][:2] == pytest.approx((0.5 + 15.0 * 0.02 * passed, 0.02), abs=1e-9)


@pytest.mark.parametrize("offset", [-3.0, 3.0])
@pytest.mark.parametrize("curvature", [-0.02, 0.02])
def test_beside_the_reference_of_a_bend_it_goes_along_its_own_circle(curvature, offset):
    """In 0.2 s the car turns as far as the road does from the one station to the other."""
    speed, delay, road = 6.0, 10, ReferencePath.from_segments([Arc(120.0, curvature)])
    x, y = road.to_cartesian(30.0, offset)
    own = curvature / (1.0 - curvature * offset)
    w, _ = located(road, VehicleState(0.0, x, y, road.heading(30.0), speed, 0.0, speed * own), delay)
    turned = speed * own * delay * PERIOD
    assert w["station"] - 30.0 == pytest.approx(turned / curvature, rel=1e-3)


def test_commands_on_their_way_steer_it_one_after_the_other():
    """The oldest command in memory is in force first: a later one of the same size moves the car less."""
    road, moved = ReferencePath.from_segments([Line(200.0)]), []
    for place in range(3):
        _, memory = located(road, VehicleState(v_x=15.0), 2)
        memory["sent"][0, place] = 0.1
        w, _ = located(road, VehicleState(time=0.06, x=0.9, v_x=15.0), 2, memory)
        moved.append(w["x0"][3])
    assert moved[0] == 0.0  # over by now, but for the wheels, which are measured
    assert moved[1] > 2.0 * moved[2] > 0.0


def test_headings_count_from_the_road_whatever_the_turns():
    road = ReferencePath.from_segments([Line(200.0)])
    for turns in (-3, 0, 1):
        w, _ = located(road, VehicleState(yaw=0.3 + turns * math.tau, v_x=15.0, v_y=-0.6))
        assert w["x0"][1:3] == pytest.approx((0.3, -0.04))


def test_wheels_cannot_go_beyond_their_stop():
    road, memory = ReferencePath.from_segments([Line(200.0)]), empty(math.nan)
    memory["disturbance"]["actuator"], memory["disturbance"]["sensor"] = 0.03, 0.02
    limit = BMW.steer_limit
    w, _ = located(road, VehicleState(v_x=15.0, steer_angle=limit), 0, memory)
    assert w["x0"][5] == limit
    assert w["x0"][4] == pytest.approx(limit + 0.02)  # where they are is measured
