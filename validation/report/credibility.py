"""The credibility report: verdict and headline first, then the evidence for it, and what was not looked at."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from sidestep.validation.files import write_text, written_to
from sidestep.validation.report.evidence import Evidence
from sidestep.validation.report.pages import page, picture


def write_credibility_report(
    path: Path,
    title: str,
    verdict: str,
    evidence: Sequence[Evidence],
    not_covered: Sequence[str],
    context: Mapping[str, str],
) -> None:
    """Write the page; complete or not there.

    Args:
        path: Of the HTML file, in a folder that is there.
        title: Of the page.
        verdict: One sentence that begins with PASS, FAIL or INCONCLUSIVE, or states a result.
        evidence: What is shown, the most telling figure first: it stands beside the verdict.
        not_covered: What the reader must not conclude from it, one sentence each.
        context: Command line, seeds, versions: whatever makes the same page again.

    Raises:
        InputError: The folder cannot be written to.
    """
    with written_to(path.parent):
        write_text(path, credibility_report(title, verdict, evidence, not_covered, context))


def credibility_report(
    title: str, verdict: str, evidence: Sequence[Evidence], not_covered: Sequence[str], context: Mapping[str, str]
) -> str:
    """The page as text, see `write_credibility_report`."""
    return page(
        "credibility.html",
        title=title,
        verdict=verdict,
        tone={"PASS": "pass", "FAIL": "fail", "INCO": "inconclusive"}.get(verdict[:4], ""),
        evidence=[(item, picture(item.figure) if item.figure else None) for item in evidence],
        judged=[(number, item) for number, item in enumerate(evidence) if item.passed is not None],
        not_covered=not_covered,
        context=context,
    )
