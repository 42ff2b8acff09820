"""A scenario's closed loop without anything around it: no bus, no window, no files."""

from sidestep.controller import SteeringController
from sidestep.validation.judge.verdict import Judgement, judge
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.measurement import ImperfectMeasurement
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario


def open_controller(scenario: Scenario) -> SteeringController | ImperfectMeasurement:
    """The scenario's controller, behind its sensors."""
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    imperfect = scenario.plant.noise or scenario.plant.measured_offset
    return ImperfectMeasurement(controller, scenario) if imperfect else controller


def simulate(scenario: Scenario) -> tuple[Recording, Judgement]:
    """Drive and judge a scenario.

    Raises:
        InputError: The plant cannot be used.
        PlantError: The plant cannot be built or cannot start.
    """
    with open_plant(scenario) as plant:
        recording = cosimulate(open_controller(scenario), plant, scenario)
    return recording, judge(recording, scenario)
