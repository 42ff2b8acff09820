"""What others saw of a drive that the recording does not show, for the judge: the seam for a bus's own record.

`judge(recording, scenario, findings)` takes any number of findings, the gravest first. The first one whose verdict is
not "pass" decides the drive unless something was hit, the road was left, or the run broke off; its label becomes the
drive's. One with verdict "pass" changes nothing and is told in the summary, as all are. Whoever watches a bus
(silent controller, second sender of an own id, wrong sequence, time in fail-safe) returns such findings, which
`for_the_judge` translates; the judge knows nothing of buses.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from sidestep.controller.can_port.findings import Finding as BusFinding


class Verdict(Enum):
    """What a drive is worth; exit status 0 for a pass, 1 for the others."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True)
class Finding:
    """One of them.

    Attributes:
        label: A few words that are the same for all drives of its kind, such as "controller silent".
        verdict: What the drive is worth if nothing worse happened.
        text: One line with figures: when, how long, how many.
    """

    label: str
    verdict: Verdict
    text: str


def for_the_judge(found: Iterable[BusFinding]) -> tuple[Finding, ...]:
    """What a bus's end found, for the judge."""
    return tuple(Finding(each.label, Verdict(each.verdict), each.text) for each in found)
