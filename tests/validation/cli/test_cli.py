import json
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from io import BytesIO, TextIOWrapper
from types import SimpleNamespace

import can
import pytest
from support.stand_in import KinematicCar

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.cli.main import main
from sidestep.validation.console import cells, number
from sidestep.validation.interrupt import interrupts_between_steps
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import read_columns
from sidestep.validation.report import report as report_module
from sidestep.validation.report.viewer import viewer
from sidestep.validation.scenarios.library import built_in_scenarios
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies import demo as demo_module
from sidestep.validation.studies import runs as runs_module

SHORT = ["--plant", "linear", "--set", "duration=0.4"]


@pytest.fixture(autouse=True)
def interrupts_as_at_a_terminal():
    """A shell in the background hands down an ignored SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """In an empty folder, and without the figures, which test_report.py looks at."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(report_module, "run_report", lambda run: "<!doctype html>")


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


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


# Bad input: one line, status 2, nothing written


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], ["nowhere", "allowed: blocked"]),
        (["broken.toml"], ["broken.toml", "TOML"]),
        (["single-obstacle", "--set", "sped=3"], ["sped: unknown key, did you mean speed?"]),
        (["single-obstacle", "--set", "speed=fast"], ["speed: 'fast'", "a number"]),
        (["single-obstacle", "--set", "speed=1e300"], ["speed: 1e+300", "0.01 to 150 m/s"]),
        (["single-obstacle", "--set", "plant.mass=1e-9"], ["plant.mass: 1e-09", "0.01 to 100"]),
        (["single-obstacle", "--set", "road.width_left=-4"], ["road.width_left: -4", "0.01 to 1000 m"]),
        (["single-obstacle", "--set", "obstacles.0.width=-1"], ["obstacles[0].width", "0.001 to 10000 m"]),
        (["single-obstacle", "--set", "obstacles.0.s=1"], ["obstacles[0]", "start"]),
        (["single-obstacle", "--set", "start.l=5"], ["start.l", "road's edge"]),
        (["single-obstacle", "--set", "vehicle.file=a.toml"], ["vehicle.file: no file '", "a.toml'; allowed"]),
        (["single-obstacle", "--set", "vehicle.tyre_file=a.tir"], ["vehicle.tyre_file: no file '"]),
        (["single-obstacle", "--plant", ""], ["plant.kind: unknown plant ''"]),
        (["single-obstacle", "--plant", "linear", "--can", ""], ["can: "]),
        (["--from", ""], ["--from: ''", "FILE.jsonl:ROW"]),
        (["single-obstacle", "--plant", "mujco"], ["mujco", "did you mean mujoco?", "single-track, double-track"]),
        (["single-obstacle", "--plant", "none.fmu"], ["none.fmu"]),
        (["single-obstacle", "--plant", "broken.fmu"], ["broken.fmu"]),
        (["single-obstacle", "--plant", "broken.fmu", "--map", "a.toml"], ["plant.map: no file '", "a.toml'"]),
        (["single-obstacle", "--plant", "linear", "--map", "a.toml"], ["plant.map", ".fmu"]),
        (["single-obstacle", "--plant", "linear", "--set", "plant.friction=0.6"], ["plant.friction", "only with"]),
        (["single-obstacle", "--plant", "linear", "--can", "socketcan:nocan7"], ["nocan7"]),
        (["single-obstacle", "--plant", "linear", "--can", "carrier-pigeon:1"], ["carrier-pigeon", "virtual"]),
        (["single-obstacle", "--plant", "linear", "--out", "broken.toml"], ["--out", "broken.toml"]),
        (["single-obstacle", "--plant", "linear", "--out", "broken.toml/below"], ["--out", "broken.toml"]),
        (["single-obstacle", "--plant", "linear", "--out", "/proc/sidestep"], ["--out", "/proc/sidestep"]),
        (["single-obstacle", "--plant", "linear", "--view"], ["--view", "mujoco"]),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_leaves_nothing(arguments, words, tmp_path, capsys):
    (tmp_path / "broken.toml").write_text("speed = ")
    (tmp_path / "broken.fmu").write_text("this is no zip archive")
    assert main(["run", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("sidestep: ")
    assert error.count("\n") == 1
    assert "Traceback" not in error
    assert all(word in error for word in words), error
    assert files(tmp_path) == ["broken.fmu", "broken.toml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "COMMAND"),
        (["fly"], "invalid choice: 'fly'"),
        (["run"], "SCENARIO"),
        (["run", "single-obstacle", "--colour", "red"], "--colour"),
        (["run", "single-obstacle", "--coupling", "loose"], "zero-delay"),
        (["validate", "--jobs", "0"], "--jobs: '0' is no whole number > 0"),
        (["campaign", "spec.toml", "--jobs", "-3"], "--jobs: '-3'"),
        (["validate", "--checks", "--manoeuvre", "coast"], "not allowed with argument --checks"),
        (["compare", "a", "b", "--least", "nan"], "--least: 'nan' is no number from 0 to 1"),
        (["compare", "a", "b", "--least", "good"], "--least: 'good'"),
        (["limits", "endurance", "--hours", "-1"], "--hours: '-1' is no number > 0"),
        (["limits", "scenes", "--count", "0"], "--count: '0'"),
        (["limits", "scenes", "--seed-from", "-5"], "--seed-from: '-5' is no whole number >= 0"),
        (["can", "faults", "--seed", "-1"], "--seed: '-1'"),
        (["can", "monitor", "--duration", "-1"], "--duration: '-1' is no number > 0"),
    ],
)
def test_bad_usage_is_one_line_too(arguments, words, capsys):
    with pytest.raises(SystemExit) as done:
        main(arguments)
    assert done.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith("sidestep: ")
    assert words in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["can", "monitor", "--once", "--duration", "2"], "--duration: not allowed with argument --once"),
        (["run", "moose", "--isolate", "nan"], "--isolate: 'nan' is no number > 0"),
    ],
)
def test_options_that_exclude_each_other_or_make_no_sense(arguments, words, capsys):
    with pytest.raises(SystemExit) as done:
        main(arguments)
    assert done.value.code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fmu", "check", "nope.fmu"], "nope.fmu: no such file"),
        (["fmu", "export", "moose", "--ssp", "--fmi", "3"], "--fmi: 3: a system is of FMI 2.0"),
        (["fmu", "export", "moose", "--ssp", "--set", "plant.delay=0.1"], "plant: the system's plant is that of"),
        (["fmu", "export", "moose", "--set", "plant.friction=0.6"], "--set plant: makes no difference to the"),
        (["fmu", "export", "moose", "--out", "."], "--out: cannot write '.'"),
        (["fmu", "build", "linear", "--out", "."], "--out: cannot write '.'"),
        (["can", "faults", "--spec", "a.toml", "--seed", "0"], "--seed: makes no difference beside --spec"),
        (["can", "replay", "a.blf", "--out", "x"], "--out: makes no difference without --what-if"),
        (["can", "replay", "a.blf", "--what-if", "moose", "--can", "socketcan:vcan0"], "--can: makes no difference"),
        (
            ["can", "replay", "a.blf", "--what-if", "moose"],
            "a.blf: cannot read the CAN log: No such file or",
        ),
        (
            ["can", "replay", "junk.blf", "--what-if", "moose"],
            "junk.blf: cannot read the CAN log: its content is not",
        ),
        (
            ["can", "replay", "junk.csv", "--what-if", "moose"],
            "junk.csv: cannot read the CAN log: line 1: the head",
        ),
    ],
)
def test_fmu_and_can_say_what_cannot_be_used(arguments, words, tmp_path, capsys):
    for name in ("junk.blf", "junk.csv"):
        (tmp_path / name).write_text("nothing\n")
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"sidestep: {words}")
    assert (shown.out, shown.err.count("\n"), files(tmp_path)) == ("", 1, ["junk.blf", "junk.csv"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["validate", "--plant", "linear", "--map", "a.toml"], "plant.map: "),
        (["validate", "--plant", "mujoco", "--set", "sped=3"], "sped: unknown key"),  # before minutes of checks
        (["identify", "--plant", "linear", "--out", "."], "--out: cannot write '.' (Is a directory)"),
    ],
)
def test_validate_and_identify_refuse_bad_input_before_they_drive(arguments, words, capsys):
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert words in shown.err


def test_an_input_error_comes_whole_out_of_a_worker_process():
    error = InputError("file.toml", "a: -1", "> 0")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.allowed) == (InputError, str(error), "> 0")


def test_a_plant_that_cannot_be_built_is_one_line(monkeypatch, capsys, tmp_path):
    def no_compiler(scenario):
        raise PlantError("no C compiler\nanywhere")

    monkeypatch.setattr(runs_module, "open_plant", no_compiler)
    assert main(["run", "single-obstacle", "--plant", "linear", "--out", "a"]) == 2
    assert capsys.readouterr().err == "sidestep: no C compiler anywhere\n"
    assert files(tmp_path) == []


# Output that goes nowhere


@pytest.mark.parametrize(
    ("output", "status", "words"),
    [("closed", 1, ""), ("/dev/full", 2, "sidestep: output: No space left on device\n")],
)
def test_output_that_nobody_takes_is_no_traceback(output, status, words):
    reader, writer = os.pipe()
    os.close(reader)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-m", "sidestep.validation", "--help"]
    with open(writer if output == "closed" else output, "w") as stdout:
        done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False, env=environment)
        os.dup2(os.open(os.devnull, os.O_WRONLY), stdout.fileno())
    assert (done.returncode, done.stderr) == (status, words)


def test_an_argument_of_no_text_is_refused(capsys):
    assert main(["run", "\udcff"]) == 2
    assert capsys.readouterr().err == "sidestep: arguments: \"sidestep run '\\udcff'\" cannot be read; allowed: UTF-8\n"


def test_a_terminal_without_our_signs_gets_others(monkeypatch):
    shown = TextIOWrapper(BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", shown)
    assert main(["validate", "--manoeuvres"]) == 0
    assert b"m/s?" in shown.buffer.getvalue()


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["run", "single-obstacle", "--plant", "linear", "--junit"], "--junit"),
        (["run", "single-obstacle", "--render"], "--render"),
        (["campaign", "spec.toml", "--junit"], "--junit"),
        (["compare", "a", "b", "--junit"], "--junit"),
        (["golden", "check", "a", "g.csv", "--junit"], "--junit"),
        (["validate", "--junit"], "--junit"),
        (["identify", "--plant", "linear", "--out"], "--out"),
    ],
)
@pytest.mark.parametrize("file", [".", "/proc/here/there.gif", "no-folder/a.gif"])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(arguments, option, file, tmp_path, capsys):
    if option == "--out" and file == "no-folder/a.gif":
        return  # which is made
    assert main([*arguments, file]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"sidestep: {option}: cannot write '{file}' (")
    assert (shown.out, shown.err.count("\n"), files(tmp_path)) == ("", 1, [])


# Interruption


def test_an_interrupt_leaves_complete_files_of_what_ran(monkeypatch, tmp_path, capsys):
    car = KinematicCar(raises=KeyboardInterrupt(), raises_at=0.25)
    monkeypatch.setattr(runs_module, "open_plant", lambda scenario: car)
    assert main(["run", "single-obstacle", "--out", "a"]) == 130
    assert files(tmp_path / "a") == ["can.blf", "recording.csv", "report.html", "steps.csv", "summary.json"]
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert (summary["label"], summary["verdict"]) == ("interrupted", "inconclusive")
    recording = read_columns(tmp_path / "a" / "recording.csv")
    assert recording["time"][-1] == pytest.approx(0.25)
    frames = [frame for frame in can.BLFReader(tmp_path / "a" / "can.blf") if frame.arbitration_id == 0x101]
    assert len(frames) == len(recording["time"])
    output = capsys.readouterr()
    assert "a/report.html" in output.out
    assert output.err == "sidestep: interrupted\n"


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def test_ctrl_c_waits_until_it_is_asked_for():
    done = []

    def work():
        with interrupts_between_steps() as interruption:
            interruption()
            press_ctrl_c()
            done.append("the step")
            interruption()
            done.append("the next one")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["the step"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_that_nobody_asks_for_is_raised_at_the_end():
    done = []

    def work():
        with interrupts_between_steps():
            press_ctrl_c()
            done.append("the file")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["the file"]


def test_a_second_ctrl_c_does_not_wait():
    def work():
        with interrupts_between_steps():
            press_ctrl_c()
            press_ctrl_c()
            pytest.fail("it was held back")

    with pytest.raises(KeyboardInterrupt):
        work()


def test_other_threads_are_left_alone():
    def work():
        with interrupts_between_steps() as interruption:
            interruption()
            return signal.getsignal(signal.SIGINT)

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(work).result() is signal.default_int_handler


def test_ctrl_c_from_outside(tmp_path):
    command = [sys.executable, "-m", "sidestep.validation", "run", "single-obstacle", "--plant", "linear", "--out", "a"]
    process = subprocess.Popen(
        [*command, "--set", "duration=600", "--set", "road.segments.0.length=1e5"], cwd=tmp_path,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not (tmp_path / "a" / "can.blf").exists():
        assert process.poll() is None
        time.sleep(0.02)
    time.sleep(0.3)
    os.kill(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert error == "sidestep: interrupted\n"
    assert json.loads((tmp_path / "a" / "summary.json").read_text())["label"] == "interrupted"


# The demo


@pytest.fixture
def short_demo(monkeypatch):
    """0.4 s of an empty road, driven by linear plants under the names of all three."""

    def load(name, overrides):
        return load_scenario(name, [*overrides, "obstacles=[]", "duration=0.4"])

    def plant(scenario):
        if scenario.plant.kind == "single-track":
            raise PlantError("no C compiler")
        return open_plant(load_scenario(scenario.name, ["plant.kind=linear"]))

    monkeypatch.setattr(demo_module, "load_scenario", load)
    monkeypatch.setattr(demo_module, "SCENES", ("single-obstacle",))
    monkeypatch.setattr(runs_module, "open_plant", plant)


def test_the_demo_goes_on_without_a_compiler_and_says_so(short_demo, tmp_path, capsys):
    assert main(["demo", "--out", "d"]) == 1
    rows = json.loads((tmp_path / "d" / "summary.json").read_text())["runs"]
    assert [(row["plant"], row["preset"], row["label"]) for row in rows] == [
        ("linear", "default", "ok"), ("single-track", "default", "plant invalid"),
        ("mujoco", "default", "ok"), ("linear", "paper", "ok"),
    ]  # fmt: skip
    assert "no C compiler" in capsys.readouterr().out
    html = (tmp_path / "d" / "report.html").read_text()
    assert 'href="single-obstacle-mujoco/report.html"' in html
    for name in ("linear", "mujoco", "linear-paper"):
        assert "report.html" in files(tmp_path / "d" / f"single-obstacle-{name}")


def test_the_papers_baseline_does_not_count(short_demo, monkeypatch, tmp_path):
    monkeypatch.setattr(demo_module, "CASES", (("linear", "default"), ("single-track", "paper")))
    assert main(["demo", "--out", "d"]) == 0


@pytest.mark.parametrize(
    ("verdicts", "interrupted", "verdict"),
    [
        (["pass", "pass"], False, Verdict.PASS),
        (["pass", "inconclusive"], False, Verdict.INCONCLUSIVE),
        (["inconclusive", "fail"], False, Verdict.FAIL),
        (["pass"], True, Verdict.INCONCLUSIVE),
    ],
)
def test_what_shows_nothing_is_no_pass_of_the_demo(verdicts, interrupted, verdict):
    assert demo_module._verdict(verdicts, interrupted) is verdict


def test_an_interrupted_demo_keeps_what_ran(short_demo, monkeypatch, tmp_path, capsys):
    plain = runs_module.open_plant

    def interrupted(scenario):
        return (
            KinematicCar(raises=KeyboardInterrupt(), raises_at=0.1)
            if scenario.plant.kind == "mujoco"
            else plain(scenario)
        )

    monkeypatch.setattr(runs_module, "open_plant", interrupted)
    assert main(["demo", "--out", "d"]) == 130
    rows = json.loads((tmp_path / "d" / "summary.json").read_text())["runs"]
    assert [row["label"] for row in rows] == ["ok", "plant invalid", "interrupted"]


def test_a_demo_that_cannot_write_is_bad_input(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["demo", "--out", "file"]) == 2
    assert capsys.readouterr().err.startswith("sidestep: --out: cannot write to 'file'")


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
