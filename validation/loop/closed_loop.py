"""A scenario's closed loop without anything around it: no bus, no window, no files."""

from sidestep.controller import SteeringController
from sidestep.validation.loop.measurement import ImperfectMeasurement
from sidestep.validation.scenarios.scenario import Scenario


def open_controller(scenario: Scenario) -> SteeringController | ImperfectMeasurement:
    """The scenario's controller, behind its sensors."""
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    imperfect = scenario.plant.noise or scenario.plant.measured_offset
    return ImperfectMeasurement(controller, scenario) if imperfect else controller
