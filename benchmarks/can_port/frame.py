"""What a steering command costs from encoding to decoding on python-can's virtual bus, stage by stage.

    python benchmarks/can_port/frame.py

Stages are measured in turn, over and over, and the quietest round of each counts: only the ratios hold on a busy
machine. "by hand" is the same with cantools' encode and decode around the same CRC and bus.
"""

import gc
from collections.abc import Callable
from time import perf_counter_ns

import can
import numpy as np
from rich.console import Console
from rich.table import Table

from sidestep.controller.can_port.codec.database import load_dbc
from sidestep.controller.can_port.codec.messages import STEER_CMD, decode_steer_command, encode_steer_command
from sidestep.controller.can_port.port import SteeringPort
from sidestep.controller.can_port.protection.e2e import Receiver
from sidestep.plant_models.signals import SteeringCommand

ROUNDS, COUNT = 12, 2000
COMMANDS = [SteeringCommand(0.01 * k, 0.3 * (k % 100) / 100.0, 15.0) for k in range(COUNT)]
FRAMES = [encode_steer_command(command, k) for k, command in enumerate(COMMANDS)]


def stages(port: SteeringPort, bus: can.BusABC) -> dict[str, Callable[[int], object]]:
    """What is measured, by name; each is called with 0, 1, 2, ..."""
    receiver, dbc = Receiver(STEER_CMD.profile, STEER_CMD.length), load_dbc().get_message_by_name("STEER_CMD")
    ready = can.Message(arbitration_id=STEER_CMD.frame_id, data=FRAMES[0], is_extended_id=False)
    values = dbc.decode(FRAMES[0], decode_choices=False)
    assert isinstance(values, dict)

    def bare(_: int) -> object:
        bus.send(ready)
        return bus.recv(0.1)

    def by_hand(k: int) -> object:
        data = bytearray(dbc.encode(values | {"SteerCmd_Angle": COMMANDS[k].steer_angle}))
        STEER_CMD.profile.protect(data, k % 16)
        bus.send(can.Message(arbitration_id=STEER_CMD.frame_id, data=data, is_extended_id=False))
        got = bus.recv(0.1)
        assert got is not None
        receiver.check(got.data)
        return dbc.decode(bytes(got.data))

    return {
        "all, as `SteeringPort.transmit`": lambda k: port.transmit(COMMANDS[k]),
        "  encode and protect": lambda k: encode_steer_command(COMMANDS[k], k),
        "  send and receive: python-can's own share": bare,
        "  check": lambda k: receiver.check(FRAMES[k]),
        "  decode": lambda k: decode_steer_command(FRAMES[k], 0.0),
        "by hand": by_hand,
    }


def median_us(stage: Callable[[int], object]) -> float:
    times = np.empty(COUNT)
    for k in range(COUNT):
        began = perf_counter_ns()
        stage(k)
        times[k] = perf_counter_ns() - began
    return 1e-3 * float(np.median(times))


def main() -> None:
    gc.disable()
    with (
        SteeringPort("virtual:frame") as port,
        can.Bus(interface="virtual", channel="bare", receive_own_messages=True, ignore_config=True) as bus,
    ):
        measured = stages(port, bus)
        rounds = [{name: median_us(stage) for name, stage in measured.items()} for _ in range(ROUNDS)]
    best = {name: min(times[name] for times in rounds) for name in measured}
    bare = next(time for name, time in best.items() if "python-can" in name)
    table = Table("one frame", "µs", "of python-can's share")
    for name, time in best.items():
        table.add_row(name, f"{time:.1f}", f"{time / bare:.2f}")
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
