"""FmuPlant: our own FMUs and such with foreign names as plants."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from support.fmus.fmu_files import CAR, START, changed, description, slalom

from sidestep.fmu.description.variables import ACCELERATION_START
from sidestep.fmu.importing.mapping import OUTPUTS, Mapping
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters


def test_it_is_a_plant(plant):
    assert isinstance(plant, Plant)
    assert check_plant(plant, CAR) == []


def test_reset_puts_the_car_there_again_and_again(plant):
    assert plant.reset(START) == START
    first = slalom(plant)
    assert plant.reset(START) == START
    np.testing.assert_array_equal(slalom(plant), first)


def test_both_standards_give_the_same_bits():
    rows = []
    for fmi in (2, 3):
        with native_plant(CAR, fmi=fmi) as plant:
            plant.reset(START)
            rows.append(slalom(plant))
    np.testing.assert_array_equal(*rows)


def test_instances_do_not_know_of_each_other(fmi):
    with native_plant(CAR, fmi=fmi) as alone:
        alone.reset(START)
        expected = slalom(alone)
    with native_plant(CAR, fmi=fmi) as one, native_plant(CAR, friction=0.3, fmi=fmi) as other:
        one.reset(START)
        other.reset(replace(START, v_x=25.0))
        rows = []
        for k in range(100):
            command = SteeringCommand(0.0, 0.1 * math.sin(0.1 * k), 12.0)
            rows.append(astuple(one.step(command, 0.02)))
            other.step(command, 0.01)
    np.testing.assert_array_equal(rows, expected)


def test_serialised_state_goes_back_to_the_last_bit(plant):
    plant.reset(START)
    slalom(plant)
    fmu = plant._fmu._slave
    state = fmu.getFMUState()
    data = fmu.serializeFMUState(state)
    here, clock = plant._values(), (plant._time, plant._steps, plant._origin)
    first = slalom(plant)
    fmu.freeFMUState(state)
    state = fmu.deserializeFMUState(data)
    fmu.setFMUState(state)
    fmu.freeFMUState(state)
    plant._time, plant._steps, plant._origin = clock
    assert plant._values() == here
    np.testing.assert_array_equal(slalom(plant), first)


def test_foreign_serialised_state_is_refused(plant):
    plant.reset(START)
    fmu = plant._fmu._slave
    state = fmu.getFMUState()
    data = fmu.serializeFMUState(state)
    fmu.freeFMUState(state)
    for foreign in (data[:-8], b"x" + data[1:]):
        with pytest.raises(FMICallException):
            fmu.deserializeFMUState(foreign)
        assert "another build" in plant._fmu._messages[-1]


def test_time_does_not_drift(plant):
    plant.reset(START)
    for k in range(1, 2001):
        state = plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.1)
        assert state.time == 1.0 + k * 0.1
    assert plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.03).time == 1.0 + 2000 * 0.1 + 0.03


def test_command_that_is_not_finite_keeps_the_last_one(plant):
    plant.reset(START)
    plant.step(SteeringCommand(0.0, 0.05, 10.0), 0.02)
    kept = plant.step(SteeringCommand(0.0, math.nan, math.inf), 0.02)
    plant.reset(START)
    plant.step(SteeringCommand(0.0, 0.05, 10.0), 0.02)
    assert plant.step(SteeringCommand(0.0, 0.05, 10.0), 0.02) == kept


def test_fmu_itself_ignores_an_input_that_is_not_a_number(plant):
    plant.reset(START)
    plant._inputs.values[:] = [math.nan, 12.0, math.nan]
    plant._fmu.set(plant._inputs)  # a warning, no error
    port = plant._fmu.port(["steer_angle_command", "target_speed", "acceleration"])
    plant._fmu.get(port)
    assert list(port.values) == [START.steer_angle, 12.0, ACCELERATION_START]


def test_renamed_and_scaled_variables(fmi, tmp_path):
    text = description(fmi)
    for ours, theirs in {"yaw_rate": "psi_dot", "steer_angle_command": "Delta.cmd", "v_x_0": "v0"}.items():
        text = text.replace(f'name="{ours}"', f'name="{theirs}"')
    foreign = changed(build_fmu(fmi=fmi), tmp_path / "foreign.fmu", {"modelDescription.xml": text.encode()})
    table = tmp_path / "map.toml"
    table.write_text(
        '[inputs]\nsteer_angle = { variable = "Delta.cmd", scale = -0.5, offset = 0.01 }\n'
        '[outputs]\nyaw_rate = { variable = "psi_dot", scale = 0.017453292519943295 }\n'
        '[start]\nv_x = "v0"\n[parameters]\nfriction = 0.7\n'
    )
    with FmuPlant.from_file(foreign, table) as plant, native_plant(CAR, friction=0.7) as own:
        plant.reset(VehicleState(v_x=15.0, steer_angle=0.01))
        own.reset(VehicleState(v_x=15.0))
        for _ in range(50):
            found = plant.step(SteeringCommand(0.0, -0.02, 15.0), 0.02)
            expected = own.step(SteeringCommand(0.0, 0.06, 15.0), 0.02)
    assert found.yaw_rate == pytest.approx(math.radians(expected.yaw_rate), rel=1e-12)
    assert replace(found, yaw_rate=0.0) == replace(expected, yaw_rate=0.0)


def test_own_fmu_from_a_file_takes_the_vehicle():
    van = VehicleParameters.preset("vw-vanagon")
    with FmuPlant.from_file(build_fmu(), vehicle=van) as plant, native_plant(van) as native:
        plant.reset(START)
        native.reset(START)
        np.testing.assert_array_equal(slalom(plant), slalom(native))


def test_linear_fmu_equals_the_linear_plant():
    with native_plant(CAR, model="linear") as fmu:
        plant = LinearPlant(CAR)
        start = replace(START, yaw_rate=0.0, v_y=0.0)
        fmu.reset(start)
        plant.reset(start)
        np.testing.assert_allclose(slalom(fmu), slalom(plant), rtol=0, atol=1e-9)


def test_rows_of_a_mapping_may_stand_in_any_order():
    swapped = Mapping.from_text(
        '[inputs]\ntarget_speed = "target_speed"\nsteer_angle = "steer_angle_command"\n[start]\n'
        + "\n".join(f'{name} = "{name}_0"' for name in reversed(OUTPUTS))
    )
    with FmuPlant.from_file(build_fmu(), swapped) as mapped, FmuPlant.from_file(build_fmu()) as own:
        mapped.reset(START)
        own.reset(START)
        np.testing.assert_array_equal(slalom(mapped, 10), slalom(own, 10))
