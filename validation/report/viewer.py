"""MuJoCo's own window on a run, in real time."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.validation.report.film import NEEDED, Scene
from sidestep.validation.scenarios.scenario import Scenario


@contextmanager
def viewer(plant: Plant, scenario: Scenario | None = None, controller: Any = None) -> Iterator[Callable[[float], None]]:
    """Open the viewer; yields what is to be called with the simulated time [s] to show the car there and wait.

    With a scenario, its road and the `plan` of the controller are drawn, too.

    Raises:
        InputError: Another plant than MuJoCo's, or no display.
    """
    if not isinstance(plant, Scene):
        raise InputError("--view", "the plant is not MuJoCo's", NEEDED)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("--view", "there is no display (DISPLAY is not set)", "a graphical session")
    import mujoco.viewer

    from sidestep.validation.report.scene import draw_plan

    with mujoco.viewer.launch_passive(plant.model, plant.data, show_left_ui=False, show_right_ui=False) as window:
        began = time.perf_counter()

        def show(simulated: float) -> None:
            if scenario is not None and (scene := window.user_scn) is not None:
                with window.lock():
                    scene.ngeom = 0
                    draw_plan(scene, scenario, controller.plan, *plant.spot[:2])
            window.sync()
            time.sleep(max(0.0, simulated - (time.perf_counter() - began)))

        yield show
