"""The quick check of a foreign MuJoCo model before a drive: does its car hold the speed, and go where it steers?"""

from dataclasses import replace

from sidestep.plant_models.checks.quick import quick_check
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.foreign.vehicle import require_speed
from sidestep.validation.loop.cosimulation import PLANT_STEP
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import Scenario


def model_doubts(scenario: Scenario) -> list[str]:
    """What was changed in the model, and what looks odd, as sentences.

    Args:
        scenario: Whose plant is a MuJoCo model; it is driven straight on and through one bend, on an empty road.

    Raises:
        InputError: The car does not hold the scenario's speed, or does not go where it steers.
        PlantError: It cannot start or go on.
    """
    settings = replace(scenario.plant, steer_offset=0.0, delay=0.0)
    with open_plant(replace(scenario, obstacles=(), plant=settings)) as plant:
        require_speed(plant, scenario.speed, f"{settings.name}.xml")
        start = replace(scenario.start, v_x=scenario.speed)
        doubts = quick_check(plant, scenario.vehicle, start, PLANT_STEP)
        notes = list(getattr(plant, "notes", ()))
    said = [(doubt.is_certain, doubt.sentence.partition(": ")[2]) for doubt in doubts]
    if certain := [sentence for is_certain, sentence in said if is_certain]:
        allowed = "another steering, drive or forward in its mapping file (--map)"
        raise InputError(settings.kind, f"a first bend contradicts it: {'; '.join(certain)}", allowed)
    return notes + [sentence for _, sentence in said]
