"""The steering actuator, state by state and on both sides of every limit."""

import itertools
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.controller.can_port.actuator import Actuator, ActuatorConfig
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.database import messages
from sidestep.controller.can_port.codec.messages import ActuatorState
from sidestep.controller.can_port.protection.e2e import CheckStatus
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

INIT, STANDBY, ACTIVE = ActuatorState.INIT, ActuatorState.STANDBY, ActuatorState.ACTIVE
HOLD, RAMP, FAULT = ActuatorState.HOLD, ActuatorState.RAMP_TO_ZERO, ActuatorState.FAULT
CYCLE = 0.01


class Bench:
    """An actuator whose wheels follow at once, a sender, and a clock."""

    def __init__(self, config=None, protection="P02", angle=0.0):
        self.message = messages(protection)["STEER_CMD"]
        self.actuator = Actuator(config, self.message)
        self.time, self.angle, self.counters = 0.0, angle, itertools.count()
        self.answer = None

    def frame(self, angle=0.2, speed=15.0, **more):
        command = SteeringCommand(self.time, angle, speed)
        return m.encode_steer_command(command, next(self.counters), message=self.message, **more)

    def step(self, *frames, dt=CYCLE):
        self.time += dt
        self.answer = self.actuator.step(frames, VehicleState(self.time, v_x=14.0, steer_angle=self.angle))
        self.angle = self.answer.steer_angle
        return self.actuator.state

    def send(self, count, **more):
        return [self.step(self.frame(**more)) for _ in range(count)]


def driving(**more):
    bench = Bench(**more)
    bench.send(50)
    assert bench.actuator.state is ACTIVE
    assert bench.angle == pytest.approx(0.2)
    return bench


def test_init_keeps_wheels_and_speed_until_the_channel_is_valid():
    bench = Bench(angle=0.05)
    assert [bench.step() for _ in range(10)] == [INIT] * 10
    assert bench.answer == SteeringCommand(bench.time, 0.05, 14.0, Status.FAULT)
    # INITIAL opens the channel, eight OK make it VALID; the last of them is the first to be used
    assert bench.send(10) == [INIT] * 8 + [ACTIVE] * 2


def test_the_first_call_starts_from_the_wheels_whatever_has_arrived():
    bench = Bench(angle=0.05)
    assert bench.step(*[bench.frame(angle=0.5) for _ in range(10)]) is ACTIVE
    assert bench.angle == pytest.approx(0.05)  # no time has passed yet


def test_init_goes_with_the_wheels_and_what_follows_does_not():
    bench = Bench(angle=0.05)
    bench.step()
    bench.angle = 0.08
    bench.step()
    assert bench.answer.steer_angle == 0.08
    bench = driving()
    bench.angle = 0.1  # wheels that lag
    for _ in range(3):
        bench.step()
        bench.angle = 0.1
    assert (bench.actuator.state, bench.answer.steer_angle) == (HOLD, pytest.approx(0.2))


def test_active_follows_angle_speed_and_status():
    bench = driving()
    bench.step(m.encode_steer_command(SteeringCommand(0.0, 0.21, 7.0, Status.BLOCKED), next(bench.counters)))
    assert bench.answer == SteeringCommand(bench.time, pytest.approx(0.21), pytest.approx(7.0), Status.BLOCKED)


@pytest.mark.parametrize(
    ("age", "state"),
    [(0.0, ACTIVE), (0.0249, ACTIVE), (0.025, ACTIVE), (0.0251, HOLD), (0.05, HOLD), (0.0501, RAMP), (9.0, RAMP)],
)
def test_age_of_the_last_command_decides(age, state):
    bench = driving()
    assert bench.step(dt=age) is state


def test_ages_in_whole_cycles():
    bench = driving()
    assert [bench.step() for _ in range(7)] == [ACTIVE, ACTIVE, HOLD, HOLD, HOLD, RAMP, RAMP]


def test_hold_keeps_angle_and_speed_and_says_so():
    bench = driving()
    for _ in range(4):
        bench.step()
    assert bench.answer == SteeringCommand(bench.time, pytest.approx(0.2), pytest.approx(15.0), Status.DEGRADED)


def test_ramp_goes_to_zero_at_its_rate_and_asks_to_stop():
    for sign in (1, -1):
        bench = Bench()
        bench.send(50, angle=0.2 * sign)
        for _ in range(5):
            bench.step()
        angles = []
        while bench.angle:
            assert bench.step() is RAMP
            assert (bench.answer.target_speed, bench.answer.status) == (0.0, Status.FAULT)
            angles.append(bench.angle * sign)
        assert angles == pytest.approx([max(0.0, 0.2 - 0.003 * k) for k in range(1, len(angles) + 1)], abs=1e-12)
        assert len(angles) == pytest.approx(0.2 / 0.3 / CYCLE, abs=1)
        bench.step()
        assert bench.angle == 0.0


def test_standby_steers_back_and_keeps_the_speed_asked_for():
    bench = driving()
    assert bench.step(bench.frame(enable=False, speed=5.0)) is STANDBY
    assert bench.answer.steer_angle == pytest.approx(0.2 - 0.003)
    assert bench.answer.target_speed == pytest.approx(5.0)
    assert bench.answer.status is Status.DEGRADED
    bench.send(200, enable=False)
    assert bench.angle == 0.0


def test_a_command_that_is_not_finite_ends_in_standby_and_a_stop():
    bench = driving()
    assert bench.step(bench.frame(angle=math.nan)) is STANDBY
    assert bench.answer.target_speed == 0.0


def test_fault_is_for_good():
    bench = driving()
    bench.angle = math.nan
    assert bench.step(bench.frame()) is FAULT
    assert bench.answer == SteeringCommand(bench.time, pytest.approx(0.2), 0.0, Status.FAULT)
    assert bench.send(20) == [FAULT] * 20
    assert bench.angle == pytest.approx(0.2)


def test_fault_from_the_start_never_yields_a_bad_number():
    bench = Bench(angle=math.nan)
    assert bench.step() is FAULT
    assert bench.answer == SteeringCommand(bench.time, 0.0, 0.0, Status.FAULT)
    report = m.decode_steer_status(m.encode_steer_status(bench.actuator.report, 0))
    assert report.state is FAULT


@pytest.mark.parametrize(("own", "asked"), [(0.5, 5.0), (5.0, 0.5)])
def test_lower_rate_limit_wins(own, asked):
    bench = Bench(ActuatorConfig(rate_limit=own))
    bench.send(10, angle=0.0, rate_limit=asked)
    for k in range(1, 21):
        bench.step(bench.frame(angle=0.02 * k, rate_limit=asked))
    assert bench.angle == pytest.approx(20 * 0.5 * CYCLE)
    bench.send(500, angle=-1.0, rate_limit=asked)
    assert bench.angle == pytest.approx(-1.0)


@pytest.mark.parametrize("limit", [0.1, 0.5, 1.2])
def test_angle_limit_on_both_sides(limit):
    bench = Bench(ActuatorConfig(angle_limit=limit))
    for wanted, got in ((limit - 0.01, limit - 0.01), (limit + 0.01, limit), (-limit - 0.01, -limit)):
        bench.send(200, angle=wanted)
        assert bench.angle == pytest.approx(got, abs=2.6e-5)


def test_a_rate_limit_of_zero_still_lets_the_angle_stay():
    bench = driving()
    bench.send(3, rate_limit=0.0)
    assert (bench.actuator.state, bench.actuator.implausible) == (ACTIVE, 0)
    bench.step(bench.frame(angle=0.21, rate_limit=0.0))
    assert bench.actuator.implausible == 1


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("dt", "step", "followed"), [(0.01, 0.0599, True), (0.01, 0.0601, False), (0.02, 0.0699, True),
                                                      (0.02, 0.0701, False)])  # fmt: skip
def test_an_angle_farther_away_than_the_rate_limit_allows_is_not_followed(dt, step, followed, sign):
    """1 rad/s asked for: 1 rad/s times the elapsed time and the 50 ms that frames may have waited."""
    bench = Bench()
    bench.send(50, angle=0.2 * sign, rate_limit=1.0)
    assert bench.step(bench.frame(angle=0.2 * sign + step, rate_limit=1.0), dt=dt) is ACTIVE
    assert bench.actuator.implausible == (not followed)
    assert (bench.angle != pytest.approx(0.2 * sign)) == followed


def test_a_sender_that_really_jumped_is_followed_again_when_it_could_have_got_there():
    bench = Bench()
    bench.send(50, angle=0.0, rate_limit=1.0)
    states = bench.send(60, angle=0.3, rate_limit=1.0)
    assert bench.actuator.implausible == 24  # 0.3 s less 50 ms; the 25th is far enough in time
    assert set(states[24:]) == {ACTIVE}
    assert RAMP in states


def test_a_contradictory_frame_or_one_that_answers_no_state_of_late_is_not_followed():
    bench = driving()
    mode, enable = 0x10, 0x80
    for change in (mode, enable):
        data = bytearray(bench.frame(angle=0.21))
        data[1] ^= change
        bench.message.profile.protect(data, data[1] & 0xF)
        bench.step(bytes(data))
    assert bench.actuator.implausible == 2
    bench.step(bench.frame(angle=0.21, answers=round(bench.time / CYCLE) - 35))
    assert bench.actuator.implausible == 3
    assert bench.angle == pytest.approx(0.2)
    assert bench.actuator.channel.receiver.counts[CheckStatus.ERROR] == 0
    assert bench.actuator.asked == SteeringCommand(pytest.approx(0.5), pytest.approx(0.2), pytest.approx(15.0))


@pytest.mark.parametrize(("behind", "followed"), [(0, True), (6, True), (30, True), (31, False), (-1, False)])
def test_the_state_that_is_answered_was_sent_lately(behind, followed):
    bench = driving()
    bench.step(bench.frame(angle=0.21, answers=round(bench.time / CYCLE) + 1 - behind))
    assert (bench.angle == pytest.approx(0.21)) is (bench.actuator.implausible == 0) is followed


@pytest.mark.parametrize(("ahead", "followed"), [(0, True), (1, True), (11, True), (12, False), (-1, False)])
def test_answers_go_on_and_not_faster_than_time(ahead, followed):
    bench = driving()
    answered = round(bench.time / CYCLE) - 15
    bench.step(bench.frame(answers=answered))
    bench.step(bench.frame(answers=answered + ahead))
    assert (bench.actuator.implausible == 0) is followed


def test_enabling_may_jump():
    bench = driving()
    bench.send(10, enable=False)
    assert bench.step(bench.frame(angle=1.2)) is ACTIVE


def test_frozen_sender_is_caught_within_50_ms():
    bench = driving()
    frozen = bench.frame()
    bench.step(frozen)
    states = [bench.step(frozen) for _ in range(8)]
    assert states == [ACTIVE, ACTIVE, HOLD, HOLD, HOLD, RAMP, RAMP, RAMP]
    assert bench.actuator.channel.receiver.counts[CheckStatus.REPEATED] == 8


def test_recovery_after_a_blackout_of_a_second_is_without_a_jump():
    bench = driving()
    for _ in range(100):
        bench.step()
    assert bench.actuator.channel.state is E2EState.INVALID
    assert bench.angle == 0.0
    for _ in range(99):  # lost on the way: the counter has moved on
        next(bench.counters)
    before, states = bench.angle, []
    for _ in range(30):
        states.append(bench.step(bench.frame(rate_limit=0.5)))
        assert abs(bench.angle - before) <= 0.5 * CYCLE + 1e-12
        before = bench.angle
    assert states.index(ACTIVE) == 14  # the counter jumped, then 14 good ones in a row
    assert set(states[states.index(ACTIVE) :]) == {ACTIVE}


def test_corrupt_frames_alone_never_move_the_wheels():
    bench = driving()
    for k in range(200):
        data = bytearray(bench.frame(angle=-0.5))
        data[k % 8] ^= 1 << k % 7
        bench.step(bytes(data))
    assert bench.actuator.state is RAMP
    assert bench.angle == 0.0
    assert bench.actuator.channel.receiver.counts[CheckStatus.ERROR] == 200


def test_lost_commands_are_reported():
    bench = driving()
    for skipped in (0, 1, 2):
        for _ in range(skipped):
            bench.frame()
        bench.step(bench.frame())
    assert bench.actuator.report is not None
    assert bench.actuator.report.lost == 3
    bench.angle = 0.15
    bench.step(bench.frame())
    report = m.decode_steer_status(m.encode_steer_status(bench.actuator.report, 0))
    assert (report.state, report.e2e_state) == (ACTIVE, E2EState.VALID)
    assert (report.angle, report.rate) == (pytest.approx(0.15), pytest.approx(-0.05 / CYCLE, abs=5e-4))


def test_no_rate_is_reported_where_there_is_no_time_between():
    bench = Bench(angle=0.3)
    bench.step()
    assert bench.actuator.report.rate == 0.0
    bench.angle = 0.4
    bench.step(dt=0.0)
    assert bench.actuator.report.rate == 0.0


def test_a_clock_that_goes_backwards_moves_nothing():
    bench = driving()
    assert bench.step(bench.frame(angle=0.21), dt=-0.005) is ACTIVE
    assert bench.angle == pytest.approx(0.2)


@pytest.mark.parametrize("protection", ["P05", "none"])
def test_other_protections(protection):
    bench = driving(protection=protection)
    assert bench.answer.target_speed == pytest.approx(15.0)


finite = st.floats(-2.0, 2.0)
happenings = st.lists(
    st.tuples(
        st.sampled_from(["send", "send", "send", "lose", "repeat", "corrupt", "disable", "nan", "garbage"]),
        finite,
        st.floats(0.001, 0.04),
        st.binary(max_size=9),
    ),
    max_size=80,
)


@given(happenings)
def test_whatever_arrives_the_wheels_stay_within_their_limits(script):
    """The invariants: bounded angle, bounded rate, and nothing followed that is older than the state says."""
    config = ActuatorConfig(angle_limit=0.6, rate_limit=1.0)
    bench = Bench(config)
    last = bench.frame()
    for what, angle, dt, noise in script:
        before = bench.angle
        if what in ("send", "disable", "nan"):
            last = bench.frame(angle=math.nan if what == "nan" else angle, enable=what != "disable")
        frames = {
            "lose": [],
            "corrupt": [bytes([last[0] ^ 0x55]) + last[1:]],
            "garbage": [noise],
        }.get(what, [last])
        state = bench.step(*frames, dt=dt)
        assert abs(bench.angle) <= 0.6
        assert abs(bench.angle - before) <= dt * (1.0 if state is ACTIVE else 0.3) + 1e-12
        if state in (RAMP, STANDBY):
            assert abs(bench.angle) <= abs(before)
        if state in (INIT, HOLD):
            assert bench.angle == before
        assert (bench.answer.target_speed == 0.0) or state is not RAMP


@pytest.mark.parametrize(
    "bad",
    [{"active_age": 0.0}, {"hold_age": 0.02}, {"ramp_rate": -1.0}, {"angle_limit": math.nan}, {"rate_limit": 0},
     {"rate_limit": math.inf}, {"hold_age": math.inf}],
)  # fmt: skip
def test_impossible_limits_are_refused(bad):
    with pytest.raises(InputError, match="active_age <= hold_age"):
        replace(ActuatorConfig(), **bad)


def test_hold_may_be_left_out():
    bench = driving(config=ActuatorConfig(active_age=0.05, hold_age=0.05))
    assert [bench.step(dt=0.025) for _ in range(3)] == [ACTIVE, ACTIVE, RAMP]
