"""The native FMUs: what is written into them, and how they come to be."""

import ctypes
import importlib.util
import os
import re
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from PIL import Image
from support.fmus.fmu_files import QUICK

from sidestep.fmu.compiling import platforms
from sidestep.fmu.compiling.platforms import PLATFORMS, CompilerError, compile_library
from sidestep.fmu.description.icon import SIZE, draw_icon
from sidestep.fmu.description.plants import MODELS, vehicle_values
from sidestep.fmu.description.variables import ATTRIBUTES, UNITS
from sidestep.fmu.native import build
from sidestep.fmu.native.build import build_fmu
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.vehicle.parameters import VehicleParameters

MODEL = MODELS["single-track"]


@pytest.fixture(params=[2, 3], ids=["FMI2", "FMI3"])
def fmi(request):
    return request.param


@pytest.fixture
def fmu(fmi):
    return build_fmu(fmi=fmi)


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(platforms, "_FLAGS", (*platforms._FLAGS, *QUICK))
    return tmp_path / "cache" / "sidestep"


@pytest.fixture
def no_compiler(empty_cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)


def test_fmpy_finds_nothing_to_complain_of(fmu):
    assert validate_fmu(str(fmu)) == []


def test_fmpy_simulates_it(fmu):
    result = fmpy.simulate_fmu(
        str(fmu), stop_time=1.0, output_interval=0.02, start_values={"steer_angle_command": 0.02, "x_0": 5.0}
    )
    assert result["x"][0] == 5.0
    assert result["time"][-1] == pytest.approx(1.0)
    assert result["y"][-1] > 0.1


def test_description_is_the_table(fmu):
    described = fmpy.read_model_description(fmu).modelVariables
    assert len(described) == len(MODEL.variables)
    for reference, (found, row) in enumerate(zip(described, MODEL.variables, strict=True)):
        causality, variability, initial = ATTRIBUTES[row.kind]
        assert (found.name, found.valueReference) == (row.name, reference)
        assert (found.causality, found.variability) == (causality, variability)
        assert found.unit == (row.unit or None)
        assert found.description == row.description
        assert (None if found.start is None else float(found.start)) == row.start
        if initial:
            assert found.initial == initial


def test_every_derivative_belongs_to_the_state_of_its_name(fmu):
    derivatives = [v for v in fmpy.read_model_description(fmu).modelVariables if v.derivative]
    assert len(derivatives) == 9
    for variable in derivatives:
        assert variable.name == f"der({variable.derivative.name})"


def test_start_values_are_those_of_the_preset():
    car = vehicle_values(VehicleParameters.preset("bmw-320i"))
    starts = {row.name: row.start for model in MODELS.values() for row in model.variables if row.name in car}
    assert starts == car


def test_units_carry_their_exponents(fmu, fmi):
    with zipfile.ZipFile(fmu) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    units = {unit.get("name"): unit[0].attrib for unit in root.iter("Unit")}
    assert units["kg.m2"] == {"kg": "1", "m": "2"}
    assert set(units) == {row.unit for row in MODEL.variables if row.unit}
    assert set(units) <= set(UNITS)


def test_no_output_that_is_a_state_depends_on_an_input(fmu):
    outputs = {u.variable.name: u.dependencies for u in fmpy.read_model_description(fmu).outputs}
    assert [v.name for v in outputs["yaw_rate"]] == ["yaw_rate"]
    assert outputs["lateral_acceleration"] is None  # on everything


def test_every_function_of_both_standards_is_exported(tmp_path):
    headers = Path(fmpy.__file__).parent / "c-code"
    declared = set()
    for header in ("fmi2FunctionTypes.h", "fmi3FunctionTypes.h"):
        declared |= set(re.findall(r"\b(fmi[23]\w+)TYPE\s*\(", (headers / header).read_text()))
    with zipfile.ZipFile(build_fmu()) as archive:
        binary = archive.extract(f"binaries/{fmpy.platform_tuple}/single_track{fmpy.sharedLibraryExtension}", tmp_path)
    library = ctypes.CDLL(binary)
    assert len(declared) > 100
    assert [name for name in sorted(declared) if not hasattr(library, name)] == []


def test_archive_holds_documentation_and_all_sources(fmu, fmi, tmp_path):
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    page = (tmp_path / "documentation" / "index.html").read_text()
    icon = tmp_path / ("model.png" if fmi == 2 else "terminalsAndIcons/icon.png")
    with Image.open(icon) as image:
        assert image.size == (SIZE, SIZE)
        assert len(image.getcolors(SIZE * SIZE)) > 2
    assert all(f"<td>{row.name}</td>" in page for row in MODEL.variables)
    assert "$" not in page
    compile_library(tmp_path / "sources", tmp_path / "again.so", QUICK)  # as anybody could
    binary = next((tmp_path / "binaries").glob("*/single_track.*"))
    assert binary.parent.name == (fmpy.platform if fmi == 2 else fmpy.platform_tuple)


def test_every_kind_of_fmu_has_its_own_icon():
    icons = {draw_icon(name) for name in ("single_track", "double_track", "steering_controller")}
    assert len(icons) == 3


@pytest.mark.parametrize("model", MODELS)
def test_expected_output_is_what_another_importer_gets(model, fmi, tmp_path):
    file = build_fmu(model, fmi)
    with zipfile.ZipFile(file) as archive:
        table = archive.extract("documentation/expected_output.csv", tmp_path)
    expected = np.genfromtxt(table, delimiter=",", names=True)
    inputs = expected[["time", "steer_angle_command", "target_speed", "acceleration"]]
    held = np.repeat(inputs, 2)[1:-1]  # fmpy interpolates: a step stands as two rows at the same time
    held["time"][0::2] = inputs["time"][:-1]
    held["time"][1::2] = inputs["time"][1:]
    for name in ("steer_angle_command", "target_speed", "acceleration"):
        held[name][1::2] = held[name][0::2]
    names = [row.name for _, row in MODELS[model].of_kind("state")]
    found = fmpy.simulate_fmu(str(file), stop_time=4.0, output_interval=0.02, input=held, output=names)
    assert np.abs(expected["y"]).max() > 0.5
    for name in names:
        np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=1e-9, err_msg=name)


def test_second_build_compiles_nothing_and_both_standards_share_the_binary(empty_cache, monkeypatch):
    compiled = []
    monkeypatch.setattr(
        build, "compile_library", lambda s, o, platform: (compiled.append(o), compile_library(s, o, platform=platform))
    )
    first = build_fmu(fmi=3)
    before = first.read_bytes()
    assert build_fmu(fmi=3) == first
    build_fmu(fmi=2)
    assert len(compiled) == 1
    for file in empty_cache.iterdir():
        file.unlink()
    assert build_fmu(fmi=3).read_bytes() == before  # reproducible
    assert len(compiled) == 2


def test_two_builds_may_race(empty_cache):
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: build_fmu(), range(2))
    assert first == second
    assert validate_fmu(str(first)) == []
    assert len(list(empty_cache.iterdir())) == 2  # binary and FMU, nothing left over


def test_out_gets_a_copy(tmp_path, fmi):
    out = tmp_path / "car.fmu"
    assert build_fmu(fmi=fmi, out=out) == out
    assert out.read_bytes() == build_fmu(fmi=fmi).read_bytes()


def test_no_compiler_names_the_ways_out(no_compiler):
    with pytest.raises(CompilerError) as caught:
        build_fmu()
    for way in ("no-such-compiler", "gcc", "sidestep[cross]", "--plant linear"):
        assert way in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, PlantError)


def test_ziglang_stands_in_for_a_missing_compiler(no_compiler, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == "ziglang")
    assert platforms.find_compiler()[:4] == [sys.executable, "-m", "ziglang", "cc"]


@pytest.fixture
def zig_that_copies(empty_cache, monkeypatch):
    """For every other platform, a file that says which; zig itself takes minutes at first."""
    monkeypatch.setattr(platforms.importlib.util, "find_spec", lambda name: name == "ziglang")
    monkeypatch.setattr(build, "compiler_version", lambda command: "zig")

    def compile_or_copy(sources, output, platform):
        if platform.target:
            output.write_text(platform.target)
        else:
            compile_library(sources, output)

    monkeypatch.setattr(build, "compile_library", compile_or_copy)


def test_one_fmu_holds_the_binaries_of_all_platforms(zig_that_copies, fmi, tmp_path):
    file = build_fmu("linear", fmi, tmp_path / "car.fmu", everywhere=True)
    with zipfile.ZipFile(file) as archive:
        found = {name.split("/")[1]: name for name in archive.namelist() if name.startswith("binaries/")}
        for platform in PLATFORMS:
            name = found.pop(platform.fmi2 if fmi == 2 else platform.fmi3)
            assert name.endswith(f"/linear{platform.suffix}")
            if platform.fmi3 != fmpy.platform_tuple:
                assert archive.read(name).decode() == platform.target
    assert found == {}
    assert validate_fmu(str(file)) == []


def test_without_ziglang_there_is_no_compiling_for_others(monkeypatch):
    monkeypatch.setattr(platforms.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(CompilerError, match=r"ziglang is not installed; `pip install sidestep\[cross\]`"):
        build_fmu(everywhere=True)


MAGIC = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}
MACHINE = {"x86_64-linux": (18, 62), "aarch64-linux": (18, 183), "x86_64-darwin": (4, 7), "aarch64-darwin": (4, 12)}
"""Where the processor stands in an ELF or Mach-O file, and its number."""


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda platform: platform.fmi3)
def test_zig_compiles_for(platform, tmp_path):
    pytest.importorskip("ziglang", reason="needs ziglang (the extra cross)")
    for name, data in build.source_files(MODEL).items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "output").mkdir()
    compile_library(tmp_path, tmp_path / "output" / "car", platform=platform)
    data = (tmp_path / "output" / "car").read_bytes()
    assert data.startswith(MAGIC[platform.suffix])
    if platform.fmi3 in MACHINE:
        place, number = MACHINE[platform.fmi3]
        assert data[place] == number
    assert b"fmi3DoStep" in data
    assert b"fmi2DoStep" in data


def test_failing_compiler_shows_what_it_said(empty_cache, tmp_path, monkeypatch):
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\necho 'single_track.c:1: fatal error: math.h is missing' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    with pytest.raises(CompilerError, match=r"math\.h is missing"):
        build_fmu()
    assert list(empty_cache.iterdir()) == []


def test_bad_arguments():
    with pytest.raises(InputError, match="fmi: 1; allowed: 2, 3"):
        build_fmu(fmi=1)
    with pytest.raises(InputError, match="unknown native FMU 'unicycle'; allowed: single-track"):
        build_fmu("unicycle")
    with pytest.raises(InputError, match=r"missing/car\.fmu: cannot be written"):
        build_fmu(out="/no/such/folder/missing/car.fmu")


def test_cache_that_cannot_be_made(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(InputError, match="XDG_CACHE_HOME"):
        build_fmu()


def test_cache_that_cannot_be_written(empty_cache, monkeypatch):
    allowed = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != empty_cache and allowed(path, mode))
    with pytest.raises(InputError, match=f"XDG_CACHE_HOME: {empty_cache} cannot be written"):
        build_fmu()
