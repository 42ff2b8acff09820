"""Whether a plant starts where it is put: the state after its reset against the one that was asked for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.scenarios.plant_settings import PlantSettings

TOLERANCES = {
    "x": (0.05, "m"), "y": (0.05, "m"), "yaw": (0.01, "rad"), "v_x": (0.1, "m/s"), "v_y": (0.1, "m/s"),
    "yaw_rate": (0.02, "rad/s"), "steer_angle": (0.01, "rad"),
}  # fmt: skip
"""How far each signal may be off, and its unit: what settling takes, and less than what a drive would show."""


@dataclass(frozen=True)
class Departure:
    """A signal that is not as it was asked for."""

    signal: str
    asked: float
    got: float

    def __str__(self) -> str:
        return f"{self.signal} {self.got:.4g} instead of {self.asked:.4g} {TOLERANCES[self.signal][1]}"


def departures(asked: VehicleState, got: VehicleState) -> tuple[Departure, ...]:
    """The signals that are off by more than TOLERANCES; yaw counts modulo a turn."""
    found = []
    for signal, (tolerance, _) in TOLERANCES.items():
        wanted, has = getattr(asked, signal), getattr(got, signal)
        off = math.remainder(has - wanted, math.tau) if signal == "yaw" else has - wanted
        if not abs(off) <= tolerance:
            found.append(Departure(signal, wanted, has))
    return tuple(found)


def reset_to(plant: Plant, start: VehicleState, settings: PlantSettings) -> tuple[VehicleState, tuple[Departure, ...]]:
    """Reset a plant; the state that it is in, and what of that is not as asked.

    Args:
        plant: The plant of `settings`.
        start: Where to put it.
        settings: With `accept_start`, a plant that starts elsewhere is driven from there.

    Raises:
        InputError: It starts elsewhere, and that is not accepted.
        PlantError: The plant cannot start, or its state is not finite.
    """
    state = plant.reset(start)
    if not state.is_finite():
        raise PlantError(f"the plant returned a state that is not finite: {state}")
    off = departures(start, state)
    if off and not settings.accept_start:
        raise _refusal(off, settings)
    return state, off


def reset_at(plant: Plant, start: VehicleState) -> VehicleState:
    """Reset a plant for an open-loop drive, which means nothing at another speed or heading.

    Raises:
        InputError: It starts elsewhere.
        PlantError: The plant cannot start.
    """
    state = plant.reset(start)
    if off := [departure for departure in departures(start, state) if departure.signal in ("x", "y", "yaw", "v_x")]:
        raise InputError(
            "start", "the plant starts with " + ", ".join(map(str, off)),
            "a plant whose reset takes it; of an FMU, the variables that set it as start.SIGNAL in its mapping file",
        )  # fmt: skip
    return state


def _refusal(off: Sequence[Departure], settings: PlantSettings) -> InputError:
    remedy = "a plant whose reset takes it"
    if settings.kind.endswith(".fmu"):
        keys = ", ".join(f"start.{departure.signal}" for departure in off)
        remedy = f"the variable that sets it as {keys} in {settings.map or 'a mapping file (--map)'}"
    return InputError(
        "start", f"the plant {settings.name} starts with " + ", ".join(map(str, off)),
        f"{remedy}, or --accept-start (plant.accept_start=true) to drive from there",
    )  # fmt: skip
