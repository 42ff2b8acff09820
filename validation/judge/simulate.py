"""A scenario driven and judged, without a bus, a window or files."""

from sidestep.validation.judge.verdict import Judgement, judge
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario


def simulate(scenario: Scenario) -> tuple[Recording, Judgement]:
    """Drive and judge a scenario.

    Raises:
        InputError: The plant cannot be used, or does not start where it is put.
        PlantError: The plant cannot be built or cannot start.
    """
    recording = closed_loop(scenario)
    return recording, judge(recording, scenario)
