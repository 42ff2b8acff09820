"""What carries a node's frames: a bus in real time, or nothing at all in virtual time."""

from types import SimpleNamespace

import pytest

from sidestep.controller.can_port.bus.log import read_log
from sidestep.controller.can_port.link import RealTimeLink, VirtualTimeLink


def test_a_real_time_link_paces_sends_logs_and_hears_only_the_other_end(tmp_path):
    pair = (("virtual:link", ("CTRL",), None, tmp_path / "a.log"), ("virtual:link", ("EPS", "VEH"), None, None))
    with RealTimeLink(*pair[0]) as controller, RealTimeLink(*pair[1]) as vehicle:
        for k in range(5):
            controller.wait()
            controller.send([(0x101, bytes(8))])
            vehicle.send([(0x201, bytes([k] * 8))])
            assert controller.receive() == [(0x201, bytes([k] * 8))]
            assert vehicle.receive() == [(0x101, bytes(8))]
        figures = controller.statistics()
    assert (figures["sent"], figures["refused"], figures["interface"]) == (5, 0, "virtual:link")
    frames = list(read_log(tmp_path / "a.log"))
    assert [frame.arbitration_id for frame in frames] == [0x101, 0x201] * 5
    assert frames[-1].timestamp - frames[0].timestamp == pytest.approx(0.04, abs=0.03)


def test_frames_that_the_bus_refuses_are_counted(monkeypatch):
    with RealTimeLink("virtual:refuse", ("CTRL",)) as link:
        monkeypatch.setattr(link._bus, "send", lambda message: False)
        link.send([(0x101, bytes(8))] * 3)
        assert (link.sent, link.refused) == (0, 3)


def test_a_virtual_link_passes_half_a_cycle_on_each_side():
    seen = []
    node = SimpleNamespace(step=lambda time, frames: seen.append((time, list(frames))) or [(0x101, bytes(8))])
    link = VirtualTimeLink(node)
    assert link.wait() == 0.0
    assert link.receive() == [(0x101, bytes(8))]
    link.send([(0x201, bytes(8))])
    assert link.wait() == pytest.approx(0.01)
    assert seen == [(pytest.approx(-0.005), []), (pytest.approx(0.005), [(0x201, bytes(8))])]
