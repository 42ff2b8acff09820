import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.html_page import check_self_contained
from support.stored_runs import drive

from sidestep.validation.files import made, write_text
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.summary import strict_json
from sidestep.validation.report.report import demo_report, run_report, write_run
from sidestep.validation.report.usage_figure import prediction_errors

DESIGN_KEYS = {
    "scenario", "plant", "verdict", "label", "min_clearance_m", "max_lateral_acceleration", "max_steer_rate",
    "rms_lateral_error_m", "infeasible_steps", "max_slack_m", "step_time_us", "real_time_factor", "can", "versions",
}  # fmt: skip


def test_a_run_report_is_one_whole_page_that_loads_nothing(html):
    page = check_self_contained(html)
    text = " ".join(" ".join(page.words).split())
    assert "FAIL (collision): 1.705 m overlap at obstacles[0]" in text
    assert html.index("FAIL (collision)") < html.index("<svg") < html.index("<h2>Signals") < html.index("<h2>Numbers")
    assert "sidestep run &lt;x&gt;" in html  # what comes from outside is escaped
    assert page.links == ["summary.json", "recording.csv", "steps.csv"]
    assert all(f"--{name}" in html for name in ("ink", "faint", "road", "paper"))


@pytest.mark.parametrize(
    ("scene", "overrides", "car"),
    [
        ("s-curve", [], {}),
        ("single-obstacle", ["obstacles=[]"], {}),
        ("single-obstacle", ["obstacles.0.speed=5"], {}),
        ("single-obstacle", [], {"raises": KeyboardInterrupt(), "raises_at": 0.0}),
        ("single-obstacle", [], {"raises": ValueError("no <more>"), "raises_at": 0.5}),
    ],
)
def test_every_kind_of_run_can_be_reported(scene, overrides, car):
    page = check_self_contained(run_report(drive(scene, overrides, duration=1.0, **car)))
    if car.get("raises_at"):
        assert "ValueError: no <more>" in " ".join(page.words)


def test_the_same_run_gives_the_same_page(collided, html):
    assert run_report(collided) == html


def test_written_files_are_complete_and_agree(tmp_path):
    run = drive(folder=tmp_path, duration=0.5)
    write_run(run)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["recording.csv", "report.html", "steps.csv", "summary.json"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["max_lateral_acceleration"] == np.abs(run.recording["lateral_acceleration"]).max()
    assert summary["tables"]["speed"] == 15.0
    assert len((tmp_path / "recording.csv").read_text().splitlines()) == 1 + 51


def test_predictions_of_a_car_that_does_as_predicted_have_no_error(collided):
    plans = []
    for plan in collided.recording.plans:
        states = plan.states.copy()
        at = plan.time + plan.states_time
        states[:, 0] = np.interp(at, collided.recording["time"], collided.recording["l"]) + 0.1 * plan.states_time
        plans.append(SimpleNamespace(time=plan.time, states_time=plan.states_time, states=states))
    ahead, errors = prediction_errors(replace(collided.recording, plans=plans))
    assert errors.shape[1] == len(ahead) == 5
    assert np.allclose(errors, 0.1 * ahead)
    assert prediction_errors(replace(collided.recording, plans=[]))[1].size == 0


# Summaries


def test_summary_has_every_promised_key(collided):
    s = collided.summary
    assert set(s) >= DESIGN_KEYS
    assert (s["verdict"], s["label"], s["preset"]) == ("fail", "collision", "default")
    assert set(s["step_time_us"]) == {"median", "p99", "max"}
    assert s["step_time_us"]["median"] <= s["step_time_us"]["p99"] <= s["step_time_us"]["max"]
    assert {"python", "sidestep", "numpy", "mujoco"} <= set(s["versions"])
    assert s["real_time_factor"] > 0.0


def test_summary_figures_are_those_of_the_recording():
    run = drive(overrides=["obstacles=[]", "start.l=1"], duration=4.0)
    s, offset = run.summary, run.recording["l"]
    assert s["rms_lateral_error_m"] == pytest.approx(math.sqrt(np.mean(offset**2)))
    assert s["final_rms_lateral_error_m"] == pytest.approx(math.sqrt(np.mean(offset[-101:] ** 2)))
    assert s["final_rms_lateral_error_m"] < s["rms_lateral_error_m"]
    assert s["min_clearance_m"] is None
    assert s["infeasible_steps"] == 0


def test_json_is_strict():
    text = strict_json({"a": math.nan, "b": [math.inf, (1.5, -math.inf)], "c": {"d": None, "e": True}})
    assert json.loads(text, parse_constant=pytest.fail) == {
        "a": None,
        "b": [None, [1.5, None]],
        "c": {"d": None, "e": True},
    }


# Folders and files


def test_a_folder_is_unmade_when_what_follows_is_refused(tmp_path):
    from sidestep.plant_models.errors import InputError

    deep = tmp_path / "a" / "b"
    with pytest.raises(InputError, match="no bus"), made(deep):
        raise InputError("can", "no bus")
    assert list(tmp_path.iterdir()) == []
    with made(deep):
        pass
    assert deep.is_dir()


def test_a_file_that_fails_half_way_leaves_the_old_one(tmp_path):
    file = tmp_path / "a.txt"
    write_text(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(file, "new \ud800")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


# The demo's page


def test_demo_report_shows_every_row_and_the_ones_that_could_not_run(tmp_path):
    runs = [drive(folder=tmp_path, duration=1.0), drive(overrides=["controller.preset=paper"], duration=1.0)]
    missing = {
        "scenario": "single-obstacle", "plant": "single-track", "preset": "default", "verdict": "fail",
        "label": "plant invalid", "detail": "", "error": "no C compiler",
    }  # fmt: skip
    summaries = [{**runs[0].summary, "report": "a/report.html"}, missing, runs[1].summary]
    page = check_self_contained(demo_report(runs, summaries, Verdict.FAIL))
    text = " ".join(" ".join(page.words).split())
    assert "FAIL: 0 of 2 runs passed" in text
    assert "linear (paper)" in text
    assert "plant invalid" in text
    assert page.links == ["a/report.html"]


def test_a_comparison_reaches_as_far_as_both_runs(tmp_path):
    short = drive(duration=0.5)
    long = replace(drive(duration=1.0), folder=tmp_path)
    summaries = [long.summary, short.summary]
    check_self_contained(demo_report([long, short], summaries, Verdict.PASS))
