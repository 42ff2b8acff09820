"""The steering actuator, state by state."""

import math

import pytest
from support.can_port.actuator_bench import ACTIVE, CYCLE, FAULT, HOLD, INIT, RAMP, STANDBY, Bench, driving

from sidestep.controller.can_port.actuator import ActuatorConfig
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.protection.e2e import CheckStatus
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.plant_models.signals import Status, SteeringCommand


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


@pytest.mark.parametrize("protection", ["P05", "none"])
def test_other_protections(protection):
    bench = driving(protection=protection)
    assert bench.answer.target_speed == pytest.approx(15.0)


def test_hold_may_be_left_out():
    bench = driving(config=ActuatorConfig(active_age=0.05, hold_age=0.05))
    assert [bench.step(dt=0.025) for _ in range(3)] == [ACTIVE, ACTIVE, RAMP]
