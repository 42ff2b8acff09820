"""`sidestep compare` and `sidestep golden`."""

import argparse
import time
from pathlib import Path

from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.arguments import share


def add_compare(commands: argparse._SubParsersAction) -> None:
    """Add `compare` to the commands of `sidestep`."""
    compare = commands.add_parser("compare", help="overlay runs and rate each pair after ISO/TS 18571")
    compare.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folders that `sidestep run` wrote")
    compare.add_argument("--out", type=Path, metavar="DIR", help="default: runs/<time>-compare")
    compare.add_argument("--least", type=share, metavar="RATING", help="overall rating, 0 to 1, that each has to reach")
    compare.add_argument("--junit", type=Path, metavar="FILE", help="also write every rating as a test case")
    compare.set_defaults(command=_compare)


def add_golden(commands: argparse._SubParsersAction) -> None:
    """Add `golden` and what is below it to the commands of `sidestep`."""
    golden = commands.add_parser("golden", help="hold runs to a recording that was found good")
    below = golden.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, text in (("record", "keep a run as golden: the only way one changes"), ("check", "hold a run to one")):
        parser = below.add_parser(name, help=text)
        parser.add_argument("run", type=Path, metavar="RUN", help="folder that `sidestep run` wrote")
        parser.add_argument("file", type=Path, metavar="FILE.csv", help="the golden recording")
        if name == "check":
            parser.add_argument("--junit", type=Path, metavar="FILE", help="also write every signal as a test case")
        parser.set_defaults(command=_record if name == "record" else _check)


def _compare(options: argparse.Namespace) -> int:
    from sidestep.validation.files import check_file, made
    from sidestep.validation.judge.summary import versions
    from sidestep.validation.report.compare.compare import evidence, pairs, read_runs
    from sidestep.validation.report.credibility import write_credibility_report
    from sidestep.validation.report.exports.junit import JunitCase, write_junit

    check_file(options.junit, "--junit")
    if len(options.runs) < 2:
        raise InputError("RUN", "only one", "two runs at least")
    runs, least = read_runs(options.runs), options.least
    rated = pairs(runs)
    shown = evidence(runs, rated, least)
    passed = shown[-1].passed
    lowest = min(rated, key=lambda pair: pair.overall)
    verdict = {None: "", True: "PASS: ", False: "FAIL: "}[passed] + f"lowest rating {lowest}"
    out = options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-compare"
    context = {"Command": options.command_line, "Versions": ", ".join(f"{n} {v}" for n, v in versions().items())}
    with made(out):
        write_credibility_report(out / "report.html", "Runs compared", verdict, shown, [_NOT_SAID], context)
    if options.junit:
        failures = [str(pair) if least is not None and pair.overall < least else "" for pair in rated]
        groups = [(f"sidestep.compare.{pair.reference}", f"{pair.other}: {pair.signal}") for pair in rated]
        cases = [JunitCase(*group, failure) for group, failure in zip(groups, failures, strict=True)]
        write_junit(options.junit, "sidestep compare", cases)
    print(*rated, verdict, f"report: {out / 'report.html'}", sep="\n")
    return 1 if passed is False else 0


_NOT_SAID = "Which of the runs is right: a rating says how alike they are."


def _record(options: argparse.Namespace) -> int:
    from sidestep.validation.report.compare.compare import read_runs
    from sidestep.validation.report.compare.golden import record

    run = read_runs([options.run])[0]
    if run.summary["verdict"] != "pass":
        raise InputError(
            str(options.run), f"did not pass: {run.summary['verdict']}: {run.summary['label']}", "one that did"
        )
    record(run.samples, run.summary["scenario"], options.file)
    print(f"golden: {options.file}")
    return 0


def _check(options: argparse.Namespace) -> int:
    from sidestep.validation.files import check_file
    from sidestep.validation.report.compare.compare import read_runs
    from sidestep.validation.report.compare.golden import check, read_golden
    from sidestep.validation.report.exports.junit import JunitCase, write_junit

    check_file(options.junit, "--junit")
    run = read_runs([options.run])[0]
    departures = check(run.samples, read_golden(options.file, run.summary["scenario"]))
    for departure in departures:
        print(departure)
    if options.junit:
        cases = [
            JunitCase(f"sidestep.golden.{options.file.stem}", d.signal, "" if d.passed else str(d)) for d in departures
        ]
        write_junit(options.junit, "sidestep golden", cases)
    passed = all(departure.passed for departure in departures)
    print("PASS" if passed else "FAIL")
    return 0 if passed else 1
