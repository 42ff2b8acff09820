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
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.report.credibility import write_credibility_report
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.exports.junit import JunitCase, judged_case
from sidestep.validation.studies.limits import CONFIDENCE, deciding_runs, lower_bound, upper_bound

SHOWN = 2000
"""Rows of the table at most, the worst ones: a page stays below 5 MiB."""


def summarised(campaign: Campaign, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures of the whole: n, k, the bound of the failure rate, labels, worst row, influences.

    Inconclusive runs are neither passes nor failures: n in the bound is without them.
    """
    verdicts = Counter(row["verdict"] for row in rows)
    failures, unknown = verdicts[Verdict.FAIL.value], verdicts[Verdict.INCONCLUSIVE.value]
    allowed = campaign.failure_rate
    verdict, known = _verdict(len(rows), failures, unknown, allowed), len(rows) - unknown
    undecided = verdict is Verdict.INCONCLUSIVE
    needed = deciding_runs(failures, known, allowed) if undecided and allowed is not None else None
    worst = next((row for row in worst_first(rows) if row["margin_m"] is not None), None)
    return {
        "campaign": campaign.name,
        "verdict": verdict.value,
        "n": len(rows),
        "failures": failures,
        "inconclusive": unknown,
        "failure_rate_upper_bound_95": _bound(failures, known),
        "failure_rate_allowed": allowed,
        "deciding_runs": None if needed is None or needed <= known else needed,
        "verdicts": dict(verdicts),
        "labels": dict(Counter(row["label"] for row in rows)),
        "worst_row": worst and worst["row"],
        "worst_margin_m": worst and worst["margin_m"],
        "influences": [one._asdict() for one in influences(rows)],
    }


def _verdict(n: int, failures: int, unknown: int, allowed: float | None) -> Verdict:
    """A pass holds even if all that is unknown had failed; a failure, even if all of it had passed.

    Without a rate that is allowed, one failure decides. With one, its bounds do: between them, too few were run.
    """
    if unknown == n:
        return Verdict.INCONCLUSIVE
    if allowed is None:
        return Verdict.FAIL if failures else Verdict.INCONCLUSIVE if unknown else Verdict.PASS
    if _bound(failures + unknown, n) <= allowed:
        return Verdict.PASS
    return Verdict.FAIL if lower_bound(failures, n) > allowed else Verdict.INCONCLUSIVE


def _bound(failures: int, runs: int) -> float:
    return upper_bound(failures, runs) if runs else 1.0


def sentence(summary: dict[str, Any]) -> str:
    """The verdict in words: never "safe", but how many runs and what that bounds."""
    bar = summary["failure_rate_allowed"]
    bound = float(f"{100.0 * summary['failure_rate_upper_bound_95']:.2g}")  # 100, not 1e+02
    words = (
        f"{summary['verdict'].upper()}: {counted_noun(summary['n'], 'run')}, "
        f"{counted_noun(summary['failures'], 'failure')}, "
        f"{summary['inconclusive']} inconclusive, failure rate at most "
        f"{bound:g} % with {100.0 * CONFIDENCE:.0f} % confidence"
    )
    words += "" if bar is None else f" (allowed: {100.0 * bar:.2g} %)"
    if summary["verdict"] == Verdict.INCONCLUSIVE.value:
        words += f"; {_undecided(summary)}"
    if summary["worst_row"] is not None:
        words += f"; smallest clearance {summary['worst_margin_m']:.3f} m in row {summary['worst_row']}"
    return words


def counted_noun(count: int, noun: str) -> str:
    """1 run, 2 runs."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _undecided(summary: dict[str, Any]) -> str:
    """What would decide."""
    if (needed := summary["deciding_runs"]) is None:
        return "what is inconclusive has to be decided first"
    return f"{needed} conclusive runs would decide, if the same share of them failed"


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Failures, what shows nothing, and passes, each by their margin; what could not be run comes first."""
    order = [verdict.value for verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.PASS)]

    def badness(row: Row) -> tuple[int, float]:
        return order.index(row["verdict"]), -1e9 if row["margin_m"] is None else row["margin_m"]

    return sorted(rows, key=badness)


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
    worst = worst_first(rows)
    left_out = f" Here are the {SHOWN} worst of {len(rows)}." if len(rows) > SHOWN else ""
    runs = Evidence(
        "Runs",
        "Failures first, then what shows nothing, then passes, each by their clearance. Each of them runs again, to "
        "the last bit, by its command, given in the campaign's own folder. On paper: the first 40." + left_out,
        table=_runs_table(worst[:SHOWN], ranked),
    )
    labels = Counter(row["label"] for row in rows)
    outcomes = Evidence(
        "Outcomes",
        "A run fails if it touches an obstacle, leaves the road, breaks off, stops or creeps where there is a way "
        "past, or is not driven at the speed asked. What is inconclusive shows nothing and counts as neither: the "
        'bound is of the others. "infeasible, handled": in some steps no plan held all bounds; the controller fell '
        "back and came through. All labels: docs/verdicts.md.",
        table=Table(("outcome", "runs"), tuple((label, str(count)) for label, count in labels.most_common())),
    )
    if not any(row["margin_m"] is not None for row in rows):
        return [outcomes, runs]
    buffer = scenario_of(campaign, cases(campaign)[0]).controller.buffer
    drawn = [Evidence("Clearance", _CLEARANCE, clearance_figure(rows, buffer)), outcomes]
    if ranked:
        drawn += [
            Evidence("Where it fails", _MAP, failure_map(rows, ranked)),
            Evidence("What matters", _RANKING, ranking_figure(ranked)),
        ]
    return [*drawn, runs]


_CLEARANCE = "Signed distance of the true outlines, every 10 ms or less, by code that the controller does not share."
_MAP = (
    "Every run over the parameters that tell failed from passed runs best (Kolmogorov-Smirnov distance), or, without "
    "failures, that explain most; two pairs of them where there are four. A point leads to its row."
)
_RANKING = (
    "First-order Sobol index of the runs' ranks by clearance, estimated by bins of equal count and corrected for "
    "chance. What several parameters do only together is in none of the bars."
)


def _runs_table(rows: Sequence[Row], ranked: Sequence[Influence]) -> Table:
    keys = [one.key for one in ranked[:5]]
    return Table(
        ("row", "verdict", "outcome", "clearance [m]", *keys, "again"),
        tuple(
            (
                str(row["row"]),
                row["verdict"].upper(),
                row["error"] or row["label"],
                "–" if row["margin_m"] is None else f"{row['margin_m']:.3f}",
                *(_short(row["values"][key]) for key in keys),
                f"sidestep run --from campaign.jsonl:{row['row']}",
            )
            for row in rows
        ),
        anchor="row",
        commands=True,
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
        _junit_case(
            f"sidestep.campaign.{campaign.name}",
            f"row {row['row']}: " + ", ".join(f"{key}={_short(value)}" for key, value in row["values"].items()),
            row,
        )
        for row in rows
    ]


def _junit_case(group: str, name: str, row: Row) -> JunitCase:
    if row["error"]:
        return JunitCase(group, name, error=row["error"])
    return judged_case(group, name, Verdict(row["verdict"]), row["label"])
