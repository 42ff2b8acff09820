"""Reading .tir files: signs against the ISO formula, and every reason to refuse one."""

import json
import math
from importlib.resources import files
from pathlib import Path

import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.formula import cornering_stiffness, tyre_forces
from sidestep.plant_models.tyres.property_file import read_tyre
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.scenarios.scenario import load_scenario

TEXT = """\
[MDI_HEADER]
FILE_TYPE = 'tir'
! : COMMENT : made up, of the size of a 205/60R15
[UNITS]
LENGTH = 'meter'
FORCE = 'newton'   $ the file's forces
ANGLE = 'radians'
[MODEL]
FITTYP = 61
TYRESIDE = 'LEFT'
LONGVL = 16.7
[DIMENSION]
UNLOADED_RADIUS = 0.3135
[OPERATING_CONDITIONS]
INFLPRES = 220000
NOMPRES = 220000
[VERTICAL]
FNOMIN = 4000
[STRUCTURAL]
LONGITUDINAL_STIFFNESS = 358066
LATERAL_STIFFNESS = 102673
[SCALING_COEFFICIENTS]
LMUY = 1
LMUV = 0
[LONGITUDINAL_COEFFICIENTS]
PCX1 = 1.579
PDX1 = 1.0422
PKX1 = 21.687
[LATERAL_COEFFICIENTS]
PCY1 = 1.338
PDY1 = 0.8785
PKY1 = -15.324
PKY2 = 1.715
PHY1 = -0.0018
PVY1 = -0.0066
PEY1 = -0.8057
PEY3 = 0.09
PEY4 = -7.0
PKY6 = -0.92
PVY3 = -0.16
[ALIGNING_COEFFICIENTS]
QBZ1 = 12.0
QCZ1 = 1.05
QDZ1 = 0.09
QHZ1 = 0.0047
QHZ3 = 0.1
QEZ1 = -1.6
QEZ4 = -0.3
QEZ5 = -0.9
QBZ9 = 10.0
QBZ10 = -0.2
QDZ6 = 0.001
"""


@pytest.fixture
def tir(tmp_path):
    def write(old="", new=""):
        assert old in TEXT
        file = tmp_path / "tyre.tir"
        file.write_text(TEXT.replace(old, new) if old else TEXT)
        return file

    return write


def iso(alpha, gamma, fz):
    """F_y and M_z at no longitudinal slip with the file's own numbers and its own signs: K_y < 0."""
    g, df = math.sin(gamma), fz / 4000.0 - 1.0
    k = -15.324 * 4000.0 * math.sin(2.0 * math.atan(fz / 4000.0 / 1.715))
    rise = fz * -0.16 * g
    sh, sv = -0.0018 + (fz * -0.92 * g - rise) / k, -0.0066 * fz + rise
    d, ay = 0.8785 * fz, alpha + sh
    b = k / 1.338 / d
    e = -0.8057 * (1.0 - (0.09 - 7.0 * g) * math.copysign(1.0, ay))
    x = b * ay
    fy = d * math.sin(1.338 * math.atan(x - e * (x - math.atan(x)))) + sv
    at = alpha + 0.0047 + 0.1 * g
    x = 12.0 * at
    e = -1.6 * (1.0 + (-0.3 - 0.9 * g) * 2.0 / math.pi * math.atan(12.0 * 1.05 * at))
    trail = fz * 0.3135 / 4000.0 * 0.09 * math.cos(1.05 * math.atan(x - e * (x - math.atan(x))))
    br = 10.0 - 0.2 * b * 1.338
    residual = fz * 0.3135 * 0.001 * math.cos(math.atan(br * (alpha + sh + sv / k)))
    assert df > -1.0
    return fy, (residual - trail * fy) * math.cos(alpha)


@pytest.mark.parametrize("alpha", [-0.12, -0.01, 0.0, 0.03, 0.2])
@pytest.mark.parametrize("camber", [-0.05, 0.0, 0.04])
@pytest.mark.parametrize("load", [2000.0, 5500.0])
def test_forces_are_those_of_the_file_s_own_axes(tir, alpha, camber, load):
    left = read_tyre(tir())
    _, fy, mz = tyre_forces(0.0, -alpha, camber, load, 1.0, left.as_array())
    assert (fy, mz) == pytest.approx(iso(alpha, camber, load), rel=1e-9, abs=1e-9)
    right = read_tyre(tir("'LEFT'", "'RIGHT'"))
    _, fy, mz = tyre_forces(0.0, alpha, -camber, load, 1.0, right.as_array())
    assert (-fy, -mz) == pytest.approx(iso(alpha, camber, load), rel=1e-9, abs=1e-9)


def test_relaxation_lengths_are_those_of_the_carcass(tir):
    tyre = read_tyre(tir())
    assert tyre.relaxation_x == pytest.approx(21.687 * 4000.0 / 358066.0)
    assert tyre.relaxation_y == pytest.approx(cornering_stiffness(4000.0, tyre.as_array()) / 102673.0)
    assert read_tyre(tir("LATERAL_STIFFNESS = 102673", "")).relaxation_y == 0.3


def test_what_the_file_does_not_give_is_zero(tir):
    tyre = read_tyre(tir())
    assert (tyre.p_dy2, tyre.p_ex1, tyre.r_bx1, tyre.p_ky4) == (0.0, 0.0, 0.0, 2.0)
    assert (tyre.p_ky1, tyre.p_hy1, tyre.p_vy1) == (15.324, 0.0018, -0.0066)


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "problem"),
    [
        ("FITTYP = 61", "FITTYP = 52", 9, "FITTYP", "'52'"),
        ("'meter'", "'mm'", 5, "LENGTH", "'mm'"),
        ("'newton'", "'kN'", 6, "FORCE", "'kN'"),
        ("'radians'", "'degree'", 7, "ANGLE", "'degree'"),
        ("'LEFT'", "'TOP'", 10, "TYRESIDE", "'TOP'"),
        ("LMUY = 1", "LMUY = 0.8", 23, "LMUY", "scaling"),
        ("INFLPRES = 220000", "INFLPRES = 250000", 15, "INFLPRES", "nominal pressure"),
        ("PKY1 = -15.324", "PKY1 = 15.324", 32, "PKY1", "ISO"),
        ("PDY1 = 0.8785", "PDY1 = 0,8785", 31, "PDY1", "'0,8785' is not a number"),
        ("PDY1 = 0.8785", "PDY1 = nan", 31, "PDY1", "'nan' is not a number"),
        ("PDY1 = 0.8785", "PDY1 = -1", 31, "PDY1", "-1"),
    ],
)
def test_a_bad_value_is_named_with_file_line_and_key(tir, old, new, line, key, problem):
    file = tir(old, new)
    with pytest.raises(InputError) as error:
        read_tyre(file)
    assert error.value.where == f"{file}, line {line}, {key}"
    assert problem in error.value.problem


def test_files_that_are_none(tir, tmp_path):
    with pytest.raises(InputError, match="no PKY1"):
        read_tyre(tir("PKY1 = -15.324", ""))
    with pytest.raises(InputError, match=r"missing\.tir: No such file"):
        read_tyre(Path(tmp_path / "missing.tir"))
    (tmp_path / "binary.tir").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="no FITTYP"):
        read_tyre(tmp_path / "binary.tir")


def test_vehicle_files_and_scenarios_name_a_tyre_file(tir, tmp_path):
    tir()
    preset = files("sidestep.plant_models") / "vehicle" / "presets" / "bmw-320i.toml"
    car = tmp_path / "car.toml"
    car.write_text('tyre_file = "tyre.tir"\n' + preset.read_text().replace("nominal_load = 2681.3", "p_dy1 = 0.7"))
    tyre = VehicleParameters.from_file(car).tyre
    assert (tyre.p_dy1, tyre.p_ky1) == (0.7, 15.324)
    file = json.dumps(str(tmp_path / "tyre.tir"))
    tyre = load_scenario("moose", [f"vehicle.tyre_file={file}", "vehicle.tyre.p_dy1=0.8"]).vehicle.tyre
    assert (tyre.p_dy1, tyre.p_ky1) == (0.8, 15.324)
    tir("FITTYP = 61", "FITTYP = 5")
    with pytest.raises(InputError, match=r"tyre\.tir, line 9, FITTYP: '5'; allowed: 61, 62"):
        load_scenario("moose", [f"vehicle.tyre_file={file}"])
