"""Step halving says so where it shows nothing."""

import pytest
from support.fmus.odd_fmus import Odd

from sidestep.fmu.importing.plant import FmuPlant
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.model_error.accuracy import step_size
from sidestep.validation.model_error.step_size import step_halving

CAR = VehicleParameters.preset("bmw-320i")


@pytest.mark.parametrize(
    "odd",
    [
        Odd(macros=("INNER=0.001",)),  # its own step stays 1 ms
        Odd(macros=("STRICT_STEP",), attributes="", experiment='stepSize="0.01"'),  # steps of 10 ms and no others
    ],
    ids=["own step", "one step"],
)
def test_an_fmu_whose_own_step_does_not_change_is_not_assessable(odd, tmp_path):
    file = odd.write(tmp_path / "odd.fmu")
    with FmuPlant.from_file(file) as plant:
        found = step_halving(plant, str(file), CAR, 15.0, 4.0)
        shown = step_size(plant, str(file), CAR)
    assert [s.passed for s in found] == [None] * len(found)
    assert shown.verdict == ""
    assert "Not assessable: what odd.fmu answers does not change" in shown.note
    assert shown.table is not None
    assert {row[2:] for row in shown.table.rows} == {("not assessable", "not assessable")}


def test_an_fmu_whose_own_step_is_the_one_it_is_called_with_is_assessed(tmp_path):
    file = Odd(macros=("INNER=1.0",)).write(tmp_path / "odd.fmu")
    with FmuPlant.from_file(file) as plant:
        found = step_halving(plant, str(file), CAR, 15.0, 4.0)
    assert found[0].passed is not None
    assert found[0].numerical_error > 1e-6
