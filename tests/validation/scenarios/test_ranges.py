"""Every number that a scenario file or `--set` can hold is refused by name, or gives a run that ends."""

import math
import re
from typing import get_type_hints

import pytest

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.surface import FrictionPatch
from sidestep.plant_models.ranges import Range, bounded_fields
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.scenarios.keys import TABLES, numeric_keys
from sidestep.validation.scenarios.scenario import load_scenario

KEYS = list(numeric_keys())
ABSURD = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e-308, 0.0)
SCENE = """
speed = 15.0
duration = 0.1
road = { width_left = 4.0, width_right = 4.0, segments = [{ type = "line", length = 150.0 }] }
obstacles = [{ s = 40.0, l = -0.5, length = 4.5, width = 1.8 }]
[vehicle.suspension]
[plant]
kind = "linear"
"""
ON_MUJOCO = ("plant.patches[]", "plant.heights", "plant.grade", "plant.bank")


@pytest.fixture
def drive(tmp_path):
    """Set one key of a small scene to a value and drive it; what is refused raises."""
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    (tmp_path / "flat.csv").write_text("0,0\n0,0\n", encoding="utf-8")

    def drive(path: str, value: float) -> None:
        settings = [f"{path.replace('[]', '.0')}={value!r}"]
        if path.startswith(ON_MUJOCO):
            settings.insert(0, "plant.kind=mujoco")
        if path.startswith("plant.patches"):
            settings.insert(1, "plant.patches=[{s=0.0, l=0.0, length=1.0, width=1.0, friction=0.5}]")
        if path.startswith("plant.heights"):
            settings.insert(1, 'plant.heights={path="flat.csv", spacing=100.0, x=-9.0, y=-9.0}')
        recording, _ = simulate(load_scenario(tmp_path / "scene.toml", settings))
        assert len(recording["time"])

    return drive


@pytest.mark.closed_loop
@pytest.mark.filterwarnings("ignore:(overflow|invalid value|divide by zero):RuntimeWarning")  # of cars that blow up
@pytest.mark.parametrize("key", KEYS, ids=lambda key: key.path)
def test_no_value_hangs_or_breaks(key, drive):
    refused = 0
    for value in (*ABSURD, key.range.low, key.range.high):
        value = int(value) if isinstance(key.range.low, int) and math.isfinite(value) and value < 1e300 else value
        inside = key.range.low <= value <= key.range.high
        try:
            drive(key.path, value)
            assert inside
        except PlantError:
            assert inside
        except InputError as error:
            refused += 1
            if not inside:
                shown = str(error).replace("[0]", "[]")
                assert re.search(rf"\b{re.escape(key.path)}: ", shown)
                assert f"{value}" in shown
                assert str(key.range) in shown
    assert refused >= 5


@pytest.mark.parametrize(("table", "cls"), TABLES.items(), ids=list(TABLES))
def test_every_number_has_a_range(table, cls):
    numbers = {name for name, kind in get_type_hints(cls).items() if kind in (int, float, float | None)}
    assert numbers == {bounded.name for bounded in bounded_fields(cls)}
    assert numbers or table == ""


def test_ranges_hold_their_defaults():
    for key in KEYS:
        assert key.range.low < key.range.high
        if key.default is not None:
            key.range.check(key.default, key.path, isinstance(key.default, int))


@pytest.mark.parametrize("value", [True, "wide", None, [1.0], math.nan, 1.0 + 1e-9])
def test_a_range_takes_numbers_only(value):
    with pytest.raises(InputError, match=r"^a\.b: .*allowed: (a number, )?0 to 1 m$"):
        Range(0.0, 1.0, "m").check(value, "a.b")


def test_dataclasses_hold_to_their_ranges_without_a_file():
    with pytest.raises(InputError, match=r"patch\.friction: 0\.0; allowed: 0\.001 to 10$"):
        FrictionPatch(0.0, 0.0, 1.0, 1.0, 0.0)
