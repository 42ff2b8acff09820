"""Where the car will be when its next command takes effect."""

import math
from dataclasses import astuple

import pytest

from sidestep.controller import ControllerConfig
from sidestep.controller.memory import empty
from sidestep.controller.mpc.roll import Body
from sidestep.controller.perception.locate import locate
from sidestep.controller.records import STATE, WORK, record
from sidestep.controller.settings import settings_of
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
PERIOD = 0.02


def located(road, state, delay=0, memory=None, rolls=False):
    """Work space and memory after one look at a state."""
    memory, work, now = empty(math.nan) if memory is None else memory, record(WORK), record(STATE)
    settings = settings_of(BMW, ControllerConfig(input_delay_steps=delay, body_roll=rolls))
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


def test_the_body_leans_as_far_as_a_steady_turn_asks():
    """Learned while it is driven, at more than walking speed; somebody who missed a state starts again upright."""
    road, memory, body = ReferencePath.from_segments([Line(200.0)]), None, Body.of(BMW)
    rolled = 0.0
    for k in range(150):
        state = VehicleState(time=PERIOD * k, v_x=15.0, yaw_rate=0.2)
        w, memory = located(road, state, 0, memory, rolls=True)
        assert (k == 0) == (w["roll"][0] == 0.0)
        rolled += PERIOD * w["roll"][1]
    assert rolled == pytest.approx(w["roll"][0], rel=0.1)  # what the rates add up to
    assert w["roll"][0] == pytest.approx(body.gain * 15.0 * 0.2 / body.stiffness, rel=0.01)
    assert abs(w["roll"][1]) < 1e-3
    for later, speed in ((2.0 * PERIOD, 15.0), (PERIOD, 2.9)):
        late = VehicleState(time=PERIOD * 149 + later, v_x=speed, yaw_rate=0.2)
        w, _ = located(road, late, 0, memory.copy(), rolls=True)
        assert w["roll"].tolist() == [0.0, 0.0]
