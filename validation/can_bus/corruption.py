"""What becomes of corrupt steering frames: which check stops how many."""

import math
from collections import Counter
from dataclasses import dataclass
from random import Random

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.codec.database import CYCLE
from sidestep.controller.can_port.codec.messages import STEER_CMD, encode_steer_command
from sidestep.controller.can_port.protection.e2e import ACCEPTED
from sidestep.plant_models.signals import SteeringCommand, VehicleState

_SPEED, _ANGLE, _STEP = 15.0, 0.05, 0.001  # of the good commands around a corrupt one


@dataclass(frozen=True)
class Corruption:
    """What became of corrupt STEER_CMD frames.

    Attributes:
        frames: How many, each with a random set of its 64 bits flipped.
        passed_crc: Those whose CRC fitted by chance.
        by_counter: Of these, those that the counter stopped.
        by_plausibility: And those that reserved bits, mode, enable, angle or rate stopped.
        accepted: What is left.
    """

    frames: int
    passed_crc: int
    by_counter: int
    by_plausibility: int
    accepted: int

    def sentence(self) -> str:
        """All of it, in one sentence."""
        share, theory = self.passed_crc / self.frames, 1.0 / 256.0
        spread = math.sqrt(theory * (1.0 - theory) / self.frames)
        return (
            f"{self.frames} corrupt frames: CRC passed by chance {self.passed_crc} = {100.0 * share:.4f} % "
            f"(theory {100.0 * theory:.4f} %, standard deviation {100.0 * spread:.4f} %); of these "
            f"{self.by_counter} stopped by the counter, {self.by_plausibility} by plausibility; "
            f"accepted {self.accepted}"
        )


def corrupt(count: int, seed: int) -> Corruption:
    """Corrupt `count` frames; each that passes the CRC meets an actuator that is ACTIVE on an intact channel."""
    draw, counter_of = Random(f"corrupt {seed}"), STEER_CMD.profile.counter_of
    good = [int.from_bytes(_good(k), "little") for k in range(16)]
    passed = []
    for k in range(count):
        data = (good[k % 16] ^ (draw.getrandbits(64) or 1)).to_bytes(8, "little")
        if counter_of(data) is not None:
            passed.append((k % 16, data))
    fates = Counter(_fate(k, data) for k, data in passed)
    return Corruption(count, len(passed), fates["counter"], fates["plausibility"], fates["accepted"])


def _good(k: int) -> bytes:
    return encode_steer_command(SteeringCommand(0.0, _ANGLE + _STEP * (k % 16), _SPEED), k, rate_limit=0.4)


def _fate(place: int, data: bytes) -> str:
    """What stops a frame that comes in the place of the good one number `place`."""
    actuator = Actuator()
    for k in range(place, place + 16):
        actuator.step([_good(k)], VehicleState(k * CYCLE, v_x=_SPEED))
    before = sum(actuator.channel.receiver.counts[status] for status in ACCEPTED)
    now = (place + 16) * CYCLE
    actuator.step([data], VehicleState(now, v_x=_SPEED))
    if actuator.asked and math.isclose(actuator.asked.time, now):
        return "accepted"
    in_sequence = sum(actuator.channel.receiver.counts[status] for status in ACCEPTED) > before
    return "plausibility" if in_sequence else "counter"
