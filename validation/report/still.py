"""A picture of MuJoCo's scene for the report: the closest approach, as the camera behind the car sees it."""

import base64
import io
from dataclasses import replace

import numpy as np
from markupsafe import Markup
from PIL import Image

from sidestep.plant_models.errors import InputError
from sidestep.validation.loop.plants import open_plant, plant_kind
from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.film import Camera
from sidestep.validation.report.film_of import state_at
from sidestep.validation.scenarios.scenario import Scenario

_ELEMENT = '<img alt="MuJoCo\'s scene, {}" style="width: 100%" src="data:image/jpeg;base64,{}">'


def still(scenario: Scenario, recording: Recording, time: float | None) -> Markup:
    """The scene of MuJoCo's car as an element that holds its picture, or a sentence on why there is none.

    Args:
        scenario: What was driven.
        recording: What happened.
        time: What to show, in [s]; None for the middle of the run.

    Returns:
        Nothing for another plant than MuJoCo's.
    """
    if not plant_kind(scenario.plant.kind).is_scene:
        return Markup()
    state = state_at(recording, recording["time"][-1] / 2.0 if time is None else time)
    ideal = replace(scenario, plant=replace(scenario.plant, steer_offset=0.0, delay=0.0))
    with open_plant(ideal) as plant:
        plant.reset(state)
        try:
            camera = Camera(plant)
        except InputError as error:
            return Markup("<p>No picture of MuJoCo's scene: {}; it needs {}.</p>").format(error.problem, error.allowed)
        step = int(np.searchsorted(recording.steps["time"], state.time, side="right")) - 1
        pixels = camera.picture(scenario, recording.plans[step] if recording.plans else None)
        camera.close()
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=85)
    when = f"{state.time:.2f} s, {'the middle' if time is None else 'closest approach'}"
    return Markup(_ELEMENT).format(when, base64.b64encode(file.getvalue()).decode())
