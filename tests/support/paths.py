"""Reference paths that come near themselves."""

import math

import numpy as np
from hypothesis import settings

from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Line

steady = settings(deadline=None, derandomize=True, max_examples=50)
HAIRPIN = ReferencePath.from_segments([Line(60.0), Arc(3.0 * math.pi, 1 / 3), Line(60.0)])
CIRCLE = ReferencePath.from_segments([Arc(50.0 * math.pi, 0.02), Arc(50.0 * math.pi, 0.02)])


def figure_eight() -> ReferencePath:
    t = np.linspace(0.0, math.tau, 120)
    return ReferencePath.from_waypoints(np.column_stack([60.0 * np.sin(t), 60.0 * np.sin(t) * np.cos(t)]))


def circle_points(radius: float, spacing: float) -> np.ndarray:
    angle = np.arange(0.0, math.tau - 0.5 * spacing / radius, spacing / radius)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])
