"""The bound of a failure rate, against its definition and published numbers; files of results."""

import csv
import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from scipy.stats import binom

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.main import main
from sidestep.validation.studies.limits import Outcome, counted, in_parallel, kept_rows, upper_bound, write_outcome


@pytest.mark.parametrize(("runs", "percent"), [(50, 5.8), (300, 1.0), (2995, 0.1)])
def test_no_failure_bounds_the_rate(runs, percent):
    assert 100.0 * upper_bound(0, runs) == pytest.approx(percent, abs=0.06)
    assert upper_bound(0, runs) == pytest.approx(1.0 - 0.05 ** (1.0 / runs))


@pytest.mark.parametrize(("failures", "runs"), [(1, 20), (3, 100), (17, 40)])
def test_at_the_bound_so_few_failures_have_five_percent(failures, runs):
    assert binom.cdf(failures, runs, upper_bound(failures, runs)) == pytest.approx(0.05)


def test_failures_only_bound_nothing():
    assert upper_bound(4, 4) == 1.0
    assert counted(0, 0) == "no run"
    assert counted(0, 300) == "0 of 300, rate at most 0.99 %"


@dataclass(frozen=True)
class Row:
    name: str
    value: float


def test_rows_are_written_as_csv_and_json(tmp_path: Path):
    rows = [Row("a", 1.5), Row("b", math.nan)]
    write_outcome(tmp_path / "new", Outcome("things", {"total": 1.5}, rows, False), "sidestep limits things")
    with (tmp_path / "new" / "things.csv").open(newline="") as stream:
        assert list(csv.reader(stream)) == [["name", "value"], ["a", "1.5"], ["b", "nan"]]
    assert json.loads((tmp_path / "new" / "things.json").read_text()) == {
        "command_line": "sidestep limits things",
        "passed": False,
        "total": 1.5,
        "rows": [{"name": "a", "value": 1.5}, {"name": "b", "value": None}],
    }


def test_rows_are_in_the_file_as_soon_as_they_are_done(tmp_path: Path):
    file = tmp_path / "things.csv"
    write_outcome(tmp_path, Outcome("things", {}, [Row("earlier", 0.0)] * 9, True), "")
    keep = kept_rows(tmp_path, "things")
    assert (tmp_path / "things.json").exists()
    assert file.read_text().count("earlier") == 9
    keep(Row("a", 1.5))
    assert file.read_text().splitlines() == ["name,value", "a,1.5"]
    keep(Row("b", math.nan))
    assert file.read_text().splitlines() == ["name,value", "a,1.5", "b,nan"]
    assert not (tmp_path / "things.json").exists()


def test_a_disk_that_fills_up_is_named(tmp_path: Path):
    (tmp_path / "things.csv").symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"--out: cannot write to .*No space left"):
        kept_rows(tmp_path, "things")(Row("a", 1.5))


def test_results_come_in_the_order_of_the_calls():
    done = []
    calls = [partial(pow, n, 2) for n in range(6)]
    assert in_parallel("squares", calls, 1, done.append) == done == [0, 1, 4, 9, 16, 25]


@pytest.mark.parametrize(
    ("command", "change"),
    [
        ("scenes", "plant.kind=linear"), ("delay", "controller.period=0.1"),
        ("delay", "controller.input_delay_steps=2"),
        ("moose", "speed=10"), ("moose", "obstacles.0.l=3"), ("moose", "duration=3"), ("optimum", "plant.kind=linear"),
        ("endurance", "obstacles=[]"),
    ],
)  # fmt: skip
def test_what_a_study_sets_itself_is_refused(command, change, tmp_path, capsys):
    assert main(["limits", command, "--set", change, "--out", str(tmp_path / "x")]) == 2
    key = change.partition("=")[0]
    assert f"--set {key}: makes no difference here: this study sets it; allowed: " in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
