"""Campaigns: which cases there are, what a row says, and that it runs again to the last bit."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from support.campaigns.spec import SPEC, campaign
from support.stored_runs import drive

from sidestep.plant_models.errors import InputError
from sidestep.validation.campaigns.campaign import cases, load_campaign, number_of_cases, scenario_of
from sidestep.validation.campaigns.campaign_run import figures, run_campaign
from sidestep.validation.cli.main import main

ROOT = Path(__file__).parents[3]


# Cases


def test_cases_follow_from_the_specification_alone(tmp_path):
    spec = campaign(tmp_path)
    first, again = cases(spec), cases(spec)
    assert first == again
    assert len({case.seed for case in first}) == len(first) == 40
    assert cases(replace(spec, runs=20)) == first[:20]  # a longer campaign begins with the shorter one's cases
    assert cases(replace(spec, seed=4))[0].values != first[0].values


def test_a_sobol_campaign_is_spread_evenly(tmp_path):
    """Every one of 2^k equal parts of each range holds n / 2^k of the cases, wherever the sequence is shifted to."""
    spec = replace(campaign(tmp_path), runs=64)
    for key, low, high in (("speed", 10.0, 18.0), ("plant.noise", 0.0, 2.0), ("obstacles.1.l", 0.2, 1.4)):
        values = np.array([case.values[key] for case in cases(spec)])
        assert low <= values.min() < values.max() < high
        assert np.ptp(np.histogram(values, 16, (low, high))[0]) <= 2
    models = [case.values["controller.tyre_model"] for case in cases(spec)]
    assert abs(models.count("linear") - 32) <= 1


def test_a_grid_has_every_combination_once(tmp_path):
    spec = replace(campaign(tmp_path), method="grid")
    every = cases(spec)
    assert number_of_cases(spec) == len(every) == 5 * 5 * 5 * 2
    assert len({tuple(case.values.values()) for case in every}) == len(every)
    assert {case.values["speed"] for case in every} == {10.0, 12.0, 14.0, 16.0, 18.0}


def test_a_case_is_the_scenario_with_its_values(tmp_path):
    spec = campaign(tmp_path)
    case = cases(spec)[5]
    scenario = scenario_of(spec, case, ["duration=1.5"])
    assert scenario.speed == case.values["speed"]
    assert scenario.obstacles[1].l == case.values["obstacles.1.l"]
    assert (scenario.plant.noise_seed, scenario.duration) == (case.seed, 1.5)
    scenes = campaign(tmp_path, 'scenario = "random"\nruns = 3')
    drawn = [scenario_of(scenes, case) for case in cases(scenes)]
    assert len({scene.name for scene in drawn}) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("runs = 3", "scenario: missing"),
        ('scenario = "x"', "no built-in scenario"),
        ('scenario = "moose"\nruns = 0', "runs"),
        ('scenario = "moose"\nvary.speed = {low = 2.0}', "vary.speed: is no range"),
        ('scenario = "moose"\nvary.speed = {low = 2.0, high = 1.0}', "vary.speed: is no range"),
        ('scenario = "moose"\nvary.speed = 3', "vary.speed: 3 is not a table"),
        ('scenario = "moose"\nvary.sped = {low = 1.0, high = 2.0}', "sped: unknown key, did you mean speed"),
        ('scenario = "moose"\nset.speed = 3\nvary.speed = {low = 1.0, high = 2.0}', "vary.speed: is also in"),
        ('scenario = "moose"\nmethod = "grid"\nvary.speed = {low = 1.0, high = 2.0, steps = 2000000}', "2000000 cases"),
        ("a", "no readable TOML file"),
        ('scenario = "moose"\nset.plant.kind = "mujco"', "spec.toml: plant.kind: unknown plant 'mujco', did you mean"),
        ('scenario = "moose"\nvary.plant.kind.values = ["linear", "no.fmu"]', "no.fmu: no such file"),
        ('scenario = "moose"\nvary.plant.mass = {low = -1.0, high = 1.0}', "spec.toml: plant.mass: -1.0"),
        ('scenario = "moose"\nvary.speed = {low = 10.0, high = nan}', "vary.speed.high: nan"),
        ('scenario = "moose"\nvary.speed.values = [10.0, "fast"]', "spec.toml: speed: 'fast'"),
        ('scenario = "moose"\nvary.start.l = {low = 0.0, high = 30.0}', "start.l: .*the road's edge"),
        (
            'scenario = "moose"\nset.plant.kind = "linear"\nvary.plant.friction = {low = 0.5, high = 1.0}',
            "plant.friction: .*the plant linear does not know it",
        ),
    ],
)
def test_a_wrong_specification_is_refused_before_anything_runs(tmp_path, monkeypatch, capsys, text, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.toml").write_text(text)
    assert main(["campaign", "spec.toml"]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert (error.count("\n"), [file.name for file in tmp_path.iterdir()]) == (1, ["spec.toml"])


def test_examples_specification_is_right():
    assert load_campaign(ROOT / "examples" / "friction_sweep.toml").name == "friction_sweep"


# Command line


@pytest.mark.closed_loop
def test_a_row_runs_again_to_the_last_bit(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    campaign(tmp_path, SPEC.replace("runs = 40", "runs = 3").replace("duration = 0.2\n", ""))
    assert main(["campaign", "spec.toml", "--jobs", "1", "--junit", "j.xml"]) == 0
    assert capsys.readouterr().out.startswith("PASS: 3 runs, 0 failures, 0 inconclusive, failure rate at most 63 %")
    assert json.loads(Path("runs/spec/summary.json").read_text())["n"] == 3
    assert main(["run", "--from", "runs/spec/campaign.jsonl:2", "--out", "again", "--junit", "r.xml"]) == 0
    assert "row 2 again: the same to the last bit" in capsys.readouterr().out
    assert ElementTree.parse("r.xml").getroot().get("failures") == "0"
    assert main(["run", "--from", "runs/spec/campaign.jsonl:2", "--out", "again", "--set", "speed=11"]) == 0
    assert "again:" not in capsys.readouterr().out
    for reference, message in (
        ("runs/spec/campaign.jsonl:7", "no row 7"),
        ("x", "FILE.jsonl:ROW"),
        ("x:1", "cannot be read"),
    ):
        assert main(["run", "--from", reference]) == 2
        assert message in capsys.readouterr().err
    assert main(["campaign", "spec.toml", "--junit", "no/j.xml", "--jobs", "1"]) == 2
    assert "--junit: cannot write" in capsys.readouterr().err


def test_without_dask_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"sidestep\[dask\]"):
        run_campaign(campaign(tmp_path), tmp_path / "c.jsonl", dask="tcp://127.0.0.1:1")


def test_figures_of_a_row_are_json_and_those_of_the_run():
    run = drive(duration=0.5)
    row = figures(run.scenario, run.recording, run.judgement)
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert row["margin_m"] == min(run.judgement.min_clearance, run.judgement.min_edge_clearance)
    assert row["rms_lateral_error_m"] == pytest.approx(run.summary["rms_lateral_error_m"])
