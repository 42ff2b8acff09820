"""How values show in a notebook: a small table, escaped."""

from collections.abc import Iterable
from html import escape

_LEFT = 'style="text-align: left"'


def facts_table(title: str, facts: Iterable[tuple[str, object]]) -> str:
    """HTML of a title and its facts.

    Args:
        title: Above the table.
        facts: Name and value of each, the value as text or with a `str` of its own.
    """
    rows = "".join(
        f"<tr><th {_LEFT}>{escape(name)}</th><td {_LEFT}>{escape(str(value))}</td></tr>" for name, value in facts
    )
    return f"<b>{escape(title)}</b><table>{rows}</table>"
