"""The one way from a scenario to its closed loop: the controller, what it is told of the plant, and the drive.

Whoever drives a scenario takes `open_controller` or `closed_loop`; nobody else makes a controller of one, so that
nothing that a scenario says of controller, sensors or plant is left out.
"""

from contextlib import nullcontext

from sidestep.controller import SteeringController
from sidestep.plant_models.plant import Plant
from sidestep.validation.loop.cosimulation import Controller, Coupling, Port, cosimulate
from sidestep.validation.loop.measurement import ImperfectMeasurement, sensed
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario


def bare_controller(scenario: Scenario) -> SteeringController:
    """The scenario's controller; whoever gives it the state stands for the sensors."""
    return SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)


def open_controller(scenario: Scenario) -> SteeringController | ImperfectMeasurement:
    """The scenario's controller, behind its sensors."""
    return sensed(bare_controller(scenario), scenario)


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
