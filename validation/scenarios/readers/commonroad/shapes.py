"""Shapes and states of a CommonRoad file."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
import shapely

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.imported import Imported
from sidestep.validation.scenarios.readers.safe_xml import number


@dataclass(frozen=True)
class Box:
    """An oriented box in the frame of what it belongs to.

    Attributes:
        length, width: In [m].
        x, y: Its centre, in [m].
        yaw: In [rad].
        note: What it bounds, if the shape was no rectangle.
    """

    length: float
    width: float
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    note: str = ""

    @property
    def outline(self) -> shapely.Polygon:
        """Its corners in that frame."""
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (self.length / 2.0, self.width / 2.0)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return shapely.Polygon(half @ np.array([[c, s], [-s, c]]) + (self.x, self.y))


def box_of(shape: ET.Element, where: str) -> Box:
    """The bounding box of a rectangle, circle or polygon.

    Raises:
        InputError: It is none of these.
    """
    x, y = _point(shape.find("center"), where)
    if shape.tag == "rectangle":
        yaw = number(shape.findtext("orientation") or "0", where)
        return Box(_size(shape, "length", where), _size(shape, "width", where), x, y, yaw)
    if shape.tag == "circle":
        radius = _size(shape, "radius", where)
        return Box(2.0 * radius, 2.0 * radius, x, y, note=f"the square around a circle of {radius:g} m radius")
    if shape.tag == "polygon":
        corners = np.array([_point(point, where) for point in shape.findall("point")])
        if len(corners) >= 3:
            low, high = corners.min(axis=0), corners.max(axis=0)
            (length, width), (cx, cy) = np.maximum(high - low, 0.01), 0.5 * (low + high)
            return Box(
                float(length),
                float(width),
                float(cx),
                float(cy),
                note=f"the box around a polygon of {len(corners)} corners",
            )
    raise InputError(f"{where}: shape", f"{shape.tag!r} cannot be used", "rectangle, circle, polygon")


def pose_of(state: ET.Element, where: str, result: Imported) -> tuple[float, float, float]:
    """x, y and yaw of a state; the middle of an area, which is told."""
    position = state.find("position")
    place = None if position is None else position.find("point")
    if position is None or len(position) == 0:
        raise InputError(where, "has a state without a position")
    if place is not None:
        x, y = _point(place, where)
    elif position[0].tag == "lanelet":
        raise InputError(where, "has a lanelet as the position of a state", "a point")
    else:
        box = box_of(position[0], where)
        x, y = box.x, box.y
        result.note("positions given as areas are taken at their middle")
    return x, y, value_of(state.find("orientation"), where, 0.0)


def value_of(element: ET.Element | None, where: str, default: float) -> float:
    """An exact value, or the middle of an interval; the default if there is none."""
    if element is None:
        return default
    if (exact := element.findtext("exact")) is not None:
        return number(exact, where)
    low, high = (number(element.findtext(name), where) for name in ("intervalStart", "intervalEnd"))
    return 0.5 * (low + high)


def _point(element: ET.Element | None, where: str) -> tuple[float, float]:
    return (
        (0.0, 0.0) if element is None else (number(element.findtext("x"), where), number(element.findtext("y"), where))
    )


def _size(shape: ET.Element, name: str, where: str) -> float:
    value = number(shape.findtext(name), f"{where}: {name}")
    if not value > 0.0:
        raise InputError(f"{where}: {name}", f"{value} m", "> 0")
    return value
