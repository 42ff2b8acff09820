"""What a figure shows, as numbers: read from the drawn figure itself, for `templates/charts.js` to draw again.

There is no second description of any chart: lines, areas, points, bars, words, limits and legends are taken from
Matplotlib's artists. A figure with something in it that is not read stays the picture that it is.
"""

import json
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import Collection, PathCollection
from matplotlib.colors import BoundaryNorm, to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path
from matplotlib.text import Annotation, Text
from matplotlib.ticker import FixedLocator
from numpy.typing import NDArray

from sidestep.validation.report.style import TIME, themed

Array = NDArray[np.float64]
Chart = dict[str, Any]

MOST_POINTS = 4000
"""Of a line: of more, the extremes of as many stretches are kept."""

_FINE = 5
"""Digits kept of an axes' span: a hundredfold zoom still shows no steps."""

_DASHES = {"--": "6 4", ":": "1.5 3", "-.": "7 3 1.5 3"}


def chart_data(figure: Figure) -> Markup | None:
    """The charts of a figure as JSON, safe within a script element; None if it holds something else, too."""
    panels = [axes for axes in figure.axes if _bar(axes) is None]
    bars = [bar for axes in figure.axes if (bar := _bar(axes)) is not None]
    charts = [_chart(axes, panels, figure) for axes in panels]
    if not charts or any(chart is None for chart in charts):
        return None
    data = {
        "title": _words(figure.get_suptitle()),
        "columns": max(_place(axes)[1] for axes in panels) + 1,
        "charts": charts,
        "shades": [_shades(bar) for bar in bars],
    }
    return Markup(json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _chart(axes: Axes, panels: Sequence[Axes], figure: Figure) -> Chart | None:
    scales = [axis.get_scale() for axis in (axes.xaxis, axes.yaxis)]
    if not set(scales) <= {"linear", "log"}:
        return None
    limits = [np.array(axes.get_xlim()), np.array(axes.get_ylim())]
    series = [_series(axes, artist, limits) for artist in _artists(axes)]
    if any(one is None for one in series):
        return None
    box, (wide, high) = axes.get_position(), figure.get_size_inches()
    row, column = _place(axes)
    beside = [other for other in panels if _place(other)[0] == row]
    below = [other for other in panels if _place(other)[1] == column]
    return {
        "title": _first(axes.get_title("left"), axes.get_title("center"), *(o.get_title("center") for o in below)),
        "x": _axis(
            axes.xaxis,
            limits[0],
            _first(axes.get_xlabel(), *(o.get_xlabel() for o in reversed(below) if o.get_label() == axes.get_label())),
        ),
        "y": _axis(axes.yaxis, limits[1], _first(axes.get_ylabel(), *(o.get_ylabel() for o in beside))),
        "ratio": round(box.height * high / (box.width * wide), 3),
        "time": axes.get_label() == TIME,
        "equal": axes.get_aspect() == 1.0,
        "series": [one for one in series if one],
    }


def _place(axes: Axes) -> tuple[int, int]:
    """Row and column in the figure's grid."""
    spec = axes.get_subplotspec()
    return (spec.rowspan.start, spec.colspan.start) if spec else (0, 0)


def _first(*words: str) -> str:
    return _words(next(filter(None, words), ""))


def _words(text: str) -> str:
    """Without mathematics' marks, on one line."""
    return " · ".join(filter(None, text.replace("$", "").split("\n")))


def _axis(axis: Axis, limits: Array, label: str) -> dict[str, Any]:
    fixed = isinstance(axis.get_major_locator(), FixedLocator)
    ticks = [
        (_round(float(place), limits), _words(word.get_text()))
        for place, word in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
    ]
    return {
        "label": label,
        "limits": [_round(float(limit), limits) for limit in limits],
        "log": axis.get_scale() == "log",
        "ticks": ticks if fixed and any(word for _, word in ticks) else None,
    }


def _artists(axes: Axes) -> Iterable[Artist]:
    """What stands in the axes, in the order in which it is drawn; no frames, no legends."""
    drawn = [*axes.collections, *axes.patches, *axes.lines, *axes.texts]
    return sorted((artist for artist in drawn if artist.get_visible()), key=lambda artist: artist.get_zorder())


def _series(axes: Axes, artist: Artist, limits: list[Array]) -> dict[str, Any] | None:
    """One artist: empty if it shows nothing, None if it is not read."""
    if isinstance(artist, Text):
        return _text(axes, artist, limits)
    if isinstance(artist, Line2D):
        return _line(axes, artist, limits)
    if isinstance(artist, PathCollection):
        return _points(artist, limits)
    if isinstance(artist, Collection):
        return _areas(artist, [_data_path(axes, artist, path) for path in artist.get_paths()], limits)
    if isinstance(artist, Patch):
        return _areas(
            artist,
            [axes.transData.inverted().transform_path(artist.get_transform().transform_path(artist.get_path()))],
            limits,
        )
    return None


def _data_path(axes: Axes, artist: Collection, path: Path) -> Path:
    return path if artist.get_transform() == axes.transData else artist.get_transform().transform_path(path)


def _named(artist: Artist, **about: Any) -> dict[str, Any]:
    label = str(artist.get_label())
    alpha = artist.get_alpha()
    return {
        **about,
        **({} if label.startswith("_") or not label else {"name": label}),
        **({} if alpha is None else {"alpha": alpha}),
    }


def _line(axes: Axes, line: Line2D, limits: list[Array]) -> dict[str, Any] | None:
    x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
    if not len(x):
        return {}
    about = {"colour": _colour(line.get_color()), "width": line.get_linewidth()}
    if dashes := _DASHES.get(str(line.get_linestyle())):
        about["dashes"] = dashes
    if line.get_transform() == axes.get_xaxis_transform():
        return _named(line, kind="upright", at=_round(float(x[0]), limits[0]), **about)
    if line.get_transform() == axes.get_yaxis_transform():
        return _named(line, kind="level", at=_round(float(y[0]), limits[1]), **about)
    if line.get_transform() != axes.transData:
        return None
    if line.get_marker() not in (None, "None", "", " "):
        about["marks"] = max(0.5 * line.get_markersize(), 0.8) * (0.5 if line.get_marker() == "." else 1.0)
    if str(line.get_linestyle()) == "None":
        about["width"] = 0.0
    if line.get_drawstyle() == "steps-post":
        about["steps"] = True
    x, y = _thinned(x, y)
    return _named(line, kind="line", x=_rounded(x, limits[0]), y=_rounded(y, limits[1]), **about)


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """The lowest and the highest point of each of MOST_POINTS / 2 stretches, if there are more points than that."""
    if len(x) <= MOST_POINTS:
        return x, y
    parts = np.array_split(np.arange(len(x)), MOST_POINTS // 2)
    safe = np.nan_to_num(y)
    kept = sorted({int(part[f(safe[part])]) for part in parts for f in (np.argmin, np.argmax)})
    return x[kept], y[kept]


def _points(cloud: PathCollection, limits: list[Array]) -> dict[str, Any]:
    places = np.ma.filled(np.ma.asarray(cloud.get_offsets(), dtype=float), np.nan)
    if not len(places):
        return {}
    cloud.update_scalarmappable()
    filled = _rgba(cloud.get_facecolor())
    colours = [_colour(colour) for colour in (filled if len(filled) else _rgba(cloud.get_edgecolor()))]
    urls = [url for url in cloud.get_urls() if url is not None]
    crossed = not len(filled) or len(np.asarray(cloud.get_paths()[0].vertices)) < 6
    return _named(
        cloud, kind="points", x=_rounded(places[:, 0], limits[0]), y=_rounded(places[:, 1], limits[1]),
        colour=colours[0] if len(set(colours)) == 1 else colours, crossed=crossed,
        size=round(float(np.sqrt(np.asarray(cloud.get_sizes())[0]) / 2.0), 2),
        **({"urls": urls} if len(urls) == len(places) else {}),
    )  # fmt: skip


def _areas(artist: Any, paths: Sequence[Path], limits: list[Array]) -> dict[str, Any]:
    """Closed outlines; a path with several parts has holes."""
    if isinstance(artist, Collection):
        artist.update_scalarmappable()
    filled = _rgba(artist.get_facecolor())
    edged = _rgba(artist.get_edgecolor())
    shapes = []
    for number, path in enumerate(paths):
        parts = [part for part in path.to_polygons(closed_only=False) if len(np.asarray(part)) > 1]
        if not parts:
            continue
        rings = [_flat(np.asarray(part), limits) for part in parts]
        fill = filled[number % len(filled)] if len(filled) else (0, 0, 0, 0)
        edge = edged[number % len(edged)] if len(edged) else (0, 0, 0, 0)
        shapes.append({"rings": rings, "fill": _shade(fill), "edge": _shade(edge)})
    return _named(artist, kind="areas", shapes=shapes) if shapes else {}


def _rgba(colours: Any) -> Array:
    """Colours, one or many, as rows of red, green, blue and opacity."""
    array = np.asarray([to_rgba(colours)] if isinstance(colours, str | tuple) else colours, dtype=float)
    return array.reshape(-1, 4)


def _shade(rgba: Any) -> list[Any] | None:
    """Colour and opacity; None for what cannot be seen."""
    return [_colour(rgba), round(float(rgba[3]), 3)] if rgba[3] > 0.0 else None


def _text(axes: Axes, text: Text, limits: list[Array]) -> dict[str, Any]:
    if not text.get_text().strip():
        return {}
    place = text.xy if isinstance(text, Annotation) else text.get_position()
    if text.get_transform() == axes.transAxes:
        place = axes.transData.inverted().transform(axes.transAxes.transform(place))
    lift = float(text.xyann[1]) if isinstance(text, Annotation) else 0.0
    x, y = (_round(float(value), limit) for value, limit in zip(place, limits, strict=True))
    return {
        "kind": "words",
        "x": x,
        "y": y,
        "lift": lift,
        "text": _words(text.get_text()),
        "align": text.get_horizontalalignment(),
    }


def _bar(axes: Axes) -> Any:
    return getattr(axes, "_colorbar", None)


def _shades(bar: Any) -> dict[str, Any]:
    """A colour bar: what its colours stand for, from the lowest value on."""
    norm, axis = bar.norm, bar.ax.yaxis
    if isinstance(norm, BoundaryNorm):
        ends = np.asarray(norm.boundaries)
        stops = [(f"{low:.3g}", to_hex(bar.cmap(norm(0.5 * (low + high))))) for low, high in pairwise(ends)]
        return {"label": _words(axis.label.get_text()), "steps": True, "stops": stops}
    values = np.linspace(norm.vmin, norm.vmax, 9)
    stops = [(f"{value:.3g}", to_hex(bar.cmap(norm(value)))) for value in values]
    return {"label": _words(axis.label.get_text()), "steps": False, "stops": stops}


def _colour(colour: Any) -> str:
    return themed(to_hex(colour if isinstance(colour, str) else tuple(colour)))


def _round(value: float, limits: Array) -> float | None:
    """Fine enough for the axes; what spans decades keeps its digits instead."""
    if not np.isfinite(value):
        return None
    low, high = sorted(float(limit) for limit in limits)
    if low > 0.0 and high > 30.0 * low:
        return float(f"{value:.6g}")
    return round(value, _FINE - int(np.floor(np.log10((high - low) or 1.0))))


def _rounded(values: Array, limits: Array) -> list[float | None]:
    return [_round(float(value), limits) for value in values]


def _flat(points: Array, limits: list[Array]) -> list[float | None]:
    x, y = (_rounded(points[:, i], limits[i]) for i in range(2))
    return [value for pair in zip(x, y, strict=True) for value in pair]
