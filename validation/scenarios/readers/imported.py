"""What a reader of a foreign format makes of a file."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Imported:
    """A scenario's tables, as in a scenario file, and what became of the foreign one's contents.

    Attributes:
        tables: All that `scenario_from_tables` needs; no other file is named in them.
        notes: What was assumed, simplified or left out, for the user.
    """

    tables: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Tell the user, once."""
        if text not in self.notes:
            self.notes.append(text)
