"""Runs read back, rated, overlaid; MF4."""

import json
import shutil
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from support.html_page import check_self_contained
from support.stored_runs import drive, stored

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.main import main
from sidestep.validation.loop.recording import STEP_UNITS
from sidestep.validation.report.compare.compare import evidence, pairs, read_runs
from sidestep.validation.report.compare.golden import TOLERANCES
from sidestep.validation.report.exports.mdf import require_mdf, write_mdf


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for name, aim in (("a", 1.0), ("b", 1.0), ("c", 1.2)):
        stored(drive(overrides=["obstacles=[]"], aim=aim, duration=4.0), folder / name)
    return [folder / name for name in "abc"]


def test_runs_come_back_as_they_were(folders):
    run = read_runs(folders[:1])[0]
    again = drive(overrides=["obstacles=[]"], aim=1.0, duration=4.0)
    assert run.name == "linear"
    for part in ("speed", "start", "obstacles", "vehicle", "controller", "plant"):
        assert getattr(run.scenario, part) == getattr(again.scenario, part)
    assert np.array_equal(run.samples["l"], again.recording["l"])
    assert [one.name for one in read_runs(folders)] == [str(folder) for folder in folders]  # all are "linear"


def test_the_same_run_rates_one_and_another_less(folders):
    rated = pairs(read_runs(folders))
    assert len(rated) == 3 * len(TOLERANCES)
    same = [pair for pair in rated if {pair.reference, pair.other} == {str(folders[0]), str(folders[1])}]
    assert [pair.overall for pair in same] == [1.0] * len(TOLERANCES)
    assert all(0.0 < pair.overall < 1.0 for pair in rated if pair not in same)


def test_what_never_changes_is_not_rated(folders, tmp_path):
    stored(drive(overrides=["obstacles=[]"], duration=2.0), tmp_path / "straight")
    rated = pairs(read_runs([tmp_path / "straight", folders[0]]))
    assert all(pair.rating is None and "never changes" in str(pair) for pair in rated)
    assert all(
        cell == "–" for cell in evidence(read_runs([tmp_path / "straight", folders[0]]), rated)[-1].table.rows[0][2:]
    )


def test_a_comparison_is_a_page_test_cases_and_an_exit_status(folders, tmp_path, capsys):
    arguments = ["compare", *map(str, folders), "--out", str(tmp_path / "out"), "--junit", str(tmp_path / "j.xml")]
    assert main(arguments) == 0
    assert capsys.readouterr().out.count("1.000 (excellent)") == len(TOLERANCES)
    check_self_contained((tmp_path / "out" / "report.html").read_text())
    assert main([*arguments, "--least", "0.999"]) == 1
    assert "FAIL: lowest rating" in capsys.readouterr().out
    assert ElementTree.parse(tmp_path / "j.xml").getroot().get("failures") == str(2 * len(TOLERANCES))
    assert main(["compare", str(folders[0])]) == 2


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("", None, "b/summary.json: cannot be read (No such file or directory); allowed: a folder that `sidestep run`"),
        ("summary.json", "{", "b/summary.json: is no JSON (Expecting"),
        ("summary.json", "[]", "b/summary.json: is not that of one run"),
        ("summary.json", '{"runs": []}', "b/summary.json: is not that of one run"),
        ("recording.csv", None, "b/recording.csv: cannot be read (No such file"),
        ("recording.csv", "", "b/recording.csv: is cut short in line 1"),
        ("recording.csv", "time [s]\n1.0", "b/recording.csv: is cut short in line 2"),
        ("recording.csv", "time [s],x [m]\n1.0\n", "b/recording.csv: has 1 values in line 2, not 2"),
        ("recording.csv", "time [s],x [m]\n1.0,fast\n", "b/recording.csv: holds something else (could not convert"),
        ("recording.csv", "time [s],x [m]\n1.0,2.0\n", "b/recording.csv: lacks y, yaw"),
    ],
)
def test_what_is_no_run_says_which_file_and_why(folders, name, text, words, tmp_path, capsys):
    if name:
        shutil.copytree(folders[1], tmp_path / "b")
        (tmp_path / "b" / name).unlink()
        if text is not None:
            (tmp_path / "b" / name).write_text(text)
    assert main(["compare", str(folders[0]), str(tmp_path / "b"), "--out", str(tmp_path / "out")]) == 2
    assert f"{tmp_path}/{words}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_run_of_a_scenario_with_files_comes_back(tmp_path):
    (tmp_path / "track.csv").write_text("x [m],y [m]\n0,0\n50,0\n100,1\n150,0\n")
    (tmp_path / "mine.toml").write_text(
        'speed = 10.0\nduration = 1.0\nroad = { width_left = 4.0, width_right = 4.0, waypoints = "track.csv" }\n'
    )
    stored(drive(tmp_path / "mine.toml", duration=0.5), tmp_path / "a")
    (run,) = read_runs([tmp_path / "a"])
    assert (run.scenario.name, run.scenario.path.length) == ("mine", pytest.approx(150.0, abs=1.0))


def test_mf4_holds_both_groups_with_their_units(tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="needs the extra mdf")
    run = drive(duration=0.5)
    write_mdf(tmp_path / "r.mf4", run.recording, "a run")
    with asammdf.MDF(tmp_path / "r.mf4") as mdf:
        yaw_rate, status = mdf.get("yaw_rate", group=0), mdf.get("status", group=1)
        assert np.array_equal(yaw_rate.samples, run.recording["yaw_rate"])
        assert np.allclose(yaw_rate.timestamps, run.recording["time"])
        assert yaw_rate.unit == "rad/s"
        assert len(status.samples) == len(run.recording.steps["status"])
        assert {channel.name for channel in mdf.groups[1].channels} == set(STEP_UNITS)


def test_without_asammdf_nothing_is_driven(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(InputError, match=r"sidestep\[mdf\]"):
        require_mdf()
    assert main(["run", "single-obstacle", "--plant", "linear", "--mf4", "--out", str(tmp_path / "r")]) == 2
    assert not (tmp_path / "r").exists()
    assert "asammdf" in capsys.readouterr().err


def test_summary_holds_what_makes_the_scenario_again(folders):
    assert json.loads((folders[0] / "summary.json").read_text())["tables"]["obstacles"] == []
