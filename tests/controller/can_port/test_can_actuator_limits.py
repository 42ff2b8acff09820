"""What the actuator lets wheels do: angle and rate limits, jumps, answers that fit no state, clocks that are odd."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.can_port.actuator_bench import ACTIVE, CYCLE, HOLD, INIT, RAMP, STANDBY, Bench, driving

from sidestep.controller.can_port.actuator import ActuatorConfig
from sidestep.controller.can_port.protection.e2e import CheckStatus
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand


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
