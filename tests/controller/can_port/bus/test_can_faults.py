"""The faulty bus: each fault does what it says, and none of them gets past the actuator."""

import itertools
import math
from collections import Counter
from dataclasses import replace

import pytest

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.bus.faults import REORDER_DELAY, FaultSpec, FaultyBus
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.database import messages
from sidestep.controller.can_port.codec.messages import ActuatorState
from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus, Receiver
from sidestep.plant_models.signals import SteeringCommand, VehicleState

CYCLE = 0.01
ID = m.STEER_CMD.frame_id


def frame(k, protection="P02"):
    return m.encode_steer_command(
        SteeringCommand(0.0, 0.3 * math.sin(0.05 * k), 0.01 * k), k, message=messages(protection)["STEER_CMD"]
    )


def transport(spec, count=2000, protection="P02"):
    """Send one frame a cycle; the (cycle, identifier, data) that arrive."""
    bus, arrived = FaultyBus(spec, messages(protection)), []
    for k in range(count):
        bus.send(k * CYCLE, ID, frame(k, protection))
        arrived += [(k, *got) for got in bus.receive(k * CYCLE)]
    return arrived + [(math.inf, *got) for got in bus.receive(math.inf)]


def sent_index(arrived):
    """Which frame each arrived one is: the speed tells."""
    return [round(100 * m.decode_steer_command(data, 0.0).command.target_speed) for _, _, data in arrived]


def checks(arrived, protection="P02"):
    message = messages(protection)["STEER_CMD"]
    receiver = Receiver(message.profile, message.length)
    return Counter(receiver.check(data) for _, frame_id, data in arrived if frame_id == ID)


# --- the faults


def test_without_faults_everything_arrives_at_once_and_untouched():
    assert transport(FaultSpec(seed=5)) == [(k, ID, frame(k)) for k in range(2000)]


def test_same_seed_same_faults():
    spec = FaultSpec(seed=3, loss=0.1, jitter=0.02, corruption=0.1, duplication=0.1)
    assert transport(spec) == transport(spec)
    assert transport(spec) != transport(replace(spec, seed=4))


def test_another_fault_leaves_the_losses_where_they_were():
    alone = sent_index(transport(FaultSpec(seed=3, loss=0.2)))
    together = transport(FaultSpec(seed=3, loss=0.2, jitter=0.004, duplication=0.3, reorder=0.1))
    assert sorted(set(sent_index(together))) == alone


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_loss(share):
    lost = 1.0 - len(transport(FaultSpec(loss=share))) / 2000
    assert lost == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 2000))


def test_loss_of_everything_and_of_nothing():
    assert transport(FaultSpec(loss=1.0)) == []
    assert len(transport(FaultSpec(loss=0.0))) == 2000


def test_bursts_are_as_long_as_asked():
    index = sent_index(transport(FaultSpec(loss=0.01, burst=10)))
    gaps = Counter(b - a - 1 for a, b in itertools.pairwise(index) if b - a > 1)
    assert max(gaps) <= 20  # two in a row at most
    assert sum(gaps[n] for n in range(1, 11)) >= 0.9 * gaps.total()
    assert {n for n in gaps if n <= 10} >= {1, 5, 10}


def test_duplicates_follow_at_once():
    arrived = transport(FaultSpec(duplication=0.3))
    assert len(arrived) == pytest.approx(2600, abs=80)
    counts = checks(arrived)
    assert counts[CheckStatus.REPEATED] == len(arrived) - 2000
    assert counts[CheckStatus.OK] == 1999


def test_delay_is_exact():
    arrived = transport(FaultSpec(delay=0.05), 100)
    assert [k for k, _, _ in arrived[:95]] == list(range(5, 100))
    assert sent_index(arrived) == list(range(100))


def test_jitter_delays_evenly_up_to_its_limit_and_lets_frames_overtake():
    arrived = transport(FaultSpec(jitter=0.03))
    late = [k - i for (k, _, _), i in zip(arrived, sent_index(arrived), strict=True) if k < math.inf]
    assert set(late) == {1, 2, 3}
    assert max(late.count(n) for n in (1, 2, 3)) < 1.2 * min(late.count(n) for n in (1, 2, 3))
    assert sent_index(arrived) != sorted(sent_index(arrived))


def test_reordering_holds_a_share_back():
    arrived = transport(FaultSpec(reorder=0.2))
    late = Counter(k - i for (k, _, _), i in zip(arrived, sent_index(arrived), strict=True) if k < math.inf)
    assert set(late) == {0, round(REORDER_DELAY / CYCLE)}
    assert late[3] == pytest.approx(400, abs=80)


def test_corruption_is_detected_but_for_the_chance_of_the_crc():
    arrived = transport(FaultSpec(corruption=1.0), 10_000)
    assert all(data != frame(k) for k, _, data in arrived)
    passed = sum(m.STEER_CMD.profile.counter_of(data) is not None for _, _, data in arrived)
    assert passed / 10_000 == pytest.approx(1 / 256, abs=4 * math.sqrt(1 / 256 / 10_000))
    accepted = sum(count for status, count in checks(arrived).items() if status in ACCEPTED)
    assert accepted <= 0.4 * passed  # the counter stops most of what the CRC lets pass


def test_profile_5_lets_less_pass():
    arrived = transport(FaultSpec(corruption=1.0), 10_000, "P05")
    profile = messages("P05")["STEER_CMD"].profile
    assert sum(profile.counter_of(data) is not None for _, _, data in arrived) <= 3  # expected: 0.15


def test_wrong_length_is_detected():
    arrived = transport(FaultSpec(wrong_length=1.0))
    assert {len(data) for _, _, data in arrived} == set(range(8))
    assert checks(arrived) == {CheckStatus.ERROR: 2000}


@pytest.mark.parametrize("protection", ["P02", "P05"])
def test_masquerade_is_detected(protection):
    assert checks(transport(FaultSpec(masquerade=1.0), 2000, protection), protection) == {CheckStatus.ERROR: 2000}


def test_counter_jump_lasts():
    counts = checks(transport(FaultSpec(seed=1, counter_jump=0.01)))
    assert counts[CheckStatus.ERROR] == 0
    assert 5 < counts[CheckStatus.WRONGSEQUENCE] + counts[CheckStatus.OKSOMELOST] + counts[CheckStatus.REPEATED] < 45


def test_freeze_repeats_the_last_good_frame_and_ends():
    arrived = transport(FaultSpec(freeze=True, start=0.5, end=1.0), 200)
    assert [data for _, _, data in arrived] == [frame(49 if 50 <= k < 100 else k) for k in range(200)]
    assert checks(arrived)[CheckStatus.REPEATED] == 50


def test_stuck_value_under_a_live_counter_and_crc():
    arrived = transport(FaultSpec(stuck=True, start=0.5, end=1.0), 200)
    assert checks(arrived) == {CheckStatus.INITIAL: 1, CheckStatus.OK: 199}
    angles = [m.decode_steer_command(data, 0.0).command.steer_angle for _, _, data in arrived]
    assert set(angles[49:100]) == {angles[49]}
    assert len(set(angles[100:])) > 90


def test_flood_puts_foreign_frames_ahead():
    arrived = transport(FaultSpec(flood=5), 50)
    assert [frame_id == ID for _, frame_id, _ in arrived] == ([False] * 5 + [True]) * 50
    assert {frame_id for _, frame_id, _ in arrived}.isdisjoint({x.frame_id for x in messages().values()} - {ID})


def test_only_one_message_and_only_in_time():
    bus = FaultyBus(FaultSpec(loss=1.0, only="VEH_POS", start=0.1, end=0.2))
    for k in range(30):
        for name in ("VEH_POS", "VEH_DYN"):
            bus.send(k * CYCLE, messages()[name].frame_id, bytes(8))
        bus.send(k * CYCLE, 0x7FF, b"foreign")
    got = Counter(frame_id for frame_id, _ in bus.receive(math.inf))
    assert got == {messages()["VEH_DYN"].frame_id: 30, messages()["VEH_POS"].frame_id: 20, 0x7FF: 30}


# --- the actuator behind the faulty bus


def steer_through(spec, cycles=400):
    """Actuator behind a faulty bus: its states, its angles and what was asked."""
    bus, actuator, angle, states, angles, asked = FaultyBus(spec), Actuator(), 0.0, [], [], []
    for k in range(cycles):
        time = k * CYCLE
        bus.send(time, ID, frame(k))
        data = [got for frame_id, got in bus.receive(time) if frame_id == ID]
        angle = actuator.step(data, VehicleState(time, v_x=15.0, steer_angle=angle)).steer_angle
        states.append(actuator.state)
        angles.append(angle)
        asked.append(0.3 * math.sin(0.05 * k))
    return states, angles, asked


@pytest.mark.parametrize("spec", [FaultSpec(loss=0.05), FaultSpec(delay=0.05), FaultSpec(duplication=0.2)])
def test_harmless_faults(spec):
    states, angles, asked = steer_through(spec)
    assert ActuatorState.RAMP_TO_ZERO not in states
    late = round(spec.delay / CYCLE)
    error = max(abs(a - b) for a, b in zip(angles[20:], asked[20 - late :], strict=False))
    assert error <= 3 * 0.3 * 0.05 + 1e-3  # three cycles of the slalom's largest rate


@pytest.mark.parametrize("seed", range(20))
def test_a_fifth_lost_is_usable(seed):
    states, _, _ = steer_through(FaultSpec(seed=seed, loss=0.2))
    assert states.count(ActuatorState.RAMP_TO_ZERO) <= 0.1 * len(states)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("fault", [{"loss": 1.0}, {"loss": 0.5}, {"corruption": 0.5}, {"corruption": 1.0}])
def test_bad_bus_ends_in_safe_zero_steering(fault, seed):
    states, angles, _ = steer_through(FaultSpec(seed=seed, start=1.0, **fault), 600)
    assert states[-1] is ActuatorState.RAMP_TO_ZERO
    assert angles[-1] == 0.0


def test_frozen_sender_is_caught_within_50_ms_and_recovers():
    states, _, _ = steer_through(FaultSpec(freeze=True, start=1.0, end=2.0))
    first = states.index(ActuatorState.RAMP_TO_ZERO)
    assert 1.0 < first * CYCLE <= 1.0 + 0.05 + CYCLE
    again = states.index(ActuatorState.ACTIVE, first)
    assert again == 200 + 14  # one jump of the counter, then 14 good frames
    assert set(states[first:again]) == {ActuatorState.RAMP_TO_ZERO}
    assert set(states[again:]) == {ActuatorState.ACTIVE}


@pytest.mark.parametrize("seed", range(40))
def test_any_mixture_keeps_the_wheels_within_their_limits(seed):
    """Seeded mixtures of all faults: what is followed was sent, at the actuator's own pace."""
    share = [0.0, 0.02, 0.1, 0.3][seed % 4]
    spec = FaultSpec(
        seed=seed, loss=share, burst=1 + seed % 12, duplication=share, delay=0.01 * (seed % 6), jitter=0.03 * share,
        reorder=share, corruption=0.1 * share, wrong_length=share, masquerade=share, counter_jump=0.1 * share,
        freeze=seed % 7 == 3, stuck=seed % 7 == 5, flood=seed % 3, start=0.5, end=3.0,
    )  # fmt: skip
    states, angles, _ = steer_through(spec)
    assert all(abs(angle) <= m.MAX_ANGLE for angle in angles)
    assert all(abs(b - a) <= m.MAX_RATE_LIMIT * CYCLE + 1e-12 for a, b in itertools.pairwise(angles))
    assert set(states[340:]) == {ActuatorState.ACTIVE}  # all is well again 0.4 s after the faults
