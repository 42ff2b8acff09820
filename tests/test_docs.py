"""What the documentation says of the code, held against the code."""

import importlib
import re
import runpy
from ast import literal_eval
from dataclasses import fields
from pathlib import Path

import pytest

from sidestep.controller import ControllerConfig
from sidestep.controller.mpc.grid import grid
from sidestep.controller.records import LAYERS, SLACKS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
CONTROLLER = (ROOT / "docs" / "controller.md").read_text(encoding="utf-8")
EQUATIONS = CONTROLLER.partition("## Where")[2].partition("\n## ")[0]


def test_settings_table_is_that_of_the_code():
    rows = re.findall(r"^\| (`.*?) \| (.*?) \|", CONTROLLER.partition("## Settings")[2], re.MULTILINE)
    documented = {key: literal_eval(default) for keys, default in rows for key in re.findall(r"`(\w+)`", keys)}
    assert documented == {f.name: f.default for f in fields(ControllerConfig)}


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(\w+\.\w+)`", EQUATIONS))))
def test_every_function_of_the_equation_table_exists(name):
    module, function = name.split(".")
    files = [file for top in ("plant_models", "controller") for file in (ROOT / top).rglob(f"{module}.py")]
    dotted = ["sidestep." + ".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files]
    assert any(callable(getattr(importlib.import_module(one), function, None)) for one in dotted)


def test_every_equation_of_the_paper_has_a_place():
    rows = re.findall(r"^\| (\(.*?) \|", EQUATIONS, re.MULTILINE)
    spans = [re.findall(r"\d+", part) for row in rows for part in row.split(",")]
    assert sorted(n for span in spans for n in range(int(span[0]), int(span[-1]) + 1)) == list(range(1, 17))


def test_sizes_in_the_data_flow_are_those_of_the_code():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    level, block, _ = grid(ControllerConfig().period)
    assert f"lattice of {LAYERS} layers" in page
    assert f"{len(level)} nodes" in page
    assert f"{block[-1] + 1} steering rates, {SLACKS} slacks" in page


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_files_lead_somewhere(page):
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_pages_made_from_the_code_are_up_to_date(capsys, monkeypatch):
    tool = runpy.run_path(str(ROOT / "tools" / "pages.py"))
    monkeypatch.setattr("sys.argv", ["pages.py", "--check"])
    assert tool["main"]() == 0, capsys.readouterr().out


def test_a_page_that_is_old_is_named(capsys, monkeypatch):
    tool = runpy.run_path(str(ROOT / "tools" / "pages.py"))
    monkeypatch.setattr("sys.argv", ["pages.py", "--check"])
    monkeypatch.setitem(tool["PAGES"], "scenarios.md", lambda: "# Another page\n")
    assert tool["main"]() == 1
    assert capsys.readouterr().out == "docs/scenarios.md is not what python tools/pages.py writes\n"


def test_every_test_that_a_page_names_is_there():
    written = "\n".join(file.read_text(encoding="utf-8") for file in (ROOT / "tests").rglob("test_*.py"))
    for page in PAGES:
        for name in re.findall(r"`(test_\w+)`", page.read_text(encoding="utf-8")):
            assert f"def {name}(" in written, f"{page.name}: {name}"


def test_every_file_that_a_page_names_is_there():
    """Programs of this repository, from its root: those that a command runs and those that a sentence names."""
    for page in PAGES:
        for name in re.findall(r"\b(?:benchmarks|tools|tests|examples)/[\w/]+\.(?:py|toml)\b", page.read_text("utf-8")):
            assert (ROOT / name).exists(), f"{page.name}: {name}"
