"""Campaigns: which cases there are, that none is lost or run twice, what their numbers mean, and the imperfect car."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from campaign_work import deadly, fake
from html_page import check_self_contained
from scipy.stats.qmc import Sobol
from stand_in import KinematicCar
from stored_runs import drive

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.campaigns import journal
from sidestep.validation.campaigns.campaign import Campaign, cases, load_campaign, number_of_cases, scenario_of
from sidestep.validation.campaigns.campaign_figures import influences, telling
from sidestep.validation.campaigns.campaign_report import junit_cases, sentence, summarised, write_campaign_report
from sidestep.validation.campaigns.campaign_run import figures, load_rows, run_campaign, run_case
from sidestep.validation.campaigns.journal import open_journal, read_journal
from sidestep.validation.cli.main import main
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.measurement import FITTED_NOISE, NOISE, ImperfectMeasurement, measured
from sidestep.validation.loop.plants import ImperfectSteering, open_plant, true_vehicle
from sidestep.validation.model_error.sensitivity import first_order, separation, trend
from sidestep.validation.report.exports.junit import write_junit
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.limits import upper_bound

ROOT = Path(__file__).parents[3]
SPEC = """
scenario = "double-obstacle"
runs = 40
seed = 3
[set]
plant.kind = "linear"
duration = 0.2
[vary]
speed = { low = 10.0, high = 18.0 }
plant.noise = { low = 0.0, high = 2.0 }
"obstacles.1.l" = { low = 0.2, high = 1.4 }
controller.tyre_model = { values = ["linear", "affine"] }
"""


def campaign(folder: Path, text: str = SPEC) -> Campaign:
    (folder / "spec.toml").write_text(text)
    return load_campaign(folder / "spec.toml")


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


# Rows


def test_a_killed_campaign_goes_on_to_the_same_rows(tmp_path):
    """SIGKILL at any moment: every row that was there stays as it was, and each comes once."""
    spec = campaign(tmp_path)
    whole = run_campaign(spec, tmp_path / "whole.jsonl", 1, work=fake)
    assert [row["row"] for row in whole] == list(range(40))
    file = tmp_path / "killed.jsonl"
    script = "import sys, campaign_work; campaign_work.go_on(*sys.argv[1:])"
    for moment in np.random.default_rng(0).uniform(0.0, 0.15, 2):
        process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path), str(file)], cwd=ROOT / "tests")
        before = len(read_journal(file)[1]) if file.exists() else 0
        while process.poll() is None and (not file.exists() or file.read_bytes().count(b"\n") <= before + 1):
            time.sleep(0.002)
        time.sleep(moment)
        process.kill()
        process.wait()
    written = read_journal(file)[1]
    assert len(written) >= 4
    assert run_campaign(spec, file, 1, work=fake) == whole
    assert read_journal(file)[1][: len(written)] == written
    assert len(read_journal(file)[1]) == 40


def test_a_line_that_was_cut_short_is_run_again(tmp_path):
    spec, file = campaign(tmp_path), tmp_path / "c.jsonl"
    whole = run_campaign(spec, file, 1, work=fake)
    text = file.read_bytes()
    for cut in (1, 40, len(text) - text.index(b"\n"), len(text) - 5):
        file.write_bytes(text[:-cut])
        assert run_campaign(spec, file, 1, work=fake) == whole
        assert file.read_bytes() == text


def test_a_disk_that_is_full_ends_a_campaign_that_goes_on_later(tmp_path, monkeypatch):
    spec, file, write = replace(campaign(tmp_path), runs=8), tmp_path / "c.jsonl", os.write
    left = iter((10_000, 10_000, 10_000, 100))  # the fourth line is cut short
    with monkeypatch.context() as patch:
        patch.setattr(journal.os, "write", lambda where, line: write(where, line[: next(left)]))
        with pytest.raises(InputError, match=r"--out: cannot write .*\(No space left"):
            run_campaign(spec, file, 1, work=fake)
    assert len(read_journal(file)[1]) == 2
    assert run_campaign(spec, file, 1, work=fake) == run_campaign(spec, tmp_path / "whole.jsonl", 1, work=fake)


def test_a_journal_belongs_to_one_specification_and_one_process(tmp_path):
    spec, file = campaign(tmp_path), tmp_path / "c.jsonl"
    run_campaign(spec, file, 1, work=fake)
    with pytest.raises(InputError, match="another specification"):
        run_campaign(replace(spec, seed=9), file, 1, work=fake)
    head, _ = read_journal(file)
    with open_journal(file, head), pytest.raises(InputError, match="another process"):
        run_campaign(spec, file, 1, work=fake)
    assert load_rows(file)[0] == spec
    for text, message in (("", "is empty"), ("x\n", "line 1: is no JSON"), ("3\n", "no objects"), ("{}\n", "camp")):
        file.write_text(text)
        with pytest.raises(InputError, match=message):
            load_rows(file)
    with pytest.raises(InputError, match="cannot be read"):
        load_rows(tmp_path / "no.jsonl")


def forged(key: str, value: object):
    return lambda rows: [*rows[:-1], {**rows[-1], key: value}]


@pytest.mark.parametrize(
    ("forge", "reason"),
    [
        (lambda rows: [*rows, rows[1]], "line 10: row 1: is there twice"),
        (lambda rows: [*rows[:-1], {**rows[0], "row": 8}], r"row 8: is none of the campaign's 8 \(0 to 7\)"),
        (forged("row", -1), "row -1: is none of"),
        (forged("row", "7"), r"line 9: is no row of a campaign \(Expected `int`, got `str` - at `\$.row`"),
        (forged("row", 6), "line 9: row 6: is there twice"),
        (forged("seed", 1), r"row 7: has seed 1, not \d+"),
        (forged("values", {}), "row 7: was run with controller.tyre_model = None, not affine"),
        (lambda rows: [{**rows[0], "values": rows[0]["values"] | {"speed": 1.0}}], "row 0: was run with speed = 1.0"),
        (forged("margin_m", -0.1), "row 7: says that it passed, with margin_m -0.1"),
        (forged("error", "PlantError: fell over"), "row 7: says that it passed, with error 'PlantError: fell over'"),
        (forged("margin_m", float("nan")), "row 7: has a margin_m of nan"),
        (forged("verdict", True), "line 9: is no row of a campaign"),
        (lambda rows: [{"row": 0}], "line 2: is no row of a campaign"),
    ],
)
def test_rows_that_the_campaign_did_not_run_are_refused(tmp_path, forge, reason):
    """They counted as runs: a journal of four runs and a failure became a pass of seven."""
    spec, file = replace(campaign(tmp_path), runs=8), tmp_path / "c.jsonl"
    rows = [{**fake(case), "verdict": "pass", "label": "ok", "margin_m": 0.3} for case in cases(spec)]
    run_campaign(spec, file, 1, work=fake)
    head = file.read_text().splitlines()[0]
    file.write_text("\n".join([head, *map(json.dumps, rows), ""]))
    assert len(load_rows(file)[1]) == 8
    before = "\n".join([head, *map(json.dumps, forge(rows)), ""])
    file.write_text(before)
    with pytest.raises(InputError, match=reason):
        run_campaign(spec, file, 1, work=fake)
    with pytest.raises(InputError, match=reason):
        load_rows(file)
    assert file.read_text() == before


def test_a_process_that_dies_is_a_row(tmp_path):
    rows = run_campaign(replace(campaign(tmp_path), runs=9), tmp_path / "c.jsonl", 2, work=deadly)
    assert [row["row"] for row in rows] == list(range(9))
    assert [row["error"] for row in rows] == [None] * 7 + ["the process that ran it died", None]


def test_what_a_case_raises_is_a_row(tmp_path):
    spec = campaign(tmp_path)
    row = run_case(replace(spec, set={"plant.kind": "nothing.fmu"}), cases(spec)[0])
    assert (row["verdict"], row["label"], row["margin_m"]) == ("fail", "error", None)
    assert row["error"].startswith("InputError")


@pytest.mark.closed_loop
def test_rows_are_the_same_in_one_process_in_two_and_on_a_cluster(tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    spec = replace(campaign(tmp_path), runs=6)
    alone = run_campaign(spec, tmp_path / "1.jsonl", 1)
    assert {(row["verdict"], row["label"]) for row in alone} == {("inconclusive", "scene too short")}
    assert run_campaign(spec, tmp_path / "2.jsonl", 2) == alone
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
        assert run_campaign(spec, tmp_path / "3.jsonl", dask=cluster.scheduler_address) == alone


# Report


def test_a_campaign_ends_in_a_verdict_a_report_and_test_cases(tmp_path):
    spec = campaign(tmp_path)
    rows = [
        *run_campaign(spec, tmp_path / "c.jsonl", 1, work=fake)[1:],
        run_case(replace(spec, set={"a": 1}), cases(spec)[0]),
    ]
    summary = summarised(spec, rows)
    failed = sum(row["values"]["plant.noise"] >= 1.25 for row in rows[:-1]) + 1
    assert (summary["n"], summary["failures"], summary["verdict"]) == (40, failed, "fail")
    assert failed / 40 < summary["failure_rate_upper_bound_95"] < failed / 40 + 0.2
    assert summarised(replace(spec, failure_rate=0.9), rows)["verdict"] == "pass"
    assert summary["influences"][0]["key"] == "plant.noise"
    assert telling(rows[:-1], influences(rows))[0] == "plant.noise"
    write_campaign_report(tmp_path / "r.html", spec, rows, summary, {"Command": "sidestep campaign"})
    html = (tmp_path / "r.html").read_text()
    page = check_self_contained(html)
    text = " ".join(" ".join(page.words).split())
    assert f"FAIL: 40 runs, {failed} failures, 0 inconclusive" in text
    assert "plant.noise 0 to 2" in text
    write_junit(tmp_path / "j.xml", spec.name, junit_cases(spec, rows))
    suite = ElementTree.parse(tmp_path / "j.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("40", str(failed - 1), "1")
    assert len(suite.findall("testcase/failure")) == failed - 1


@pytest.mark.parametrize(
    ("counts", "allowed", "verdict", "bound"),
    [
        ((20, 0, 0), None, "pass", 1.0 - 0.05 ** (1 / 20)),
        ((19, 0, 1), None, "inconclusive", 1.0 - 0.05 ** (1 / 19)),
        ((18, 1, 1), None, "fail", upper_bound(1, 19)),
        ((19, 0, 1), 0.3, "pass", 1.0 - 0.05 ** (1 / 19)),
        ((15, 0, 5), 0.3, "inconclusive", 1.0 - 0.05 ** (1 / 15)),
        ((10, 9, 1), 0.3, "fail", upper_bound(9, 19)),
        ((0, 0, 20), 0.3, "inconclusive", 1.0),
        ((0, 0, 20), None, "inconclusive", 1.0),
    ],
)
def test_inconclusive_runs_are_neither_passes_nor_failures(tmp_path, counts, allowed, verdict, bound):
    spec = replace(campaign(tmp_path), runs=20, failure_rate=allowed)
    names = ("pass", "fail", "inconclusive")
    verdicts = [name for name, count in zip(names, counts, strict=True) for _ in range(count)]
    rows = [{**fake(case), "verdict": one} for case, one in zip(cases(spec), verdicts, strict=True)]
    summary = summarised(spec, rows)
    assert (summary["verdict"], summary["failures"], summary["inconclusive"]) == (verdict, *counts[1:])
    assert summary["failure_rate_upper_bound_95"] == pytest.approx(bound)
    assert sentence(summary).startswith(f"{verdict.upper()}: 20 runs, {counts[1]} failures, {counts[2]} inconclusive")
    cases_of = junit_cases(spec, rows)
    assert [sum(bool(getattr(c, kind)) for c in cases_of) for kind in ("failure", "error")] == list(counts[1:])


@pytest.mark.parametrize("passed", [0, 1, 5])
def test_reports_of_small_and_of_hopeless_campaigns(tmp_path, passed):
    spec = campaign(tmp_path, 'scenario = "moose"\nruns = 5\nvary.speed = {low = 1.0, high = 2.0}')
    rows = [
        {
            **run_case(replace(spec, set={"x": 0}), case),
            "verdict": "pass" if case.row < passed else "fail",
            "margin_m": 0.1 * case.row or None,
        }
        for case in cases(spec)
    ]
    for chosen in (rows, rows[:1]):
        write_campaign_report(tmp_path / "r.html", spec, chosen, summarised(spec, chosen), {})
        check_self_contained((tmp_path / "r.html").read_text())


def test_sensitivity_is_that_of_the_ishigami_function():
    """S_1 = 0.3139, S_2 = 0.4424, S_3 = 0 for a = 7, b = 0.1 (Ishigami and Homma 1990)."""
    x = np.pi * (2.0 * Sobol(3, scramble=False).random_base2(14)[1:].T - 1.0)
    y = np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])
    assert [first_order(row, y) for row in x] == pytest.approx([0.3139, 0.4424, 0.0], abs=0.005)
    assert trend(x[0], y) > 0.3
    assert abs(trend(x[1], y)) < 0.05
    assert first_order(np.sign(x[0]), np.sign(x[0])) == pytest.approx(1.0)
    assert first_order(np.zeros(9), np.arange(9.0)) == first_order(np.arange(9.0), np.zeros(9)) == 0.0
    assert trend(np.zeros(9), np.arange(9.0)) == 0.0
    assert separation(np.arange(100.0), np.arange(100) > 89) == pytest.approx(1.0)
    assert separation(x[0], x[1] > 0.0) < 0.03


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


# What a campaign varies of the car


def test_a_late_car_does_what_it_was_told_that_much_earlier():
    commands = [SteeringCommand(0.0, 0.01 * k, 10.0 + k) for k in range(20)]
    prompt, late = KinematicCar(), KinematicCar()
    delayed = ImperfectSteering(late, delay=0.05)
    for _ in range(2):  # the second time as the first
        prompt.applied.clear()
        late.applied.clear()
        prompt.reset(VehicleState(v_x=9.0))
        delayed.reset(VehicleState(v_x=9.0, steer_angle=0.3))
        for command in commands:
            prompt.step(command, 0.01)
            delayed.step(command, 0.01)
        told = [(command.steer_angle, command.target_speed) for command in late.applied]
        assert told[:5] == [(0.3, 9.0)] * 5
        assert told[5:] == [(command.steer_angle, command.target_speed) for command in prompt.applied[:15]]


def test_mass_and_stiffness_change_the_car_and_not_what_the_controller_knows():
    scenario = load_scenario("moose", ["plant.kind=linear", "plant.mass=1.2", "plant.stiffness=0.9"])
    known, true = scenario.vehicle, true_vehicle(scenario)
    assert open_controller(scenario).vehicle is known  # pyright: ignore[reportAttributeAccessIssue]
    assert true.mass / known.mass == pytest.approx(1.2)
    assert true.yaw_inertia / known.yaw_inertia == pytest.approx(1.2)
    loaded = true_vehicle(load_scenario("moose", ["plant.kind=linear", "plant.mass=1.2"]))  # tyres under more load
    assert loaded.cornering_stiffness_rear > known.cornering_stiffness_rear
    for name in ("cornering_stiffness_front", "cornering_stiffness_rear"):
        assert getattr(true, name) / getattr(loaded, name) == pytest.approx(0.9)
    with pytest.raises(
        InputError, match=r"plant\.mass: 1\.2: the plant x does not know it; allowed: only with linear, "
    ):
        open_plant(load_scenario("moose", ["plant.kind=x.fmu", "plant.mass=1.2"]))


class Noting:
    """A controller that keeps what it is told."""

    plan = None

    def __init__(self):
        self.states = []

    def reset(self):
        self.states = []

    def step(self, state):
        self.states.append(state)
        return SteeringCommand(state.time, 0.0, 10.0)


def test_noise_has_its_size_its_seed_and_leaves_time_alone():
    inner = Noting()
    scenario = load_scenario("moose", ["plant.noise=2", "plant.measured_offset=0.3"])
    measured = ImperfectMeasurement(inner, scenario.plant)
    true = VehicleState(time=3.0, x=10.0, y=-4.0, yaw=2.0, v_x=8.0)

    def told():
        measured.reset()
        for _ in range(4000):
            measured.step(true)
        return np.array([[getattr(state, name) for name in VehicleState.__slots__] for state in inner.states])

    states = told()
    assert np.array_equal(told(), states)
    expected = np.array([getattr(true, name) for name in VehicleState.__slots__])
    expected[1:3] += 0.3 * np.array([-np.sin(2.0), np.cos(2.0)])  # to the left of the car
    deviation = 2.0 * np.array([getattr(NOISE, name) for name in VehicleState.__slots__])
    assert np.all(np.abs(states.mean(axis=0) - expected) <= 5.0 * deviation / np.sqrt(4000) + 1e-12)
    assert states.std(axis=0) == pytest.approx(deviation, rel=0.05, abs=1e-12)


def test_what_identification_fits_has_noise_of_its_size_and_seed():
    true = {name: np.linspace(0.0, 1.0, 4000) for name in ("steer_angle", "v_y", *FITTED_NOISE)}
    drive = measured(true, 2.0, (7, 1))
    for name, values in drive.items():
        assert np.std(values - true[name]) == pytest.approx(2.0 * FITTED_NOISE.get(name, 0.0), rel=0.05)
    assert np.array_equal(measured(true, 2.0, (7, 1))["yaw_rate"], drive["yaw_rate"])
    assert not np.allclose(measured(true, 2.0, (7, 2))["yaw_rate"], drive["yaw_rate"])


def test_figures_of_a_row_are_json_and_those_of_the_run():
    run = drive(duration=0.5)
    row = figures(run.scenario, run.recording, run.judgement)
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert row["margin_m"] == min(run.judgement.min_clearance, run.judgement.min_edge_clearance)
    assert row["rms_lateral_error_m"] == pytest.approx(run.summary["rms_lateral_error_m"])


def test_ctrl_c_keeps_what_is_done(tmp_path):
    spec, file = campaign(tmp_path), tmp_path / "c.jsonl"
    script = "import sys, campaign_work; campaign_work.go_on(*sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path), str(file)], cwd=ROOT / "tests", stderr=subprocess.PIPE
    )
    while process.poll() is None and (not file.exists() or file.read_bytes().count(b"\n") < 3):
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    assert b"KeyboardInterrupt" in errors
    assert len(run_campaign(spec, file, 1, work=fake)) == 40
