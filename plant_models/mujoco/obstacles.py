"""The boxes that a car in MuJoCo must not touch: bodies that are moved, not bodies that move."""

import math
from collections.abc import Sequence

import mujoco
from numpy.typing import NDArray

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath

_BURIED = -100.0  # where an obstacle is that is not there, in [m]


def add_obstacle(spec: mujoco.MjSpec, name: str, obstacle: Obstacle, touches: int) -> None:
    """Add a body with a box, which is not there before it is placed.

    Args:
        spec: Of the world.
        name: Of body and geom.
        obstacle: Whose size the box has.
        touches: Bits of MuJoCo's contact filter.
    """
    body = spec.worldbody.add_body(name=name, mocap=True, pos=[0.0, 0.0, _BURIED])
    size = [obstacle.length / 2.0, obstacle.width / 2.0, obstacle.height / 2.0]
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=[0.0, 0.0, obstacle.height / 2.0],
        contype=touches, conaffinity=touches, rgba=[0.8, 0.1, 0.1, 1.0],
    )  # fmt: skip


def place_obstacles(
    positions: NDArray, quaternions: NDArray, obstacles: Sequence[Obstacle], path: ReferencePath | None, time: float
) -> None:
    """Put the boxes where the obstacles are at a time [s].

    Args:
        positions, quaternions: Rows of `mocap_pos` and `mocap_quat`, written.
        obstacles: In the same order.
        path: The road that they are given on; None for the x axis.
        time: In [s].
    """
    for i, obstacle in enumerate(obstacles):
        x, y, yaw = obstacle.pose(path, time)
        positions[i] = x, y, 0.0 if obstacle.is_there(time) else _BURIED
        quaternions[i] = yaw_quaternion(yaw)


def yaw_quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Of a turn about the vertical, in [rad]."""
    return math.cos(yaw / 2.0), 0.0, 0.0, math.sin(yaw / 2.0)
