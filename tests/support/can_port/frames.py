"""Frames, commands and buses for the tests of the CAN port."""

import math
import socket

import can
import pytest

from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.codec.database import CYCLE
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status, SteeringCommand

GROUP = "239.74.163.2"


def message(frame_id=0x101, data=b"\1\2\3", **more):
    return can.Message(arbitration_id=frame_id, data=data, is_extended_id=False, **more)


@pytest.fixture
def multicast_spec():
    """A port that nobody uses; skips where the kernel keeps multicast from the loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        spec = f"udp_multicast:{GROUP}:{probe.getsockname()[1]}"
    try:
        with Bus(spec) as one, Bus(spec) as two:
            if not one.send(message()) or two.receive(1.0) is None:
                pytest.skip("multicast does not come back on this machine's interfaces")
    except InputError as error:
        pytest.skip(f"no multicast here: {error}")
    return spec


def slalom(count, start=0.0):
    return [
        SteeringCommand(
            start + k * CYCLE, 0.3 * math.sin(0.1 * k), 15.0 - 0.01 * k, Status(k % 3),
            acceleration=math.nan if k % 7 == 3 else 3.0 * math.cos(0.1 * k),
        )
        for k in range(count)
    ]  # fmt: skip


def assert_same_but_quantised(got, asked):
    assert got is not None
    assert abs(got.steer_angle - asked.steer_angle) <= 2.5e-5 * (1 + 1e-9)
    assert abs(got.target_speed - asked.target_speed) <= 0.005 * (1 + 1e-9)
    assert got.acceleration == pytest.approx(asked.acceleration, abs=0.0005 * (1 + 1e-9), nan_ok=True)
    assert (got.time, got.status) == (asked.time, asked.status)
