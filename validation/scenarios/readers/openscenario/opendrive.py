"""OpenDRIVE roads (1.4 to 1.8): plan view, lane widths and offsets; one road at a time."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.safe_xml import number, read_xml

Array = NDArray[np.float64]

DRIVABLE = {
    "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional", "mwyEntry",
    "mwyExit",
}  # fmt: skip
"""Lane types that a car may use."""

_GAUSS = np.polynomial.legendre.leggauss(8)
_PARTS = 8  # of a piece when it is integrated


@dataclass(frozen=True)
class Geometry:
    """A piece of the plan view.

    Attributes:
        s, x, y, heading, length: Where it starts along the road and in the world, and how long it is.
        kind: line, arc, spiral, poly3 or paramPoly3.
        values: Of that kind: nothing; curvature; curvature at both ends; a to d; aU to dU, aV to dV and 1 if its
            parameter runs from 0 to 1 rather than along the arc.
    """

    s: float
    x: float
    y: float
    heading: float
    length: float
    kind: str
    values: tuple[float, ...] = ()

    def poses(self, u: Array) -> Array:
        """x, y, heading at distances u [m] from its start, shape (3, n)."""
        if self.kind in ("line", "arc", "spiral"):
            start, end = {"line": (0.0, 0.0), "arc": self.values * 2}.get(self.kind, self.values)[:2]
            along, across = _clothoid(start, (end - start) / self.length, u)
            turn = u * (start + 0.5 * (end - start) / self.length * u)
        elif self.kind == "poly3":
            along, across, turn = self._poly3(u)
        else:
            along, across, turn = self._param_poly3(u)
        c, s = math.cos(self.heading), math.sin(self.heading)
        return np.stack([self.x + c * along - s * across, self.y + s * along + c * across, self.heading + turn])

    def _poly3(self, u: Array) -> tuple[Array, Array, Array]:
        """v(u) over the local axis u; the arc length along the curve is inverted by a table."""
        a, b, c, d = self.values
        grid = np.linspace(0.0, self.length, 2001)
        slope = b + grid * (2.0 * c + 3.0 * d * grid)
        speed = np.hypot(1.0, slope)
        arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(grid))])
        at = np.interp(u, arc, grid)
        return at, a + at * (b + at * (c + at * d)), np.arctan(b + at * (2.0 * c + 3.0 * d * at))

    def _param_poly3(self, u: Array) -> tuple[Array, Array, Array]:
        p = u / self.length if self.values[8] else u
        (au, bu, cu, du), (av, bv, cv, dv) = self.values[:4], self.values[4:8]
        turn = np.arctan2(bv + p * (2.0 * cv + 3.0 * dv * p), bu + p * (2.0 * cu + 3.0 * du * p))
        return au + p * (bu + p * (cu + p * du)), av + p * (bv + p * (cv + p * dv)), turn


def _clothoid(curvature: float, sharpness: float, u: Array) -> tuple[Array, Array]:
    nodes, weights = _GAUSS
    parts = (np.arange(_PARTS)[:, None] + 0.5 * (nodes + 1.0)[None, :]).ravel() / _PARTS
    share = np.tile(0.5 * weights / _PARTS, _PARTS)
    t = u[:, None] * parts
    angle = t * (curvature + 0.5 * sharpness * t)
    return u * (np.cos(angle) @ share), u * (np.sin(angle) @ share)


@dataclass(frozen=True)
class Lane:
    """A lane of a section; its widths are cubics of the distance from their start, counted from the section's."""

    id: int
    type: str
    widths: Array = field(repr=False)  # rows of sOffset, a, b, c, d

    def width(self, ds: Array) -> Array:
        """At distances ds [m] from the section's start, in [m]."""
        return _cubics(self.widths, ds) if len(self.widths) else np.zeros_like(ds)


@dataclass(frozen=True, eq=False)
class Road:
    """A road of an OpenDRIVE file.

    Attributes:
        id, length: Name, and length along its reference line in [m].
        pieces: Of the plan view, ascending.
        offsets: Lane offset: rows of s, a, b, c, d.
        sections: Start of each lane section, in [m], and its lanes by their number.
        right_hand: Whether traffic keeps to the right.
        notes: What was not looked at.
    """

    id: str
    length: float
    pieces: tuple[Geometry, ...]
    offsets: Array
    sections: tuple[tuple[float, dict[int, Lane]], ...]
    right_hand: bool
    notes: tuple[str, ...]

    def reference(self, s: ArrayLike) -> Array:
        """x, y, heading of its reference line, shape (3, n); straight on beyond its ends."""
        s = np.atleast_1d(np.asarray(s, dtype=np.float64))
        inside = np.clip(s, 0.0, self.length)
        starts = np.array([piece.s for piece in self.pieces])
        which = np.clip(np.searchsorted(starts, inside, side="right") - 1, 0, len(starts) - 1)
        poses = np.empty((3, len(s)))
        for i in np.unique(which).tolist():
            at = which == i
            poses[:, at] = self.pieces[i].poses(inside[at] - starts[i])
        beyond = s - inside
        poses[:2] += beyond * np.stack([np.cos(poses[2]), np.sin(poses[2])])
        return poses

    def curvature(self, s: float) -> float:
        """Of its reference line, in [1/m]."""
        ends = self.reference([s - 0.5, s + 0.5])[2]
        return math.remainder(ends[1] - ends[0], math.tau)

    def world(self, s: ArrayLike, t: ArrayLike) -> Array:
        """x, y, heading of points beside its reference line, t [m] to the left, shape (3, n)."""
        x, y, heading = self.reference(s)
        return np.stack([x - t * np.sin(heading), y + t * np.cos(heading), heading])

    def locate(self, x: float, y: float) -> tuple[float, float]:
        """S and t of a world point, in [m]."""
        grid = np.linspace(0.0, self.length, max(2, math.ceil(self.length)))
        px, py, _ = self.reference(grid)
        s = float(grid[np.argmin(np.hypot(px - x, py - y))])
        for _ in range(8):
            (px,), (py,), (h,) = self.reference(s)
            s += (x - px) * math.cos(h) + (y - py) * math.sin(h)
        (px,), (py,), (h,) = self.reference(s)
        return s, float((y - py) * math.cos(h) - (x - px) * math.sin(h))

    def lanes_at(self, s: float) -> dict[int, Lane]:
        """Lanes of the section at s by their number."""
        return self._section(s)[1]

    def borders(self, lane: int, s: ArrayLike) -> tuple[Array, Array]:
        """Inner and outer border of a lane as t, shape (n,), in [m]; its number counts from the centre outwards.

        Raises:
            InputError: There is no such lane.
        """
        s = np.atleast_1d(np.asarray(s, dtype=np.float64))
        inner, outer = np.empty_like(s), np.empty_like(s)
        sign = 1 if lane > 0 else -1
        starts = np.array([start for start, _ in self.sections])
        which = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(starts) - 1)
        for i in np.unique(which).tolist():
            at, lanes = which == i, self.sections[i][1]
            if lane not in lanes:
                raise InputError(
                    f"road {self.id}", f"no lane {lane} at {s[at][0]:.1f} m", ", ".join(map(str, sorted(lanes)))
                )
            ds, t = s[at] - starts[i], _cubics(self.offsets, s[at]) if len(self.offsets) else np.zeros(int(at.sum()))
            for number_ in range(sign, lane, sign):
                t = t + sign * lanes[number_].width(ds)
            inner[at], outer[at] = t, t + sign * lanes[lane].width(ds)
        return inner, outer

    def centre(self, lane: int, s: ArrayLike) -> Array:
        """Middle of a lane as t, shape (n,), in [m]; of lane 0 the lane offset."""
        if lane == 0:
            s = np.atleast_1d(np.asarray(s, dtype=np.float64))
            return _cubics(self.offsets, s) if len(self.offsets) else np.zeros_like(s)
        inner, outer = self.borders(lane, s)
        return 0.5 * (inner + outer)

    def lane_of(self, s: float, t: float) -> int:
        """The lane that holds a point; the nearest if none does."""
        lanes = [lane for lane in self.lanes_at(s) if lane != 0]
        return min(lanes, key=lambda lane: abs(float(self.centre(lane, s)[0]) - t))

    def direction(self, lane: int) -> int:
        """1 if traffic of a lane goes along the reference line, else -1."""
        return 1 if (lane < 0) == self.right_hand else -1

    def drivable_beside(self, lane: int, s: float) -> tuple[int, int]:
        """The outermost drivable lanes of the same direction that lie side by side with one, from inner to outer."""
        lanes, sign = self.lanes_at(s), 1 if lane > 0 else -1
        low = high = lane
        while low - sign in lanes and low != sign and lanes[low - sign].type in DRIVABLE:
            low -= sign
        while high + sign in lanes and lanes[high + sign].type in DRIVABLE:
            high += sign
        return low, high

    def _section(self, s: float) -> tuple[float, dict[int, Lane]]:
        return next((section for section in reversed(self.sections) if section[0] <= s + 1e-9), self.sections[0])


def _cubics(rows: Array, s: Array) -> Array:
    which = np.clip(np.searchsorted(rows[:, 0], s, side="right") - 1, 0, len(rows) - 1)
    start, a, b, c, d = rows[which].T
    u = s - start
    return a + u * (b + u * (c + u * d))


def read_opendrive(file: Path) -> dict[str, Road]:
    """The roads of a file by their id.

    Raises:
        InputError: It is none, or a road's plan view or lanes cannot be used.
    """
    root = read_xml(file)
    if root.tag != "OpenDRIVE":
        raise InputError(str(file), f"its root element is {root.tag!r}", "OpenDRIVE")
    roads = {element.get("id", ""): element for element in root.findall("road")}
    if not roads:
        raise InputError(str(file), "has no road")
    return {key: _road(element, f"{file}: road {key}") for key, element in roads.items()}


def _road(element: ET.Element, where: str) -> Road:
    pieces = tuple(_geometry(piece, where) for piece in element.findall("planView/geometry"))
    if not pieces:
        raise InputError(where, "has no plan view")
    sections = tuple(
        (number(section.get("s"), where), _lanes(section, where)) for section in element.findall("lanes/laneSection")
    )
    if not sections:
        raise InputError(where, "has no lane section")
    return Road(
        element.get("id", ""), number(element.get("length"), where), pieces,
        _rows(element.findall("lanes/laneOffset"), "s", where), sections,
        element.get("rule", "RHT") != "LHT", tuple(_not_flat(element, where)),
    )  # fmt: skip


def _not_flat(element: ET.Element, where: str) -> list[str]:
    notes = []
    for path, name in (
        ("elevationProfile/elevation", "elevation"),
        ("lateralProfile/superelevation", "superelevation"),
    ):
        rows = _rows(element.findall(path), "s", where)
        if len(rows) and np.any(rows[:, 1:] != 0.0):
            notes.append(f"the road's {name} is left out: it is taken as flat")
    if element.find("lateralProfile/shape") is not None:
        notes.append("the road's cross section is left out: it is taken as flat")
    return notes


def _geometry(element: ET.Element, where: str) -> Geometry:
    s, x, y, heading, length = (number(element.get(name), where) for name in ("s", "x", "y", "hdg", "length"))
    for kind, names in _KINDS.items():
        if (found := element.find(kind)) is not None:
            values = tuple(number(found.get(name), f"{where}: {kind}") for name in names)
            if kind == "paramPoly3":
                values += (float(found.get("pRange", "normalized") == "normalized"),)
            return Geometry(s, x, y, heading, max(length, 1e-9), kind, values)
    raise InputError(f"{where}: geometry at {s:g} m", "is of an unknown kind", ", ".join(_KINDS))


_KINDS = {
    "line": (),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": ("a", "b", "c", "d"),
    "paramPoly3": ("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"),
}


def _lanes(section: ET.Element, where: str) -> dict[int, Lane]:
    lanes = {}
    for side in ("left", "center", "right"):
        for lane in section.findall(f"{side}/lane"):
            key = int(number(lane.get("id"), where))
            if lane.find("border") is not None and lane.find("width") is None:
                raise InputError(f"{where}: lane {key}", "is given by its border", "width")
            lanes[key] = Lane(key, lane.get("type", ""), _rows(lane.findall("width"), "sOffset", where))
    return lanes


def _rows(elements: list[ET.Element], start: str, where: str) -> Array:
    rows = [[number(e.get(name), where) for name in (start, "a", "b", "c", "d")] for e in elements]
    return np.array(sorted(rows), dtype=np.float64).reshape(-1, 5)
