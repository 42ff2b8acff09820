"""MuJoCo's own window on a run, in real time."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant


@contextmanager
def viewer(plant: Plant) -> Iterator[Callable[[float], None]]:
    """Open the viewer; yields what is to be called with the simulated time [s] to show the car there and wait.

    Raises:
        InputError: Another plant than MuJoCo's, or no display.
    """
    from sidestep.plant_models.mujoco_plant import MujocoPlant

    if not isinstance(plant, MujocoPlant):
        raise InputError("--view", "the plant is not MuJoCo's", "--plant mujoco without plant.steer_offset")
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("--view", "there is no display (DISPLAY is not set)", "a graphical session")
    import mujoco.viewer

    with mujoco.viewer.launch_passive(plant.model, plant.data, show_left_ui=False, show_right_ui=False) as window:
        began = time.perf_counter()

        def show(simulated: float) -> None:
            window.sync()
            time.sleep(max(0.0, simulated - (time.perf_counter() - began)))

        yield show
