"""HTML pages: one file each, nothing loaded from outside."""

import base64
import io
import re
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

from sidestep.validation.report.explore.chart_data import chart_data
from sidestep.validation.report.style import styled, svg

LARGEST_SVG = 600_000
"""Figures with more characters than this as SVG become pictures: a page stays below 5 MiB."""

_PAGES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
)
_PAGES.tests["numeric"] = re.compile(r"[-+–]?(\d|$)").match


def page(template: str, **values: Any) -> str:
    """The page from a template of this package; what is no Markup is escaped."""
    return _PAGES.get_template(template).render(**values)


class Picture(NamedTuple):
    """A figure twice: as drawn, for print and for readers without scripts, and what it shows, to be explored.

    Attributes:
        drawn: An element: SVG that follows the page's theme, or a PNG if that were too large.
        data: JSON for `templates/charts.js`; None if the figure holds something that is not read.
    """

    drawn: Markup
    data: Markup | None


def picture(figure: Figure) -> Picture:
    """A figure for a page."""
    drawn = svg(figure)
    data = chart_data(figure)
    if len(drawn) <= LARGEST_SVG:
        return Picture(Markup(drawn), data)
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    encoded = base64.b64encode(buffer.getvalue()).decode()
    return Picture(Markup('<img alt="" src="data:image/png;base64,{}">').format(encoded), data)
