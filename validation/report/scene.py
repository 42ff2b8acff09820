"""What the controller sees, drawn into MuJoCo's scene: road edges, corridor, planned and predicted path."""

from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from sidestep.validation.geometry import Array
from sidestep.validation.scenarios.scenario import Scenario

_WHITE, _GREEN, _BLUE, _ORANGE = (0.9, 0.9, 0.9, 1.0), (0.1, 0.7, 0.3, 1.0), (0.2, 0.5, 1.0, 1.0), (1.0, 0.6, 0.0, 1.0)
_SPAN = 120.0  # of the road's edges around the car, in [m]


def draw_plan(scene: mujoco.MjvScene, scenario: Scenario, plan: Any, x: float, y: float) -> None:
    """Append lines to a scene.

    Args:
        scene: Geoms are added until it is full.
        scenario: Road and its widths.
        plan: Of the controller; None before its first step.
        x, y: Where the car is, in [m].
    """
    path, config = scenario.path, scenario.controller
    s, _, _ = path.project(x, y)
    stations = np.linspace(max(0.0, s - _SPAN / 3), min(path.length, s + _SPAN), 80)
    for offset in (config.width_left, -config.width_right):
        _line(scene, path.to_cartesian(stations, np.full(80, offset)), 0.01, 0.06, _WHITE)
    if plan is None:
        return
    for offsets, colour, z in ((plan.left, _GREEN, 0.03), (plan.right, _GREEN, 0.03), (plan.l, _BLUE, 0.05)):
        _line(scene, path.to_cartesian(plan.s, offsets), z, 0.04, colour)
    _line(scene, path.to_cartesian(plan.states_s, plan.states[:, 0]), 0.08, 0.07, _ORANGE)


def _line(scene: mujoco.MjvScene, points: Any, z: float, width: float, colour: tuple[float, ...]) -> None:
    x, y = (np.asarray(values, dtype=float) for values in points)
    corners = np.stack([x, y, np.full(len(x), z)], axis=1)
    corners = corners[np.isfinite(corners).all(axis=1)]
    for start, end in pairwise(corners):
        _segment(scene, start, end, width, colour)


def _segment(scene: mujoco.MjvScene, start: Array, end: Array, width: float, colour: tuple[float, ...]) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
    rgba = np.array(colour, dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
    mujoco.mjv_connector(geom, kind, width, start, end)
    geom.emission = 0.8  # seen in any light
    scene.ngeom += 1
