"""The film of a run that is over, from its recording, whatever plant drove it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sidestep.plant_models.signals import VehicleState
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.film import FRAMES_PER_SECOND, Camera, require_film, write_film
from sidestep.validation.scenarios.plant_settings import PlantSettings
from sidestep.validation.scenarios.scenario import Scenario

STATE = ("time", "x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle")
"""Columns of a recording that are the plant's state."""


def state_at(recording: Recording, time: float) -> VehicleState:
    """The sample next to a moment, in [s]."""
    row = int(np.argmin(np.abs(recording["time"] - time)))
    return VehicleState(*(float(recording[name][row]) for name in STATE))


def film_of(scenario: Scenario, recording: Recording, file: Path) -> Path:
    """Film a recording: MuJoCo's car is put where the recording has it, frame by frame.

    Args:
        scenario: What was driven.
        recording: What happened.
        file: .gif, or .mp4 with ffmpeg.

    Returns:
        The film.

    Raises:
        InputError: No OpenGL, or a file type that cannot be written.
    """
    require_film(file)
    # another plant's settings need not be MuJoCo's
    surface = scenario.plant if scenario.plant.kind == "mujoco" else PlantSettings()
    ideal = replace(scenario, plant=replace(surface, steer_offset=0.0, delay=0.0))
    frames = []
    with open_plant(ideal) as plant:
        camera = Camera(plant)
        try:
            for time in np.arange(recording["time"][0], recording["time"][-1], 1.0 / FRAMES_PER_SECOND):
                plant.reset(state_at(recording, float(time)))
                step = int(np.searchsorted(recording.steps["time"], time, side="right")) - 1
                frames.append(camera.picture(ideal, recording.plans[step] if recording.plans else None))
        finally:
            camera.close()
    write_film(file, frames)
    return file
