"""The plant that a scenario asks for: one registry, in which the kinds that come with the package are entries.

A further one is an entry of `BUILT_IN`, of `BY_ENDING` if it is a file, or a factory of somebody else's, see
`plant_factory`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Self

from sidestep.plant_models.errors import InputError, did_you_mean
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.loop.delay_line import DelayLine
from sidestep.validation.loop.plant_factory import installed_plants, plant_of
from sidestep.validation.scenarios.plant_settings import PlantSettings
from sidestep.validation.scenarios.scenario import Scenario
from sidestep.validation.scenarios.tables import file_at


@dataclass(frozen=True)
class PlantKind:
    """One entry of the registry.

    Attributes:
        build: Makes the plant of a scenario for the car that is driven.
        knows: Fields of `PlantSettings` that make a difference to it, beyond those that hold for every plant.
        is_scene: Whether it is a scene of MuJoCo's, which can be looked at.
    """

    build: Callable[[Scenario, VehicleParameters], Plant]
    knows: tuple[str, ...] = ()
    is_scene: bool = False


def _linear(_: Scenario, vehicle: VehicleParameters) -> Plant:
    from sidestep.plant_models.linear.plant import LinearPlant

    return LinearPlant(vehicle)


def _native(scenario: Scenario, vehicle: VehicleParameters) -> Plant:
    from sidestep.fmu.native.plant import native_plant

    return native_plant(vehicle, friction=scenario.plant.friction, model=scenario.plant.kind)


def _mujoco(scenario: Scenario, vehicle: VehicleParameters) -> Plant:
    from sidestep.plant_models.mujoco.plant import MujocoPlant

    settings = scenario.plant
    return MujocoPlant(
        vehicle, path=scenario.path, obstacles=scenario.obstacles, friction=settings.friction, tyre=settings.tyre,
        surface=settings.surface,
    )  # fmt: skip


def _foreign(scenario: Scenario, vehicle: VehicleParameters) -> Plant:
    from sidestep.fmu.importing.isolation import IsolatedPlant
    from sidestep.fmu.importing.plant import FmuPlant

    settings = scenario.plant
    mapping = file_at(Path(), settings.map, "plant.map") if settings.map else None
    build = partial(FmuPlant.from_file, Path(settings.kind), mapping, vehicle, settings.friction)
    return IsolatedPlant(build, settings.isolate) if settings.isolate else build()


def _mjcf(scenario: Scenario, vehicle: VehicleParameters) -> Plant:
    from sidestep.plant_models.mujoco.foreign.car_map import CarMap
    from sidestep.plant_models.mujoco.foreign.plant import MjcfPlant

    settings = scenario.plant
    told = CarMap.from_file(file_at(Path(), settings.map, "plant.map")) if settings.map else None
    return MjcfPlant(
        Path(settings.kind), told, vehicle, scenario.path, scenario.obstacles, settings.friction, settings.surface
    )


def _by_name(scenario: Scenario, vehicle: VehicleParameters) -> Plant:
    settings = scenario.plant
    return plant_of(
        settings.kind, vehicle=vehicle, path=scenario.path, obstacles=scenario.obstacles, friction=settings.friction
    )  # fmt: skip


_CAR, _ROLLS, _ROAD = ("mass", "stiffness"), ("roll_centre",), ("tyre", "grade", "bank", "patches", "heights")
_COMMON = ("kind", "accept_start", "steer_offset", "delay", "noise", "noise_seed", "measured_offset")
BUILT_IN: dict[str, PlantKind] = {
    "linear": PlantKind(_linear, _CAR),
    "single-track": PlantKind(_native, ("friction", *_CAR)),
    "double-track": PlantKind(_native, ("friction", *_CAR, *_ROLLS)),
    "mujoco": PlantKind(_mujoco, ("friction", *_CAR, *_ROLLS, *_ROAD), is_scene=True),
}
"""Plants that come with the package."""
PLANT_KINDS = tuple(BUILT_IN)
ROLLING = tuple(name for name, kind in BUILT_IN.items() if "roll_centre" in kind.knows)
"""Those with springs."""
BY_ENDING: dict[str, PlantKind] = {
    ".fmu": PlantKind(_foreign, ("friction", "map", "isolate")),
    ".xml": PlantKind(_mjcf, ("friction", "map", "grade", "bank"), is_scene=True),
}
"""Plants that are files, see `plant_settings.FILES`."""
_OUTSIDE = PlantKind(_by_name, ("friction", *_CAR))


def plant_kind(name: str) -> PlantKind:
    """The entry of a kind: a built-in one, a file's by its ending, `module:factory`, an entry point's.

    Raises:
        InputError: There is none.
    """
    if name in BUILT_IN:
        return BUILT_IN[name]
    if ending := next((ending for ending in BY_ENDING if name.endswith(ending)), None):
        return BY_ENDING[ending]
    if ":" in name or name in installed_plants():
        return _OUTSIDE
    known = (*PLANT_KINDS, *installed_plants())
    problem = f"unknown plant {name!r}{did_you_mean(name, known)}"
    raise InputError("plant.kind", problem, f"{', '.join(known)}, an .fmu or .xml file, or package.module:factory")


def open_plant(scenario: Scenario) -> Plant:
    """Build the plant of `scenario.plant`; heavy libraries are loaded only for the plant that needs them.

    Raises:
        InputError: Unknown plant, missing or broken FMU or mapping, or a setting that the plant has not.
        PlantError: The plant cannot be built (no C compiler for the native FMU, say).
    """
    settings = scenario.plant
    kind = plant_kind(settings.kind)
    _require_known(settings, kind)
    plant = kind.build(scenario, true_vehicle(scenario))
    if settings.steer_offset or settings.delay:
        return ImperfectSteering(plant, settings.steer_offset, settings.delay)
    return plant


def _require_known(settings: PlantSettings, kind: PlantKind) -> None:
    """Refuse a setting that would make no difference to the plant."""
    for f in fields(PlantSettings):
        if f.name in (*_COMMON, *kind.knows) or getattr(settings, f.name) == f.default:
            continue
        files = ((f"a {ending} file", kind) for ending, kind in BY_ENDING.items())
        others = [name for name, other in (*BUILT_IN.items(), *files) if f.name in other.knows]
        raise InputError(
            f"plant.{f.name}", f"{getattr(settings, f.name)}: the plant {settings.name} does not know it",
            f"only with {', '.join(others)}",
        )  # fmt: skip


def true_vehicle(scenario: Scenario) -> VehicleParameters:
    """The car that is driven, where the controller believes in `scenario.vehicle`.

    Inertias follow the mass, as of a load that is spread like the car; a stiffer tyre peaks as high, and earlier.

    Raises:
        InputError: A mass that the car cannot have.
    """
    vehicle, mass, stiffness = scenario.vehicle, scenario.plant.mass, scenario.plant.stiffness
    raised, chassis = scenario.plant.roll_centre, vehicle.suspension
    if mass == stiffness == 1.0 and raised == 0.0:
        return vehicle
    if raised and not chassis:
        raise InputError("plant.roll_centre", f"{vehicle.name} has no suspension data", "0, or [suspension]")
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


class ImperfectSteering:
    """A plant with late commands, whose wheels stand to the left of the commanded angle; it measures neither.

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
