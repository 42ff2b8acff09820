import json
from contextlib import suppress

import pytest
from PIL import Image

from sidestep.validation.cli.main import main
from sidestep.validation.report import report as report_module
from sidestep.validation.scenarios.scenario import load_scenario


def lane(y0, y1):
    left, right = ("".join(f"<point><x>{x}</x><y>{y}</y></point>" for x in (0, 50, 100)) for y in (y1, y0))
    return f'<lanelet id="1"><leftBound>{left}</leftBound><rightBound>{right}</rightBound></lanelet>'


def exact(tag, value):
    return f"<{tag}><exact>{value}</exact></{tag}>"


STATE = (
    "<initialState><position><point><x>10</x><y>0</y></point></position>"
    f"{exact('orientation', 0.0)}{exact('time', 0)}{exact('velocity', 8.0)}</initialState>"
)
GOAL = f"<goalState>{'<time><intervalStart>3</intervalStart><intervalEnd>5</intervalEnd></time>'}</goalState>"
SCENE = (
    f'<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" benchmarkID="TST_A-1_1_T-1">{lane(-2, 2)}'
    f'<planningProblem id="2">{STATE}{GOAL}</planningProblem></commonRoad>'
)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(report_module, "run_report", lambda run: "<!doctype html>")
    (tmp_path / "scene.xml").write_text(SCENE)


def test_import_writes_a_scenario_and_a_picture(tmp_path, capsys):
    assert main(["import", "scene.xml", "--out", "mine.toml"]) == 0
    out = capsys.readouterr().out
    assert "note: no place is asked as the goal" in out
    assert "100 m of road, 0 obstacles" in out
    scenario = load_scenario(tmp_path / "mine.toml")
    assert (scenario.name, scenario.speed, scenario.goal.time) == ("TST_A-1_1_T-1", 8.0, pytest.approx([0.3, 0.5]))
    with Image.open(tmp_path / "mine.png") as picture:
        assert picture.width > 500


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["import", "none.xml", "--out", "a.toml"], "none.xml: cannot be read"),
        (["import", "scene.xml", "--out", "none/a.toml"], "--out"),
        (["import", "scene.xml"], "--out"),
        (["run", "scene.xml", "--set", "parameters.v=3"], "a CommonRoad file has none"),
        (["run", "none.xosc"], "no built-in scenario and no file 'none.xosc'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, arguments, words):
    before = sorted(tmp_path.rglob("*"))
    with suppress(SystemExit):
        assert main(arguments) == 2
    captured = capsys.readouterr().err
    assert words in captured
    assert captured.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.closed_loop
def test_run_takes_the_file_itself(tmp_path, capsys):
    main(["run", "scene.xml", "--plant", "linear", "--can", "off", "--out", "drive"])
    assert "note: no place is asked as the goal" in capsys.readouterr().out
    summary = json.loads((tmp_path / "drive" / "summary.json").read_text())
    assert summary["end"] == "goal reached"
    assert any("no place is asked" in note for note in summary["notes"])
