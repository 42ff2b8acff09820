"""FMUs as they come: one tiny FMU for each kind of oddity, what becomes of it, and the table in docs/fmi.md."""

from dataclasses import replace
from functools import cache, partial
from math import cos, exp, sin, tan
from pathlib import Path

import pytest
from support.fmus.fmu_files import unpacked
from support.fmus.odd_fmus import ROWS, Odd
from support.fmus.odd_kinds import ENCODINGS, KINDS, PROPOSED

from sidestep.fmu.importing.checks.findings import check_fmu
from sidestep.fmu.importing.isolation import IsolatedPlant
from sidestep.fmu.importing.mapping import Mapping
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.importing.proposal import describe, propose_mapping
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.cli.main import main

ROOT = Path(__file__).parents[3]


def drive(kind, file):
    """The offset after a second in a bend."""
    text = kind.mapping
    if text == PROPOSED:
        with unpacked(file) as fmu:
            text = propose_mapping(fmu.about, file)
    build = partial(FmuPlant.from_file, file, Mapping.from_text(text) if text else None)
    with IsolatedPlant(build, 30.0) if kind.isolated else build() as plant:
        plant.reset(VehicleState(v_x=15.0))
        return [plant.step(SteeringCommand(0.0, 0.03, 15.0), 0.01) for _ in range(100)][-1].y


@cache
def expected():
    """What the plain car does: the FMU without an oddity, steered alike."""
    steer, yaw, x, y = 0.0, 0.0, 0.0, 0.0
    for _ in range(1000):
        h, v = 1e-3, 15.0
        steer += min((0.03 - steer) * (1.0 - exp(-h / 0.05)), 0.4 * h)
        rate = v * tan(steer) / 2.579
        v_y = 1.423 * rate
        x, y, yaw = x + h * (v * cos(yaw) - v_y * sin(yaw)), y + h * (v * sin(yaw) + v_y * cos(yaw)), yaw + h * rate
    return y


def made(name, folder):
    kind = KINDS[name]
    file = kind.odd.write(folder / "odd.fmu", ENCODINGS.get(name, "utf-8"))
    if kind.finish:
        kind.finish(file)
    return file


@pytest.mark.parametrize("name", KINDS)
def test_what_becomes_of_it(name, tmp_path):
    kind, file = KINDS[name], made(name, tmp_path)
    if kind.outcome.partition(",")[0] in ("drives", "compiled"):
        assert drive(kind, file) == pytest.approx(expected(), abs=kind.tolerance)
        return
    with pytest.raises(InputError if kind.outcome.startswith("refused") else PlantError) as caught:
        drive(kind, file)
    assert kind.error in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_documentation_tells_the_same():
    page = (ROOT / "docs" / "fmi.md").read_text(encoding="utf-8")
    table = page.partition("| kind | what becomes of it |\n|---|---|\n")[2].partition("\n\n")[0]
    assert table.splitlines() == [f"| {name} | {kind.outcome} |" for name, kind in KINDS.items()]
    assert len(KINDS) >= 25


def test_the_check_does_not_fault_arrays(tmp_path):
    found = check_fmu(made("arrays", tmp_path))
    assert not [what for who, what in found if who == "sidestep"], found


def test_the_check_names_the_function_that_it_died_in_and_keeps_what_it_found(tmp_path):
    odd = Odd(macros=("TERMINATE_CRASHES",), attributes='canGetAndSetFMUstate="true"')
    found = [what for who, what in check_fmu(odd.write(tmp_path / "odd.fmu")) if who == "sidestep"]
    assert "it says canGetAndSetFMUstate, but its binary lacks fmi2GetFMUstate" in found
    assert found[-1] == "the plant's process ended in fmi2Terminate: SIGABRT"


def test_info_shows_an_fmu_for_other_machines(tmp_path, capsys):
    file = made("no binary for this platform, no sources", tmp_path)
    assert main(["fmu", "info", str(file)]) == 0
    assert "in it, but for: win64" in capsys.readouterr().out


def test_the_second_instance_of_one_that_starts_once_names_the_way_out(tmp_path):
    with FmuPlant.from_file(Odd(macros=("ONCE",)).write(tmp_path / "once.fmu")) as plant:
        plant.reset(VehicleState(v_x=10.0))
        with pytest.raises(PlantError, match="returned no instance; it may start once per process: --isolate"):
            plant.reset(VehicleState(v_x=11.0))


def test_a_unit_of_another_dimension_is_not_proposed(tmp_path):
    """A wheel's speed in rad/s is no v_x, whatever it is called."""
    rows = tuple((*row[:3], "U") if row[0] == "v_x" else row for row in ROWS)
    units = '<Unit name="U"><BaseUnit rad="1" s="-1"/></Unit>' + "".join(
        f'<Unit name="{unit}"/>' for unit in ("m", "rad", "m/s", "rad/s")
    )
    file = replace(Odd(), rows=rows, units=units).write(tmp_path / "odd.fmu")
    with unpacked(file) as fmu:
        assert 'v_x = { variable = "v_x"' not in propose_mapping(fmu.about, file).partition("[start]")[0]
        assert "odd, FMI 2.0" in describe(fmu.about)
