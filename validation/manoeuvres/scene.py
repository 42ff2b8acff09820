"""Car and plant of an open-loop drive, from `--set` overrides."""

from collections.abc import Sequence

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario

_KEYS = ("vehicle.", "plant.", "controller.buffer.")
_SCENARIO = """
name = "open-loop"
speed = 15.0
duration = 1.0
road = { width_left = 4.0, width_right = 4.0, segments = [{ type = "line", length = 1000.0 }] }
"""


def open_loop_scenario(overrides: Sequence[str], noisy: bool = False) -> Scenario:
    """Vehicle, plant and buffer of `--set` overrides, on an empty road.

    Args:
        overrides: `key=value`.
        noisy: Whether what is measured may be.

    Raises:
        InputError: Bad override, or one that makes no difference to an open-loop drive.
    """
    scenario = parse_scenario(_SCENARIO, "open-loop", overrides)
    for key in (change.partition("=")[0].strip() for change in overrides):
        if not f"{key}.".startswith(_KEYS):
            raise InputError(f"--set {key}", "makes no difference here", "keys of vehicle and plant, controller.buffer")
    for name in ("measured_offset", *(() if noisy else ("noise",))):
        if value := getattr(scenario.plant, name):
            raise InputError(f"plant.{name}", f"{value}: only the plant's true state is looked at here", "0")
    return scenario
