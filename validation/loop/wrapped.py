"""A controller around another one."""

from typing import Any

from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import Controller


class Wrapped:
    """Does what the controller within does; whoever wants more of a call overrides it.

    Attributes:
        controller: The one within.
    """

    def __init__(self, controller: Controller):
        self.controller = controller

    @property
    def plan(self) -> Any:
        """The plan behind the last command."""
        return self.controller.plan

    def reset(self) -> None:
        """Forget the past."""
        self.controller.reset()

    def step(self, state: VehicleState) -> SteeringCommand:
        """The command for a state."""
        return self.controller.step(state)
