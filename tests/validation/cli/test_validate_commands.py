"""`sidestep validate` and `sidestep identify` from end to end, on the plant that is quickest."""

import errno
import json
import os
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

from sidestep.fmu.native.build import build_fmu
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.cli.main import main
from sidestep.validation.loop.recording import read_columns
from sidestep.validation.manoeuvres.catalogue import MANOEUVRES
from sidestep.validation.manoeuvres.driven import LANES, iso_3888_1
from sidestep.validation.model_error import plant_report
from sidestep.validation.model_error.identification.vehicle_file import vehicle_toml
from sidestep.validation.scenarios.scenario import load_scenario


def test_validate_writes_report_charts_and_limits(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(plant_report, "QUICK_SPEEDS", (10.0, 20.0))
    monkeypatch.setattr(plant_report, "QUICK_SHARES", (0.1, 0.3))
    junit = tmp_path / "verdicts.xml"
    command = ["validate", "--plant", "linear", "--quick", "--jobs", "1", "--out", str(tmp_path)]
    assert main([*command, "--junit", str(junit)]) == 0
    limits = json.loads((tmp_path / "validity.json").read_text(encoding="utf-8"))
    for model in ("linear", "affine"):  # one car, whichever tyres the controller predicts
        assert limits["max_lateral_acceleration"][model] == [pytest.approx([3.06, 3.06], abs=0.01)]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in (
        "PASS: from 7.5 m/s on",
        "Validity envelope, curved road",
        "Step halving",
        "T90",
        "Theil",
        "coherence",
    ):
        assert text in page
    assert {file.name for file in tmp_path.glob("*.png")} == {
        "envelope-straight.png", "envelope-curved.png", "limits.png"
    }  # fmt: skip
    assert "FAIL" not in capsys.readouterr().out
    suite = ElementTree.parse(junit).getroot()[0]
    assert [case.get("name") for case in suite] == ["Validity envelope, straight road", "Step halving"]
    assert suite.find("testcase/failure") is None
    assert main([*command, "--set", "plant.stiffness=0.6", "--junit", str(junit)]) == 1  # softer tyres than told
    suite = ElementTree.parse(junit).getroot()[0]
    failure = suite.find("testcase/failure")
    assert failure is not None
    assert failure.attrib["message"].startswith("FAIL: from 7.5 m/s on")


def test_one_manoeuvre_leaves_signals_and_a_picture(tmp_path, capsys):
    assert main(["validate", "--manoeuvre", "pulse", "--plant", "linear", "--out", str(tmp_path)]) == 0
    columns = read_columns(tmp_path / "pulse-1.csv")
    assert columns["time"][-1] == pytest.approx(4.0)
    assert (tmp_path / "pulse-1.png").stat().st_size > 10_000
    assert "yaw rate, 18571" in capsys.readouterr().out


def test_a_disk_that_fills_up_is_one_line(tmp_path, monkeypatch, capsys):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Figure, "savefig", full)
    assert main(["validate", "--manoeuvre", "pulse", "--plant", "linear", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f"sidestep: --out: cannot write to '{tmp_path}' (No space left on device); allowed: a writable folder\n"
    )


def test_the_controller_drives_a_scenario_as_a_manoeuvre(tmp_path, capsys):
    command = ["validate", "--manoeuvre", "single-obstacle", "--plant", "linear", "--junit", str(tmp_path / "j.xml")]
    assert main(command) == 0
    assert "clearance 0.2" in capsys.readouterr().out
    assert main([*command, "--set", "duration=4"]) == 0
    assert main([*command, "--set", "plant.measured_offset=1"]) == 1  # here it counts
    (case,) = ElementTree.parse(tmp_path / "j.xml").getroot()[0]
    assert case[0].get("message") in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--manoeuvres", "--quick"], "--quick: makes no difference beside --manoeuvres"),
        (["--manoeuvres", "--out", "a"], "--out: makes"),
        (["--manoeuvre", ""], "--manoeuvre: ''"),
        (["--manoeuvre", "coast", "--quick"], "--quick: makes no difference beside --manoeuvre coast"),
        (["--manoeuvre", "coast", "--jobs", "2"], "--jobs: makes"),
        (["--manoeuvre", "coast", "--junit", "j.xml"], "--junit: makes"),
        (["--manoeuvre", "moose", "--out", "a"], "--out: makes no difference beside --manoeuvre moose"),
        (["--checks", "--set", "vehicle.mass=1000"], "--set: makes no difference beside --checks"),
        (["--checks", "--jobs", "1"], "--jobs: makes"),
        (["--checks", "--plant", "linear"], "--plant: no checks for 'linear'"),
        (["--set", "plant.noise=1"], "plant.noise: 1.0: only the plant's true state"),
        (["--manoeuvre", "coast", "--set", "plant.measured_offset=0.1"], "plant.measured_offset: 0.1"),
        (["--set", "plant.friction=0.6"], "plant.friction: 0.6: the envelope is driven on (1.0, 0.6, 0.3)"),
        (["--set", "speed=20"], "--set speed: makes no difference here"),
        (["--set", "controller.preset=paper"], "--set controller.preset: makes"),
    ],
)
def test_what_would_be_ignored_is_refused(arguments, words, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["validate", *arguments]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"sidestep: {words}")
    assert (shown.out, shown.err.count("\n"), list(tmp_path.iterdir())) == ("", 1, [])


def test_manoeuvres_are_listed_and_an_unknown_one_is_refused(capsys):
    assert main(["validate", "--manoeuvres"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in (*MANOEUVRES, "iso-3888-1", "double-obstacle"))
    assert main(["validate", "--manoeuvre", "loop"]) == 2
    assert capsys.readouterr().err.startswith("sidestep: --manoeuvre: 'loop'")


def test_lanes_of_iso_3888_1_are_as_wide_and_as_far_apart_as_the_standard_says():
    scenario = iso_3888_1(80.0)
    width, boxes = scenario.vehicle.width, scenario.obstacles
    gaps = [(a.l + a.width / 2.0, b.l - b.width / 2.0) for a, b in zip(boxes[::2], boxes[1::2], strict=True)]
    assert [left - right for right, left in gaps] == pytest.approx([k * width + 0.25 for _, _, k, _ in LANES])
    assert gaps[1][0] - gaps[0][0] == pytest.approx(3.5)
    assert gaps[2][0] == pytest.approx(gaps[0][0])
    ends = [(box.s - box.length / 2.0 - 30.0, box.s + box.length / 2.0 - 30.0) for box in boxes[::2]]
    assert ends == [pytest.approx((start, end)) for start, end, _, _ in LANES]
    assert scenario.speed == pytest.approx(80.0 / 3.6)


def test_identify_writes_the_file_that_the_controller_reads(tmp_path, monkeypatch, capsys):
    file = tmp_path / "found" / "car.toml"
    wrong = ["--set", "vehicle.cornering_stiffness_front=9e4", "--set", "vehicle.yaw_inertia=1400.0"]
    assert main(["identify", "--plant", "linear", "--out", str(file), *wrong]) == 0
    found, car = VehicleParameters.from_file(file), VehicleParameters.preset("bmw-320i")
    assert found.name == "car"
    assert found.cornering_stiffness_front == pytest.approx(9e4, rel=0.01)  # what the plant had
    assert found.yaw_inertia == pytest.approx(1400.0, rel=0.01)
    assert found.cornering_stiffness_rear == pytest.approx(car.cornering_stiffness_rear, rel=0.01)
    said = " ".join(capsys.readouterr().out.split())
    assert "told apart" not in said
    assert "taken for granted, not identified: the default car bmw-320i (nothing told another)" in said
    assert f"mass {car.mass:.5g} kg" in said
    assert f"{found.cornering_stiffness_rear:.5g}" in said  # printed as it is written: per axle
    assert "the default car bmw-320i" in file.read_text()
    monkeypatch.chdir(file.parent)  # from where a built-in scenario finds it
    assert load_scenario("moose", ["vehicle.file=car.toml"]).vehicle.yaw_inertia == found.yaw_inertia


def test_a_mapping_file_tells_identify_the_car(tmp_path, capsys):
    """Motion knows ratios to the mass alone: with another mass, other stiffnesses, as well explained."""
    table, found = tmp_path / "map.toml", []
    for told in ("", "[vehicle]\nmass = 1500.0\n"):
        start = "".join(f'{name} = "{name}_0"\n' for name in ("x", "y", "yaw", "v_x", "v_y", "yaw_rate"))
        table.write_text(f"estimate = []\n[start]\n{start}{told}")
        file = tmp_path / f"car{len(found)}.toml"
        line = ["identify", "--plant", str(build_fmu("linear")), "--map", str(table), "--out", str(file)]
        assert main(line) == 0
        found.append(VehicleParameters.from_file(file))
    car, said = VehicleParameters.preset("bmw-320i"), " ".join(capsys.readouterr().out.split())
    assert [one.mass for one in found] == [car.mass, 1500.0]
    assert found[0].cornering_stiffness_front == pytest.approx(car.cornering_stiffness_front, rel=0.01)
    heavier = 1500.0 / car.mass
    assert found[1].cornering_stiffness_front == pytest.approx(heavier * car.cornering_stiffness_front, rel=0.01)
    assert "the default car bmw-320i (nothing told another), but for mass: mass 1500 kg" in said


def test_identify_drives_an_fmu_that_makes_steps_of_its_own_size(foreign, tmp_path, capsys):
    file, table = tmp_path / "car.toml", foreign[1].read_text()
    (tmp_path / "map.toml").write_text(table + "[vehicle]\npreset = 'bmw-320i'\n")
    line = ["identify", "--plant", str(foreign[0]), "--map", str(tmp_path / "map.toml"), "--out", str(file)]
    assert main(line) in (0, 1)  # a yaw rate from differences may be refused; the car was driven
    assert "taken for granted, not identified: preset bmw-320i: mass 1093.3 kg" in " ".join(
        capsys.readouterr().out.split()
    )


def test_identification_hears_the_noise_of_the_plant(tmp_path, capsys):
    """By a value that it moves, but not out of its interval, and by residuals that are white."""
    file = tmp_path / "car.toml"
    assert main(["identify", "--plant", "linear", "--set", "plant.noise=1", "--out", str(file)]) == 0
    found, true = VehicleParameters.from_file(file), VehicleParameters.preset("bmw-320i")
    error = found.cornering_stiffness_front / true.cornering_stiffness_front - 1.0
    assert 1e-4 < abs(error) < 0.01
    assert "if white (white)" in " ".join(capsys.readouterr().out.split())
    assert main(["identify", "--plant", "linear", "--set", "plant.measured_offset=1"]) == 2


@pytest.mark.parametrize("name", ["bmw-320i", "ford-escort"])
def test_a_vehicle_survives_its_file(name, tmp_path):
    car = VehicleParameters.preset(name)
    (tmp_path / "car.toml").write_text(vehicle_toml(car, "two\nlines"), encoding="utf-8")
    assert VehicleParameters.from_file(tmp_path / "car.toml") == car
