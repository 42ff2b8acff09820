"""Plants that are not ours: a factory named `package.module:factory`, or by an entry point of an installed package.

The factory is called by keyword with those of `vehicle`, `path`, `obstacles` and `friction` that it takes, and returns
a `Plant`. A class is its own factory.
"""

import importlib
import inspect
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Self

from sidestep.plant_models.errors import InputError, PlantError, SidestepError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState

GROUP = "sidestep.plants"
"""Of the entry points; their names are kinds of plants."""
OFFERED = ("vehicle", "path", "obstacles", "friction")
"""Arguments that a factory may take."""
_METHODS = ("reset", "step", "close")


@cache
def installed_plants() -> dict[str, str]:
    """`module:factory` of the plants that installed packages offer, by their names."""
    return {point.name: point.value for point in entry_points(group=GROUP)}


def factory_of(kind: str, place: str = "plant.kind") -> Callable[..., Any]:
    """The factory that `kind` names.

    Modules are found as in Python, from the working directory too.

    Args:
        kind: `package.module:factory`, or the name of an entry point.
        place: What errors call it.

    Raises:
        InputError: No such module or factory, or the module cannot be imported.
    """
    name = installed_plants().get(kind, kind)
    module, _, path = name.partition(":")
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))
    try:
        found: Any = importlib.import_module(module)
    except Exception as error:
        raise InputError(place, f"{kind!r}: cannot import {module!r} ({error})", "package.module:factory") from error
    for part in path.split("."):
        if not hasattr(found, part):
            raise InputError(place, f"{kind!r}: {module!r} has no {path!r}", "package.module:factory")
        found = getattr(found, part)
    if not callable(found):
        raise InputError(place, f"{kind!r} cannot be called", "a class or a function")
    return found


def taken(
    factory: Callable[..., Any], kind: str, place: str = "plant.kind", every: tuple[str, ...] = OFFERED
) -> tuple[str, ...]:
    """Which of the arguments that are offered a factory takes.

    Raises:
        InputError: It asks for something else.
    """
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return every
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        return every
    needed = [p.name for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL]
    if unknown := [name for name in needed if name not in every]:
        raise InputError(place, f"{kind!r} asks for {unknown[0]!r}", ", ".join(every))
    return tuple(p.name for p in parameters if p.name in every)


def plant_of(kind: str, **offered: Any) -> Plant:
    """The plant that a factory makes.

    Args:
        kind: As for `factory_of`.
        offered: Values of OFFERED.

    Raises:
        InputError: See `factory_of`; a friction that the factory does not take; or it returns no plant.
        PlantError: The factory fails.
    """
    factory = factory_of(kind)
    names = taken(factory, kind)
    if "friction" not in names and offered["friction"] != 1.0:
        raise InputError("plant.friction", f"{offered['friction']}: {kind} does not take it", "1.0")
    try:
        plant = factory(**{name: offered[name] for name in names})
    except SidestepError:
        raise
    except Exception as error:
        raise PlantError(f"{kind}: {type(error).__name__}: {error}") from error
    if missing := [name for name in _METHODS if not callable(getattr(plant, name, None))]:
        raise InputError("plant.kind", f"{kind!r} makes something without {missing[0]!r}", f"{', '.join(_METHODS)}")
    return Guarded(plant, kind)


class Guarded:
    """Somebody else's plant, whose own exceptions end a drive as those of our plants do; all else is the plant's."""

    def __init__(self, plant: Any, kind: str):
        self._plant, self._kind = plant, kind

    def reset(self, state: VehicleState) -> VehicleState:
        """Reset the plant.

        Raises:
            PlantError: It cannot start.
        """
        return self._called(self._plant.reset, state)

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Step the plant.

        Raises:
            PlantError: It fails.
        """
        return self._called(self._plant.step, command, dt)

    def close(self) -> None:
        """Close the plant."""
        self._plant.close()

    def _called(self, method: Callable[..., Any], *arguments: Any) -> VehicleState:
        try:
            return method(*arguments)
        except SidestepError:
            raise
        except Exception as error:
            raise PlantError(f"{self._kind}: {type(error).__name__}: {error}") from error

    def __getattr__(self, name: str) -> Any:
        if name == "_plant":  # not there yet, as in a copy
            raise AttributeError(name)
        return getattr(self._plant, name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
