"""Protection profiles and the E2E state machine, transition by transition."""

import e2e.crc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec import samples
from sidestep.controller.can_port.codec.database import load_dbc, messages
from sidestep.controller.can_port.protection.e2e import CheckStatus, Profile2, Profile5, Receiver, Unprotected
from sidestep.controller.can_port.protection.e2e_state import E2EState, E2EStateMachine, StateConfig
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState

OK, LOST, REPEATED, SEQUENCE, ERROR, NONEW, INITIAL = (
    CheckStatus.OK, CheckStatus.OKSOMELOST, CheckStatus.REPEATED, CheckStatus.WRONGSEQUENCE,
    CheckStatus.ERROR, CheckStatus.NONEWDATA, CheckStatus.INITIAL,
)  # fmt: skip
NODATA, INIT, VALID, INVALID = E2EState.NODATA, E2EState.INIT, E2EState.VALID, E2EState.INVALID


def crc16_ccitt(data):
    """CRC-16-CCITT-FALSE bit by bit: polynomial 0x1021, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x1021 if crc & 0x8000 else 0)
        crc &= 0xFFFF
    return crc


# --- profiles


def test_profile_2_is_the_library_authors_published_vector():
    for ids, payload, counter, frame in (
        (bytes(16), bytes(8), 1, "4501000000000000"),
        (bytes(range(16)), bytes(range(8)), 2, "bc02020304050607"),
        (bytes(range(16)), bytes(range(8)), 1, "6101020304050607"),
    ):
        data = bytearray(payload)
        Profile2(ids).protect(data, counter)
        assert data.hex() == frame
        assert Profile2(ids).counter_of(data) == counter


def test_profile_5_is_the_autosar_example():
    data = bytearray(8)
    Profile5(0x1234).protect(data, 0)
    assert data.hex() == "1cca000000000000"
    assert e2e.crc.calculate_crc16(b"123456789") == crc16_ccitt(b"123456789") == 0x29B1
    data[3:] = b"abcde"
    Profile5(0x1234).protect(data, 200)
    assert int.from_bytes(data[:2], "little") == crc16_ccitt(bytes([200]) + b"abcde\x34\x12")


@given(st.binary(min_size=12, max_size=12), st.integers(0, 0xFFFF), st.integers(0, 255), st.integers(0, 95))
def test_profile_5_detects_every_bit_flip(payload, data_id, counter, bit):
    data = bytearray(payload)
    profile = Profile5(data_id)
    profile.protect(data, counter)
    assert profile.counter_of(data) == counter
    assert Profile5(data_id ^ 1).counter_of(data) is None
    data[bit // 8] ^= 1 << bit % 8
    assert profile.counter_of(data) is None


@pytest.mark.parametrize(("protection", "counters"), [("P02", 16), ("P05", 256), ("none", 1)])
def test_cantools_reads_every_protection_alike(protection, counters):
    commands = messages(protection)["STEER_CMD"]
    assert commands.is_fd == (protection == "P05")
    for counter in (0, 15, 16, 255, 256):
        data = m.encode_steer_command(SteeringCommand(0.0, -0.7, 12.5), counter, rate_limit=0.4, message=commands)
        assert len(data) == commands.length
        theirs = load_dbc(protection).get_message_by_name("STEER_CMD").decode(data, decode_choices=False)
        assert theirs["SteerCmd_Counter"] == counter % counters
        assert protection != "none" or theirs["SteerCmd_CRC"] == 0
        assert theirs["SteerCmd_Angle"] == pytest.approx(-0.7)
        assert m.decode_steer_command(data, 0.0, commands).command == SteeringCommand(
            0.0, pytest.approx(-0.7), pytest.approx(12.5)
        )


@pytest.mark.parametrize("protection", ["P02", "P05", "none"])
def test_every_protection_carries_every_message(protection):
    catalogue = messages(protection)
    sample = [catalogue[x.name] for x in samples.VEHICLE_STATE]
    state = VehicleState(0.0, 12.0, -3.0, 0.1, 15.0, 0.2, 0.3, 0.0)
    got = samples.decode_vehicle_state(samples.encode_vehicle_state(state, 4.0, 0, sample=sample), 0.0, sample=sample)
    assert got is not None
    assert (got.x, got.y, got.v_x) == pytest.approx((12.0, -3.0, 15.0))
    eps = m.SteerStatus(m.ActuatorState.HOLD, 0.1, 0.2, VALID, 7)
    frame = m.encode_steer_status(eps, 0, catalogue["STEER_STATUS"])
    assert m.decode_steer_status(frame, catalogue["STEER_STATUS"]).state is m.ActuatorState.HOLD
    report = m.ControllerStatus(m.QpStatus.SOLVED, m.Status.TRACKING, m.SteerMode.ANGLE, 1e-4, 0.0, 9)
    frame = m.encode_controller_status(report, 0, catalogue["CTRL_STATUS"])
    assert m.decode_controller_status(frame, catalogue["CTRL_STATUS"]).iterations == 9


def test_fd_export_keeps_frame_format_and_data_ids():
    text = load_dbc("P05").as_dbc_string()
    assert 'BA_ "VFrameFormat" BO_ 257 14;' in text
    assert 'BA_ "E2EDataIDs" BO_ 257 "0101";' in text
    assert len({messages("P05")[name].profile for name in messages()}) == len(messages())


@pytest.mark.parametrize(("protection", "number", "length"), [("P02", 1, 8), ("P05", 2, 12), ("none", 0, 8)])
def test_the_database_says_which_protection_it_describes(protection, number, length):
    for message in load_dbc(protection).messages:
        if message.name not in messages():
            continue
        assert (message.dbc.attributes["E2EProfile"].value, message.length) == (number, length)
        assert message.is_fd == (protection == "P05")
        assert message.dbc.attributes["VFrameFormat"].value == (14 if message.is_fd else 0)
        if protection != "P02":
            given = "" if protection == "none" else f"{message.frame_id:04x}"
            assert message.dbc.attributes["E2EDataIDs"].value == given
        for signal in message.signals:  # of the header: every number that fits
            if signal.name.endswith(("_CRC", "_Counter")):
                assert (signal.minimum, signal.maximum) == (0, (1 << signal.length) - 1)
    assert {message.length for message in messages(protection).values()} == {length}


def test_profiles_are_values():
    assert len({Profile2(bytes(16)), Profile2(bytes(16)), Profile5(1), Unprotected(), Unprotected()}) == 3
    assert Unprotected().counter_of(b"anything") == 0


def test_without_protection_only_the_length_counts():
    receiver = Receiver(Unprotected(), 8)
    assert [receiver.check(data) for data in (bytes(8), bytes(8), bytes(7), None)] == [OK, OK, ERROR, NONEW]


@pytest.mark.parametrize("max_delta", [1, 2, 14])
def test_largest_tolerated_gap(max_delta):
    profile = m.STEER_CMD.profile
    frames = [m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), counter) for counter in range(16)]
    for step, expected in ((max_delta, OK if max_delta == 1 else LOST), (max_delta + 1, SEQUENCE)):
        receiver = Receiver(profile, 8, max_delta)
        receiver.check(frames[0])
        assert receiver.check(frames[step]) is expected


# --- state machine


def machine(**more):
    return E2EStateMachine(
        init=StateConfig(3, 2, 1), valid=StateConfig(4, 1, 2), invalid=StateConfig(5, 3, 1), **more
    )  # fmt: skip


def run(states, checks):
    return [states.add(check) for check in checks]


def test_nodata_waits_for_anything_intact():
    for first in CheckStatus:
        expected = NODATA if first in (ERROR, NONEW) else INIT
        assert run(machine(), [ERROR, NONEW, first]) == [NODATA, NODATA, expected]


def test_the_check_that_ends_nodata_is_not_counted():
    assert run(machine(), [OK, OK, OK]) == [INIT, INIT, VALID]


def test_init_to_valid_needs_min_ok():
    assert run(machine(), [INITIAL, OK, REPEATED, LOST]) == [INIT, INIT, INIT, VALID]
    assert run(machine(), [INITIAL, OK, NONEW, NONEW, OK, SEQUENCE, OK]) == [INIT] * 6 + [VALID]  # the first OK is out


def test_init_tolerates_max_error():
    assert run(machine(), [INITIAL, ERROR, OK, OK]) == [INIT, INIT, INIT, VALID]
    assert run(machine(), [INITIAL, ERROR, ERROR]) == [INIT, INIT, INVALID]
    assert run(machine(), [INITIAL, ERROR, NONEW, NONEW, ERROR]) == [INIT] * 5  # three checks apart: never both inside


def valid_machine(**more):
    states = machine(**more)
    assert run(states, [OK, OK, OK])[-1] is VALID
    return states


def test_valid_stays_on_errors_up_to_the_limit():
    assert run(valid_machine(), [ERROR, ERROR, OK, OK, ERROR, ERROR]) == [VALID] * 6
    assert run(valid_machine(), [ERROR, ERROR, ERROR]) == [VALID, VALID, INVALID]


@pytest.mark.parametrize("silence", [NONEW, REPEATED, SEQUENCE, INITIAL])
def test_valid_ends_when_nothing_ok_is_left_in_the_window(silence):
    assert run(valid_machine(), [silence] * 4) == [VALID, VALID, VALID, INVALID]
    assert run(valid_machine(), [silence, silence, silence, OK, *[silence] * 4]) == [VALID] * 7 + [INVALID]


def test_invalid_recovers_with_enough_ok_and_few_errors():
    states = valid_machine()
    run(states, [ERROR, ERROR, ERROR])
    # kept from before: OK (one of two slid out), three ERROR; five checks count
    assert run(states, [OK, OK, OK, OK]) == [INVALID, INVALID, INVALID, VALID]


def test_invalid_stays_with_too_few_ok():
    states = valid_machine()
    run(states, [NONEW] * 4)
    assert run(states, [OK, NONEW, NONEW, OK, NONEW, OK, NONEW, OK]) == [INVALID] * 7 + [VALID]


def test_clear_to_invalid_forgets_the_past():
    kept, cleared = valid_machine(), valid_machine(clear_to_invalid=True)
    run(kept, [ERROR] * 3)
    run(cleared, [ERROR] * 3)
    assert run(kept, [OK] * 3) == [INVALID] * 3
    assert run(cleared, [OK] * 3) == [INVALID, INVALID, VALID]


def test_a_larger_window_starts_with_the_checks_of_the_smaller_one_only():
    states = E2EStateMachine(init=StateConfig(2, 2, 0), valid=StateConfig(4, 1, 0), invalid=StateConfig(4, 1, 0))
    # the error is out of INIT's window when it turns valid, and must not come back with VALID's larger one
    assert run(states, [INITIAL, OK, OK, OK]) == [INIT, INIT, VALID, VALID]
    states = E2EStateMachine(init=StateConfig(2, 2, 1), valid=StateConfig(4, 1, 0), invalid=StateConfig(4, 1, 0))
    assert run(states, [INITIAL, ERROR, OK, OK, OK]) == [INIT, INIT, INIT, VALID, VALID]


@given(st.lists(st.sampled_from(CheckStatus), max_size=60))
def test_state_follows_from_the_window_alone(checks):
    """Against the specification's words, counted afresh for every check."""
    states = machine()
    config = {INIT: states.init, VALID: states.valid, INVALID: states.invalid}
    expected, history = NODATA, []
    for check in checks:
        if expected is NODATA:
            expected = NODATA if check in (ERROR, NONEW) else INIT
        else:
            c = config[expected]
            history = [*history, check][-c.window :]
            errors, good = history.count(ERROR), history.count(OK) + history.count(LOST)
            if errors <= c.max_error and good >= c.min_ok:
                expected = VALID
            elif expected is VALID or (expected is INIT and errors > c.max_error):
                expected = INVALID
            history = history[-config[expected].window :]
        assert states.add(check) is expected


@pytest.mark.parametrize("bad", [(0, 1, 0), (3, 0, 0), (3, 4, 0), (3, 1, -1), (3, 1, 4)])
def test_impossible_thresholds_are_refused(bad):
    with pytest.raises(InputError, match="1 <= min_ok <= window, 0 <= max_error <= window"):
        StateConfig(*bad)


def test_frozen_sender_is_caught_as_soon_as_too_few_good_frames_are_left():
    receiver, states = Receiver(m.STEER_CMD.profile, 8), E2EStateMachine()
    frames = [m.encode_steer_command(SteeringCommand(0.0, 0.1, 15.0), k) for k in range(20)]
    assert [states.add(receiver.check(frame)) for frame in frames][-1] is VALID
    seen = [states.add(receiver.check(frames[-1])) for _ in range(20)]
    assert seen.index(INVALID) == states.valid.window - states.valid.min_ok


def counted(checks, wanted, start=()):
    """How many of `checks` it takes a machine with the default thresholds, after `start`, to be `wanted`."""
    states = E2EStateMachine()
    run(states, [INITIAL, *start])
    return run(states, checks).index(wanted) + 1


def test_default_thresholds_on_both_sides():
    assert counted([OK] * 20, VALID) == 8
    assert counted([OK] * 20, VALID, [ERROR] * 6) == 8
    assert counted([ERROR] * 20, INVALID) == 7
    assert counted([ERROR] * 20, INVALID, [OK] * 16) == 7
    assert counted([NONEW] * 20, INVALID, [OK] * 16) == 9  # seven OK of sixteen are left
    assert counted([NONEW] * 20, INVALID, [OK] * 8) == 16 - 8 + 1
    lost = [*[OK] * 16, *[NONEW] * 30]
    assert counted([OK] * 20, VALID, lost) == 14
    states = E2EStateMachine()
    run(states, [INITIAL, *lost])
    assert set(run(states, [ERROR, OK, OK, OK, OK] * 8)) == {INVALID}  # three errors in every sixteen
    assert (states.init, states.valid) == (StateConfig(16, 8, 6), StateConfig(16, 8, 6))
    assert states.invalid == StateConfig(16, 14, 2)


@pytest.mark.parametrize("good", [(3, 1, 0), (3, 3, 3), (1, 1, 1)])
def test_thresholds_at_their_limits_are_allowed(good):
    assert StateConfig(*good).window == good[0]


def test_a_machine_shows_its_state_not_its_window():
    assert "state=<E2EState.NODATA: 2>" in repr(E2EStateMachine())
    assert "deque" not in repr(E2EStateMachine())


def test_numbers_of_the_states_are_the_specification_s():
    assert [state.name for state in sorted(E2EState)] == ["VALID", "DEINIT", "NODATA", "INIT", "INVALID"]
    assert sorted(E2EState) == [0, 1, 2, 3, 4]
