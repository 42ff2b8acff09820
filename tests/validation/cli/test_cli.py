"""The command line on good input: files, exit status, tables and the viewer."""

import json
import time
from contextlib import contextmanager
from types import SimpleNamespace

import can
import pytest
from support.folders import files

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.cli.main import main
from sidestep.validation.console import cells, number
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import read_columns
from sidestep.validation.report.viewer import viewer
from sidestep.validation.scenarios.library import built_in_scenarios
from sidestep.validation.scenarios.scenario import load_scenario

SHORT = ["--plant", "linear", "--set", "duration=0.4"]


# Good input


def test_scenarios_lists_every_name(capsys):
    assert main(["scenarios"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(built_in_scenarios())


def test_version_and_help(capsys):
    for argument, words in (("--version", "0."), ("--help", "scenarios")):
        with pytest.raises(SystemExit) as done:
            main([argument])
        assert done.value.code == 0
        assert words in capsys.readouterr().out


def test_a_run_passes_and_leaves_its_files(tmp_path, capsys):
    assert main(["run", "double-obstacle", "--plant", "linear", "--out", "a"]) == 0
    assert files(tmp_path / "a") == ["can.blf", "recording.csv", "report.html", "steps.csv", "summary.json"]
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert (summary["verdict"], summary["plant"], summary["coupling"]) == ("pass", "linear", "zero-delay")
    assert summary["can"]["sent"] == 800
    assert summary["command_line"] == "sidestep run double-obstacle --plant linear --out a"
    output = capsys.readouterr()
    assert "pass: " in output.out
    assert "a/report.html" in output.out
    assert output.err == ""


def test_the_same_command_gives_the_same_recording(tmp_path):
    for out in ("a", "b"):
        assert main(["run", "double-obstacle", *SHORT, "--out", out]) == 1  # too short to show anything
    assert (tmp_path / "a" / "recording.csv").read_bytes() == (tmp_path / "b" / "recording.csv").read_bytes()


def test_the_frames_of_the_log_are_the_commands_of_the_recording(tmp_path):
    main(["run", "double-obstacle", *SHORT, "--out", "a"])
    frames = [frame for frame in can.BLFReader(tmp_path / "a" / "can.blf") if frame.arbitration_id == 0x101]
    recording = read_columns(tmp_path / "a" / "recording.csv")
    assert len(frames) == len(recording["time"]) - 1 == 40
    assert [frame.timestamp for frame in frames] == pytest.approx(recording["time"][:-1].tolist(), abs=1e-6)
    assert recording["steer_received"] == pytest.approx(recording["steer_command"], abs=2.5e-5)  # half a bit


def test_without_can_the_plant_gets_the_commands_as_they_are(tmp_path):
    main(["run", "double-obstacle", *SHORT, "--out", "a"])
    main(["run", "double-obstacle", *SHORT, "--can", "off", "--out", "a"])  # over the files of the run before
    assert "can.blf" not in files(tmp_path / "a")
    recording = read_columns(tmp_path / "a" / "recording.csv")
    assert recording["steer_received"].tolist() == recording["steer_command"].tolist()
    assert json.loads((tmp_path / "a" / "summary.json").read_text())["can"] == {
        "sent": 0,
        "lost": 0,
        "strangers": 0,
        "interface": "off",
    }


def test_the_default_folder_says_when_and_what(tmp_path):
    main(["run", "single-obstacle", *SHORT, "--coupling", "one-step-delay"])
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-single-obstacle")
    assert json.loads((folder / "summary.json").read_text())["coupling"] == "one-step-delay"


def test_a_failed_run_is_exit_status_1(tmp_path):
    # a wall over the whole road that comes nearer: no braking helps
    wall = "obstacles=[{s=30, l=0, length=1, width=8, speed=-20}]"
    assert (
        main(["run", "single-obstacle", "--plant", "linear", "--set", wall, "--set", "duration=1.5", "--out", "a"]) == 1
    )
    assert json.loads((tmp_path / "a" / "summary.json").read_text())["label"] == "collision"


# Plants and viewer


@pytest.mark.parametrize("kind", ["linear", "mujoco"])
def test_a_misaligned_steering_is_invisible_to_its_measurement(kind):
    scene = load_scenario("single-obstacle", [f"plant.kind={kind}", "plant.steer_offset=0.02"])
    straight = load_scenario("single-obstacle", [f"plant.kind={kind}"])
    with open_plant(scene) as bent, open_plant(straight) as plain:
        bent.reset(VehicleState(v_x=15.0))
        plain.reset(VehicleState(v_x=15.0, steer_angle=0.02))
        for _ in range(30):
            state = bent.step(SteeringCommand(0.0, 0.0, 15.0), 0.01)
            expected = plain.step(SteeringCommand(0.0, 0.02, 15.0), 0.01)
        assert state.yaw_rate == pytest.approx(expected.yaw_rate, rel=1e-9)
        assert state.steer_angle == pytest.approx(expected.steer_angle - 0.02, abs=1e-12)
        assert not bent.collided  # pyright: ignore[reportAttributeAccessIssue]


def test_the_viewer_follows_the_simulation(monkeypatch):
    import mujoco.viewer

    synced = []

    @contextmanager
    def launch(model, data, **_):
        yield SimpleNamespace(sync=lambda: synced.append(data.time))

    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    monkeypatch.setenv("DISPLAY", ":0")
    with MujocoPlant(VehicleParameters.preset("bmw-320i")) as plant, viewer(plant) as show:
        plant.reset(VehicleState(v_x=5.0))
        began = time.perf_counter()
        plant.step(SteeringCommand(0.0, 0.0, 5.0), 0.05)
        show(0.05)
        assert time.perf_counter() - began >= 0.04
    assert synced == pytest.approx([0.05])


def test_the_viewer_needs_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with (
        MujocoPlant(VehicleParameters.preset("bmw-320i")) as plant,
        pytest.raises(InputError, match="no display"),
        viewer(plant),
    ):
        pass


# Tables


def test_numbers_stay_readable():
    assert number(None, "m", 2) == "–"
    assert number(1.2345, "m", 2) == "1.23 m"
    assert number(3.9e102, "mm", 3) == "3.9e+102 mm"
    assert set(cells({"plant": "single-track"})) == {"–"}
