"""The plant that a scenario asks for."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Self

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.loop.delay_line import DelayLine
from sidestep.validation.scenarios.plant_settings import PlantSettings
from sidestep.validation.scenarios.scenario import Scenario
from sidestep.validation.scenarios.tables import did_you_mean, file_at

PLANT_KINDS = ("linear", "single-track", "double-track", "mujoco")
"""Plants that come with the package; the path of an .fmu file is one more."""
ROLLING = ("mujoco", "double-track")
"""Those with springs."""


def open_plant(scenario: Scenario) -> Plant:
    """Build the plant of `scenario.plant`; heavy libraries are loaded only for the plant that needs them.

    Raises:
        InputError: Unknown plant, missing or broken FMU or mapping, or a setting that the plant has not.
        PlantError: The plant cannot be built (no C compiler for the native FMU, say).
    """
    settings, plant = scenario.plant, _bare_plant(scenario)
    if settings.steer_offset or settings.delay:
        return ImperfectSteering(plant, settings.steer_offset, settings.delay)
    return plant


def _bare_plant(scenario: Scenario) -> Plant:
    settings, vehicle = scenario.plant, true_vehicle(scenario)
    if settings.map and not settings.kind.endswith(".fmu"):
        raise InputError("plant.map", f"{settings.map!r} without an FMU", "only with an .fmu file as plant")
    if settings.isolate and not settings.kind.endswith(".fmu"):
        raise InputError("plant.isolate", f"{settings.isolate} without an FMU", "only with an .fmu file as plant")
    if settings.kind != "mujoco":
        _require_plain_road(settings)
    if settings.kind == "linear":
        from sidestep.plant_models.linear.plant import LinearPlant

        if not math.isclose(settings.friction, 1.0):
            raise InputError("plant.friction", f"{settings.friction}: linear tyres do not slide", "1.0")
        return LinearPlant(vehicle)
    if settings.kind in ("single-track", "double-track"):
        from sidestep.fmu.importing.plant import FmuPlant

        return FmuPlant.native(vehicle, friction=settings.friction, model=settings.kind)
    if settings.kind == "mujoco":
        from sidestep.plant_models.mujoco.plant import MujocoPlant

        return MujocoPlant(
            vehicle, path=scenario.path, obstacles=scenario.obstacles, friction=settings.friction,
            tyre=settings.tyre, surface=settings.surface,
        )  # fmt: skip
    if settings.kind.endswith(".fmu"):
        from sidestep.fmu.importing.isolation import IsolatedPlant
        from sidestep.fmu.importing.plant import FmuPlant

        mapping = file_at(Path(), settings.map, "plant.map") if settings.map else None
        build = partial(FmuPlant.from_file, Path(settings.kind), mapping, vehicle, settings.friction)
        return IsolatedPlant(build, settings.isolate) if settings.isolate else build()
    problem = f"unknown plant {settings.kind!r}{did_you_mean(settings.kind, PLANT_KINDS)}"
    raise InputError("plant.kind", problem, f"{', '.join(PLANT_KINDS)}, or an .fmu file")


def true_vehicle(scenario: Scenario) -> VehicleParameters:
    """The car that is driven, where the controller believes in `scenario.vehicle`.

    Inertias follow the mass, as of a load that is spread like the car; a stiffer tyre peaks as high, and earlier.

    Raises:
        InputError: An FMU from outside, whose numbers are its own, a mass that the car cannot have, or roll centres
            of a car that does not roll.
    """
    vehicle, mass, stiffness = scenario.vehicle, scenario.plant.mass, scenario.plant.stiffness
    raised, kind, chassis = scenario.plant.roll_centre, scenario.plant.kind, vehicle.suspension
    if mass == stiffness == 1.0 and raised == 0.0:
        return vehicle
    if kind.endswith(".fmu"):
        allowed = f"their defaults, or {', '.join(PLANT_KINDS)}"
        raise InputError("plant.mass, plant.stiffness, plant.roll_centre", "an FMU has its own", allowed)
    if raised and (kind not in ROLLING or not chassis):
        raise InputError("plant.roll_centre", f"{raised} m: {kind} does not roll", f"0, or {', '.join(ROLLING)}")
    if chassis:
        chassis = replace(
            chassis, roll_inertia=mass * chassis.roll_inertia, pitch_inertia=mass * chassis.pitch_inertia,
            roll_centre_front=chassis.roll_centre_front + raised, roll_centre_rear=chassis.roll_centre_rear + raised,
        )  # fmt: skip
    try:
        return vehicle.with_(
            mass=mass * vehicle.mass,
            yaw_inertia=mass * vehicle.yaw_inertia,
            tyre=replace(vehicle.tyre, p_ky1=stiffness * vehicle.tyre.p_ky1),
            suspension=chassis,
        )
    except InputError as error:
        raise InputError("plant.mass", f"{mass}: makes {error.where} {error.problem}", error.allowed) from error


def _require_plain_road(settings: PlantSettings) -> None:
    for name in ("tyre", "grade", "bank", "patches", "heights"):
        if getattr(settings, name) != getattr(PlantSettings, name):
            raise InputError(f"plant.{name}", f"the plant {settings.name} does not know it", "only with plant mujoco")


class ImperfectSteering:
    """A plant whose wheels are told late, and stand to the left of where they are told to, unknown to its measurement.

    Args:
        plant: The plant behind.
        offset: Of the wheels, in [rad].
        delay: Of the commands, in [s]; until the first one arrives, angle and speed are held.
    """

    def __init__(self, plant: Plant, offset: float = 0.0, delay: float = 0.0):
        self.plant, self.offset, self.delay = plant, offset, delay

    def reset(self, state: VehicleState) -> VehicleState:
        """Reset the plant behind; the measured angle is the true one less the offset."""
        self._line = DelayLine(self.delay)
        return self._measured(self.plant.reset(replace(state, steer_angle=state.steer_angle + self.offset)), reset=True)

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Step the plant behind with the angle displaced."""
        self._heard = self._line.transmit(replace(command, time=self._time)) or self._heard
        angle = self._heard.steer_angle + self.offset
        return self._measured(self.plant.step(replace(self._heard, steer_angle=angle), dt))

    def _measured(self, state: VehicleState, reset: bool = False) -> VehicleState:
        state = replace(state, steer_angle=state.steer_angle - self.offset)
        self._time = state.time
        if reset:
            self._heard = SteeringCommand(state.time, state.steer_angle, state.v_x)
        return state

    @property
    def collided(self) -> bool:
        """Whether the plant behind says that it touched an obstacle."""
        return bool(getattr(self.plant, "collided", False))

    @property
    def estimated(self) -> tuple[str, ...]:
        """Signals that the plant behind does not report."""
        return tuple(getattr(self.plant, "estimated", ()))

    def close(self) -> None:
        """Close the plant behind."""
        self.plant.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
