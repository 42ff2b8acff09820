"""What is installed: every package and data file is in the wheel, every requirement is pinned."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SETUPTOOLS = PROJECT["tool"]["setuptools"]
FOLDERS = {name: name.removeprefix("sidestep").lstrip(".").replace(".", "/") for name in SETUPTOOLS["packages"]}
PACKED = {FOLDERS[package]: patterns for package, patterns in SETUPTOOLS["package-data"].items()}
LAYERS = ("plant_models", "controller", "fmu", "validation")
CONSTRAINTS = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_package_is_listed():
    files = [file for top in LAYERS for file in (ROOT / top).rglob("__init__.py")]
    assert {str(file.parent.relative_to(ROOT)) for file in files} == set(FOLDERS.values()) - {""}


@pytest.mark.parametrize("package", sorted(set(FOLDERS) - {"sidestep"}))
def test_every_data_file_is_packed(package):
    folder = ROOT / FOLDERS[package]
    packed = {file for pattern in SETUPTOOLS["package-data"].get(package, ()) for file in folder.glob(pattern)}
    below = [ROOT / other for other in FOLDERS.values() if folder in (ROOT / other).parents]
    data = {
        file
        for file in folder.rglob("*")
        if file.is_file() and not file.suffix.startswith((".py", ".nb")) and not set(below) & set(file.parents)
    }
    parents = {ROOT / other / pattern for other, patterns in PACKED.items() for pattern in patterns}
    assert {file for file in data if not any(file.match(str(pattern)) for pattern in parents)} <= packed


@pytest.mark.parametrize("package", ["sidestep", *(f"sidestep.{layer}" for layer in LAYERS)])
def test_types_are_announced(package):
    assert (ROOT / FOLDERS[package] / "py.typed").is_file()
    assert "py.typed" in SETUPTOOLS["package-data"][package]


def test_the_top_package_is_a_module_and_nothing_else():
    """Its folder is the checkout: what is beside it there is no part of it."""
    assert SETUPTOOLS["package-dir"] == {"sidestep": "."}
    assert SETUPTOOLS["include-package-data"] is False
    assert [file.name for file in ROOT.glob("*.py")] == ["__init__.py"]


def test_every_requirement_is_pinned():
    extras = PROJECT["project"]["optional-dependencies"].values()
    required = PROJECT["project"]["dependencies"] + [name for extra in extras for name in extra]
    pinned = {normalised(line.partition("==")[0]) for line in CONSTRAINTS}
    assert {normalised(re.split(r"[\[<>=!~; ]", name)[0]) for name in required} - pinned == set()


def test_constraints_are_pins_and_nothing_else():
    assert [line for line in CONSTRAINTS if not re.fullmatch(r"[\w.-]+==[\w.]+( ; .+)?", line)] == []
