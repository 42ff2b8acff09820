"""The protected bits of our messages: CRC, counter, and what a receiver makes of a frame that is not intact."""

import itertools

import e2e.crc
import pytest
from support.can_port.own_messages import MESSAGES, by_name, safe_values

from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.database import load_dbc, messages
from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus, Receiver
from sidestep.plant_models.signals import Status, SteeringCommand


def crc8_h2f(data):
    """CRC-8/AUTOSAR bit by bit: polynomial 0x2F, start and final exclusive-or 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ (0x2F if crc & 0x80 else 0)
        crc &= 0xFF
    return crc ^ 0xFF


@pytest.mark.parametrize("protection", ["P02", "P05", "none"])
def test_reserved_bits_are_those_that_nothing_uses(protection):
    for name, message in messages(protection).items():
        full = message.encode({s.name: s.high * s.scale for s in message.signals}, 15)
        assert not int.from_bytes(full, "little") & message.reserved
        bits = sum(s.length for s in load_dbc(protection).get_message_by_name(name).signals)
        assert message.reserved.bit_count() == 8 * message.length - bits
    assert messages()["STEER_CMD"].reserved == 0
    assert messages()["VEH_POS"].reserved == 7 << 13


# --- protection


def test_crc_is_the_catalogued_one():
    assert e2e.crc.calculate_crc8_h2f(b"123456789") == crc8_h2f(b"123456789") == 0xDF


def test_frame_computed_by_hand():
    data = m.encode_steer_command(SteeringCommand(0.0, 0.1, 15.0, Status.DEGRADED), counter=5, rate_limit=0.5)
    # counter 5, mode 2, enable 1 | 2000 steps | 100 steps, 1500 steps << 10, status 1 << 24, answers what is not known
    payload = bytes([0x05 | 2 << 4 | 1 << 7, 0xD0, 0x07, 0x64, 0x70, 0x17, 0x01 | 63 << 2])
    data_id = bytes.fromhex("084b8ed1195c9fe22a6db0f33b7ec109")[5]
    assert data == bytes([crc8_h2f(payload + bytes([data_id]))]) + payload
    assert data[1:].hex() == "a5d007647017fd"


@by_name
def test_every_single_bit_flip_is_detected_at_every_counter(message):
    for counter, bit in itertools.product(range(16), range(8 * message.length)):
        data = bytearray(message.encode(safe_values(message), counter))
        data[bit // 8] ^= 1 << bit % 8
        assert message.profile.counter_of(data) is None


@by_name
def test_bursts_behind_the_counter_up_to_a_byte_are_detected(message):
    word = int.from_bytes(message.encode(safe_values(message), 3), "big")
    for burst in range(1, 256):
        for shift in range(8 * (message.length - 2) - 7):
            assert message.profile.counter_of((word ^ burst << shift).to_bytes(message.length, "big")) is None


def test_a_frame_under_the_wrong_identifier_is_detected():
    for sender, receiver in itertools.permutations(MESSAGES, 2):
        for counter in range(16):
            assert receiver.profile.counter_of(sender.encode(safe_values(sender), counter)) is None


def test_receiver_judges_by_the_step_of_the_counter():
    frames = [m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), counter) for counter in range(16)]
    expected = {0: "REPEATED", 1: "OK", 2: "OKSOMELOST", 3: "OKSOMELOST"}
    for last, step in itertools.product(range(16), range(16)):
        receiver = Receiver(m.STEER_CMD.profile, m.STEER_CMD.length)
        assert receiver.check(frames[last]) is CheckStatus.INITIAL
        assert receiver.check(frames[(last + step) % 16]).name == expected.get(step, "WRONGSEQUENCE")


def test_receiver_rejects_wrong_lengths_and_counts():
    receiver = Receiver(m.STEER_CMD.profile, m.STEER_CMD.length)
    data = m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), 0)
    for wrong in (b"", data[:1], data[:7], data + b"\0"):
        assert receiver.check(wrong) is CheckStatus.ERROR
    assert receiver.check(None) is CheckStatus.NONEWDATA
    assert receiver.check(data) is CheckStatus.INITIAL
    assert receiver.check(data) is CheckStatus.REPEATED
    assert receiver.counts == {
        CheckStatus.ERROR: 4,
        CheckStatus.NONEWDATA: 1,
        CheckStatus.INITIAL: 1,
        CheckStatus.REPEATED: 1,
    }


def test_a_corrupt_frame_does_not_move_the_counter():
    receiver = Receiver(m.STEER_CMD.profile, m.STEER_CMD.length)
    first, second = (m.encode_steer_command(SteeringCommand(0.0, 0.0, 0.0), counter) for counter in (0, 1))
    receiver.check(first)
    assert receiver.check(bytes([second[0] ^ 1]) + second[1:]) is CheckStatus.ERROR
    assert receiver.check(second) in ACCEPTED
