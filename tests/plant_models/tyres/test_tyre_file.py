"""Reading .tir files: signs against the ISO formula, and every reason to refuse one."""

import json
import math
import re
from dataclasses import asdict, replace
from importlib.resources import files
from pathlib import Path

import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.tyres.formula import cornering_stiffness, tyre_forces
from sidestep.plant_models.tyres.property_file import LAWS, read_tyre, read_tyre_file
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


# MF-Tyre 5.2, of which 5, 6, 51, 52 and PAC2002 files are


def iso_5(alpha, gamma, fz):
    """F_y of MF-Tyre 5.2 with the file's own numbers and signs: camber shifts the curve, and does not stiffen it."""
    k = -15.324 * 4000.0 * math.sin(2.0 * math.atan(fz / 4000.0 / 1.715))
    ay = alpha - 0.0018 + 0.03 * gamma
    d, sv = 0.8785 * fz, -0.0066 * fz + fz * -0.16 * gamma
    e = -0.8057 * (1.0 - (0.09 - 7.0 * gamma) * math.copysign(1.0, ay))
    x = k / 1.338 / d * ay
    return d * math.sin(1.338 * math.atan(x - e * (x - math.atan(x)))) + sv


VERSIONS = [f"FITTYP = {number}" for number, law in LAWS.items() if law == "5.2"]


@pytest.mark.parametrize("version", [*VERSIONS, "PROPERTY_FILE_FORMAT = 'PAC2002'"])
@pytest.mark.parametrize("camber", [-0.03, 0.0, 0.02])
def test_older_files_have_their_own_camber(tir, version, camber):
    file = tir("FITTYP = 61", version)
    file.write_text(file.read_text().replace("PEY1", "PHY3 = 0.03\nPEY1"))
    read = read_tyre_file(file)
    assert read.law == "5.2"
    assert "PKY6" in read.unused
    for alpha, load in ((-0.1, 2000.0), (-0.01, 5500.0), (0.08, 4000.0)):
        _, fy, _ = tyre_forces(0.0, -alpha, math.asin(camber), load, 1.0, read.tyre.as_array())
        assert fy == pytest.approx(iso_5(alpha, camber, load), rel=1e-9)


@pytest.mark.parametrize("version", ["FITTYP = 60", "FITTYP = 61", "FITTYP = 62", ""])
def test_newer_files_and_those_that_only_look_so(tir, version):
    read = read_tyre_file(tir("FITTYP = 61", version))
    assert (read.law, read.tyre) == ("6.1", read_tyre(tir()))


def test_older_files_tell_their_relaxation(tir):
    file = tir("FITTYP = 61", "FITTYP = 6")
    assert read_tyre(file).relaxation_y == 0.3  # the default's: the carcass is 6.1's way
    file.write_text(file.read_text() + "PTX1 = 2.0\nPTY1 = 2.5\nPTY2 = 1.8\n")
    tyre = read_tyre(file)
    assert tyre.relaxation_x == pytest.approx(2.0 * 0.3135)
    assert tyre.relaxation_y == pytest.approx(2.5 * 0.3135 * math.sin(2.0 * math.atan(1.0 / 1.8)))


def test_a_negative_peak_is_the_same_curve(tir):
    """MF_05 files of some fitters: D and K negative, B positive, which QBZ10 multiplies."""
    plain = read_tyre(tir())
    expected = replace(plain, q_bz10=-plain.q_bz10)
    assert read_tyre(tir("PDY1 = 0.8785", "PDY1 = -0.8785")) == expected


def test_lateral_slip_alone_is_filled_in_and_told(tir):
    read = read_tyre_file(tir("PKX1 = 21.687", "PKX1 = 0"))
    assert (read.tyre.p_kx1, read.tyre.r_bx1) == (22.303, 13.276)
    assert read.tyre.p_cy1 == 1.338
    assert read.filled.startswith("longitudinal slip")
    assert {"PCX1", "PDX1", "PKX1"} <= set(read.unused)


def test_what_is_not_used_is_listed(tir):
    file = tir()
    file.write_text(file.read_text() + "[OVERTURNING_COEFFICIENTS]\nQSX1 = 0.1\n[TURNSLIP_COEFFICIENTS]\nPDXP1 = 0.4\n")
    assert set(read_tyre_file(file).unused) == {"LMUV", "QSX1", "PDXP1"}


# Scaling factors and pressure


@pytest.mark.parametrize(
    ("factor", "names"),
    [
        ("LMUY", {"p_dy1": 0.8, "p_vy1": 0.8, "p_vy3": 0.8, "q_bz1": 1.25, "q_bz9": 1.25, "q_dz6": 0.8}),
        ("LKY", {"p_ky1": 0.8, "q_bz1": 0.8, "q_bz9": 0.8, "relaxation_y": 0.8}),
        ("LFZO", {"nominal_load": 0.8, "relaxation_x": 0.8, "relaxation_y": 0.8}),
        ("LCY", {"p_cy1": 0.8}),
        ("LEY", {"p_ey1": 0.8}),
        ("LHY", {"p_hy1": 0.8}),
        ("LMUX", {"p_dx1": 0.8}),
        ("LKXK", {"p_kx1": 0.8, "relaxation_x": 0.8}),
        ("LTR", {"q_dz1": 0.8}),
        ("LSGAL", {"relaxation_y": 0.8}),
        ("LMY", {}),
    ],
)
def test_scaling_factors_go_into_the_coefficients(tir, factor, names):
    plain, read = asdict(read_tyre(tir())), asdict(read_tyre(tir("LMUY = 1", f"{factor} = 0.8")))
    changed = {name: read[name] / plain[name] for name in plain if read[name] != plain[name]}
    assert changed == pytest.approx(names)


def test_peak_and_stiffness_scale_as_forces_do(tir):
    """LMUY: the peak follows, the slope at zero slip stays."""
    tyre, weak = (read_tyre(tir("LMUY = 1", f"LMUY = {factor}")).without_shifts() for factor in (1.0, 0.5))
    small = [tyre_forces(0.0, 1e-4, 0.0, 4000.0, 1.0, t.as_array())[1] for t in (tyre, weak)]
    large = [max(tyre_forces(0.0, a, 0.0, 4000.0, 1.0, t.as_array())[1] for a in (0.1, 0.2, 0.4)) for t in (tyre, weak)]
    assert small[1] == pytest.approx(small[0], rel=1e-3)
    assert large[1] == pytest.approx(0.5 * large[0], rel=0.02)


def test_pressure_goes_into_the_coefficients(tir):
    file = tir("INFLPRES = 220000", "INFLPRES = 242000")
    assert read_tyre(file) == read_tyre(tir())  # without coefficients for it, it does nothing
    file = tir("INFLPRES = 220000", "INFLPRES = 242000")
    file.write_text(file.read_text() + "PPY1 = 0.5\nPPY2 = 0.3\nPPY3 = -0.2\nPPY4 = 1.0\nPPZ1 = 0.4\n")
    tyre, plain = read_tyre_file(file).tyre, read_tyre(tir())
    assert tyre.p_ky1 == pytest.approx(1.05 * plain.p_ky1)
    assert tyre.p_ky2 == pytest.approx(1.03 * plain.p_ky2)
    assert tyre.p_dy1 == pytest.approx((1.0 - 0.02 + 0.01) * plain.p_dy1)
    assert tyre.q_dz1 == pytest.approx(0.96 * plain.q_dz1)


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "problem"),
    [
        ("FITTYP = 61", "FITTYP = 21", 9, "FITTYP", "'21'"),
        ("PCY1 = 1.338", "PCY1 = 1.338\nPCY2 = 0.8", 31, "PCY2", "motorcycle"),
        ("'meter'", "'mm'", 5, "LENGTH", "'mm'"),
        ("'newton'", "'kN'", 6, "FORCE", "'kN'"),
        ("'radians'", "'degree'", 7, "ANGLE", "'degree'"),
        ("'LEFT'", "'TOP'", 10, "TYRESIDE", "'TOP'"),
        ("LMUY = 1", "LNEW = 0.8", 23, "LNEW", "scaling"),
        ("NOMPRES = 220000", "NOMPRES = 0", 16, "NOMPRES", "0"),
        ("PKY1 = -15.324", "PKY1 = 15.324", 32, "PKY1", "ISO"),
        ("PDY1 = 0.8785", "PDY1 = 0,8785", 31, "PDY1", "'0,8785' is not a number"),
        ("PDY1 = 0.8785", "PDY1 = nan", 31, "PDY1", "'nan' is not a number"),
        ("PDY1 = 0.8785", "PDY1 = 0", 31, "PDY1", "0"),
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
    with pytest.raises(InputError, match=r"missing\.tir: cannot be read \(No such file"):
        read_tyre(Path(tmp_path / "missing.tir"))
    (tmp_path / "binary.tir").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="no UNLOADED_RADIUS"):
        read_tyre(tmp_path / "binary.tir")


def test_vehicle_files_and_scenarios_name_a_tyre_file(tir, tmp_path):
    tir()
    preset = files("sidestep.plant_models") / "vehicle" / "presets" / "bmw-320i.toml"
    car = tmp_path / "car.toml"
    text = preset.read_text().replace("nominal_load = 2681.3", "p_dy1 = 0.7")
    car.write_text('tyre_file = "tyre.tir"\n' + text)
    with pytest.raises(InputError, match=r"vehicle\.tyre_file: says how stiff the tyres are, and so does cornering_"):
        VehicleParameters.from_file(car)
    car.write_text('tyre_file = "tyre.tir"\n' + re.sub(r"cornering_stiffness_.*\n", "", text))
    tyre = VehicleParameters.from_file(car).tyre
    assert (tyre.p_dy1, tyre.p_ky1) == (0.7, 15.324)
    file = json.dumps(str(tmp_path / "tyre.tir"))
    shod = load_scenario("moose", [f"vehicle.tyre_file={file}", "vehicle.tyre.p_dy1=0.8"]).vehicle
    assert (shod.tyre.p_dy1, shod.tyre.p_ky1) == (0.8, 15.324)
    assert shod.tyre_scale("front") == shod.tyre_scale("rear") == pytest.approx(1.0)
    with pytest.raises(InputError, match=r"vehicle\.tyre_file: says how stiff"):
        load_scenario("moose", [f"vehicle.tyre_file={file}", "vehicle.cornering_stiffness_front=1e5"])
    tir("FITTYP = 61", "FITTYP = 7")
    with pytest.raises(InputError, match=r"tyre\.tir, line 9, FITTYP: '7'; allowed: 5, 6, 51, 52, 60, 61, 62"):
        load_scenario("moose", [f"vehicle.tyre_file={file}"])
