"""Several runs of one scenario over each other: paths from above, steering, acceleration, what sets them apart."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.style import legend, panel, styled, timeline
from sidestep.validation.report.topview import OUTLINE_EVERY, draw_cars, draw_road, driven_extent, stacked_axes
from sidestep.validation.scenarios.scenario import Scenario


class Line(NamedTuple):
    """One of the runs: its name, colour and recording."""

    name: str
    colour: str
    recording: Recording


def compared_top_view(scenario: Scenario, lines: Sequence[Line]) -> Figure:
    """The driven paths, with the outlines of the first run's car."""
    with styled():
        extents = np.array([driven_extent(line.recording) for line in lines])
        view = float(extents[:, 0].min()), float(extents[:, 1].max())
        figure, (axes,) = stacked_axes(scenario.path, [view])
        draw_road(axes, scenario, view, time=0.0)
        first = lines[0]
        outlines = np.arange(0.0, first.recording["time"][-1], OUTLINE_EVERY)
        draw_cars(axes, scenario, first.recording, outlines, facecolor="none", edgecolor=first.colour)
        for line in lines:
            axes.plot(line.recording["x"], line.recording["y"], color=line.colour, label=line.name, zorder=4)
        axes.set_title(f"Driven paths; outlines: {first.name}")
        legend(axes)
    return figure


def compared_signals(lines: Sequence[Line]) -> Figure:
    """Steering angle and lateral acceleration over time, and over the road how far the paths are from the first."""
    with styled():
        figure = Figure(figsize=(11.0, 2.6))
        figure.subplots_adjust(0.045, 0.17, 0.995, 0.9, wspace=0.16)
        steering, acceleration, apart = figure.subplots(1, 3)
        first = lines[0].recording
        for name, colour, recording in lines:
            steering.plot(recording["time"], np.degrees(recording["steer_angle"]), color=colour, label=name)
            acceleration.plot(recording["time"], recording["lateral_acceleration"], color=colour, label=name)
            shared = first["s"][first["s"] <= recording["s"].max()]
            difference = np.interp(shared, recording["s"], recording["l"]) - first["l"][: len(shared)]
            apart.plot(shared, 100.0 * difference, color=colour, label=name)
        timeline(panel(steering, "Steering angle", "deg")).set_xlabel("time  [s]")
        timeline(panel(acceleration, "Lateral acceleration", "m/s²")).set_xlabel("time  [s]")
        panel(apart, f"Offset from the path on {lines[0].name}", "cm").set_xlabel("along the road  [m]")
    return figure
