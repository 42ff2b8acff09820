"""What sensors tell of a plant: the truth, or the truth with noise and an offset."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import TypeVar

import numpy as np

from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import Controller
from sidestep.validation.loop.recording import Array
from sidestep.validation.loop.wrapped import Wrapped
from sidestep.validation.scenarios.plant_settings import PlantSettings
from sidestep.validation.scenarios.scenario import Scenario

_ANGLE, _STEER_ANGLE = math.radians(0.1), math.radians(0.02)
NOISE = VehicleState(x=0.02, y=0.02, yaw=_ANGLE, v_x=0.03, v_y=0.03, yaw_rate=_ANGLE, steer_angle=_STEER_ANGLE)
"""Standard deviations, white from step to step: the order of a good satellite and inertial navigation system."""

FITTED_NOISE = {"yaw_rate": _ANGLE, "lateral_acceleration": 0.03}
"""The same of what identification fits, in [rad/s] and, of an accelerometer, in [m/s^2]."""

_DEVIATIONS = np.array(astuple(NOISE))


def measured(drive: Mapping[str, Array], noise: float, seed: Sequence[int]) -> dict[str, Array]:
    """An open-loop drive whose fitted signals have `noise` times their noise; its steering and start are known."""
    random = np.random.default_rng(seed)
    return dict(drive) | {
        name: drive[name] + noise * deviation * random.standard_normal(len(drive[name]))
        for name, deviation in FITTED_NOISE.items()
    }


Sensed = TypeVar("Sensed", bound=Controller)


def sensed(controller: Sensed, scenario: Scenario) -> "Sensed | ImperfectMeasurement":
    """A controller behind the scenario's sensors: itself where these tell the truth."""
    settings = scenario.plant
    return ImperfectMeasurement(controller, settings) if settings.noise or settings.measured_offset else controller


class ImperfectMeasurement(Wrapped):
    """A controller behind sensors that err; the same settings give the same errors."""

    def __init__(self, controller: Controller, settings: PlantSettings):
        super().__init__(controller)
        self.settings = settings
        self._random = np.random.default_rng(self.settings.noise_seed)

    def reset(self) -> None:
        """Forget the past, noise included."""
        self._random = np.random.default_rng(self.settings.noise_seed)
        super().reset()

    def step(self, state: VehicleState) -> SteeringCommand:
        """The controller's answer to the state as it is measured."""
        offset = self.settings.measured_offset
        shift = np.array([0.0, -offset * math.sin(state.yaw), offset * math.cos(state.yaw), 0.0, 0.0, 0.0, 0.0, 0.0])
        errors = shift + self.settings.noise * _DEVIATIONS * self._random.standard_normal(len(_DEVIATIONS))
        return super().step(VehicleState(*map(float, np.array(astuple(state)) + errors)))
