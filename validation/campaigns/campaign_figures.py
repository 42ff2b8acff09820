"""Figures of a campaign: clearances, where it fails, and which parameters matter."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.stats import rankdata

from sidestep.validation.campaigns.journal import Row
from sidestep.validation.model_error.sensitivity import first_order, separation, trend
from sidestep.validation.report.style import BLUE, FAINT, INK, ORANGE, RED, legend, panel, styled

Array = np.ndarray

LOWEST = -0.5
"""Overlaps beyond this count as this: how far a car slides on after it has hit something says nothing, in [m]."""


class Influence(NamedTuple):
    """How far the margin depends on one parameter, see `sensitivity`."""

    key: str
    share: float
    trend: float


def column(rows: Sequence[Row], key: str) -> tuple[Array, list[str] | None]:
    """What a parameter takes in each row: numbers, or places in a list of names."""
    values = [row["values"][key] for row in rows]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float), None
    names = sorted({str(value) for value in values})
    return np.array([names.index(str(value)) for value in values], dtype=float), names


def influences(rows: Sequence[Row]) -> list[Influence]:
    """Of every parameter on the runs' ranks by margin, the largest first; rows without a margin do not count."""
    rows = [row for row in rows if row["margin_m"] is not None]
    if not rows:
        return []
    margin = rankdata([row["margin_m"] for row in rows])
    found = []
    for key in rows[0]["values"]:
        values, names = column(rows, key)
        direction = 0.0 if names else trend(values, margin)  # names have no order to rise along
        found.append(Influence(key, first_order(values, margin), direction))
    return sorted(found, key=lambda one: -one.share)


def clearance_figure(rows: Sequence[Row], buffer: float) -> Figure:
    """Distribution of the smallest clearance to obstacles and edges, and its share of runs below."""
    margin = np.maximum([row["margin_m"] for row in rows if row["margin_m"] is not None], LOWEST)
    failed = np.array([row["verdict"] != "pass" for row in rows if row["margin_m"] is not None], dtype=bool)
    with styled():
        figure = Figure(figsize=(11.0, 3.0))
        figure.subplots_adjust(0.055, 0.15, 0.985, 0.9, wspace=0.14)
        density, below = figure.subplots(1, 2, sharex=True)
        edges = np.linspace(margin.min(), max(margin.max(), margin.min() + 1e-6), 41)
        panel(density, "Smallest clearance", "runs")
        density.hist([margin[~failed], margin[failed]], edges.tolist(), stacked=True, color=[BLUE, RED],
                     label=["passed", "not passed"])  # fmt: skip
        panel(below, "Runs with less than this", "%")
        below.step(np.sort(margin), 100.0 * np.arange(1, len(margin) + 1) / len(margin), where="post", color=BLUE)
        for axes in (density, below):
            axes.axvline(0.0, color=INK, linewidth=1.0)
            axes.axvline(buffer, color=ORANGE, linestyle="--", linewidth=1.2, label=f"buffer {buffer:g} m")
            axes.set_xlabel(f"clearance  [m]; negative: overlap, at {LOWEST:g} or more")
        below.set_ylim(0.0, 101.0)
        legend(density)
    return figure


def telling(rows: Sequence[Row], ranked: Sequence[Influence]) -> list[str]:
    """The parameters, those first that tell failed from passed runs, or else those that matter most."""
    failed = np.array([row["verdict"] != "pass" for row in rows], dtype=bool)
    if failed.all() or not failed.any():
        return [one.key for one in ranked]
    values = {one.key: column(rows, one.key)[0] for one in ranked}
    return sorted(values, key=lambda key: -separation(values[key], failed))


def failure_map(rows: Sequence[Row], ranked: Sequence[Influence]) -> Figure:
    """Every run over the most telling parameters, in pairs; failures crossed, the others by their clearance."""
    keys = telling(rows, ranked)[:4]
    pairs = list(zip(keys[0::2], keys[1::2], strict=False)) or [(keys[0], keys[0])]
    passed = np.array([row["verdict"] == "pass" for row in rows], dtype=bool)
    margin = np.array([row["margin_m"] for row in rows], dtype=float)
    with styled():
        figure = Figure(figsize=(11.0, 4.2))
        figure.subplots_adjust(0.06, 0.12, 0.92, 0.92, wspace=0.2)
        shades = Normalize(margin[passed].min(initial=np.inf), margin[passed].max(initial=-np.inf))
        for axes, pair in zip(figure.subplots(1, len(pairs), squeeze=False)[0], pairs, strict=True):
            x, y = (_along(axis, rows, key) for axis, key in zip((axes.xaxis, axes.yaxis), pair, strict=True))
            drawn = (
                axes.scatter(x[passed], y[passed], 16, margin[passed], cmap="viridis", norm=shades, linewidths=0.0,
                             rasterized=len(rows) > 2000),
                axes.scatter(x[~passed], y[~passed], 34, RED, marker="x", linewidths=1.4, label="not passed"),
            )  # fmt: skip
            for cloud, which in zip(drawn, (passed, ~passed), strict=True):
                cloud.set_urls([f"#row-{rows[i]['row']}" for i in np.flatnonzero(which).tolist()])
            axes.set_title(f"{pair[1]} over {pair[0]}")
            legend(axes)
        bar = figure.colorbar(ScalarMappable(shades, "viridis"), cax=figure.add_axes((0.935, 0.12, 0.012, 0.8)))
        bar.set_label("clearance where passed  [m]")
    return figure


def _along(axis: Axis, rows: Sequence[Row], key: str) -> Array:
    """A parameter's values, its axis labelled for them."""
    values, names = column(rows, key)
    axis.set_label_text(key)
    if names:
        axis.set_ticks(range(len(names)), names)
    return values


def ranking_figure(ranked: Sequence[Influence]) -> Figure:
    """Bars: what share of the margin's variance each parameter explains alone."""
    with styled():
        figure = Figure(figsize=(11.0, 0.8 + 0.28 * len(ranked)))
        axes = figure.subplots()
        figure.subplots_adjust(0.17, 0.45 / figure.get_figheight(), 0.985, 1.0 - 0.3 / figure.get_figheight())
        panel(axes, "What a parameter alone explains of the runs' order by clearance", "%")
        shares = [100.0 * one.share for one in ranked]
        axes.barh(range(len(ranked)), shares, color=BLUE, height=0.62)
        for place, one in enumerate(ranked):
            words = f"{100.0 * one.share:.0f} %" + (f", clearance {'grows' if one.trend > 0.0 else 'falls'} with it"
                                                    if abs(one.trend) > 0.2 else "")  # fmt: skip
            axes.text(100.0 * one.share, place, f"  {words}", va="center", fontsize=8.5)
        axes.set_yticks(range(len(ranked)), [one.key for one in ranked])
        axes.set_xlim(0.0, max(100.0 * max(one.share for one in ranked) * 1.5, 10.0))
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_color(FAINT)
    return figure
