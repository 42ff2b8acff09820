"""The scene from above, after the paper's Figs. 3 and 4: road, obstacles, corridor, planned and driven paths."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.validation.geometry import Array, car_boxes, obstacle_boxes, obstacle_poses
from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.style import BLUE, GREEN, INK, ORANGE, PAPER, PURPLE, RED, ROAD, legend, styled
from sidestep.validation.scenarios.scenario import Scenario

OUTLINE_EVERY = 0.5
"""Time between the drawn outlines of the car, in [s]."""

LOOK_BACK = 1.2
"""How long before the closest approach the second view is taken, in [s]."""

View = tuple[float, float]
"""First and last station that is shown, in [m]."""

_WIDTH = 11.0  # of a figure, in [inch]


def top_view(scenario: Scenario, recording: Recording, judgement: Judgement) -> Figure:
    """The whole run, and the plan as it stood shortly before the closest approach."""
    with styled():
        views = [driven_extent(recording)]
        plan = _plan_before(recording, judgement)
        if plan is not None:
            views.append((plan.s[0] - 10.0, plan.s[-1]))
        figure, axes = stacked_axes(scenario.path, views)
        draw_run(axes[0], scenario, recording, judgement, views[0])
        if plan is not None:
            draw_plan_of(axes[1], scenario, recording, plan, views[1])
    return figure


def scene_view(scenario: Scenario) -> Figure:
    """What is to be driven: road, obstacles where they are at the start, with the ways that they go, and the car."""
    path, start = scenario.path, scenario.start
    view = 0.0, path.length
    with styled():
        figure, (axes,) = stacked_axes(path, [view])
        draw_road(axes, scenario, view, 0.0)
        times = np.arange(0.0, scenario.duration + 0.1, 0.1)
        for obstacle in scenario.obstacles:
            there = obstacle.is_there(times)
            if obstacle.moves and there.any():
                x, y, _ = obstacle_poses(path, obstacle, times[there])
                axes.plot(x, y, color=RED, linewidth=0.8, alpha=0.6)
        car = car_boxes(scenario.vehicle, start.x, start.y, start.yaw)
        axes.add_collection(PolyCollection(list(car), facecolor=BLUE, edgecolor=BLUE, zorder=3), autolim=False)
        axes.set_title(f"{scenario.name}: {scenario.speed:.1f} m/s, {scenario.duration:.1f} s", loc="left")
    return figure


def distance(clearance: float, digits: int) -> str:
    """A signed clearance in words."""
    return f"{clearance:.{digits}f} m clear" if clearance > 0.0 else f"{-clearance:.{digits}f} m overlap"


def driven_extent(recording: Recording) -> View:
    """The stations that a run covers, with some room."""
    return float(recording["s"].min()) - 4.0, float(recording["s"].max()) + 4.0


def _plan_before(recording: Recording, judgement: Judgement) -> Any:
    """The plan LOOK_BACK before the closest approach; without obstacles, at the largest steering angle."""
    if not recording.plans:
        return None
    busiest = recording["time"][np.argmax(np.abs(recording["steer_angle"]))]
    moment = judgement.time - LOOK_BACK if judgement.time is not None else busiest
    return recording.plans[int(np.argmin(np.abs(recording.steps["time"] - moment)))]


def _is_straight(path: ReferencePath) -> bool:
    return bool(np.ptp(np.asarray(path.to_cartesian(np.linspace(0.0, path.length, 50), 0.0)[1])) < 1e-6)


def stacked_axes(path: ReferencePath, views: Sequence[View]) -> tuple[Figure, list[Axes]]:
    """Axes below each other; a straight road is drawn wider than it is, a curved one true to scale."""
    if _is_straight(path):
        heights = [2.2] * len(views)
    else:
        spans = [np.ptp(np.array(path.to_cartesian(np.linspace(*view, 100), 0.0)), axis=1) + 14.0 for view in views]
        heights = [float(np.clip(_WIDTH * span[1] / span[0], 2.0, 5.0)) for span in spans]
    above, below = 0.3, 0.45  # room for titles and labels, in [inch]
    height = sum(heights) + (above + below) * len(views)
    figure = Figure(figsize=(_WIDTH, height))
    grid = figure.subplots(len(views), 1, squeeze=False, height_ratios=heights)
    gap = (above + below) / (sum(heights) / len(heights))
    figure.subplots_adjust(0.05, below / height, 0.995, 1.0 - above / height, hspace=gap)
    return figure, list(grid[:, 0])


def draw_road(axes: Axes, scenario: Scenario, view: View, time: float) -> None:
    """Road surface, edges, reference path, and the obstacles where they are at `time`."""
    path = scenario.path
    s = np.linspace(*view, 400)
    widths = path.widths(s)
    left, right = path.to_cartesian(s, widths[0]), path.to_cartesian(s, -widths[1])
    axes.fill([*left[0], *right[0][::-1]], [*left[1], *right[1][::-1]], facecolor=ROAD, edgecolor="none", zorder=0)
    for edge in (left, right):
        axes.plot(*edge, color=INK, linewidth=1.2)
    axes.plot(*path.to_cartesian(s, np.zeros_like(s)), color=INK, linewidth=0.8, linestyle=(0, (8, 6)), alpha=0.6)
    boxes = [obstacle_boxes(path, obstacle, np.array([time]))[0] for obstacle in scenario.obstacles]
    axes.add_collection(PolyCollection(boxes, facecolor=RED, edgecolor=RED, alpha=0.85, zorder=3), autolim=False)
    if _is_straight(path):
        axes.set(xlim=view, ylim=(-widths[1].max() - 0.6, widths[0].max() + 0.6))
        axes.set(xlabel="along the road  [m]", ylabel="across, stretched  [m]")
    else:
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(xlabel="x  [m]", ylabel="y  [m]")
    axes.grid(False)


def _band(axes: Axes, scenario: Scenario, s: Array, left: Array, right: Array, label: str) -> None:
    path = scenario.path
    widths = path.widths(s)
    upper, lower = (path.to_cartesian(s, np.clip(bound, -widths[1], widths[0])) for bound in (left, right))
    outline = [*upper[0], *lower[0][::-1]], [*upper[1], *lower[1][::-1]]
    axes.fill(*outline, facecolor=GREEN, edgecolor="none", alpha=0.22, label=label, zorder=1)
    for edge in (upper, lower):
        axes.plot(*edge, color=GREEN, linewidth=1.0, zorder=1.5)


def draw_run(
    axes: Axes, scenario: Scenario, recording: Recording, judgement: Judgement, view: View | None = None
) -> None:
    """The run from above: road, corridor as met, driven path, outlines of the car, closest approach.

    Args:
        axes: To draw in.
        scenario, recording, judgement: Those of a run.
        view: Stations that are shown; None for all that was driven.
    """
    view = view or driven_extent(recording)
    draw_road(axes, scenario, view, judgement.time or 0.0)
    met = np.array([(plan.s[0], plan.left[0], plan.right[0]) for plan in recording.plans]).reshape(-1, 3)
    _band(axes, scenario, *met.T, label="corridor for the car's centre, as met")
    draw_cars(axes, scenario, recording, np.arange(0.0, recording["time"][-1], OUTLINE_EVERY), facecolor="none")
    axes.plot(recording["x"], recording["y"], color=BLUE, label="driven path", zorder=4)
    if judgement.time is not None and judgement.min_clearance is not None:
        draw_cars(axes, scenario, recording, np.array([judgement.time]), facecolor=BLUE)
        i = int(np.argmin(np.abs(recording["time"] - judgement.time)))
        o = judgement.obstacle
        above = o is None or scenario.obstacles[o].l < recording["l"][i]  # on the side that is free
        axes.annotate(
            distance(judgement.min_clearance, 2), (recording["x"][i], recording["y"][i]), (0, 16 if above else -24),
            textcoords="offset points", ha="center", fontsize=8.5, fontweight="bold", zorder=6,
        )  # fmt: skip
    axes.set_title(f"The run: outlines every {OUTLINE_EVERY:g} s, closest approach filled")
    legend(axes)


def draw_cars(
    axes: Axes, scenario: Scenario, recording: Recording, times: Array, facecolor: str, edgecolor: str = BLUE
) -> None:
    """Outlines of the car where it is at `times` [s]."""
    index = np.searchsorted(recording["time"], times - 1e-9)
    boxes = car_boxes(scenario.vehicle, *(recording[name][index] for name in ("x", "y", "yaw")))
    fade = 0.35 if facecolor != "none" else 0.8
    cars = PolyCollection(list(boxes), facecolor=facecolor, edgecolor=edgecolor, linewidth=1.0, alpha=fade, zorder=3.5)
    axes.add_collection(cars, autolim=False)


def draw_plan_of(axes: Axes, scenario: Scenario, recording: Recording, plan: Any, view: View | None = None) -> None:
    """One plan from above: corridor, planned path, prediction, and what was driven in the end.

    Args:
        axes: To draw in.
        scenario, recording: Those of the run.
        plan: One of the recording's.
        view: Stations that are shown; None for those of the plan.
    """
    view = view or (plan.s[0] - 10.0, plan.s[-1])
    path = scenario.path
    draw_road(axes, scenario, view, plan.time)
    _band(axes, scenario, plan.s, plan.left, plan.right, label="corridor for the car's centre")
    shown = (recording["s"] >= view[0]) & (recording["s"] <= view[1])
    axes.plot(
        recording["x"][shown], recording["y"][shown], color=BLUE, linewidth=1.2, label="driven in the end", zorder=4
    )
    axes.plot(*path.to_cartesian(plan.s, plan.l), color=PURPLE, linestyle="--", label="planned path", zorder=4)
    predicted = path.to_cartesian(plan.states_s, plan.states[:, 0])
    axes.plot(*predicted, color=ORANGE, marker="o", markersize=3.5, linewidth=1.2, markeredgecolor=PAPER,
              markeredgewidth=0.4, label="predicted by the controller", zorder=5)  # fmt: skip
    draw_cars(axes, scenario, recording, np.array([plan.time]), facecolor=BLUE)
    axes.set_title(f"The plan at t = {plan.time:.2f} s")
    legend(axes)
