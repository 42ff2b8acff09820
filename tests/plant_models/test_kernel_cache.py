"""Compiled code is kept between processes, and never outlives a source that went into it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sidestep.plant_models.kernels as kernels
from sidestep.plant_models.kernels import kernel, source_stamp

PACKAGE = Path(kernels.__file__).resolve().parent
_CURVATURE = """
import numpy as np
from sidestep.plant_models.road import reference_path, segments
road = reference_path.ReferencePath.from_segments([segments.Arc(50.0, 0.01)])
value = road.curvature(np.array([10.0]))[0]
hits = sum(reference_path._curvatures.stats.cache_hits.values())
print(value, hits, reference_path.__file__)
"""


@pytest.fixture
def copy(tmp_path):
    """Folder of a copy of `plant_models` that is imported as the product is."""
    shutil.copytree(PACKAGE, tmp_path / "sidestep/plant_models", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(PACKAGE.parent / "__init__.py", tmp_path / "sidestep")
    return tmp_path / "sidestep/plant_models"


def curvature(copy: Path) -> tuple[float, int]:
    """Of a bend with 0.01 1/m as a process that imports the copy sees it, and how much came out of the cache."""
    unset = ("NUMBA_CACHE_DIR", "NUMBA_DISABLE_JIT")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment["PYTHONPATH"] = str(copy.parents[1])
    command = [sys.executable, "-S", "-c", f"import sys; sys.path += {sys.path!r}\n{_CURVATURE}"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=True)
    value, hits, file = done.stdout.split()
    assert Path(file).is_relative_to(copy)
    return float(value), int(hits)


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert text.count(old) >= 1
    file.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.closed_loop
def test_a_kernel_follows_a_change_in_a_kernel_that_it_inlines(copy):
    assert curvature(copy) == (0.01, 0)
    assert curvature(copy) == (0.01, 1)  # the next process compiles nothing
    edit(copy / "road/clothoid.py", "return table[row, 4] +", "return 3.0 * table[row, 4] +")
    value, hits = curvature(copy)
    assert value == pytest.approx(0.03)
    assert hits == 0


@pytest.mark.parametrize(
    ("changed", "kernels_of", "new"),
    [
        ("tyres/contact.py", "tyres/contact.py", True),
        ("tyres/formula.py", "tyres/contact.py", True),
        ("tyres/parameters.py", "tyres/contact.py", True),  # its constants
        ("tyres/formula.py", "mujoco/loop.py", True),  # through contact.py
        ("kernels.py", "speed_control.py", True),
        ("tyres/contact.py", "tyres/formula.py", False),
        ("mujoco/looks.py", "mujoco/loop.py", False),
    ],
)
def test_the_stamp_of_a_file_covers_what_it_imports(copy, monkeypatch, changed, kernels_of, new):
    monkeypatch.setattr(kernels, "_PACKAGES", copy.parent)
    before = stamp(copy / kernels_of)
    with (copy / changed).open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert (stamp(copy / kernels_of) != before) is new


def stamp(file: Path) -> str:
    source_stamp.cache_clear()
    kernels._read.cache_clear()
    try:
        return source_stamp(file)
    finally:
        source_stamp.cache_clear()
        kernels._read.cache_clear()


def test_versions_count(monkeypatch):
    file = PACKAGE / "speed_control.py"
    before = stamp(file)
    monkeypatch.setattr(kernels, "_VERSIONS", (*kernels._VERSIONS[:-1], "0.0"))
    assert stamp(file) != before


def test_every_kernel_has_this_decorator():
    for layer in ("plant_models", "controller", "fmu", "validation"):
        for file in (PACKAGE.parent / layer).rglob("*.py"):
            found = re.findall(r"^\s*@(?:numba\.)?n?jit\b", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert found == [], file


def twice(x):
    return 2.0 * x


def test_the_function_itself_stays_at_hand():
    compiled = kernel(twice)
    assert compiled(1.5) == 3.0
    assert getattr(compiled, "py_func", compiled) is twice


@pytest.mark.closed_loop
@pytest.mark.parametrize("how", ["cut", "empty", "garbage", "one bit"])
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_what_is_damaged_in_the_cache_is_compiled_again(tmp_path, monkeypatch, ending, how):
    monkeypatch.setattr(kernels.numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "tripled.py").write_text("def tripled(x):\n    return 3.0 * x\n")

    def hits() -> int:
        """Of a fresh process' compiler, as far as the cache can tell."""
        names: dict = {}
        exec(compile((tmp_path / "tripled.py").read_text(), str(tmp_path / "tripled.py"), "exec"), names)
        compiled = kernel(names["tripled"])
        assert compiled(1.5) == 4.5
        return sum(compiled.stats.cache_hits.values())

    assert [hits(), hits()] == [0, 1]
    [file] = (tmp_path / "cache").rglob(f"*.{ending}")
    data = file.read_bytes()
    flipped = data[:-60] + bytes([data[-60] ^ 1]) + data[-59:]
    file.write_bytes({"cut": data[: len(data) // 2], "empty": b"", "garbage": b"garbage", "one bit": flipped}[how])
    assert [hits(), hits()] == [0, 1]
