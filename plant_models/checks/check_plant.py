"""Conformance check of a plant: does it keep to the seams' conventions? Run it on your own plant.

findings = check_plant(MyPlant(), vehicle)      # [] when all is well
"""

from collections.abc import Callable, Iterator, Sequence

from sidestep.plant_models.checks.car import OF_THE_CAR
from sidestep.plant_models.checks.conventions import CONVENTIONS, closing, reset
from sidestep.plant_models.checks.driving import DT, NAMES
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.vehicle.parameters import VehicleParameters

_METHODS = ("reset", "step", "close", "__enter__", "__exit__")


def check_plant(
    plant: Plant, vehicle: VehicleParameters | None = None, dt: float = DT, placed: Sequence[str] = NAMES
) -> list[str]:
    """Drive a plant through short manoeuvres and compare with what every plant promises.

    Checked are life cycle, start state, clock, determinism, axes and signs (ISO 8855), that pose and velocity agree,
    that yaw does not wrap, speed control, commands that are NaN; with `vehicle` also reference point, road-wheel angle,
    limits and lag of the steering, slip of both axles (mass, stiffness), yaw inertia and grip.
    About 80 s of simulated time; the plant is closed at the end.

    Args:
        plant: The plant, without errors of its own such as a misaligned steering, on a road of friction 1.
        vehicle: The car that it models, if known.
        dt: Step of the checks, in [s]; they also step by half of it.
        placed: Signals that a reset sets; others are not asked for.

    Returns:
        One sentence for every finding, empty if there is none.
    """
    missing = [name for name in _METHODS if not callable(getattr(plant, name, None))]
    if missing:
        return [f"The plant has no method {', '.join(missing)}."]
    findings = _found(reset, plant, dt, placed)
    findings += [finding for check in CONVENTIONS for finding in _found(check, plant, dt)]
    if vehicle is not None:
        findings += [finding for check in OF_THE_CAR for finding in _found(check, plant, vehicle, dt)]
    return findings + _found(closing, plant)


def _found(check: Callable[..., Iterator[str]], *arguments: object) -> list[str]:
    try:
        return list(check(*arguments))
    except Exception as error:  # whatever a stranger's plant raises is a finding
        return [f"The check of {check.__name__.replace('_', ' ')} ended with {type(error).__name__}: {error}."]
