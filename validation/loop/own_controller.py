"""Controllers that are not ours, by `package.module:factory`, with ours beside them to take over.

The factory is called by keyword with those of `vehicle`, `path`, `obstacles`, `config` and `speed` that it takes, and
returns something with `step(state)`, whose answer is a SteeringCommand or the road-wheel angle alone, in [rad].
`reset()` is called if it is there. Ours steps at every state, too. Where the other one raises, or answers with what is
not finite, ours drives from then on, degraded; the drive then counts as a failure of the other one.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from sidestep.controller import SteeringController
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import Controller
from sidestep.validation.loop.plant_factory import factory_of, taken
from sidestep.validation.loop.wrapped import Wrapped
from sidestep.validation.scenarios.scenario import Scenario

OFFERED = ("vehicle", "path", "obstacles", "config", "speed")
"""Arguments that a factory may take."""
PLACE = "controller.kind"


class OwnController(Wrapped):
    """Somebody else's controller, and ours if that fails.

    Attributes:
        controller: Ours.
        own: The other one.
        failure: What it did and when; empty while it drives.
    """

    def __init__(self, ours: Controller, own: Any, speed: float):
        super().__init__(ours)
        self.own, self.speed, self.failure = own, speed, ""

    @property
    def plan(self) -> Any:
        """Ours; what its solver says counts only where it drives."""
        plan = self.controller.plan
        if self.failure or plan is None:
            return plan
        return plan._replace(feasible=True, slack_corridor=0.0, slack_slip=0.0, solver_status="NOT ASKED")

    def reset(self) -> None:
        """Forget the past, a failure too."""
        self.failure = ""
        super().reset()
        if callable(reset := getattr(self.own, "reset", None)):
            self._guarded(reset, 0.0)

    def step(self, state: VehicleState) -> SteeringCommand:
        """The other one's command, or ours."""
        ours = super().step(state)
        if not self.failure:
            answer = self._guarded(lambda: self._command(state), state.time)
            if answer is not None:
                return answer
        return replace(ours, status=max(ours.status, Status.DEGRADED))

    def _command(self, state: VehicleState) -> SteeringCommand:
        answer = self.own.step(state)
        if not isinstance(answer, SteeringCommand):
            answer = SteeringCommand(state.time, float(answer), self.speed)
        if not math.isfinite(answer.steer_angle + answer.target_speed):
            raise ValueError(f"answered with {answer}")
        return answer

    def _guarded(self, call: Callable[[], Any], time: float) -> Any:
        try:
            return call()
        except Exception as error:  # somebody else's code: it may raise anything
            self.failure = f"{type(error).__name__} at {time:.2f} s ({error}); ours drove on"
            return None


def with_own(ours: SteeringController, scenario: Scenario) -> SteeringController | OwnController:
    """The controller that a scenario names, ours beside it; ours alone if it names none.

    Raises:
        InputError: The factory cannot be found or used.
        PlantError: It raises.
    """
    kind = scenario.controller_kind
    if not kind:
        return ours
    factory = factory_of(kind, PLACE)
    offered = {
        "vehicle": scenario.vehicle, "path": scenario.path, "obstacles": scenario.obstacles,
        "config": scenario.controller, "speed": scenario.speed,
    }  # fmt: skip
    try:
        own = factory(**{name: offered[name] for name in taken(factory, kind, PLACE, OFFERED)})
    except Exception as error:
        if isinstance(error, InputError):
            raise
        raise PlantError(f"{kind}: {type(error).__name__}: {error}") from error
    if not callable(getattr(own, "step", None)):
        raise InputError(PLACE, f"{kind!r} makes something without 'step'", "step(state)")
    return OwnController(ours, own, scenario.speed)
