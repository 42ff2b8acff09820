"""A scenario driven and judged without anything around it: no bus, no window, no files."""

from sidestep.validation.judge.verdict import Judgement, judge
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario


def simulate(scenario: Scenario) -> tuple[Recording, Judgement]:
    """Drive and judge a scenario.

    Raises:
        InputError: The plant cannot be used.
        PlantError: The plant cannot be built or cannot start.
    """
    with open_plant(scenario) as plant:
        recording = cosimulate(open_controller(scenario), plant, scenario)
    return recording, judge(recording, scenario)
