"""The one seam between controller and world: what every plant can do."""

from typing import Protocol, Self, runtime_checkable

from sidestep.plant_models.signals import SteeringCommand, VehicleState


@runtime_checkable
class Plant(Protocol):
    """A vehicle that can be stepped.

    Life cycle: construct, `reset`, any number of `step`, and again from `reset`; `close` ends it
    (twice does no harm) and is called by the context manager.
    """

    def reset(self, state: VehicleState) -> VehicleState:
        """Put the car at `state` and return the state it really is in (time included).

        Raises:
            PlantError: The plant cannot start there.
        """
        ...

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds and return the state at the end.

        Raises:
            PlantError: The plant cannot go on.
        """
        ...

    def close(self) -> None:
        """Release what the plant holds."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...
