"""`sidestep export c`: what it writes compiles as C and as C++ and answers with the in-process controller's bits."""

import subprocess
from dataclasses import astuple, replace

import pytest
from support.component import in_process, scene_of

from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.validation.cli.main import main

STEPS = 100


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c") / "controller"
    assert main(["export", "c", "double-obstacle", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def driven():
    """States as the example's input, and the answers with its obstacle."""
    scene = replace(scene_of("double-obstacle"), obstacles=[Obstacle(40.0, 0.5, 4.5, 1.8)])
    controller, plant = in_process(scene), LinearPlant(scene.vehicle)
    state, lines, answers = plant.reset(scene.start), [], []
    for _ in range(STEPS):
        command = controller.step(state)
        lines.append(" ".join(map(repr, map(float, astuple(state)))))
        answers.append((command.steer_angle, command.acceleration, command.target_speed, int(command.status)))
        state = plant.step(command, 0.02)
    return "\n".join(lines), answers


def test_it_writes_header_libraries_example_and_setup(exported):
    names = {file.name for file in exported.iterdir()}
    assert names == {"sidestep.h", "libsidestep.so", "libsidestep.a", "example.c", "controller.setup"}
    assert sum(1 for line in (exported / "example.c").read_text().splitlines() if line.strip()) < 40


@pytest.mark.parametrize("library", ["libsidestep.a", "libsidestep.so"])
@pytest.mark.parametrize("compiler", [("cc", "-std=c99"), ("c++", "-x", "c++", "-std=c++11")], ids=["c", "c++"])
def test_the_example_has_the_controllers_bits(compiler, library, exported, driven, tmp_path):
    strict = ("-Wall", "-Wextra", "-Werror", "-pedantic")
    program = tmp_path / "example"
    plain = ["-x", "none"] if "-x" in compiler else []
    linked = [exported / library, f"-Wl,-rpath,{exported}", "-lm"]
    command = [*compiler, *strict, exported / "example.c", *plain, *linked, "-o", program]
    subprocess.run(command, check=True)
    states, answers = driven
    done = subprocess.run(
        [program, exported / "controller.setup"], input=states, capture_output=True, text=True, check=True
    )
    found = [line.split() for line in done.stdout.splitlines()]
    assert [(*map(float, numbers), int(status)) for *numbers, status in found] == answers
    assert done.stderr == ""


def test_a_program_with_the_wrong_file_says_so(exported, tmp_path):
    program = tmp_path / "example"
    subprocess.run(["cc", exported / "example.c", exported / "libsidestep.a", "-lm", "-o", program], check=True)
    done = subprocess.run([program, exported / "sidestep.h"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "the setup is too short\n")


def test_what_cannot_be_exported_is_bad_input(tmp_path, capsys):
    assert main(["export", "c", "--set", "controller.preset=paper", "--out", str(tmp_path / "c")]) == 2
    assert "controller.formulation: 'paper': its solver is not compiled" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["export", "c", "--out", str(tmp_path / "file")]) == 2
    assert "file: cannot be made: File exists" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]
