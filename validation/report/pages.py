"""HTML pages: one file each, nothing loaded from outside."""

import base64
import io
import re
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

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


def picture(figure: Figure) -> Markup:
    """A figure as an element: SVG that follows the page's theme, or a PNG if that were too large."""
    drawn = svg(figure)
    if len(drawn) <= LARGEST_SVG:
        return Markup(drawn)
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    return Markup('<img alt="" src="data:image/png;base64,{}">').format(base64.b64encode(buffer.getvalue()).decode())
