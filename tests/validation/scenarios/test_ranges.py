"""Every number that a scenario file or `--set` can hold is refused by name, or gives a run that ends."""

import math
import re
from dataclasses import MISSING, fields
from typing import get_type_hints

import pytest

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.surface import FrictionPatch
from sidestep.plant_models.ranges import Range, bounded_fields
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.scenarios.schema import tables

TABLES = {table.name: table.cls for table in tables()}
KEYS = {f"{table.name}.{key.name}".lstrip("."): key.range for table in tables() for key in table.keys if key.range}
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
@pytest.mark.parametrize(("path", "limits"), KEYS.items(), ids=list(KEYS))
def test_no_value_hangs_or_breaks(path, limits, drive):
    refused = 0
    for value in (*ABSURD, limits.low, limits.high):
        value = int(value) if isinstance(limits.low, int) and math.isfinite(value) and abs(value) < 2**63 else value
        inside = limits.low <= value <= limits.high
        try:
            drive(path, value)
            assert inside
        except PlantError:
            assert inside
        except InputError as error:
            refused += 1
            if not inside:
                shown = str(error).replace("[0]", "[]")
                assert re.search(rf"\b{re.escape(path)}: ", shown)
                assert f"{value}" in shown
                assert str(limits) in shown
    assert refused >= 5


@pytest.mark.parametrize(("table", "cls"), TABLES.items(), ids=list(TABLES))
def test_every_number_has_a_range(table, cls):
    numbers = {name for name, kind in get_type_hints(cls).items() if kind in (int, float, float | None)}
    if not table.startswith("road.segments"):  # whose bounds are the road's own, see test_road.py
        assert numbers == {bounded.name for bounded in bounded_fields(cls)}


@pytest.mark.parametrize(("table", "cls"), TABLES.items(), ids=list(TABLES))
def test_ranges_hold_their_defaults(table, cls):
    defaults = {field.name: field.default for field in fields(cls) if field.default not in (MISSING, None)}
    for name, limits, *_ in bounded_fields(cls):
        assert limits.low < limits.high
        if name in defaults:
            limits.check(defaults[name], name, isinstance(defaults[name], int))


@pytest.mark.parametrize("value", [True, "wide", None, [1.0], math.nan, 1.0 + 1e-9])
def test_a_range_takes_numbers_only(value):
    with pytest.raises(InputError, match=r"^a\.b: .*allowed: (a number, )?0 to 1 m$"):
        Range(0.0, 1.0, "m").check(value, "a.b")


def test_dataclasses_hold_to_their_ranges_without_a_file():
    with pytest.raises(InputError, match=r"patch\.friction: 0\.0; allowed: 0\.001 to 10$"):
        FrictionPatch(0.0, 0.0, 1.0, 1.0, 0.0)
