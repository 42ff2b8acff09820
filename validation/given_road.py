"""The road as its way-points give it: polyline and widths, measured by shapely, without the path laid along it."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sidestep.plant_models.road.polyline import Polyline
from sidestep.plant_models.road.widths import Widths

Array = NDArray[np.float64]

_BLOCK, _BEYOND = 50.0, 60.0  # the polyline is cut into parts, so that a near-by leg is not taken for this one, in [m]


@dataclass(frozen=True, eq=False)
class GivenEdges:
    """Way-points, the arc length of each along their polyline, and the widths there.

    Attributes:
        points: Shape (n, 2), in [m].
        stations: Shape (n,), in [m].
        widths: Left and right, shape (n, 2), in [m].
        period: Length of a closed road, 0 for an open one, in [m].
    """

    points: Array
    stations: Array
    widths: Array
    period: float

    def clearance(self, corners: Array, near: Array) -> Array:
        """Smallest signed distance of a box's corners to the edges, shape (n,), in [m]; negative when over.

        Args:
            corners: Shape (n, 4, 2), in [m].
            near: Arc length along the polyline near which each box is, shape (n,), in [m].
        """
        result, block = np.empty(len(corners)), np.floor(near / _BLOCK)
        for at in np.unique(block).tolist():
            chosen = block == at
            part, start = self._part(at * _BLOCK - _BEYOND, (at + 1) * _BLOCK + _BEYOND)
            result[chosen] = self._clearance(part, start, corners[chosen])
        return result

    def _part(self, start: float, end: float) -> tuple[shapely.LineString, float]:
        """The polyline between two arc lengths, straight on beyond the ends of an open one, and where it starts."""
        points, stations = self.points, self.stations
        if self.period:
            laps = range(int(np.floor(start / self.period)), int(np.floor(end / self.period)) + 1)
            stations = np.concatenate([stations[:-1] + lap * self.period for lap in laps])
            points = np.concatenate([points[:-1]] * len(laps))
        else:
            first, last = points[0] - points[1], points[-1] - points[-2]
            before = points[0] + first / np.hypot(*first) * 2.0 * _BEYOND
            after = points[-1] + last / np.hypot(*last) * 2.0 * _BEYOND
            points = np.vstack([before, points, after])
            stations = np.concatenate([stations[:1] - 2.0 * _BEYOND, stations, stations[-1:] + 2.0 * _BEYOND])
        low = max(int(np.searchsorted(stations, start)) - 1, 0)
        high = min(int(np.searchsorted(stations, end)) + 1, len(stations))
        return shapely.LineString(points[low:high]), float(stations[low])

    def _clearance(self, part: shapely.LineString, start: float, corners: Array) -> Array:
        points = shapely.points(corners)
        along = shapely.line_locate_point(part, points)
        before, behind = (shapely.line_interpolate_point(part, np.maximum(along + step, 0.0)) for step in (-0.01, 0.01))
        a, b = shapely.get_coordinates(before), shapely.get_coordinates(behind)
        p = corners.reshape(-1, 2)
        side = np.sign((b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0]))
        offset = side.reshape(along.shape) * shapely.distance(part, points)
        u = start + along
        left, right = (
            np.interp(np.remainder(u, self.period) if self.period else u, self.stations, w) for w in self.widths.T
        )
        return np.minimum(left - offset, right + offset).min(axis=1)


def edges_of(line: Polyline, edges: Widths) -> GivenEdges:
    """The edges beside way-points: of the widths given with them, or else the same everywhere."""
    widths = line.widths if line.widths is not None else np.tile(edges.table[0], (len(line.points), 1))
    stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line.points, axis=0).T))])
    return GivenEdges(line.points, stations, widths, float(stations[-1]) if line.closed else 0.0)
