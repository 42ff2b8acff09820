"""One finding of a report: what was looked at, what came out, and whether it is good enough."""

from dataclasses import dataclass

from markupsafe import Markup
from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Table:
    """Cells as they are shown; a cell that is PASS or FAIL is coloured.

    Attributes:
        columns: Heads, with units.
        rows: As many cells each as there are heads.
        anchor: If given, a row is found under this and its first cell, such as #row-12.
        commands: Whether the last cell of each row is a command to be copied.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    anchor: str = ""
    commands: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """A section of a report.

    Attributes:
        title: In a few words.
        note: What it means and how it was got; blank lines part paragraphs.
        figure: Drawn in the look of `style.styled`.
        scene: What `scene_data` gives, if the figure is a view from above.
        table: The numbers behind it.
        passed: Whether it meets its bar; None where there is none.
        section: Heading above it and what follows; empty to stay under the one before.
    """

    title: str
    note: str = ""
    figure: Figure | None = None
    table: Table | None = None
    passed: bool | None = None
    section: str = ""
    scene: Markup | None = None

    @property
    def verdict(self) -> str:
        """PASS, FAIL, or nothing."""
        return "" if self.passed is None else "PASS" if self.passed else "FAIL"
