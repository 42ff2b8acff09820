"""The README keeps its word: its code runs, its commands exist, its tables are those that were measured."""

import re
import runpy
import shlex
from pathlib import Path

import pytest

from sidestep.validation.cli.main import _parser
from sidestep.validation.scenarios.library import built_in_scenarios

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
INSTALL = "python3 -m venv .venv && .venv/bin/pip install -q -c constraints.txt -e "
COMMANDS = sorted(set(re.findall(r"`(sidestep [^`]+)`", README)))


def test_the_two_lines_come_first():
    lines = [line.strip() for line in README.splitlines() if line.strip()]
    assert lines[1] == INSTALL + ". && .venv/bin/sidestep demo"
    assert lines[2] == INSTALL + "'.[test]' && .venv/bin/pytest -q"


def test_python_block_drives_around_the_obstacle(capsys):
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    states = []
    names: dict[str, object] = {}
    exec(
        block.replace("\n    state = my_plant", "\n    seen(state)\n    state = my_plant"),
        names | {"seen": states.append},
    )
    assert len(states) == 1200
    printed = capsys.readouterr().out
    assert "".join(f"    {line}\n" for line in printed.splitlines()) in README
    beside = [abs(state.y) for state in states if 37.0 < state.x < 43.0]
    assert min(beside) > 0.9 + 0.8  # half of obstacle and car
    assert abs(states[-1].y) < 1e-3


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_exist(command):
    """Each is parsed with its options; nothing is run."""
    options = _parser().parse_args(shlex.split(command)[1:])
    assert callable(options.command)
    if hasattr(options, "scenario"):
        assert options.scenario in built_in_scenarios()


def test_commands_were_found():
    assert {"sidestep demo", "sidestep scenarios", "sidestep bench --solvers"} <= set(COMMANDS)


def test_tables_are_those_of_the_stored_figures():
    with_tables = runpy.run_path(str(ROOT / "benchmarks" / "readme.py"))["with_tables"]
    assert with_tables(README) == README


def test_picture_is_there_and_small():
    assert 20_000 < (ROOT / "docs" / "images" / "double-obstacle.png").stat().st_size < 300_000


def test_example_passes_the_plant_check_and_the_obstacle(capsys):
    runpy.run_path(str(ROOT / "examples" / "own_plant.py"), run_name="__main__")
    shown = capsys.readouterr().out
    found = [line for line in shown.splitlines() if line.startswith("check_plant")]
    assert [line.split()[1] for line in found] == ["v_y", "yaw_rate", "The"]  # all that a car without tyres lacks
    assert "rolls without slip" in found[-1]
    assert "+2." in shown or "-2." in shown
    assert shown.rstrip().endswith("TRACKING")
