"""A scenario's closed loop without anything around it: no bus, no window, no files."""

import math

from sidestep.controller import SteeringController
from sidestep.plant_models.obstacle import FOREVER, Obstacle
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.judge.verdict import Judgement, judge
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.measurement import ImperfectMeasurement
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario

_BEHIND = -1e6  # where no obstacle matters any more, in [m]


def open_controller(scenario: Scenario) -> SteeringController | ImperfectMeasurement:
    """The scenario's controller, behind its sensors."""
    moving = any(o.moves and (o.trajectory or o.appears > 0.0 or o.vanishes < FOREVER) for o in scenario.obstacles)
    kind = SeesPresent if moving else SteeringController
    controller = kind(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    imperfect = scenario.plant.noise or scenario.plant.measured_offset
    return ImperfectMeasurement(controller, scenario) if imperfect else controller


class SeesPresent(SteeringController):
    """Knows of each obstacle where it is and how fast at every step, and takes it to go on like that."""

    def step(self, state: VehicleState) -> SteeringCommand:
        """As `SteeringController.step`."""
        if math.isfinite(state.time):
            self.boxes[:] = [_as_if_constant(obstacle, state.time) for obstacle in self.obstacles]
        return super().step(state)


def _as_if_constant(obstacle: Obstacle, time: float) -> tuple[float, ...]:
    """The box at time 0 that comes to where the obstacle is, at the speed that it has now; elsewhere if not there."""
    if not obstacle.is_there(time):
        return _BEHIND, 0.0, 1.0, 1.0, 0.0, 0.0
    now = obstacle.at(time)
    return now.s - now.speed * time, now.l, now.length, now.width, now.heading, now.speed


def simulate(scenario: Scenario) -> tuple[Recording, Judgement]:
    """Drive and judge a scenario.

    Raises:
        InputError: The plant cannot be used.
        PlantError: The plant cannot be built or cannot start.
    """
    with open_plant(scenario) as plant:
        recording = cosimulate(open_controller(scenario), plant, scenario)
    return recording, judge(recording, scenario)
