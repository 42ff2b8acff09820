"""The typed records on our CAN messages, there and back."""

import itertools
import math
from dataclasses import FrozenInstanceError, fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.controller.can_port.actuator import ActuatorConfig
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec import samples
from sidestep.controller.can_port.codec.database import load_dbc, messages
from sidestep.controller.can_port.protection.e2e_state import E2EState, StateConfig
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

angles = st.floats(-m.MAX_ANGLE, m.MAX_ANGLE)
speeds = st.floats(0.0, 163.83)


@given(angles, speeds, st.sampled_from(Status), st.integers(0, 10**6), st.booleans(), st.floats(0.0, m.MAX_RATE_LIMIT))
def test_command_round_trip(angle, speed, status, counter, enable, rate_limit):
    frame = m.decode_steer_command(
        m.encode_steer_command(SteeringCommand(1.0, angle, speed, status), counter, enable, rate_limit), time=2.0
    )
    assert frame.enable is enable
    assert frame.command.time == 2.0
    assert frame.command.steer_angle == pytest.approx(angle if enable else 0.0, abs=2.5e-5 * (1 + 1e-9))
    assert frame.command.target_speed == pytest.approx(speed, abs=0.005 * (1 + 1e-9))
    assert frame.command.status is status
    assert frame.rate_limit == pytest.approx(rate_limit, abs=0.0025 * (1 + 1e-9))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["steer_angle", "target_speed"])
def test_what_is_not_finite_disables_the_steering(field, bad):
    command = replace(SteeringCommand(0.0, 0.3, 15.0), **{field: bad})
    frame = m.decode_steer_command(m.encode_steer_command(command, 0), 0.0)
    assert frame == m.SteerFrame(SteeringCommand(0.0, 0.0, 0.0, Status.FAULT), enable=False, rate_limit=0.0)


def test_implausible_intact_frames_are_not_enabled():
    good = {
        "SteerCmd_Mode": 2,
        "SteerCmd_Enable": 1,
        "SteerCmd_Angle": 0.2,
        "SteerCmd_RateLimit": 1.0,
        "SteerCmd_TargetSpeed": 15.0,
        "SteerCmd_Status": 0,
        "SteerCmd_Answers": 0.2,
    }
    dbc = load_dbc().get_message_by_name("STEER_CMD")

    def decoded(**changes):
        values = {"SteerCmd_CRC": 0, "SteerCmd_Counter": 0} | good | changes
        return m.decode_steer_command(dbc.encode(values, strict=False), 0.0)

    def enabled(**changes):
        frame = decoded(**changes)
        assert frame.plausible == frame.enable  # a good angle without enable, or the other way round
        return frame.enable

    assert enabled()
    assert enabled(SteerCmd_Angle=1.6)
    assert enabled(SteerCmd_Angle=-1.6)
    assert not enabled(SteerCmd_Angle=1.60005)
    assert not enabled(SteerCmd_Angle=-1.6384)
    assert not any(enabled(SteerCmd_Mode=mode) for mode in range(8) if mode != 2)
    assert not enabled(SteerCmd_Enable=0)
    for mode in (0, 1, 7):
        assert decoded(SteerCmd_Mode=mode, SteerCmd_Enable=0, SteerCmd_Angle=0.0).plausible
        assert not decoded(SteerCmd_Mode=mode, SteerCmd_Enable=0, SteerCmd_Angle=5e-5).plausible
        assert not decoded(SteerCmd_Mode=mode, SteerCmd_Angle=0.0).plausible
    assert not decoded(SteerCmd_Mode=2, SteerCmd_Enable=0, SteerCmd_Angle=0.0).plausible


# --- vehicle state and status


@given(
    st.builds(
        VehicleState,
        time=st.just(0.5),
        x=st.floats(-8000, 8000),
        y=st.floats(-8000, 8000),
        yaw=st.floats(-200, 200),
        v_x=st.floats(-80, 80),
        v_y=st.floats(-30, 30),
        yaw_rate=st.floats(-3, 3),
        steer_angle=st.just(0.25),
    ),
    st.floats(-3.1, 3.1),
)
def test_vehicle_state_round_trip(state, yaw_error):
    frames = samples.encode_vehicle_state(state, 4.2, 9)
    got = samples.decode_vehicle_state(frames, time=0.5, steer_angle=0.25, near_yaw=state.yaw + yaw_error)
    assert got is not None
    for name, half_step in {"x": 5e-4, "y": 5e-4, "yaw": 2e-5, "v_x": 2.5e-3, "v_y": 5e-4, "yaw_rate": 5e-5}.items():
        assert getattr(got, name) == pytest.approx(getattr(state, name), abs=half_step * (1 + 1e-6)), name
    assert (got.time, got.steer_angle) == (0.5, 0.25)
    assert samples.VEH_DYN.decode(frames[0])["VehDyn_AccLat"] == pytest.approx(4.2)
    assert samples.decode_vehicle_state(frames, 0.5).steer_angle == 0.0


@given(st.lists(st.floats(allow_nan=False), min_size=8, max_size=8))
def test_the_exact_state_is_exact_and_cantools_reads_it(numbers):
    state = VehicleState(*numbers)
    frame = samples.exact_frame(state)
    assert samples.exact_state(frame.data) == state
    assert (frame.arbitration_id, frame.is_fd, frame.channel) == (samples.EXACT_ID, True, samples.LOG_CHANNEL)
    assert list(load_dbc().get_message_by_name("STATE_EXACT").decode(bytes(frame.data)).values()) == numbers


@given(st.integers(0, 10**6))
def test_a_command_names_the_sample_it_answers(number):
    frames = samples.encode_vehicle_state(VehicleState(time=0.01 * number), 0.0, 0)
    told = round(samples.VEH_HEADING.decode(frames[2])["VehHeading_Sample"] / 0.01)
    assert told == number % samples.SAMPLES
    command = SteeringCommand(0.0, 0.1, 15.0)
    frame = m.decode_steer_command(m.encode_steer_command(command, 0, answers=told), 0.0)
    assert frame.answers == number % samples.SAMPLES % m.ANSWERS
    assert m.decode_steer_command(m.encode_steer_command(command, 0), 0.0).answers is None


@pytest.mark.parametrize("field", ["x", "y", "yaw", "v_x", "v_y", "yaw_rate"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_vehicle_state_that_is_not_finite_is_not_valid(field, bad):
    frames = samples.encode_vehicle_state(replace(VehicleState(v_x=15.0), **{field: bad}), 0.0, 0)
    assert samples.decode_vehicle_state(frames, 0.0) is None


def test_heading_is_taken_as_it_comes_unless_another_is_near():
    for yaw in (3.0, -3.0):
        frames = samples.encode_vehicle_state(VehicleState(yaw=yaw, v_x=15.0), 0.0, 0)
        assert samples.decode_vehicle_state(frames, 0.0).yaw == pytest.approx(yaw)


def test_a_sample_is_three_messages():
    with pytest.raises(ValueError, match="zip"):
        samples.encode_vehicle_state(VehicleState(), 0.0, 0, sample=samples.VEHICLE_STATE[:2])
    with pytest.raises(ValueError, match="zip"):
        samples.decode_vehicle_state([bytes(8)] * 2, 0.0)


def test_only_more_than_8_bytes_need_can_fd():
    assert [replace(m.STEER_CMD, length=length).is_fd for length in (7, 8, 9)] == [False, False, True]


def test_status_round_trips():
    for state, e2e_state in itertools.product(m.ActuatorState, E2EState):
        status = m.SteerStatus(state, -0.12345, 0.5, e2e_state, 123)
        assert m.decode_steer_status(m.encode_steer_status(status, 3)) == replace(status, angle=pytest.approx(-0.12345))
    for qp_status, mode, status in itertools.product(m.QpStatus, m.SteerMode, Status):
        report = m.ControllerStatus(qp_status, status, mode, 0.000123, 0.0015, 17)
        got = m.decode_controller_status(m.encode_controller_status(report, 3))
        assert got == replace(report, solve_time=pytest.approx(0.000123), slack=pytest.approx(0.0015))


@pytest.mark.parametrize("record", [
    m.SteerStatus(m.ActuatorState.HOLD, 0.0, 0.0, E2EState.VALID, 0),
    m.ControllerStatus(m.QpStatus.SOLVED, Status.TRACKING, m.SteerMode.ANGLE, 0.0, 0.0, 0),
    m.STEER_CMD, m.STEER_CMD.profile, messages("P05")["STEER_CMD"].profile, ActuatorConfig(), StateConfig(4, 2, 1),
], ids=lambda record: type(record).__name__)  # fmt: skip
def test_records_do_not_change(record):
    with pytest.raises(FrozenInstanceError):
        setattr(record, fields(record)[0].name, None)


def test_numbers_without_a_name_read_as_the_worst():
    assert m.ActuatorState(9) is m.ActuatorState.FAULT
    assert m.QpStatus(9) is m.QpStatus.NUMERICS
    assert m.SteerMode(5) is m.SteerMode.FAULT
    assert E2EState(7) is E2EState.INVALID
