"""One look for every figure: colour-blind safe (Okabe and Ito), and inline SVG that follows the page's theme."""

import io
import re
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sidestep.validation.files import complete_path

BLUE, ORANGE, GREEN, RED, PURPLE, SKY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9"
INK, FAINT, ROAD, PAPER = "#24292f", "#c3c9d0", "#eceff2", "#fefefe"
"""Theme colours: with BLUE, `svg` hands them over to the page as CSS variables, --ink and so on."""

TIME = "time"
"""Label of axes along which a run's time goes: in a page they share their cursor and their zoom."""

_THEME = {INK: "ink", FAINT: "faint", ROAD: "road", PAPER: "paper", BLUE: "blue"}
_RC: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.facecolor": PAPER,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.alpha": 0.5,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.facecolor": PAPER,
    "svg.fonttype": "path",  # looks the same with whatever fonts the reader has
    "svg.hashsalt": "sidestep",
}


def styled() -> AbstractContextManager[None]:
    """Context in which figures are made."""
    return mpl.rc_context(_RC)


def panel(axes: Axes, title: str, unit: str) -> Axes:
    """Title and unit above an axes, in one line."""
    axes.set_title(f"{title}  [{unit}]")
    axes.margins(x=0.0)
    return axes


def timeline(axes: Axes) -> Axes:
    """Mark axes whose abscissa is a run's time, in [s]."""
    axes.set_label(TIME)
    return axes


def themed(colour: str) -> str:
    """A colour as a page takes it: the theme's own variable where it has one."""
    return f"var(--{_THEME[colour]})" if colour in _THEME else colour


def legend(axes: Axes) -> None:
    """A legend in one line above the axes, to the right of the title; every label once."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(
        list(unique.values()), list(unique), loc="lower right", bbox_to_anchor=(1.005, 1.0), ncols=len(unique),
        borderaxespad=0.15, borderpad=0.1, handlelength=1.5, columnspacing=1.2, handletextpad=0.5,
    )  # fmt: skip


def write_figure(file: Path, figure: Figure) -> None:
    """Write a picture that is complete or not there, in the format of its name."""
    with complete_path(file) as path:
        figure.savefig(path, dpi=150)


def svg(figure: Figure) -> str:
    """The figure as an <svg> element to be put into a page; scales with its container."""
    buffer = io.StringIO()
    with styled():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for colour in _THEME:
        text = text.replace(colour, themed(colour))
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    return re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
