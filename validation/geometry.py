"""Exact oriented boxes in the world and the distances between them, by shapely."""

import numpy as np
import shapely
from numpy.typing import NDArray

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.trajectory import interpolated
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.given_road import edges_of

Array = NDArray[np.float64]

FAR = 1e7
"""Where something is that is not there, in [m]."""


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


def obstacle_poses(path: ReferencePath, obstacle: Obstacle, time: Array) -> Array:
    """x, y [m] and yaw [rad] of an obstacle's centre at each time [s], shape (3, n).

    A way that was given in the world is taken as it was given, not by the path. While it is not there it is far away.
    """
    time = np.asarray(time, dtype=np.float64)
    if obstacle.trajectory is not None and obstacle.trajectory.world is not None:
        poses = interpolated(obstacle.trajectory.world, time)
    else:
        s, l, heading, _ = obstacle.track(time)  # noqa: E741 (the paper's letter)
        x, y = path.to_cartesian(s, l)
        poses = np.stack([x, y, path.heading(s) + heading])
    poses[:2, ~obstacle.is_there(time)] = FAR
    return poses


def obstacle_boxes(path: ReferencePath, obstacle: Obstacle, time: Array) -> Array:
    """Outline of an obstacle in the world at each time, shape (n, 4, 2), in [m]."""
    x, y, yaw = obstacle_poses(path, obstacle, time)
    return boxes(x, y, yaw, obstacle.length / 2.0, obstacle.length / 2.0, obstacle.width)


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


def edge_clearance(path: ReferencePath, corners: Array, s: Array) -> Array:
    """Smallest signed distance of a box's corners to the road's edges, shape (n,), in [m]; negative when over.

    On a road of way-points it is measured from their polyline, see `given_road`; on one of segments, which is exact,
    from the path.

    Args:
        path: Reference path, with the road's widths.
        corners: Shape (n, 4, 2), in [m].
        s: Stations near the boxes, shape (n,), in [m]: which branch of a road near itself is meant.
    """
    if path.given is not None:
        near = path.given_station(s)
        return edges_of(path.given, path.edges).clearance(corners, near)
    station, offset, _ = path.project(corners[..., 0], corners[..., 1], near=s[:, None])
    left, right = path.widths(station)
    return np.minimum(left - offset, right + offset).min(axis=1)
