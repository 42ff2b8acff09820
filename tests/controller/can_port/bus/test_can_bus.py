"""Opening a bus, and what a bus may meet on the way."""

import os
import socket
import sys
from pathlib import Path

import can
import pytest
from support.can_port.frames import GROUP, message

from sidestep.controller.can_port.bus import bus as bus_module
from sidestep.controller.can_port.bus.bus import Bus, can_interfaces, resolve_spec
from sidestep.plant_models.errors import InputError

# --- specifications


def test_auto_takes_vcan_if_it_is_there(monkeypatch):
    monkeypatch.setattr(bus_module, "can_interfaces", lambda: ["vcan0"])
    assert resolve_spec("auto") == resolve_spec("auto", several_processes=True) == "socketcan:vcan0"


def test_auto_without_vcan(monkeypatch):
    monkeypatch.setattr(bus_module, "can_interfaces", lambda: ["can0", "vcan1"])
    first, second = resolve_spec("auto"), resolve_spec("auto")
    assert first != second
    assert {first.partition(":")[0], second.partition(":")[0]} == {"virtual"}
    shared = resolve_spec("auto", several_processes=True)
    assert shared == resolve_spec("auto", several_processes=True)
    assert shared.startswith(f"udp_multicast:{GROUP}:")


@pytest.mark.parametrize("spec", ["off", "virtual:mine", "socketcan:vcan3"])
def test_everything_else_is_taken_as_it_is(spec):
    assert resolve_spec(spec) == spec


def test_unknown_interface():
    with pytest.raises(InputError, match=r"can: unknown interface 'carrier-pigeon' in 'carrier-pigeon:1'; allowed: "):
        Bus("carrier-pigeon:1")


@pytest.mark.parametrize("spec", ["Virtual:case", "VIRTUAL:case"])
def test_interface_names_without_regard_to_case(spec):
    with Bus(spec) as one, Bus("virtual:case") as two:
        one.send(message())
        assert len(two.drain()) == 1


@pytest.mark.parametrize("spec", ["virtual", "virtual:", "socketcan"])
def test_missing_channel(spec):
    with pytest.raises(InputError, match="names no channel"):
        Bus(spec)


@pytest.mark.parametrize("channel", ["239.74.163.2", "10.0.0.1:43113", "nonsense:1", f"{GROUP}:0", f"{GROUP}:70000"])
def test_bad_multicast_address(channel):
    with pytest.raises(InputError, match="is no multicast group and port"):
        Bus(f"udp_multicast:{channel}")


def test_missing_vcan_names_what_is_there(monkeypatch):
    monkeypatch.setattr(bus_module, "can_interfaces", lambda: ["can0", "vcan7"])
    with pytest.raises(InputError, match=r"no CAN interface 'vcan0' on this machine \(there are: can0, vcan7\)"):
        Bus("socketcan:vcan0")


@pytest.mark.parametrize("spec", ["socketcan:can0", "socketcan:vcan9", "slcan:/dev/ttyUSB0", "pcan:PCAN_USBBUS1"])
def test_real_hardware_is_refused(spec, monkeypatch):
    monkeypatch.setattr(bus_module, "can_interfaces", lambda: ["can0", "vcan9"])  # vcan9: a real one, renamed
    with pytest.raises(InputError, match=r"may move real hardware.*--allow-real-bus"):
        Bus(spec)


def test_real_hardware_when_allowed_fails_in_one_line():
    with pytest.raises(InputError, match=r"cannot open 'slcan:/dev/does-not-exist'") as caught:
        Bus("slcan:/dev/does-not-exist", allow_real_bus=True)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(sys.platform != "linux", reason="sysfs is Linux's")
def test_interfaces_of_this_machine_are_can_interfaces():
    assert "lo" not in can_interfaces()
    assert all(Path("/sys/class/net", name).exists() for name in can_interfaces())


def test_configuration_in_the_home_directory_does_not_leak_in(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    (tmp_path / "can.conf").write_text("[default]\nreceive_own_messages = True\n")
    with Bus("virtual:leak") as bus:
        bus.send(message())
        assert bus.receive() is None


# --- traffic


def test_virtual_buses_of_one_name_hear_each_other_and_no_one_else():
    with Bus("virtual:a") as sender, Bus("virtual:a") as listener, Bus("virtual:b") as stranger:
        assert sender.send(message(data=b"\7"))
        got = listener.receive()
        assert got is not None
        assert (got.arbitration_id, bytes(got.data)) == (0x101, b"\7")
        assert listener.receive() is stranger.receive() is sender.receive() is None


def test_drain_hands_out_everything_in_order():
    with Bus("virtual:a") as sender, Bus("virtual:a") as listener:
        for k in range(300):
            sender.send(message(data=bytes([k % 256])))
        assert [got.data[0] for got in listener.drain()] == [k % 256 for k in range(300)]
        assert listener.drain() == []


def test_own_identifiers_errors_and_foreign_formats_are_passed_over():
    with Bus("virtual:a") as sender, Bus("virtual:a", own_ids=[0x101]) as listener:
        sender.send(message(0x101))
        sender.send(can.Message(arbitration_id=0x102, is_extended_id=True))
        sender.send(can.Message(arbitration_id=0x102, is_extended_id=False, is_remote_frame=True))
        sender.send(can.Message(is_error_frame=True))
        sender.send(message(0x102))
        assert [got.arbitration_id for got in listener.drain()] == [0x102]


def test_echo():
    with Bus("virtual:a", echo=True) as bus:
        bus.send(message())
        assert len(bus.drain()) == 1


def test_a_send_error_is_counted_not_raised(monkeypatch):
    with Bus("virtual:a") as bus:
        for error in (can.CanOperationError("No buffer space available", 105), OSError("Network is down")):

            def refuse(_message, timeout=None, error=error):
                raise error

            monkeypatch.setattr(bus._bus, "send", refuse)
            assert bus.send(message()) is False
        assert bus.errors == 2


def test_a_bus_that_only_yields_errors_does_not_hang_the_receiver(monkeypatch):
    with Bus("virtual:a") as bus:

        def refuse(_timeout):
            raise can.CanOperationError("Network is down")

        monkeypatch.setattr(bus._bus, "recv", refuse)
        assert bus.receive(0.01) is None
        assert bus.drain() == []
        assert bus.errors > 0


def test_multicast_between_two_buses(multicast_spec):
    with Bus(multicast_spec) as one, Bus(multicast_spec, own_ids=[0x201]) as two:
        one.send(message(0x101, b"\1"))
        two.send(message(0x201, b"\2"))
        got = two.receive(1.0)
        assert got is not None
        assert (got.arbitration_id, bytes(got.data)) == (0x101, b"\1")
        assert two.receive(0.05) is None


def test_multicast_survives_garbage_and_other_groups(multicast_spec):
    port = int(multicast_spec.rpartition(":")[2])
    other = f"udp_multicast:239.74.163.3:{port}"
    with Bus(multicast_spec) as one, Bus(multicast_spec) as two, Bus(other) as stranger:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vandal:
            for garbage in (b"", b"\xc1", b"not msgpack", os.urandom(200), b"\x81\xa1x\x01"):
                vandal.sendto(garbage, (GROUP, port))
        stranger.send(message(0x7FF))
        one.send(message(0x101))
        got = two.receive(1.0)
        assert got is not None
        assert got.arbitration_id == 0x101
        assert two.errors == 5
        assert two.receive(0.05) is None


def test_multicast_buffer_holds_a_flood(multicast_spec):
    with Bus(multicast_spec) as one, Bus(multicast_spec) as two:
        for k in range(1000):
            one.send(message(0x101, k.to_bytes(2, "big")))
        assert [int.from_bytes(got.data, "big") for got in two.drain()] == list(range(1000))
