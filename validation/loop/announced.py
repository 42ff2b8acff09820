"""A controller that somebody listens to."""

from collections.abc import Callable
from typing import Any

from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import Controller


class Announced:
    """A controller whose every state is told to somebody first.

    Args:
        controller: The controller.

    Attributes:
        announce: Called with the state.
    """

    def __init__(self, controller: Controller):
        self._controller = controller
        self.announce: Callable[[VehicleState], None] = lambda _: None

    @property
    def plan(self) -> Any:
        """The controller's."""
        return self._controller.plan

    def reset(self) -> None:
        """Reset the controller."""
        self._controller.reset()

    def step(self, state: VehicleState) -> SteeringCommand:
        """Tell the state, then step the controller."""
        self.announce(state)
        return self._controller.step(state)
