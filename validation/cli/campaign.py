"""`sidestep campaign`, and what `sidestep run --from` needs of one."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.arguments import add_jobs


def add_campaign(commands: argparse._SubParsersAction) -> None:
    """Add `campaign` to the commands of `sidestep`."""
    campaign = commands.add_parser("campaign", help="drive a scenario many times over ranges of its keys")
    campaign.add_argument("spec", type=Path, metavar="SPEC.toml", help="what varies: see docs/campaigns.md")
    add_jobs(campaign)
    campaign.add_argument("--dask", metavar="tcp://HOST:PORT", help="scheduler of a Dask cluster that does it instead")
    campaign.add_argument(
        "--out", type=Path, metavar="DIR", help="default: runs/<name>; what is there of it already is not run again"
    )
    campaign.add_argument("--junit", type=Path, metavar="FILE", help="also write every row as a test case")
    campaign.set_defaults(command=_campaign)


def _campaign(options: argparse.Namespace) -> int:
    from sidestep.validation.campaigns.campaign import load_campaign
    from sidestep.validation.campaigns.campaign_report import junit_cases, sentence, summarised, write_campaign_report
    from sidestep.validation.campaigns.campaign_run import about, run_campaign
    from sidestep.validation.files import check_file, made, write_text, written_to
    from sidestep.validation.judge.summary import strict_json
    from sidestep.validation.report.exports.junit import write_junit

    check_file(options.junit, "--junit")
    campaign = load_campaign(options.spec)
    out = options.out or Path("runs") / campaign.name
    with made(out):
        rows = run_campaign(campaign, out / "campaign.jsonl", options.jobs, options.dask)
    summary = summarised(campaign, rows)
    context = {"Command": options.command_line, "Seed": str(campaign.seed), **about(campaign)}
    with written_to(out):
        write_text(out / "summary.json", strict_json(summary | {"about": context}))
        write_campaign_report(out / "report.html", campaign, rows, summary, context)
    if options.junit:
        write_junit(options.junit, campaign.name, junit_cases(campaign, rows))
    print(sentence(summary))
    for row in rows:
        if row["verdict"] != "pass":
            print(f"row {row['row']}: {row['verdict']}: {row['error'] or row['label']}")
    print(f"report: {out / 'report.html'}; replay: sidestep run --from {shlex.quote(str(out / 'campaign.jsonl'))}:ROW")
    return 0 if summary["verdict"] == "pass" else 1


def replayed(reference: str, overrides: Sequence[str] = ()) -> tuple[Any, dict[str, Any] | None]:
    """The scenario behind FILE:ROW, changed by `overrides`, and the row; None for that if anything was changed.

    Raises:
        InputError: No such file or row.
    """
    from sidestep.validation.campaigns.campaign import cases, scenario_of
    from sidestep.validation.campaigns.campaign_run import load_rows

    file, _, number = reference.rpartition(":")
    if not file or not number.isdecimal() or len(number) > 9:
        raise InputError("--from", f"{reference!r}", "FILE.jsonl:ROW")
    campaign, rows = load_rows(Path(file))
    row = next((row for row in rows if row["row"] == int(number)), None)
    if row is None:
        raise InputError("--from", f"no row {number} in {file}", f"one of its {len(rows)} rows")
    scenario = scenario_of(campaign, cases(campaign)[row["row"]], overrides)
    return scenario, None if overrides else row


def compared_to_row(run: Any, row: dict[str, Any]) -> str:
    """What of a run is not as in a campaign's row, or that nothing is."""
    from sidestep.validation.campaigns.campaign_run import figures

    now = figures(run.scenario, run.recording, run.judgement)
    changed = [f"{key} {row.get(key)} -> {now[key]}" for key in now if now[key] != row.get(key)]
    return f"row {row['row']} again: " + ("; ".join(changed) if changed else "the same to the last bit")
