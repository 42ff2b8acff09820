"""The bus on Linux' own CAN stack; run with `tools/vcanbox.py -- python -m pytest -m vcan`."""

import math
import os
import shutil
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import can
import pytest
from support.can_port.frames import assert_same_but_quantised, slalom

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.bus.bus import Bus, can_interfaces, resolve_spec
from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.controller.can_port.bus.pacing import Pacer
from sidestep.controller.can_port.codec.database import load_dbc, messages
from sidestep.controller.can_port.codec.messages import ActuatorState, encode_steer_command
from sidestep.controller.can_port.port import SteeringPort
from sidestep.controller.can_port.protection.e2e import CheckStatus
from sidestep.plant_models.signals import SteeringCommand, VehicleState

VCAN = "socketcan:vcan0"

pytestmark = [
    pytest.mark.vcan,
    pytest.mark.skipif(
        "vcan0" not in can_interfaces() and "VCANBOX" not in os.environ,
        reason="no vcan0 here; tools/vcanbox.py has one",
    ),
]


def message(data=b"\1"):
    return can.Message(arbitration_id=0x123, data=data, is_extended_id=False)


def ip(*arguments):
    subprocess.run(["ip", "link", "set", "vcan0", *arguments], check=True)


@contextmanager
def netem(*arguments):
    subprocess.run(["tc", "qdisc", "add", "dev", "vcan0", "root", "netem", *arguments], check=True)
    try:
        yield
    finally:
        subprocess.run(["tc", "qdisc", "del", "dev", "vcan0", "root"], check=True)


@pytest.fixture
def candump(tmp_path):
    """can-utils' candump, listening; the result is what it has printed by then."""
    program = shutil.which("candump")
    assert program, "can-utils is part of the vcan tests"
    log = tmp_path / "candump"
    with log.open("wb") as output, subprocess.Popen([program, "-L", "vcan0"], stdout=output) as process:
        time.sleep(0.3)

        def printed(count):
            deadline = time.monotonic() + 5.0
            while len(lines := log.read_text().splitlines()) < count and time.monotonic() < deadline:
                time.sleep(0.02)
            return lines

        yield printed
        process.terminate()


def test_auto_is_vcan0():
    assert resolve_spec("auto") == VCAN


@pytest.mark.parametrize("protection", ["P02", "P05"])
def test_every_command_crosses_the_kernel(protection, tmp_path):
    commands = slalom(300)
    with SteeringPort(VCAN, tmp_path / "can.blf", message=messages(protection)["STEER_CMD"]) as port:
        for command in commands:
            assert_same_but_quantised(port.transmit(command), command)
        assert (port.interface, port.sent, port.lost) == (VCAN, 300, 0)
        assert port.receiver.counts == {CheckStatus.INITIAL: 1, CheckStatus.OK: 299}
    with can.BLFReader(tmp_path / "can.blf") as log:
        frames = list(log)
        times = {frame_id: [f.timestamp for f in frames if f.arbitration_id == frame_id] for frame_id in (0x101, 0x103)}
        assert times[0x101] == times[0x103] == pytest.approx([command.time for command in commands], abs=2e-9)


def test_candump_shows_the_commands(candump):
    commands = slalom(100)
    with SteeringPort(VCAN) as port:
        for command in commands:
            port.transmit(command)
    dbc = load_dbc().get_message_by_name("STEER_CMD")
    frames = [line.split()[2].split("#") for line in candump(200)]
    assert [frame_id for frame_id, _ in frames] == 100 * ["103", "101"]
    angles = [dbc.decode(bytes.fromhex(data))["SteerCmd_Angle"] for frame_id, data in frames if frame_id == "101"]
    assert angles == pytest.approx([command.steer_angle for command in commands], abs=2.6e-5)


def test_two_processes_hear_each_other():
    code = (
        "from sidestep.controller.can_port.bus.bus import Bus\n"
        f"with Bus({VCAN!r}) as bus:\n"
        "    got = bus.receive(10.0)\n"
        "    got.arbitration_id += 1\n"
        "    assert bus.send(got)\n"
    )
    with Bus(VCAN) as bus, subprocess.Popen([sys.executable, "-c", code]) as other:
        answer = None
        while answer is None and other.poll() is None:
            bus.send(message(b"\7"))
            answer = bus.receive(0.1)
        assert answer is not None
        assert (answer.arbitration_id, bytes(answer.data)) == (0x124, b"\7")
        assert other.wait(10.0) == 0


def test_receive_buffer_holds_a_flood():
    with Bus(VCAN) as sender, Bus(VCAN) as listener:
        for k in range(3000):
            while not sender.send(message(k.to_bytes(2, "big"))):
                time.sleep(0.001)
        assert [int.from_bytes(got.data, "big") for got in listener.drain()] == list(range(3000))


def test_a_full_queue_is_counted_not_raised():
    with Bus(VCAN) as sender, Bus(VCAN) as listener:
        with netem("rate", "100kbit", "limit", "10"):
            taken = [sender.send(message()) for _ in range(100)]
            assert False in taken
            assert sender.errors == taken.count(False)
            time.sleep(0.3)
        assert len(listener.drain()) >= 10
        assert sender.send(message())


def test_interface_down_and_up():
    commands = slalom(30)
    with SteeringPort(VCAN) as port:
        for command in commands[:10]:
            port.transmit(command)
        ip("down")
        try:
            for command in commands[10:13]:
                assert_same_but_quantised(port.transmit(command), commands[9])
        finally:
            ip("up")
        assert (port.sent, port.lost) == (10, 3)
        # four counts on is one too many to go unnoticed: one more command is held back, then all is well
        assert_same_but_quantised(port.transmit(commands[13]), commands[9])
        for command in commands[14:]:
            assert_same_but_quantised(port.transmit(command), command)
        assert port.lost == 4


@pytest.mark.parametrize("spec", [FaultSpec(delay=0.02, jitter=0.01), FaultSpec(reorder=0.2)])
def test_delay_and_reordering_are_netem_s_too(spec):
    with Bus(VCAN) as sender, Bus(VCAN) as listener, netem(*spec.netem_arguments()):
        sent, arrived = {}, {}
        for k in range(40):
            sent[k] = time.monotonic()
            sender.send(message(bytes([k])))
            while got := listener.receive(0.01):
                arrived[got.data[0]] = time.monotonic()
        while got := listener.receive(0.2):
            arrived[got.data[0]] = time.monotonic()
    late = sorted(arrived[k] - sent[k] for k in range(40))
    assert late[-1] >= 0.02
    assert (late[0] >= 0.02 - 1e-3) == (spec.delay > 0.0)


@pytest.mark.parametrize("fault", ["loss", "corruption", "duplication"])
def test_faults_of_the_kernel_never_reach_the_plant(fault):
    commands = slalom(60)
    asked = [command.steer_angle for command in commands]
    with SteeringPort(VCAN) as port:
        with netem(*FaultSpec(**{fault: 0.2}).netem_arguments()):
            got = [port.transmit(command) for command in commands]
        applied = [command for command in got if command is not None]
        assert all(min(abs(command.steer_angle - angle) for angle in asked) <= 2.6e-5 for command in applied)
        assert {
            "loss": port.lost > 0,
            "corruption": port.receiver.counts[CheckStatus.ERROR] > 0,
            "duplication": port.receiver.counts[CheckStatus.REPEATED] > 0 and port.lost == 0,
        }[fault]


# --- the actuator on a bad bus


@pytest.mark.parametrize(
    "fault",
    [["loss", "20%"], ["delay", "30ms", "reorder", "80%"], ["corrupt", "10%"], ["rate", "8kbit", "limit", "5"], None],
    ids=["loss", "reorder", "corrupt", "ENOBUFS", "down"],
)
def test_the_actuator_behaves_as_its_table_says_on_a_bad_bus(fault):
    """A sender, an actuator whose wheels follow at once, and the kernel's faults between them for a second."""
    actuator, pacer, states, ages, angle, heard = Actuator(), Pacer(0.01), [], [], 0.0, None
    with Bus(VCAN) as sender, Bus(VCAN) as listener, ExitStack() as faults:
        for k in range(350):
            now = pacer.wait()
            if k == 100:
                faults.enter_context(netem(*fault)) if fault else ip("down")
            if k == 200:
                faults.close() if fault else ip("up")
            command = SteeringCommand(now, 0.2 * math.sin(0.02 * k), 15.0)
            sender.send(frame_of(encode_steer_command(command, k)))
            before = actuator.asked
            arrived = [bytes(got.data) for got in listener.drain()]
            angle = actuator.step(arrived, VehicleState(now, v_x=15.0, steer_angle=angle)).steer_angle
            heard = now if actuator.asked is not before else heard
            states.append(actuator.state)
            ages.append(math.inf if heard is None else now - heard)
    assert set(states[30:100]) == {ActuatorState.ACTIVE}
    assert ActuatorState.FAULT not in states
    assert set(states[260:]) == {ActuatorState.ACTIVE}  # and comes back
    table = {ActuatorState.ACTIVE: (0.0, 0.025), ActuatorState.HOLD: (0.025, 0.05),
             ActuatorState.RAMP_TO_ZERO: (0.05, math.inf)}  # fmt: skip
    for state, age in list(zip(states, ages, strict=True))[30:]:
        low, high = table[state]
        assert low - 1e-6 <= age <= high + 1e-6
    if fault is None:
        assert set(states[110:200]) == {ActuatorState.RAMP_TO_ZERO}
        assert sender.errors > 0
    if fault and "rate" in fault:
        assert sender.errors > 0


def frame_of(data):
    return can.Message(arbitration_id=0x101, data=data, is_extended_id=False)
