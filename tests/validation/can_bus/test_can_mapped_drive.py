"""Drives over somebody else's messages: by mapping files alone, in virtual time, asked again, and within limits."""

import json
from dataclasses import replace

import can
import numpy as np
import pytest

from sidestep.controller.can_port.actuator import Actuator, ActuatorConfig
from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.bus.log import read_log
from sidestep.controller.can_port.codec.catalogue import mapped_bus
from sidestep.controller.can_port.codec.database import CYCLE
from sidestep.controller.can_port.codec.mapping import Limits
from sidestep.controller.can_port.codec.messages import encode_steer_command
from sidestep.controller.can_port.interface import Interface
from sidestep.controller.can_port.nodes import ControllerNode, VehicleNode
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.can_bus import drive as can_run
from sidestep.validation.can_bus.drive import drive_virtual
from sidestep.validation.can_bus.limits import within
from sidestep.validation.can_bus.monitor import Observer
from sidestep.validation.can_bus.replay import compare
from sidestep.validation.cli.main import main
from sidestep.validation.judge.findings import for_the_judge
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.report import report
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("double-obstacle", ["plant.kind=linear"])
WHEELBASE = SCENE.vehicle.l_f + SCENE.vehicle.l_r

OWN = """VERSION ""
BU_: A B
BO_ 2566834800 ASK: 8 A
 SG_ Angle : 7|16@0- (0.05,0) [-900|900] "deg" B
 SG_ On : 16|1@1+ (1,0) [0|1] "" B
 SG_ Counter : 24|4@1+ (1,0) [0|15] "" B
 SG_ Sum : 63|8@0+ (1,0) [0|255] "" B
BO_ 304 TELL: 8 B
 SG_ Wheel : 7|16@0- (0.05,0) [0|0] "deg" A
 SG_ Speed : 16|16@1+ (0.01,0) [0|655.35] "km/h" A
 SG_ Alive : 32|8@1+ (1,0) [0|255] "" A
BO_ 305 TURN: 8 B
 SG_ Yaw : 0|16@1- (0.005,0) [-160|160] "deg/s" A
"""

MAP = """dbc = "own.dbc"
[command]
message = "ASK"
cycle_ms = 20
angle = { signal = "Angle", ratio = 16.0, positive = "right" }
enable = [{ signal = "On" }]
counter = { signal = "Counter" }
checksum = { signal = "Sum", rule = "sum" }
[[feedback]]
message = "TELL"
angle = { signal = "Wheel", ratio = 16.0 }
speed = { signal = "Speed" }
counter = { signal = "Alive" }
[[feedback]]
message = "TURN"
cycle_ms = 30
yaw_rate = { signal = "Yaw" }
"""


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own.dbc").write_text(OWN)
    (tmp_path / "own.toml").write_text(MAP)
    return mapped_bus(str(tmp_path / "own.toml"), wheelbase=WHEELBASE)


def driven(bus, scenario=SCENE):
    """The drive, its judgement, and all frames of its bus."""
    frames = []

    class Witness(ControllerNode):
        def step(self, time, arrived):
            arrived = list(arrived)
            answer = super().step(time, arrived)
            for number, data in [*arrived, *answer]:
                extended = number > 0x7FF
                frames.append(can.Message(time + 1.0, number & 0x1FFFFFFF, extended, data=data, channel=0))
            return answer

    with pytest.MonkeyPatch.context() as patch, LinearPlant(scenario.vehicle) as plant:
        patch.setattr(can_run, "ControllerNode", Witness)
        run = drive_virtual(scenario, plant, None, bus)
    return run, judge(run.recording, scenario, for_the_judge(run.findings)), frames


@pytest.mark.parametrize("name", ["tesla", "ford", "pacmod3"])
@pytest.mark.parametrize("scene", ["single-obstacle", "double-obstacle"])
def test_both_scenes_by_three_makers_messages(name, scene):
    scenario = load_scenario(scene, ["plant.kind=linear"])
    bus = mapped_bus(name, wheelbase=WHEELBASE)
    run, judgement, frames = driven(bus, scenario)
    assert (judgement.verdict.value, judgement.findings) == ("pass", ())
    assert run.vehicle.actuator.blocked == 0
    assert bus.messages["STEER_CMD"].frame_id in {frame.arbitration_id for frame in frames}
    columns, missing = compare(frames, bare_controller(within(scenario, bus)), bus)
    assert np.all(columns["difference"] == 0.0)
    assert len(columns["time"]) > 50
    assert missing == 0


def test_angle_speed_and_yaw_rate_come_back_in_their_words(own):
    run, judgement, frames = driven(own)
    assert judgement.verdict.value == "pass"
    assert 0x102 not in {frame.arbitration_id for frame in frames}  # no STEER_STATUS of ours
    assert {0x130, 0x131, 2566834800 & 0x1FFFFFFF} <= {frame.arbitration_id for frame in frames}
    sample = run.controller.listener.sample.state
    assert sample.v_x == pytest.approx(15.0, abs=0.1)
    columns, _ = compare(frames, bare_controller(SCENE), own)
    assert np.all(columns["difference"] == 0.0)


@pytest.mark.parametrize("silent", [0x130, 0x131])
def test_a_message_of_theirs_that_is_missing_stops_the_steering(own, silent):
    vehicle, node = VehicleNode(own.messages), ControllerNode(bare_controller(SCENE), own.messages)
    enabled = []
    for k in range(120):
        _, frames = vehicle.step(VehicleState(k * CYCLE, x=15.0 * k * CYCLE, v_x=15.0), [])
        answer = node.step(k * CYCLE, [f for f in frames if k < 80 or f[0] != silent])
        enabled += [bool(data[2] & 1) for number, data in answer if number == own.messages["STEER_CMD"].frame_id]
    assert enabled[-1] is False
    assert any(enabled)


def test_what_the_interface_lets_pass():
    interface = Interface(Limits(angle=0.3, rate=0.5, lateral_acceleration=3.0, lateral_jerk=4.5), 3.0)
    assert interface.rate(15.0) == pytest.approx(0.06)
    assert interface.rate(2.0) == pytest.approx(0.5)
    assert interface.highest(15.0) == pytest.approx(np.arctan(0.04))
    assert interface.highest(0.0) == 0.3
    assert interface.limited(1.0, 0.01, 15.0, 0.1) == pytest.approx(0.016)
    assert interface.limited(-1.0, 0.01, 15.0, 0.1) == pytest.approx(0.004)
    assert interface.limited(1.0, 0.039, 15.0, 0.1) == interface.highest(15.0)
    assert Interface(Limits(), 3.0).limited(1.0, -1.0, 15.0, 0.01) == 1.0


def test_a_sender_that_does_not_know_the_interface_is_not_followed(monkeypatch):
    monkeypatch.setattr(can_run, "PATIENCE", 1.0)
    bus = mapped_bus("tesla", wheelbase=WHEELBASE)
    monkeypatch.setattr(can_run, "VehicleNode", lambda *a: VehicleNode(a[0], a[1], bus.interface))
    with LinearPlant(SCENE.vehicle) as plant, pytest.raises(InputError, match="blocked by the interface"):
        drive_virtual(SCENE, plant, None, replace(bus, interface=None))


def test_an_actuator_follows_what_passes_only():
    message = mapped_bus("pacmod3").messages["STEER_CMD"]
    actuator = Actuator(ActuatorConfig(), message, Interface(Limits(rate=0.2), 2.8))
    for k in range(90):
        angle = 0.0015 * min(max(k - 40, 0), 20) + 0.1 * (k == 75)
        data = encode_steer_command(SteeringCommand(0.0, angle, 15.0), k, True, 1.0, message)
        actuator.step([data] if k % 3 == 0 else [], VehicleState(k * CYCLE, v_x=15.0))
    assert actuator.blocked == 1
    assert actuator.asked.steer_angle == pytest.approx(0.03, abs=1e-3)


# --- command line


def test_run_steers_by_a_mapping_file(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "run_report", lambda run: "<!doctype html>")
    out = tmp_path / "out"
    assert main(["run", "single-obstacle", "--plant", "linear", "--map", "tesla", "--out", str(out)]) == 0
    frames = [frame for frame in read_log(out / "can.blf") if frame.channel == 0]
    assert {(frame.arbitration_id, frame.dlc) for frame in frames} == {(0x488, 4)}
    assert json.loads((out / "summary.json").read_text())["can"]["lost"] == 0


def test_monitor_knows_their_signals(own):
    observer = Observer(own)
    node = VehicleNode(own.messages)
    for k in range(30):
        for number, data in node.step(VehicleState(k * CYCLE, v_x=15.0), [])[1]:
            observer.add(number, data, k * CYCLE)
    cells = {column.header: list(column.cells) for column in observer.table().columns}
    row = cells["message"].index("TELL")
    assert cells["E2E"][row] == "VALID"
    assert "Speed 54 km/h" in cells["signals"][row]


def test_replay_sends_their_frames(own, tmp_path):
    _, _, frames = driven(own, replace(SCENE, duration=0.3))
    from sidestep.controller.can_port.bus.log import open_log
    from sidestep.validation.can_bus.replay import replay_as_plant

    with open_log(tmp_path / "a.blf") as log:
        for frame in frames[-100:]:
            log.on_message_received(frame)
    with Bus("virtual:their-replay") as bus, Bus("virtual:their-replay", everything=True) as listener:
        assert replay_as_plant(tmp_path / "a.blf", bus, own) > 0
        sent = {frame.arbitration_id for frame in listener.drain()}
    assert 0x130 in sent
    assert not sent & {0x101, 2566834800 & 0x1FFFFFFF}


def test_can_map_on_the_command_line(own, tmp_path, capsys):
    assert main(["can", "map", str(tmp_path / "own.dbc")]) == 0
    assert 'message = "ASK"' in capsys.readouterr().out
    assert main(["can", "map", str(tmp_path / "own.dbc"), "--out", str(tmp_path / "new.toml")]) == 0
    assert mapped_bus(str(tmp_path / "new.toml")).messages["STEER_CMD"].name == "ASK"
    assert main(["can", "map", "--list"]) == 0
    assert "tesla" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "words"), [
    (["can", "map"], "one thing at a time"),
    (["can", "map", "no.dbc"], "no.dbc: cannot be read"),
    (["can", "map", "no.xls"], "unknown kind of database '.xls'; allowed: .dbc"),
    (["run", "single-obstacle", "--map", "toyota"], "names no database; allowed: a file, or --dbc FILE"),
    (["run", "single-obstacle", "--dbc", "a.dbc"], "makes no difference without a mapping file"),
    (["run", "single-obstacle", "--map", "tesla", "--map", "ford"], "2 files of one kind"),
])  # fmt: skip
def test_bad_input_is_one_line(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
