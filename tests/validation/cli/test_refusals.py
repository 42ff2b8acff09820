"""Bad input: one line, exit status 2, nothing written."""

import os
import pickle
import subprocess
import sys
from io import BytesIO, TextIOWrapper

import pytest
from support.folders import files

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.validation.cli.main import main
from sidestep.validation.studies import runs as runs_module


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
