"""Whether the rows of a journal are results of its campaign: what is counted must have been run, and once."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from sidestep.plant_models.errors import InputError
from sidestep.validation.campaigns.campaign import Case
from sidestep.validation.campaigns.journal import Row


@dataclass(frozen=True)
class _Result:
    """What every row holds, whatever else it does."""

    row: int
    seed: int
    values: dict[str, Any]
    verdict: Literal["pass", "fail", "inconclusive"]
    label: str
    margin_m: float | None
    error: str | None


def check_rows(every: Sequence[Case], rows: Sequence[Row], file: Path) -> None:
    """Compare the rows of a journal with the cases of its campaign.

    A row that was changed by hand and contradicts neither its case nor itself shows only when it is run again.

    Args:
        every: All cases, in the order of their rows.
        rows: What the journal holds, in any order, some or all of them.
        file: The journal, for the errors.

    Raises:
        InputError: A row that is incomplete, that the campaign does not have, that is there twice, that was run with
            another seed or other values, or that contradicts itself.
    """
    seen: set[int] = set()
    for line, row in enumerate(rows, 2):  # the head is line 1
        try:
            result = msgspec.convert(row, _Result)
        except msgspec.ValidationError as error:
            raise InputError(f"{file}: line {line}", f"is no row of a campaign ({error})", _REMEDY) from error
        if problem := _problem(result, every, seen):
            raise InputError(f"{file}: line {line}: row {result.row}", problem, _REMEDY)
        seen.add(result.row)


def _problem(result: _Result, every: Sequence[Case], seen: set[int]) -> str:
    """What is wrong with a row; empty if nothing is."""
    if not 0 <= result.row < len(every):
        return f"is none of the campaign's {len(every)} (0 to {len(every) - 1})"
    if result.row in seen:
        return "is there twice"
    case = every[result.row]
    if result.seed != case.seed:
        return f"has seed {result.seed}, not {case.seed}"
    asked = json.loads(json.dumps(case.values))
    if result.values != asked:
        keys = sorted(result.values.keys() ^ asked.keys()) or [k for k in asked if result.values[k] != asked[k]]
        return f"was run with {keys[0]} = {result.values.get(keys[0])}, not {asked.get(keys[0])}"
    if result.margin_m is not None and not math.isfinite(result.margin_m):
        return f"has a margin_m of {result.margin_m}"
    passed = result.verdict == "pass"
    if passed and result.error:
        return f"says that it passed, with error {result.error!r}"
    if passed and result.margin_m is not None and result.margin_m < 0.0:
        return f"says that it passed, with margin_m {result.margin_m}"
    return ""


_REMEDY = "the rows as they were written; delete the line, and that case is run again"
