"""Plants by name: the registry, factories of other people's, and one of them through every subcommand."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import SteeringCommand
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.cli.arguments import PLANTS
from sidestep.validation.cli.main import main
from sidestep.validation.loop import plant_factory, plants
from sidestep.validation.loop.plants import BUILT_IN, PLANT_KINDS, ROLLING, PlantKind, open_plant
from sidestep.validation.model_error import plant_report
from sidestep.validation.report import report
from sidestep.validation.scenarios.plant_settings import PlantSettings
from sidestep.validation.scenarios.scenario import load_scenario

ROOT = Path(__file__).parents[3]
NAME = "examples.plant_by_name:sliding_car"
SOURCE = """
from sidestep.plant_models.linear.plant import LinearPlant

class Shop:
    @staticmethod
    def car(vehicle, obstacles, path):
        plant = LinearPlant(vehicle)
        plant.seen = len(obstacles), path.length
        return plant

def fussy(vehicle, wind): ...
class Fragile(LinearPlant):
    def step(self, command, dt):
        return super().step(command, dt / (self._state.time < 0.5))

def broken(vehicle): raise ValueError("no such car")
def nothing(vehicle): return object()
value = 3
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that is found from the working directory alone."""
    (tmp_path / "strangers_cars.py").write_text(SOURCE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield "strangers_cars"
    sys.modules.pop("strangers_cars", None)


@pytest.fixture
def at_root(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])


def scene(kind, *overrides):
    return load_scenario("single-obstacle", [f"plant.kind={json.dumps(kind)}", *overrides])


# The registry


def test_built_in_kinds_are_entries_like_any_other(monkeypatch):
    assert PLANT_KINDS == ("linear", "single-track", "double-track", "mujoco")
    assert PLANTS.split(", ")[: len(PLANT_KINDS)] == list(PLANT_KINDS)
    assert ROLLING == ("double-track", "mujoco")
    monkeypatch.setitem(BUILT_IN, "mine", PlantKind(lambda scenario, vehicle: LinearPlant(vehicle)))
    with open_plant(scene("mine")) as plant:
        assert isinstance(plant, LinearPlant)
    with pytest.raises(
        InputError, match=r"plant\.mass: 1\.1: the plant mine does not know it; allowed: only with linear"
    ):
        open_plant(scene("mine", "plant.mass=1.1"))


@pytest.mark.parametrize(
    ("kind", "setting"),
    [
        ("linear", "plant.friction=0.5"),
        ("linear", "plant.roll_centre=0.1"),
        ("single-track", "plant.roll_centre=0.1"),
        ("single-track", "plant.bank=0.1"),
        ("double-track", "plant.tyre=contact"),
        ("mujoco", "plant.isolate=1.0"),
        ("mujoco", "plant.map=x.toml"),
        (NAME, "plant.grade=0.1"),
    ],
)
def test_what_would_make_no_difference_is_refused(kind, setting, at_root):
    name = setting.partition("=")[0]
    with pytest.raises(InputError, match=f"{name}: .*does not know it; allowed: only with "):
        open_plant(scene(kind, setting))


def test_every_setting_is_known_to_some_plant():
    known = {name for kind in (*BUILT_IN.values(), *plants.BY_ENDING.values()) for name in kind.knows}
    assert known | set(plants._COMMON) == set(PlantSettings.__dataclass_fields__)


def test_roll_centres_of_the_plant_alone():
    with open_plant(scene("mujoco", "plant.roll_centre=0.1")) as plant:
        chassis = plant._vehicle.suspension
    assert (chassis.roll_centre_front, chassis.roll_centre_rear) == (0.1, 0.1)
    assert load_scenario("single-obstacle").vehicle.suspension.roll_centre_rear == 0.0


# Factories


def test_a_factory_gets_what_it_asks_for(module):
    with open_plant(scene(f"{module}:Shop.car")) as plant:
        assert plant.seen == (1, scene("linear").path.length)
    assert scene(f"{module}:Shop.car").plant.name == "Shop.car"


@pytest.mark.parametrize(
    ("name", "setting", "problem", "kind"),
    [
        ("nowhere:car", "", "cannot import 'nowhere'", InputError),
        ("strangers_cars:van", "", "'strangers_cars' has no 'van'", InputError),
        ("strangers_cars:value", "", "cannot be called", InputError),
        ("strangers_cars:fussy", "", "asks for 'wind'; allowed: vehicle, path, obstacles, friction", InputError),
        ("strangers_cars:nothing", "", "makes something without 'reset'", InputError),
        ("strangers_cars:broken", "", "ValueError: no such car", PlantError),
        ("strangers_cars:Shop.car", "plant.friction=0.5", "does not take it", InputError),
    ],
)
def test_a_bad_factory_is_one_line(module, name, setting, problem, kind, capsys):
    with pytest.raises(kind, match=problem):
        open_plant(scene(name, *([setting] if setting else [])))
    assert (
        main(["run", "single-obstacle", "--plant", name, "--can", "off", *(["--set", setting] if setting else [])]) == 2
    )
    assert capsys.readouterr().err.count("\n") == 1


def test_a_plant_that_breaks_down_ends_the_run_and_leaves_no_traceback(module, tmp_path, capsys):
    name = f"{module}:Fragile"
    assert main(["run", "single-obstacle", "--plant", name, "--can", "off", "--out", str(tmp_path / "r")]) in (1, 2)
    told = capsys.readouterr()
    assert "Traceback" not in told.out + told.err
    with open_plant(scene(name)) as plant:
        state = plant.reset(scene(name).start)
        while state.time < 0.5:
            state = plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.01)
        with pytest.raises(PlantError, match="ZeroDivisionError"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.01)


@pytest.fixture
def package(module, tmp_path):
    """As pip installs it: metadata beside the module."""
    folder = tmp_path / "strangers_cars-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: strangers-cars\nVersion: 1.0\n", encoding="utf-8")
    points = f"[{plant_factory.GROUP}]\nshop-car = {module}:Shop.car\n"
    (folder / "entry_points.txt").write_text(points, encoding="utf-8")
    sys.path.append(str(tmp_path))
    plant_factory.installed_plants.cache_clear()
    yield
    plant_factory.installed_plants.cache_clear()


def test_a_package_gives_its_plant_a_name(package):
    with open_plant(scene("shop-car")) as plant:
        assert plant.seen[0] == 1
    with pytest.raises(InputError, match=r"unknown plant 'shop-cat', did you mean shop-car\?"):
        open_plant(scene("shop-cat"))


# The example, through every subcommand


def test_the_example_is_a_plant(at_root):
    with open_plant(scene(NAME, "plant.mass=1.2", "plant.friction=0.8")) as plant:
        assert plant.vehicle.mass == pytest.approx(1.2 * VehicleParameters.preset("bmw-320i").mass)
        assert check_plant(plant, plant.vehicle) == []


@pytest.mark.parametrize("can", ["off", "virtual:by-name"])
def test_it_runs_alone_and_on_a_bus(can, at_root, tmp_path):
    assert main(["run", "single-obstacle", "--plant", NAME, "--can", can, "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert (summary["plant"], summary["verdict"]) == ("sliding_car", "pass")


def test_it_is_a_node_on_a_bus_between_processes(at_root, multicast_spec, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "run_report", lambda run: "<!doctype html>")
    common = ["single-obstacle", "--can", multicast_spec, "--set", "duration=4.0"]
    command = [sys.executable, "-m", "sidestep.validation", "can", "drive", *common, "--out", str(tmp_path / "c")]
    with subprocess.Popen(command) as controller:
        assert main(["can", "plant", *common, "--plant", NAME, "--out", str(tmp_path / "p")]) == 0
        assert controller.wait(60.0) == 0
    summary = json.loads((tmp_path / "p" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["plant"], summary["can"]["refused"]) == ("sliding_car", 0)


@pytest.mark.closed_loop
def test_it_is_validated_by_worker_processes(at_root, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(plant_report, "QUICK_SPEEDS", (10.0, 20.0))
    monkeypatch.setattr(plant_report, "QUICK_SHARES", (0.1, 0.3))
    assert main(["validate", "--plant", NAME, "--quick", "--jobs", "2", "--out", str(tmp_path)]) == 0
    assert "PASS: from 7.5 m/s on" in " ".join(capsys.readouterr().out.split())
    assert main(["validate", "--plant", NAME, "--manoeuvre", "pulse", "--out", str(tmp_path)]) == 0


@pytest.mark.closed_loop
def test_it_is_identified(at_root, tmp_path):
    file = tmp_path / "found.toml"
    assert main(["identify", "--plant", NAME, "--out", str(file)]) == 0
    found, true = VehicleParameters.from_file(file), VehicleParameters.preset("bmw-320i")
    assert found.cornering_stiffness_front == pytest.approx(true.cornering_stiffness_front, rel=0.05)


@pytest.mark.closed_loop
def test_a_campaign_drives_it_in_worker_processes(at_root, tmp_path):
    spec = tmp_path / "spec.toml"
    lines = (
        'scenario = "single-obstacle"', "runs = 4", "seed = 1", "[set]", f'plant.kind = "{NAME}"', "[vary]",
        "plant.friction = { low = 0.7, high = 1.0 }", "plant.mass = { low = 1.0, high = 1.2 }",
    )  # fmt: skip
    spec.write_text("\n".join(lines), encoding="utf-8")
    assert main(["campaign", str(spec), "--jobs", "2", "--out", str(tmp_path / "c")]) in (0, 1)
    rows = [json.loads(line) for file in (tmp_path / "c").glob("*.jsonl") for line in file.read_text().splitlines()]
    assert [row["label"] for row in rows if "label" in row] == ["ok"] * 4


@pytest.mark.closed_loop
def test_the_limits_are_measured_on_it(at_root, tmp_path, capsys):
    assert main(["limits", "delay", "--plant", NAME, "--out", str(tmp_path)]) in (0, 1)
    assert f"on {NAME}" in " ".join(capsys.readouterr().out.split())
    assert (tmp_path / "delay.csv").is_file()
