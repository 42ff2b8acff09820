"""What a campaign comes to: verdict, summary, report and test cases."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sidestep.validation.campaigns.campaign import RANDOM, Campaign, cases, scenario_of
from sidestep.validation.campaigns.campaign_figures import (
    Influence,
    clearance_figure,
    failure_map,
    influences,
    ranking_figure,
)
from sidestep.validation.campaigns.journal import Row
from sidestep.validation.report.credibility import write_credibility_report
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.exports.junit import JunitCase
from sidestep.validation.studies.limits import CONFIDENCE, upper_bound

_SHOWN = 12
"""Rows of the table of the worst runs."""


def summarised(campaign: Campaign, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures of the whole: n, k, the bound of the failure rate, labels, worst row, influences."""
    failures = sum(not row["passed"] for row in rows)
    bound = upper_bound(failures, len(rows))
    allowed = campaign.failure_rate
    worst = next((row for row in worst_first(rows) if row["margin_m"] is not None), None)
    return {
        "campaign": campaign.name,
        "verdict": "pass" if (failures == 0 if allowed is None else bound <= allowed) else "fail",
        "n": len(rows),
        "failures": failures,
        "failure_rate_upper_bound_95": bound,
        "failure_rate_allowed": allowed,
        "labels": dict(Counter(row["label"] for row in rows)),
        "worst_row": worst and worst["row"],
        "worst_margin_m": worst and worst["margin_m"],
        "influences": [one._asdict() for one in influences(rows)],
    }


def sentence(summary: dict[str, Any]) -> str:
    """The verdict in words: never "safe", but how many runs and what that bounds."""
    bar = summary["failure_rate_allowed"]
    bound = float(f"{100.0 * summary['failure_rate_upper_bound_95']:.2g}")  # 100, not 1e+02
    words = (
        f"{summary['verdict'].upper()}: {summary['n']} runs, {summary['failures']} failures, failure rate at most "
        f"{bound:g} % with {100.0 * CONFIDENCE:.0f} % confidence"
    )
    words += "" if bar is None else f" (allowed: {100.0 * bar:.2g} %)"
    if summary["worst_row"] is not None:
        words += f"; smallest clearance {summary['worst_margin_m']:.3f} m in row {summary['worst_row']}"
    return words


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Failures before the others, each by their margin; what could not be run comes first."""
    return sorted(rows, key=lambda row: (row["passed"], -1e9 if row["margin_m"] is None else row["margin_m"]))


def write_campaign_report(
    file: Path, campaign: Campaign, rows: Sequence[Row], summary: dict[str, Any], context: dict[str, str]
) -> None:
    """Write the page.

    Raises:
        InputError: Its folder cannot be written to.
    """
    title = f"Campaign {campaign.name}: {campaign.scenario}"
    write_credibility_report(
        file, title, sentence(summary), _evidence(campaign, rows), _not_covered(campaign), context
    )  # fmt: skip


def _evidence(campaign: Campaign, rows: Sequence[Row]) -> list[Evidence]:
    ranked = influences(rows)
    worst = Evidence(
        "Runs with the least clearance",
        "Each of them runs again, to the last bit: sidestep run --from campaign.jsonl:ROW",
        table=_worst_table(rows, ranked),
    )
    labels = Counter(row["label"] for row in rows)
    outcomes = Evidence(
        "Outcomes",
        'A run fails if it touches an obstacle, leaves the road, or breaks off. "infeasible, handled": in some steps '
        "no plan held all bounds; the controller fell back and came through.",
        table=Table(("outcome", "runs"), tuple((label, str(count)) for label, count in labels.most_common())),
    )
    if not any(row["margin_m"] is not None for row in rows):
        return [outcomes, worst]
    buffer = scenario_of(campaign, cases(campaign)[0]).controller.buffer
    drawn = [Evidence("Clearance", _CLEARANCE, clearance_figure(rows, buffer)), outcomes]
    if ranked:
        drawn += [
            Evidence("Where it fails", _MAP, failure_map(rows, ranked)),
            Evidence("What matters", _RANKING, ranking_figure(ranked)),
        ]
    return [*drawn, worst]


_CLEARANCE = "Signed distance of the true outlines, every 10 ms or less, by code that the controller does not share."
_MAP = (
    "Every run over the parameters that tell failed from passed runs best (Kolmogorov-Smirnov distance), or, without "
    "failures, that explain most; two pairs of them where there are four."
)
_RANKING = (
    "First-order Sobol index of the runs' ranks by clearance, estimated by bins of equal count and corrected for "
    "chance. What several parameters do only together is in none of the bars."
)


def _worst_table(rows: Sequence[Row], ranked: Sequence[Influence]) -> Table:
    keys = [one.key for one in ranked[:5]]
    return Table(
        ("row", "verdict", "outcome", "clearance [m]", *keys),
        tuple(
            (
                str(row["row"]),
                "PASS" if row["passed"] else "FAIL",
                row["error"] or row["label"],
                "–" if row["margin_m"] is None else f"{row['margin_m']:.3f}",
                *(_short(row["values"][key]) for key in keys),
            )
            for row in worst_first(rows)[:_SHOWN]
        ),
    )


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _not_covered(campaign: Campaign) -> list[str]:
    ranges = "; ".join(f"{key} {_words(campaign, key)}" for key in campaign.vary) or "the seeds alone"
    scenes = "the scenes of the generator" if campaign.scenario == RANDOM else f"the scenario {campaign.scenario}"
    return [
        f"Anything but {scenes} and these ranges: {ranges}.",
        "Parameters that depend on each other: each is varied as if it knew nothing of the others, and evenly.",
        "Obstacles that are seen late, wrongly or not at all: the controller knows them from the start.",
        "The plant model's own error: a bound on the failure rate is one for this model.",
    ]


def _words(campaign: Campaign, key: str) -> str:
    values = campaign.vary[key]
    return f"in {list(values.values)}" if values.values else f"{values.low:g} to {values.high:g}"


def junit_cases(campaign: Campaign, rows: Sequence[Row]) -> list[JunitCase]:
    """One for each row."""
    return [
        JunitCase(
            f"sidestep.campaign.{campaign.name}",
            f"row {row['row']}: " + ", ".join(f"{key}={_short(value)}" for key, value in row["values"].items()),
            failure="" if row["passed"] or row["error"] else row["label"],
            error=row["error"] or "",
        )
        for row in rows
    ]
