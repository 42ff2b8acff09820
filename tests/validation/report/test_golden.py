"""Funnels, and runs that are held to the recordings in golden/ beside this file.

Nothing but a command changes these: `sidestep golden record`, or, for all of them, this file as a program
"""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.stored_runs import drive, stored

from sidestep.validation.cli.main import main
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.report.compare.golden import TIME_TOLERANCE, check, funnel, read_golden, record
from sidestep.validation.scenarios.scenario import load_scenario

GOLDEN = Path(__file__).parent / "golden"
CASES = {
    "double-obstacle-linear-paper": ("double-obstacle", ["plant.kind=linear", "controller.preset=paper"]),
    "double-obstacle-linear": ("double-obstacle", ["plant.kind=linear"]),
    "double-obstacle-single-track": ("double-obstacle", ["plant.kind=single-track"]),
}
TIME = np.arange(0.0, 4.0, 0.01)


@pytest.mark.closed_loop
@pytest.mark.parametrize("name", CASES)
def test_runs_stay_within_the_funnels_of_golden_recordings(name):
    scene, overrides = CASES[name]
    recording, _ = simulate(load_scenario(scene, overrides))
    departures = check(recording.samples, read_golden(GOLDEN / f"{name}.csv", scene))
    assert [str(departure) for departure in departures if not departure.passed] == []


def test_every_golden_recording_is_used():
    assert {file.stem for file in GOLDEN.iterdir()} == set(CASES)


@given(
    late=st.floats(-TIME_TOLERANCE, TIME_TOLERANCE), off=st.floats(-0.02, 0.02),
    phase=st.floats(0.0, 6.3), frequency=st.floats(0.1, 3.0),
)  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_what_is_little_late_and_little_off_stays_within(late, off, phase, frequency):
    def wave(time):
        return np.sin(2.0 * np.pi * frequency * time + phase)

    inside = (TIME > TIME_TOLERANCE) & (TIME[-1] - TIME_TOLERANCE > TIME)
    slack = (2.0 * np.pi * frequency * 0.01) ** 2 / 8.0  # a crest between two samples
    excess = funnel(TIME, wave(TIME), 0.02 + slack).excess(TIME, wave(TIME - late) + off)
    assert np.all(excess[inside] <= 1e-12)


@pytest.mark.parametrize("off", [0.05, -0.05])
def test_what_is_further_off_is_outside_by_that_much(off):
    excess = funnel(TIME, np.ones_like(TIME), 0.02).excess(TIME, np.full_like(TIME, 1.0 + off))
    assert np.allclose(excess, 0.03)


def test_what_comes_much_later_is_outside():
    step = (TIME > 2.0).astype(float)
    excess = funnel(TIME, step, 0.02).excess(TIME, (TIME > 2.0 + 2.0 * TIME_TOLERANCE).astype(float))
    assert TIME[np.argmax(excess)] == pytest.approx(2.0 + TIME_TOLERANCE, abs=0.015)
    assert excess.max() == pytest.approx(0.98)


def test_a_run_that_ends_too_early_is_outside(tmp_path):
    record(drive(duration=1.0).recording.samples, "moose", tmp_path / "g.csv")
    golden = read_golden(tmp_path / "g.csv", "moose")
    assert all(departure.passed for departure in check(drive(duration=2.0).recording.samples, golden))
    departures = check(drive(duration=0.5).recording.samples, golden)
    assert all(np.isinf(departure.worst) for departure in departures)
    assert str(departures[0]) == "l: has ended at 0.51 s"


def test_only_the_command_changes_what_is_golden(tmp_path, capsys):
    for name, aim in (("a", 0.0), ("b", 0.5)):
        stored(drive(aim=aim, duration=1.0, overrides=["obstacles=[]"]), tmp_path / name)
    a, b, golden = (str(tmp_path / name) for name in ("a", "b", "g.csv"))
    assert main(["golden", "record", a, golden]) == 0
    before = Path(golden).read_bytes()
    assert main(["golden", "check", a, golden, "--junit", str(tmp_path / "j.xml")]) == 0
    assert main(["golden", "check", b, golden, "--junit", str(tmp_path / "j.xml")]) == 1
    assert "rad outside at" in capsys.readouterr().out
    assert 'failures="' in (tmp_path / "j.xml").read_text()
    assert Path(golden).read_bytes() == before
    assert main(["golden", "record", b, golden]) == 0
    assert main(["golden", "check", b, golden]) == 0


def test_only_a_golden_recording_of_the_same_scenario_is_one(tmp_path, capsys):
    stored(drive(duration=1.0), tmp_path / "a")
    stored(drive("moose", duration=1.0, overrides=["obstacles=[]"]), tmp_path / "moose")
    stored(drive(), tmp_path / "failed")
    golden = tmp_path / "g.csv"
    assert main(["golden", "record", str(tmp_path / "failed"), str(golden)]) == 2
    assert "did not pass: fail: collision; allowed: one that did" in capsys.readouterr().err
    assert not golden.exists()
    assert main(["golden", "record", str(tmp_path / "moose"), str(golden)]) == 0
    others = {
        golden: "is of the scenario 'moose', the run of 'single-obstacle'",
        tmp_path / "a" / "recording.csv": "is no golden recording",
        tmp_path / "none.csv": "cannot be read (No such file",
    }
    for file, words in others.items():
        assert main(["golden", "check", str(tmp_path / "a"), str(file)]) == 2
        assert words in capsys.readouterr().err


if __name__ == "__main__":
    for case, (scene, overrides) in CASES.items():
        record(simulate(load_scenario(scene, overrides))[0].samples, scene, GOLDEN / f"{case}.csv")
