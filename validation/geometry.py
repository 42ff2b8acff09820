"""Exact oriented boxes in the world and the distances between them, by shapely."""

import numpy as np
import shapely
from numpy.typing import NDArray

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]


def boxes(x: Array, y: Array, heading: Array, front: float, rear: float, width: float) -> Array:
    """Corners of oriented boxes, counter-clockwise from the front left.

    Args:
        x, y, heading: Poses of the reference point, shape (n,), in [m] and [rad].
        front, rear: From the reference point to the box's ends, in [m].
        width: Across, in [m]; the reference point is in the middle.

    Returns:
        Shape (n, 4, 2), in [m].
    """
    along = np.array([front, -rear, -rear, front])
    across = np.array([width, width, -width, -width]) / 2.0
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack([x[:, None] + c * along - s * across, y[:, None] + s * along + c * across], axis=-1)


def car_boxes(vehicle: VehicleParameters, x: Array | float, y: Array | float, yaw: Array | float) -> Array:
    """Outline of the car at each pose of its reference point, shape (n, 4, 2), in [m]."""
    x, y, yaw = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (x, y, yaw))
    return boxes(x, y, yaw, vehicle.front_extent, vehicle.rear_extent, vehicle.width)


def obstacle_boxes(path: ReferencePath, obstacle: Obstacle, time: Array) -> Array:
    """Outline of an obstacle in the world at each time, shape (n, 4, 2), in [m]."""
    s = obstacle.s + obstacle.speed * time
    x, y = path.to_cartesian(s, np.full_like(s, obstacle.l))
    heading = path.heading(s) + obstacle.heading
    return boxes(x, y, heading, obstacle.length / 2.0, obstacle.length / 2.0, obstacle.width)


def signed_clearance(first: Array, second: Array) -> Array:
    """Distance between two convex quadrilaterals, negative by the shortest translation that parts them.

    Both are the signed distance of the origin to the Minkowski difference {a - b}, whose hull is that of
    the differences of the corners.

    Args:
        first, second: Corners, shape (n, 4, 2), in [m].

    Returns:
        Shape (n,), in [m].
    """
    differences = (first[:, :, None, :] - second[:, None, :, :]).reshape(len(first), 16, 2)
    hulls = shapely.convex_hull(shapely.multipoints(differences))
    origin = shapely.Point(0.0, 0.0)
    distance = shapely.distance(shapely.boundary(hulls), origin)
    return np.where(shapely.intersects(hulls, origin), -distance, distance)


def edge_clearance(path: ReferencePath, width_left: float, width_right: float, corners: Array, s: Array) -> Array:
    """Smallest signed distance of a box's corners to the road's edges, shape (n,), in [m]; negative when over.

    Args:
        path: Reference path.
        width_left, width_right: From it to the edges, in [m].
        corners: Shape (n, 4, 2), in [m].
        s: Stations near the boxes, shape (n,), in [m]: which branch of a road near itself is meant.
    """
    offset = path.project(corners[..., 0], corners[..., 1], near=s[:, None])[1]
    return np.minimum(width_left - offset.max(axis=1), width_right + offset.min(axis=1))
