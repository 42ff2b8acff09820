"""The one way from a scenario to its closed loop: the controller, what it is told of the plant, and the drive.

Whoever drives a scenario takes `open_controller` or `closed_loop`; nobody else makes a controller of one, so that
nothing that a scenario says of controller, sensors or plant is left out.
"""

import math
from contextlib import nullcontext

from sidestep.controller import SteeringController
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import FOREVER, Obstacle
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import Controller, Coupling, Port, cosimulate
from sidestep.validation.loop.measurement import ImperfectMeasurement, sensed
from sidestep.validation.loop.own_controller import OwnController, with_own
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario

_BEHIND = -1e6  # where no obstacle matters any more, in [m]


def bare_controller(scenario: Scenario) -> SteeringController:
    """The scenario's controller, which has to be ours; whoever gives it the state stands for the sensors.

    Raises:
        InputError: The scenario names another one, which only drives and campaigns take.
    """
    if scenario.controller_kind:
        raise InputError("controller.kind", f"{scenario.controller_kind!r} does not drive here", "our own controller")
    return _ours(scenario)


def driving_controller(scenario: Scenario) -> SteeringController | OwnController:
    """The scenario's controller, ours or somebody else's with ours beside it, in front of the sensors."""
    return with_own(_ours(scenario), scenario)


def _ours(scenario: Scenario) -> SteeringController:
    moving = any(o.moves and (o.trajectory or o.appears > 0.0 or o.vanishes < FOREVER) for o in scenario.obstacles)
    kind = SeesPresent if moving else SteeringController
    return kind(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)


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


def open_controller(scenario: Scenario) -> SteeringController | OwnController | ImperfectMeasurement:
    """The scenario's controller, behind its sensors."""
    return sensed(driving_controller(scenario), scenario)


def closed_loop(
    scenario: Scenario,
    plant: Plant | None = None,
    controller: Controller | None = None,
    port: Port | None = None,
    coupling: Coupling = "zero-delay",
) -> Recording:
    """Drive a scenario without a window or files.

    Args:
        scenario: What to drive.
        plant: One that is open, and stays so; None opens the scenario's.
        controller: None makes the scenario's, behind its sensors.
        port, coupling: See `cosimulate`.

    Raises:
        InputError: The plant cannot be used, or does not start where it is put.
        PlantError: The plant cannot be built or cannot start.
    """
    with nullcontext(plant) if plant else open_plant(scenario) as car:
        return cosimulate(controller or open_controller(scenario), car, scenario, port, coupling)
