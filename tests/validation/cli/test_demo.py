"""`sidestep demo`: what counts, what does not, and what is left where it cannot go on."""

import json

import pytest
from support.folders import files
from support.stand_in import KinematicCar

from sidestep.plant_models.errors import PlantError
from sidestep.validation.cli.main import main
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies import demo as demo_module
from sidestep.validation.studies import runs as runs_module


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
