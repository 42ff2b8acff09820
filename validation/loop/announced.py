"""A controller that somebody listens to."""

from collections.abc import Callable

from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import Controller
from sidestep.validation.loop.wrapped import Wrapped


class Announced(Wrapped):
    """A controller whose every state is told to somebody first.

    Attributes:
        announce: Called with the state.
    """

    def __init__(self, controller: Controller):
        super().__init__(controller)
        self.announce: Callable[[VehicleState], None] = lambda _: None

    def step(self, state: VehicleState) -> SteeringCommand:
        """Tell the state, then step the controller."""
        self.announce(state)
        return super().step(state)
