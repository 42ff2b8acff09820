"""A commanded acceleration in FMUs: ours realise it and stop, others get it through a mapping or not at all."""

import math
from dataclasses import replace

import pytest

from sidestep.fmu.description.plants import MODELS
from sidestep.fmu.importing.mapping import Mapping, Signal
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")


def run(plant, steps, **command):
    asked = {"steer_angle": 0.0, "target_speed": 15.0} | command
    for _ in range(steps):
        state = plant.step(SteeringCommand(0.0, **asked), 0.01)
    return state


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("wanted", "got"), [(-2.0, -2.0), (1.0, 1.0), (-30.0, -8.0), (30.0, 3.0), (0.0, 0.0)])
def test_our_fmus_realise_it(model, wanted, got):
    with native_plant(BMW, model=model) as plant:
        plant.reset(VehicleState(v_x=15.0))
        assert run(plant, 100, acceleration=wanted).v_x == pytest.approx(15.0 + got, abs=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_our_fmus_stop_and_stay(model):
    with native_plant(BMW, model=model) as plant:
        plant.reset(VehicleState(v_x=1.0))
        stopped = run(plant, 200, acceleration=-3.0, steer_angle=0.1)
        rest = run(plant, 300, acceleration=-3.0, steer_angle=0.1)
        assert abs(stopped.v_x) < 1e-3
        assert math.hypot(rest.x - stopped.x, rest.y - stopped.y) < 2e-3
        assert run(plant, 100, acceleration=1.0).v_x == pytest.approx(1.0, abs=0.02)


def test_without_one_the_target_speed_counts():
    with native_plant(BMW) as plant:
        plant.reset(VehicleState(v_x=15.0))
        run(plant, 10, acceleration=-3.0)
        assert run(plant, 500, target_speed=12.0).v_x == pytest.approx(12.0, abs=1e-2)


def test_a_mapping_hands_it_on_and_lets_the_brakes_of_others_fade():
    """Through the mapping our own FMU is somebody else's: what it gets is what it does."""
    inputs = {"steer_angle": Signal("steer_angle_command"), "acceleration": Signal("acceleration")}
    with FmuPlant(build_fmu(), replace(Mapping(), inputs=inputs), BMW) as plant:
        plant.reset(VehicleState(v_x=15.0))
        assert run(plant, 100, acceleration=-2.0).v_x == pytest.approx(13.0, abs=1e-6)
        assert run(plant, 100, acceleration=-30.0).v_x == pytest.approx(5.0, abs=1e-6)
        before = run(plant, 180, acceleration=-3.0)
        assert 0.0 <= run(plant, 1, acceleration=-3.0).v_x < 0.02  # fades twice, as ours does it, too
        assert plant._inputs.values[1] == pytest.approx(-3.0 * before.v_x / 0.1)
        assert run(plant, 400, target_speed=4.0).v_x == pytest.approx(4.0, abs=0.05)  # by the speed control of ours


def test_pedals_keep_braking_at_standstill():
    inputs = Mapping().inputs | {"throttle": Signal("steer_offset", scale=1e9), "brake": Signal("speed_gain")}
    del inputs["acceleration"]
    with FmuPlant(build_fmu(), replace(Mapping(), inputs=inputs), BMW) as plant:
        plant.reset(VehicleState(v_x=0.0))
        plant._command = SteeringCommand(0.0, 0.0, 0.0, acceleration=-3.0)
        values = dict(zip(plant._input_names, plant._input_values(0.0), strict=True))
        assert values["brake"] == 3.0
        assert values["throttle"] == 0.0
