"""`sidestep can ...` in one process: database, monitor, logs, replay and faults."""

import json
from pathlib import Path

import can
import cantools.database
import pytest

from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.bus.candump import candump_line
from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.controller.can_port.bus.log import open_log, read_log
from sidestep.controller.can_port.codec.database import load_dbc
from sidestep.controller.can_port.codec.export import FORMATS, exported
from sidestep.controller.can_port.nodes import ControllerNode
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.validation.can_bus import drive as can_run
from sidestep.validation.can_bus import faults as can_campaign
from sidestep.validation.can_bus import replay as can_replay
from sidestep.validation.can_bus.corruption import corrupt
from sidestep.validation.can_bus.drive import drive_virtual
from sidestep.validation.can_bus.monitor import Observer, monitor
from sidestep.validation.cli.main import main
from sidestep.validation.scenarios.scenario import load_scenario

DOCS = Path(__file__).parents[3] / "docs"
SCENE = load_scenario("single-obstacle", ["plant.kind=linear", "duration=1.2"])


@pytest.fixture(scope="module")
def traffic():
    """All frames of a drive, both directions, as messages."""
    frames = []

    class Witness(ControllerNode):
        def step(self, time, arrived):
            arrived = list(arrived)
            answer = super().step(time, arrived)
            for frame_id, data in [*arrived, *answer]:
                frames.append(can.Message(time + 1.0, frame_id, is_extended_id=False, data=data, channel=0))
            return answer

    with pytest.MonkeyPatch.context() as patch, LinearPlant(SCENE.vehicle) as plant:
        patch.setattr(can_run, "ControllerNode", Witness)
        drive_virtual(SCENE, plant)
    return frames


@pytest.mark.parametrize("kind", FORMATS)
def test_the_database_is_printed_and_reads_back(kind, capsys):
    assert main(["can", "dbc", "--format", kind]) == 0
    text = capsys.readouterr().out
    assert text == exported(kind)
    names = [message.name for message in load_dbc().messages]
    if kind == "json":
        assert [message["name"] for message in json.loads(text)["messages"]] == names
    else:
        again = cantools.database.load_string(text, kind, strict=True)
        assert sorted(message.name for message in again.messages) == sorted(names)


def test_the_fd_database(capsys):
    assert main(["can", "dbc", "--format", "json", "--fd"]) == 0
    printed = json.loads(capsys.readouterr().out)["messages"]
    assert {m["length"] for m in printed if m["name"] != "STATE_EXACT"} == {12}


@pytest.mark.parametrize("ending", [".blf", ".asc", ".log", ".csv"])
def test_logs_read_back(ending, tmp_path, traffic):
    with open_log(tmp_path / f"a{ending}") as log:
        for message in traffic[:200]:
            log.on_message_received(message)
    got = list(read_log(tmp_path / f"a{ending}"))
    assert [(m.arbitration_id, bytes(m.data)) for m in got] == [
        (m.arbitration_id, bytes(m.data)) for m in traffic[:200]
    ]
    offset = got[0].timestamp - traffic[0].timestamp  # .asc counts from its first frame
    assert [m.timestamp - offset for m in got] == pytest.approx([m.timestamp for m in traffic[:200]], abs=1e-5)


def test_unknown_and_broken_logs(tmp_path):
    with pytest.raises(InputError, match=r"unknown kind of CAN log '\.db'; allowed: \.blf"):
        open_log(tmp_path / "a.db")
    with pytest.raises(InputError, match=r"a\.blf: cannot read the CAN log"):
        list(read_log(tmp_path / "a.blf"))
    (tmp_path / "b.blf").write_bytes(b"no BLF file, but long enough to have a header of one" * 9)
    with pytest.raises(InputError, match=r"b\.blf: cannot read the CAN log"):
        list(read_log(tmp_path / "b.blf"))


def test_monitor_shows_signals_and_protection(capsys, tmp_path, traffic):
    with Bus("virtual:monitor") as bus, Bus("virtual:monitor") as sender:
        for message in traffic[:400]:
            sender.send(message)
        sender.send(can.Message(arbitration_id=0x7FF, data=b"\1\2", is_extended_id=False))
        monitor(bus, None, 0.05, None, tmp_path / "log.csv")
    lines = capsys.readouterr().out.splitlines()
    steer = next(line for line in lines if "STEER_CMD" in line)
    assert "VALID" in steer
    assert "rad" in steer
    assert "not ours" in next(line for line in lines if "7FF" in line)
    assert len(list(read_log(tmp_path / "log.csv"))) == 401


def test_monitor_counts_what_is_bad():
    observer = Observer()
    for k in range(5):
        observer.add(0x101, bytes([k] * 8), 0.01 * k)
    observer.add(0x101, b"\0", 0.05)
    cells = {column.header: list(column.cells) for column in observer.table().columns}
    assert (cells["frames"], cells["bad"], cells["E2E"]) == (["6"], ["6"], ["NODATA"])


def test_candump_lines(capsys):
    with Bus("virtual:candump") as bus, Bus("virtual:candump") as sender:
        sender.send(can.Message(12.5, 0x101, is_extended_id=False, data=b"\1\2"))
        monitor(bus, None, 0.02, "-", None)
    assert capsys.readouterr().out.split()[1:] == ["candump", "101#0102"]


def test_candump_writes_the_name_given_and_no_file_that_was_there(tmp_path):
    (tmp_path / "run.log").write_text("precious")
    with Bus("virtual:names") as bus, Bus("virtual:names") as sender:
        sender.send(can.Message(arbitration_id=0x101, is_extended_id=False, data=b"\1"))
        monitor(bus, None, 0.02, str(tmp_path / "run.1"), None)
        for name in ("run.1", "run.log"):
            with pytest.raises(InputError, match="is there already; allowed: another name, or --overwrite"):
                monitor(bus, None, 0.02, str(tmp_path / name), None)
        with pytest.raises(InputError, match="is there already"):
            monitor(bus, None, 0.02, None, tmp_path / "run.log")
        assert (tmp_path / "run.log").read_text() == "precious"
        assert (tmp_path / "run.1").read_text().endswith(") names 101#01\n")
        monitor(bus, None, 0.02, str(tmp_path / "run.log"), None, overwrite=True)
    assert (tmp_path / "run.log").read_text() == ""


@pytest.mark.parametrize(("changes", "line"), [
    ({"arbitration_id": 0x12}, "012#"),
    ({"arbitration_id": 0x12, "is_extended_id": True, "data": b"\xab"}, "00000012#AB"),
    ({"arbitration_id": 0x7FF, "is_remote_frame": True}, "7FF#R"),
    ({"arbitration_id": 0x7FF, "is_remote_frame": True, "dlc": 5}, "7FF#R5"),
    ({"arbitration_id": 0x4, "is_error_frame": True, "data": bytes(8)}, "20000004#0000000000000000"),
    ({"arbitration_id": 0x1, "is_fd": True, "data": bytes(12)}, "001##0" + 24 * "0"),
    ({"arbitration_id": 0x1, "is_fd": True, "bitrate_switch": True, "data": b"\1"}, "001##101"),
    ({"arbitration_id": 0x1, "is_fd": True, "error_state_indicator": True}, "001##2"),
])  # fmt: skip
def test_every_kind_of_frame_has_its_candump_line(changes, line):
    frame = can.Message(timestamp=1700000000.123456, **{"is_extended_id": False, **changes})
    assert candump_line(frame, "vcan0") == f"(1700000000.123456) vcan0 {line}"


def test_what_if_of_its_own_log_is_what_was_sent(tmp_path, traffic, capsys, monkeypatch):
    with open_log(tmp_path / "a.blf") as log:
        for message in traffic:
            log.on_message_received(message)
    monkeypatch.chdir(tmp_path)
    assert main(["can", "replay", "a.blf", "--what-if", "single-obstacle"]) == 0
    assert "difference RMS 0.00000 rad" in capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "what-if").iterdir()) == ["what_if.csv", "what_if.svg"]


def test_what_if_needs_a_vehicle(tmp_path, traffic):
    with open_log(tmp_path / "a.log") as log:
        log.on_message_received(traffic[0])
    with pytest.raises(InputError, match="never has both"):
        can_replay.what_if(tmp_path / "a.log", SCENE, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_replay_sends_what_the_vehicle_sent_in_its_time(tmp_path, traffic):
    with open_log(tmp_path / "a.blf") as log:
        for message in traffic[:60]:
            log.on_message_received(message)
    with Bus("virtual:replay-log") as bus, Bus("virtual:replay-log") as listener:
        sent = can_replay.replay_as_plant(tmp_path / "a.blf", bus)
        got = [message.arbitration_id for message in listener.drain()]
        assert got == [m.arbitration_id for m in traffic[:60] if m.arbitration_id not in (0x101, 0x103, 0x301)]
        assert sent == len(got)
        with pytest.raises(InputError, match="no frame of a vehicle"):
            can_replay.replay_as_plant(_only_commands(tmp_path, traffic), bus)


def _only_commands(folder, traffic):
    with open_log(folder / "commands.blf") as log:
        log.on_message_received(next(m for m in traffic if m.arbitration_id == 0x101))
    return folder / "commands.blf"


# --- faults


def test_a_small_campaign_passes(capsys):
    assert main(["can", "faults", "--count", "8", "--corrupt", "20000"]) == 0
    text = capsys.readouterr().out
    assert "mixtures of everything" in text
    assert "accepted 0" in text


def test_an_unsafe_case_is_named(capsys, monkeypatch):
    kind = can_campaign.Kind("hopeless", [(SCENE, FaultSpec(seed=41, loss=1.0))], can_campaign.recovers)
    monkeypatch.setattr(can_campaign, "kinds", lambda count, seed: [kind])
    assert main(["can", "faults", "--corrupt", "1000"]) == 1
    assert " 41" in capsys.readouterr().out


def test_one_description(tmp_path, capsys):
    (tmp_path / "faults.toml").write_text("loss = 0.5\nstart = 1.0\n")
    assert main(["can", "faults", "--spec", str(tmp_path / "faults.toml")]) == 0
    assert capsys.readouterr().out.count("stopped after") == 2


def test_corrupt_frames_pass_the_crc_by_chance_only():
    fate = corrupt(30_000, 1)
    assert fate.passed_crc == pytest.approx(30_000 / 256, abs=4 * (30_000 / 256) ** 0.5)
    assert fate.by_counter + fate.by_plausibility == fate.passed_crc
    assert fate.accepted == 0


# --- bad input


def test_the_monitor_listens_without_the_flag_for_sending(capsys):
    assert main(["can", "monitor", "--once", "--can", "slcan:/dev/does-not-exist"]) == 2
    assert "cannot open 'slcan:/dev/does-not-exist'" in capsys.readouterr().err  # tried, where replay is refused
    assert main(["can", "replay", "no.blf", "--can", "slcan:/dev/does-not-exist"]) == 2
    assert "may move real hardware" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["drive", "single-obstacle", "--can", "virtual:x"], "does not reach another process"),
        (["monitor", "--can", "off"], "does not reach another process"),
        (["plant", "nowhere", "--can", "auto"], "no built-in scenario"),
        (["replay", "no.blf", "--what-if", "single-obstacle"], "cannot read the CAN log: No such file"),
        (["replay", "no.trc", "--can", "socketcan:nocan"], "no CAN interface 'nocan'"),
        (["faults", "--spec", "no.toml"], "No such file"),
    ],
)
def test_bad_input_is_one_line(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["can", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_usage(capsys):
    for arguments in (["can"], ["can", "faults", "--count", "0"], ["can", "dbc", "--format", "xls"]):
        with pytest.raises(SystemExit) as done:
            main(arguments)
        assert done.value.code == 2
