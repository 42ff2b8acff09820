"""`identify --log` and `validate --log`: files, statuses, sentences; the envelope and the replay behind them."""

import json

import numpy as np
import pytest
from support.measured_logs import CHASSIS, MAP, log_table, true_values, write_table

from sidestep.controller.validity import Validity
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.cli.main import main
from sidestep.validation.model_error.identification.identified_file import read_identified
from sidestep.validation.model_error.logs.mapping import LogMap
from sidestep.validation.model_error.logs.measured import load_log
from sidestep.validation.model_error.measured.replay import replay, summary
from sidestep.validation.model_error.measured.scores import MODELS, score_all, starts_of

TRUE = true_values()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two logs of one car, the first identified."""
    place = tmp_path_factory.mktemp("logs")
    for seed, name in enumerate(("fitted", "other")):
        write_table(place / f"{name}.csv", log_table(TRUE, seed, 60.0))
    (place / "map.toml").write_text(MAP, encoding="utf-8")
    options = ["--log", str(place / "fitted.csv"), "--map", str(place / "map.toml"), "--out", str(place / "car.toml")]
    assert main(["identify", *options]) == 0
    return place


@pytest.fixture(scope="module")
def validated(folder):
    options = ["--log", str(folder / "other.csv"), "--map", str(folder / "map.toml"), "--out", str(folder / "report")]
    assert main(["validate", *options, "--identified", str(folder / "car.identified.json")]) == 0
    return folder / "report"


def test_the_vehicle_file_holds_what_was_found_and_says_how_sure_it_is(folder):
    car = VehicleParameters.from_file(folder / "car.toml")
    assert car.mass == CHASSIS.mass
    assert car.cornering_stiffness_front == pytest.approx(TRUE.C_f, rel=0.05)
    assert car.yaw_inertia == pytest.approx(TRUE.I_z, rel=0.08)
    head = (folder / "car.toml").read_text(encoding="utf-8")
    assert "# C_f = " in head
    assert "95 %" in head
    assert "# Told: l_f, l_r, mass" in head


def test_the_json_file_reads_back(folder):
    found, chassis, name = read_identified(folder / "car.identified.json")
    assert chassis == CHASSIS
    assert name == "fitted.csv"
    assert found.known("C_f")
    assert found.values.I_z == pytest.approx(TRUE.I_z, rel=0.08)


def test_the_report_judges_a_log_that_was_not_fitted(validated):
    figures = json.loads((validated / "summary.json").read_text(encoding="utf-8"))
    assert figures["passed"]
    best, linear = figures["models"]["Magic Formula"], figures["models"]["linear"]
    assert best["explained"]["yaw_rate"] > max(0.99, linear["explained"]["yaw_rate"])
    assert best["offset_p95_m"]["0-4"] < linear["offset_p95_m"]["0-4"]
    page = (validated / "report.html").read_text(encoding="utf-8")
    assert all(words in page for words in ("Steady turns", "By manoeuvre", "Validity envelope", "Our controller"))


def test_the_controller_takes_the_envelope(validated):
    limits = Validity.from_file(validated / "validity.json", "affine")
    assert limits.frictions.tolist() == [1.0]
    assert (limits.limits >= 0.0).all()
    assert limits.limits.max() > 1.0


def test_our_controller_follows_the_driven_line_as_the_driver_did(folder, tmp_path):
    """A driver who steers slowly enough for the line to show it."""
    write_table(tmp_path / "calm.csv", log_table(TRUE, 5, 40.0, acceleration=4.0, fastest=0.3))
    car = VehicleParameters.from_file(folder / "car.toml")
    found = replay(load_log(tmp_path / "calm.csv", LogMap({}, car, ())), TRUE, CHASSIS, car)
    assert found is not None
    numbers = summary(found)
    assert numbers["offset_max_m"] < 0.5
    assert numbers["steer_correlation"] > 0.95
    assert set(found.status) <= {"TRACKING", "DEGRADED"}


def test_the_true_car_predicts_to_the_noise_and_a_bank_of_its_own_adds_nothing(folder):
    log = load_log(folder / "other.csv", LogMap({}, VehicleParameters.preset("bmw-320i"), ()))
    starts = starts_of(log)
    scores = {s.model: s for s in score_all(log, TRUE, TRUE, CHASSIS, starts)}
    assert set(scores) == set(MODELS)
    assert scores["Magic Formula"].explained["yaw_rate"] > 0.998
    assert np.percentile(np.abs(scores["Magic Formula"].offset), 95.0) < 0.1


def test_a_log_alone_is_split(folder, capsys):
    options = ["--log", str(folder / "other.csv"), "--map", str(folder / "map.toml"), "--out", str(folder / "alone")]
    assert main(["validate", *options]) == 0
    assert json.loads((folder / "alone" / "summary.json").read_text(encoding="utf-8"))["fitted_to"].startswith("every")


def test_a_log_that_tells_nothing_writes_no_vehicle_file(folder, tmp_path, capsys):
    write_table(tmp_path / "calm.csv", log_table(TRUE, 0, 30.0, acceleration=0.2))
    options = [
        "--log",
        str(tmp_path / "calm.csv"),
        "--map",
        str(folder / "map.toml"),
        "--out",
        str(tmp_path / "no.toml"),
    ]
    assert main(["identify", *options]) == 1
    assert not (tmp_path / "no.toml").exists()
    assert "too little steering" in capsys.readouterr().out


@pytest.mark.parametrize(("options", "words"), [
    (["identify", "--log", "LOG"], "--map: missing beside --log"),
    (["identify", "--log", "LOG", "--map", "MAP", "--plant", "linear"], "--plant: makes no difference beside --log"),
    (["identify", "--log", "LOG", "--map", "MAP", "--set", "plant.noise=1"], "--set: makes no difference"),
    (["validate", "--log", "LOG", "--map", "MAP", "--quick"], "--quick: makes no difference"),
    (["validate", "--log", "LOG", "--map", "MAP", "--set", "vehicle.mass=900"], "makes no difference beside --log"),
    (["validate", "--log", "none.csv", "--map", "MAP"], "--log: no file 'none.csv'"),
    (["validate", "--log", "LOG", "--map", "MAP", "--identified", "MAP"], "a file of `sidestep identify --log`"),
    (["validate", "--plant", "linear", "--identified", "MAP"], "--identified: makes no difference"),
])  # fmt: skip
def test_what_is_wrong_is_one_line(folder, capsys, options, words):
    known = {"LOG": str(folder / "other.csv"), "MAP": str(folder / "map.toml")}
    assert main([known.get(word, word) for word in options]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_a_file_of_another_kind_is_refused(tmp_path):
    (tmp_path / "x.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="identify --log"):
        read_identified(tmp_path / "x.json")
