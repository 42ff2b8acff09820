import math
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import pytest

from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.linear.plant import LinearPlant, steered
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters, vehicle_presets

BMW = VehicleParameters.preset("bmw-320i")


class Broken(LinearPlant):
    """A linear plant whose report or command is falsified by one function each."""

    def __init__(self, report=lambda state: state, command=lambda command: command, vehicle=BMW):
        super().__init__(vehicle)
        self._report, self._command = report, command

    def reset(self, state):
        return self._report(super().reset(state))

    def step(self, command, dt):
        return self._report(super().step(self._command(command), dt))


@pytest.mark.parametrize("name", vehicle_presets())
def test_nothing_is_found_on_the_linear_plant(name):
    vehicle = VehicleParameters.preset(name)
    plant = LinearPlant(vehicle)
    assert isinstance(plant, Plant)
    assert check_plant(plant, vehicle) == []
    assert check_plant(Broken(vehicle=vehicle)) == []


def mirrored(state: VehicleState) -> VehicleState:
    return replace(state, y=-state.y, yaw=-state.yaw, v_y=-state.v_y, yaw_rate=-state.yaw_rate)


def at_rear_axle(state: VehicleState) -> VehicleState:
    behind, c, s = BMW.l_r, math.cos(state.yaw), math.sin(state.yaw)
    return replace(
        state, x=state.x - behind * c, y=state.y - behind * s, v_y=state.v_y - behind * state.yaw_rate
    )  # fmt: skip


FALSIFIED = {
    "degrees": (lambda state: replace(state, yaw=math.degrees(state.yaw)), "After reset, yaw is 114.592 instead of 2."),
    "milliseconds": (lambda state: replace(state, time=1e3 * state.time), "A step of 0.02 s moves time by 20 s."),
    "SAE axes": (mirrored, "Steering 0.03 rad to the left gives a yaw_rate of -0.116, not positive."),
    "drift": (lambda state: replace(state, y=state.y + 0.1 * state.time), "the car drifts "),
    "rear axle": (at_rear_axle, "v_y / yaw_rate is -0.0419 m: the reference point lies 1.4 m behind"),
    "velocity at the rear axle": (
        lambda state: replace(state, v_y=state.v_y - BMW.l_r * state.yaw_rate),
        "In a bend y changes by ",
    ),
    "lame yaw rate": (
        lambda state: replace(state, yaw_rate=0.5 * state.yaw_rate),
        "In a bend yaw changes by 0.3647, but its velocity integrates to 0.1824.",
    ),
    "infinite": (
        lambda state: replace(state, v_y=math.inf if state.time > 0.51 else 0.0),
        "A command of nan rad and 10.0 m/s makes the state NaN or infinite",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FALSIFIED)
def test_falsified_reports_are_found(name):
    report, expected = FALSIFIED[name]
    assert any(expected in finding for finding in check_plant(Broken(report), BMW)), check_plant(Broken(report), BMW)


COMMANDS = {
    "deaf": (lambda command: replace(command, target_speed=10.0), "after target_speed went from 10 to 8 m/s"),
    "offset": (lambda command: replace(command, steer_angle=command.steer_angle + 0.01), "no mirror images: yaw_rate"),
    "half": (
        lambda command: replace(command, steer_angle=0.5 * command.steer_angle),
        "1.5 s after a command of 0.03 rad, steer_angle is 0.015 rad.",
    ),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_falsified_commands_are_found(name):
    command, expected = COMMANDS[name]
    assert any(expected in finding for finding in check_plant(Broken(command=command)))


def test_steering_faster_and_further_than_the_car_can_is_found():
    wild = Broken(vehicle=replace(BMW, steer_rate_limit=2.0, steer_limit=1.2))
    findings = check_plant(wild, BMW)
    assert any(finding.startswith("steer_angle moves at 2 rad/s, the car's limit is 0.4") for finding in findings)
    assert any(finding.startswith("steer_angle reaches 1.2 rad, the car's limit is 1.066") for finding in findings)
    assert len(findings) == 2


class Dropping(Broken):
    """Starts with some of the signals at zero, and says so, or says that it does not."""

    def __init__(self, names, is_honest):
        super().__init__()
        self._dropped, self._is_honest = dict.fromkeys(names, 0.0), is_honest

    def reset(self, state):
        real = super().reset(replace(state, **self._dropped))
        return real if self._is_honest else state


@pytest.mark.parametrize("name", ["v_y", "yaw_rate", "steer_angle"])
def test_a_reset_that_drops_a_signal_is_found(name):
    asked = {"v_y": 0.5, "yaw_rate": 0.5, "steer_angle": 0.1}[name]
    assert f"After reset, {name} is 0 instead of {asked:g}." in check_plant(Dropping([name], is_honest=True))
    found = check_plant(Dropping([name], is_honest=False))
    assert any(finding.startswith(f"{name} jumps from {asked} after the reset") for finding in found), found


def wrapped(low):
    def report(state):
        return replace(state, yaw=(state.yaw - low) % math.tau + low)

    return report


@pytest.mark.parametrize("low", [-math.pi, 0.0])
def test_a_yaw_that_wraps_is_found(low):
    found = check_plant(Broken(wrapped(low)))
    assert any(finding.startswith("yaw jumps from ") and "not wrap" in finding for finding in found), found


CARS = {
    "lag": (
        BMW.with_(steer_time_constant=0.3), LinearPlant,
        ["steer_angle follows a step of the steering 0.3 s late instead of 0.05 s"],
    ),
    "rate limit": (
        BMW.with_(steer_rate_limit=0.1), LinearPlant,
        ["steer_angle moves at no more than 0.1 rad/s, the car's limit is 0.4"],
    ),
    "steering limit": (
        BMW.with_(steer_limit=0.6), LinearPlant, ["steer_angle reaches no more than 0.6 rad, the car's limit is 1.066"],
    ),
    "mass": (
        BMW.with_(
            mass=1.3 * BMW.mass, cornering_stiffness_front=BMW.cornering_stiffness_front,
            cornering_stiffness_rear=BMW.cornering_stiffness_rear,
        ), LinearPlant,
        ["the front axle slips 1.3 times as much", "the rear axle slips 1.3 times as much"],
    ),
    "mass on tyres that follow the load": (
        BMW.with_(mass=1.3 * BMW.mass), partial(native_plant, model="double-track"),
        ["the front axle slips 1.2"],
    ),
    "yaw inertia": (
        BMW.with_(yaw_inertia=1.6 * BMW.yaw_inertia), LinearPlant, ["its yaw_inertia over mass were 1.6 times"],
    ),
    "stiffness": (
        BMW.with_(cornering_stiffness_rear=0.7 * BMW.cornering_stiffness_rear), LinearPlant,
        ["the rear axle slips 1.43 times as much"],
    ),
    "friction": (BMW, partial(native_plant, friction=0.5), ["friction or tyres are others"]),
    "friction on four wheels": (
        BMW, partial(native_plant, friction=0.5, model="double-track"), ["friction or tyres are others"],
    ),
    "friction, MuJoCo": (BMW, partial(MujocoPlant, friction=0.5), ["friction or tyres are others"]),
    "another car": (
        VehicleParameters.preset("vw-vanagon"), native_plant,
        ["the wheelbase of 2.", "the reference point lies 0.1 m behind"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CARS)
def test_a_car_that_is_another_than_told_is_found(name):
    real, plant, expected = CARS[name]
    found = check_plant(plant(real), BMW)
    for part in expected:
        assert any(part in finding for finding in found), (part, found)


def test_more_angle_at_the_wheels_than_reported_is_found():
    class Ratio(Broken):
        def step(self, command, dt):
            state = super().step(replace(command, steer_angle=1.1 * command.steer_angle), dt)
            return replace(state, steer_angle=state.steer_angle / 1.1)

        def reset(self, state):
            return replace(super().reset(replace(state, steer_angle=1.1 * state.steer_angle)), **asdict(state))

    found = check_plant(Ratio(), BMW)
    assert any("In a slow bend the car turns 1.1 times as much as its road-wheel angle of 0.1" in f for f in found), (
        found
    )


def test_a_lag_that_the_report_hides_is_found():
    late = Broken(vehicle=BMW.with_(steer_time_constant=0.3))

    class Hiding(Broken):
        def reset(self, state):
            self._angle = state.steer_angle
            return late.reset(state)

        def step(self, command, dt):
            angle = command.steer_angle if math.isfinite(command.steer_angle) else self._angle
            self._angle = steered(self._angle, angle, dt, 0.05, 0.4)
            return replace(late.step(command, dt), steer_angle=self._angle)

    found = check_plant(Hiding(), BMW)
    assert any(finding.startswith("yaw_rate follows a step of the steering 0.39 s late") for finding in found), found


@pytest.mark.parametrize("name", vehicle_presets())
@pytest.mark.parametrize("kind", ["single-track", "double-track", "mujoco"])
def test_nothing_is_found_on_our_own_plants(name, kind):
    vehicle = VehicleParameters.preset(name)
    plant = MujocoPlant(vehicle) if kind == "mujoco" else native_plant(vehicle, model=kind)
    assert check_plant(plant, vehicle) == []


def test_a_plant_that_takes_no_start_is_checked_all_the_same():
    class Standing(Broken):
        def reset(self, state):
            return super().reset(VehicleState(time=state.time))

    found = check_plant(Standing(), BMW)
    assert found
    assert all(finding.startswith("After reset, ") for finding in found), found


def test_a_plant_with_a_memory_is_found():
    class Worn(Broken):
        wear = 0.0

        def step(self, command, dt):
            self.wear += 1e-9
            return super().step(replace(command, steer_angle=command.steer_angle + self.wear), dt)

    [finding] = check_plant(Worn(), BMW)
    assert finding.startswith("The same commands after the same reset give another")


def test_a_step_that_depends_on_its_length_is_found():
    class Hasty(Broken):
        def step(self, command, dt):
            return super().step(replace(command, steer_angle=command.steer_angle * dt / 0.02), dt)

    assert any("yaw_rate after 1 s depends on the step" in finding for finding in check_plant(Hasty()))


def test_raising_is_a_finding():
    class Touchy(Broken):
        def step(self, command, dt):
            if not math.isfinite(command.steer_angle):
                raise ValueError("steering is nan")
            return super().step(command, dt)

    assert check_plant(Touchy()) == ["The check of commands that are nan ended with ValueError: steering is nan."]


def test_closing_twice_and_entering():
    class Once(Broken):
        open = True

        def __enter__(self):
            return Broken()

        def close(self):
            if not self.open:
                raise RuntimeError("closed already")
            self.open = False

    once: Any = Once()
    assert check_plant(once) == ["The check of closing ended with RuntimeError: closed already."]

    class Elsewhere(Broken):
        def __enter__(self):
            return Broken()

    elsewhere: Any = Elsewhere()
    assert check_plant(elsewhere) == ["The context manager gives Broken instead of the plant itself."]


def test_missing_methods_are_named():
    class Half:
        def reset(self, state): ...

        def step(self, command: SteeringCommand, dt: float): ...

    half: Any = Half()
    assert check_plant(half) == ["The plant has no method close, __enter__, __exit__."]
