"""What a notebook needs: values as overrides, a run with report and film, short and rich forms, tables, figures."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.html_page import Page
from support.stored_runs import drive as kinematic

import sidestep
from sidestep.plant_models.errors import InputError
from sidestep.validation.report.signals_figure import draw_signal
from sidestep.validation.report.topview import draw_plan_of, draw_run
from sidestep.validation.report.usage_figure import draw_friction_circle, draw_phase_plane, draw_prediction_errors
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.runs import DrivenRun


@pytest.fixture(scope="module")
def run():
    return kinematic(duration=2.0)


def test_values_are_as_good_as_overrides():
    told = load_scenario("double-obstacle", ["speed=12.5", "plant.friction=0.6", 'plant.kind="linear"'])
    given = load_scenario("double-obstacle", speed=12.5, plant={"friction": np.float64(0.6), "kind": "linear"})
    assert given.tables == told.tables
    assert (given.speed, given.plant) == (told.speed, told.plant)
    moved = load_scenario("double-obstacle", **{"obstacles.0.l": -0.25, "road.width_left": 5})
    assert moved.obstacles[0].l == -0.25
    assert load_scenario("double-obstacle", obstacles=[]).obstacles == ()
    one = load_scenario("double-obstacle", obstacles=[{"s": 30.0, "l": 0.0, "length": 4.0, "width": 2.0}])
    assert [o.s for o in one.obstacles] == [30.0]


def test_values_that_no_file_holds_are_refused():
    with pytest.raises(InputError, match="nothing that a scenario file holds"):
        load_scenario("double-obstacle", speed=object())
    with pytest.raises(InputError, match="sped"):
        load_scenario("double-obstacle", sped=3.0)


def test_forms_are_short_and_say_what_counts(run):
    shown = [run, run.scenario, run.recording, run.judgement, run.recording.plans[0]]
    assert all(len(repr(one)) < 200 for one in shown)
    assert "'single-obstacle', 15 m/s" in repr(run.scenario)
    assert f"{len(run.recording.plans)} plans" in repr(run.recording)
    assert run.judgement.label in repr(run.judgement)
    for one in shown[1:]:
        Page(one._repr_html_())  # whole, each element closed
        assert len(one._repr_html_()) < 5000
    assert "&lt;b&gt;" in replace(run.scenario, description="<b>")._repr_html_()


def test_a_recording_becomes_a_table(run):
    pandas = pytest.importorskip("pandas")
    table = run.recording.to_pandas()
    assert isinstance(table, pandas.DataFrame)
    assert list(table.columns) == list(run.recording.samples)
    assert np.array_equal(table["yaw_rate"], run.recording["yaw_rate"])
    assert table.attrs["units"]["yaw_rate"] == "rad/s"


def test_without_pandas_the_table_says_what_it_needs(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"sidestep\[pandas\]"):
        run.recording.to_pandas()


def test_every_drawing_takes_an_axis_and_draws_in_it(run):
    drawings = [
        lambda axes: draw_signal(axes, run.recording, "yaw_rate", color="k"),
        lambda axes: draw_run(axes, run.scenario, run.recording, run.judgement),
        lambda axes: draw_plan_of(axes, run.scenario, run.recording, run.recording.plans[3]),
        lambda axes: draw_friction_circle(axes, run.scenario, run.recording),
        lambda axes: draw_phase_plane(axes, run.recording),
        lambda axes: draw_prediction_errors(axes, run.scenario, run.recording),
    ]
    for draw in drawings:
        axes = Figure().subplots()
        draw(axes)
        assert axes.has_data()
    axes = Figure().subplots()
    draw_signal(axes, run.recording, "yaw_rate")
    assert axes.lines[0].get_ydata()[-1] == np.degrees(run.recording["yaw_rate"][-1])
    assert axes.get_title() == "yaw rate  [deg/s]"
    with pytest.raises(InputError, match="yaw_rat"):
        draw_signal(axes, run.recording, "yaw_rat")


@pytest.mark.closed_loop
def test_a_drive_writes_nothing_until_it_is_asked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = sidestep.drive(load_scenario("single-obstacle", duration=0.4, plant={"kind": "linear"}))
    assert list(tmp_path.iterdir()) == []
    assert run.summary["can"]["interface"] == "off"
    report = run.report()
    assert report.relative_to("runs/single-obstacle").name == "report.html"
    assert sorted(file.name for file in report.parent.iterdir()) == [
        "recording.csv", "report.html", "steps.csv", "summary.json",
    ]  # fmt: skip
    assert run.report(tmp_path / "elsewhere").parent == tmp_path / "elsewhere"
    assert "<svg" in run._repr_html_()


@pytest.mark.closed_loop
def test_the_page_on_reports_runs_as_it_stands(tmp_path, monkeypatch):
    page = (Path(sidestep.__file__).parent / "docs" / "reports.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    assert (tmp_path / "runs" / "moose" / "report.html").is_file()
    assert (tmp_path / "offset.png").stat().st_size > 10_000


@pytest.mark.render
def test_a_run_of_any_plant_is_filmed(tmp_path, run):
    from PIL import Image

    driven = DrivenRun(run.scenario, run.recording, run.judgement, run.summary, tmp_path)
    with Image.open(driven.film(tmp_path / "run.gif")) as film:
        assert film.n_frames == pytest.approx(40, abs=1)
    with pytest.raises(InputError, match="gif"):
        driven.film(tmp_path / "run.txt")
