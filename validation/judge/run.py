"""A finished run: what reports are made of."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.scenarios.scenario import Scenario


@dataclass(frozen=True, repr=False)
class Run:
    """A finished run.

    Attributes:
        scenario: What was driven.
        recording: What happened.
        judgement: What it is worth.
        summary: Its numbers, as in summary.json.
        folder: Where its files are.
    """

    scenario: Scenario
    recording: Recording
    judgement: Judgement
    summary: dict[str, Any]
    folder: Path

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.scenario.name!r} on {self.scenario.plant.name}, {self.judgement!r})"

    @property
    def interrupted(self) -> bool:
        """Whether it was ended from the keyboard."""
        return self.recording.end is End.INTERRUPTED
