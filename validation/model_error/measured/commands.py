"""`sidestep identify --log` and `sidestep validate --log`."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.validation.console import new_table, show
from sidestep.validation.files import check_file, companion, made, write_text, written_file, written_to
from sidestep.validation.judge.summary import strict_json
from sidestep.validation.manoeuvres.scene import open_loop_scenario
from sidestep.validation.model_error.identification.car_kernel import Chassis
from sidestep.validation.model_error.identification.identified_file import (
    identified_json,
    identified_vehicle,
    read_identified,
)
from sidestep.validation.model_error.identification.log_identification import LogIdentification, identify_log
from sidestep.validation.model_error.identification.vehicle_file import vehicle_toml
from sidestep.validation.model_error.logs.mapping import LogMap, read_map
from sidestep.validation.model_error.logs.measured import MeasuredLog, load_log
from sidestep.validation.model_error.measured import log_report
from sidestep.validation.model_error.measured.log_envelope import log_envelope
from sidestep.validation.model_error.measured.replay import replay, summary
from sidestep.validation.model_error.measured.scores import RANGES, Scores, Starts, by_range, p95, score_all, starts_of
from sidestep.validation.report.credibility import write_credibility_report
from sidestep.validation.report.evidence import Table

FITTED, JUDGED = slice(0, None, 2), slice(1, None, 2)
"""Windows of a log that is fitted and judged at once."""
TARGET_EXPLAINED = {"yaw_rate": 0.99, "a_y": 0.97}
"""Share of variance that a model must reach in windows that it was not fitted to, for `validate --log` to pass."""


def identify_from_log(log_file: Path, map_file: Path | None, out: Path, command_line: str) -> int:
    """Fit a log, print, write the vehicle file and, beside it, a JSON file with everything.

    Returns:
        Exit status: 0, or 1 if the stiffnesses cannot be identified; no vehicle file is written then.

    Raises:
        InputError: Log, map or files cannot be used.
    """
    mapping = _map(map_file)
    log = load_log(log_file, mapping)
    everything = companion(out, ".identified.json")
    with written_file(out, "--out"):
        out.parent.mkdir(parents=True, exist_ok=True)
    for file in (out, everything):
        check_file(file, "--out")
    found = identify_log(log, mapping.vehicle, mapping.rear_drive)
    _print_parameters(found, log)
    with written_file(everything, "--out"):
        write_text(everything, identified_json(found, Chassis.of(mapping.vehicle, mapping.rear_drive), log.name))
    if not (found.known("C_f") and found.known("C_r")):
        reason = found.problem or "the cornering stiffnesses are refused"
        show(f"no vehicle file: {reason}", f"all values: {everything}")
        return 1
    vehicle = replace(identified_vehicle(found, mapping.vehicle), name=out.stem)
    with written_file(out, "--out"):
        write_text(out, vehicle_toml(vehicle, _head(found, mapping, command_line)))
    show(
        f"vehicle file: {out}; use it by --set vehicle.file={out}",
        f"all values: {everything}; hold them against another log by `validate --log FILE --identified {everything}`",
    )
    return 0


def validate_log(
    log_file: Path,
    map_file: Path | None,
    identified: Path | None,
    overrides: Sequence[str],
    out: Path,
    command_line: str,
) -> int:
    """Hold the models against a log; write report, validity.json and summary.json.

    Args:
        log_file: The log.
        map_file: Its mapping.
        identified: JSON file of `identify --log`; None to fit every other window of this log and judge the rest.
        overrides: `controller.buffer=...` as given to `--set`.
        out: Folder.
        command_line: For the report.

    Returns:
        Exit status: 0 if the model explains what TARGET_EXPLAINED asks for, else 1.

    Raises:
        InputError: Log, map, file or folder cannot be used.
    """
    mapping = _map(map_file)
    for change in overrides:
        if not change.partition("=")[0].strip().startswith("controller.buffer"):
            raise InputError(
                f"--set {change}", "makes no difference beside --log", "controller.buffer; the car by --map"
            )
    buffer = open_loop_scenario(overrides).controller.buffer
    log = load_log(log_file, mapping)
    if identified is not None:
        found, chassis, source = read_identified(identified)
        told = {"Fitted to": f"{source}, by {identified}"}
    else:
        found, chassis = identify_log(log, mapping.vehicle, mapping.rear_drive, FITTED), None
        told = {"Fitted to": "every other window of 3 s of this log; the others are judged"}
    chassis = chassis or Chassis.of(mapping.vehicle, mapping.rear_drive)
    _print_parameters(found, log)
    if found.problem:
        show(f"not validated: {found.problem}")
        return 1
    log = log.without(found.left_out)
    with made(out):
        starts = starts_of(log)
        part = slice(None) if identified else JUDGED
        scores = score_all(log, found.values, found.linear, chassis, starts, part)
        return _report(log, found, chassis, mapping, starts, scores, buffer, out, told | {"Command": command_line})


def _report(
    log: MeasuredLog, found: LogIdentification, chassis: Chassis, mapping: LogMap, starts: Starts,
    scores: Sequence[Scores], buffer: float, out: Path, context: dict[str, str],
) -> int:  # fmt: skip
    vehicle = identified_vehicle(found, mapping.vehicle)
    envelope = log_envelope(log, found.values, vehicle, starts, buffer)
    driven = replay(log, found.values, chassis, vehicle) if found.known("C_f") and found.known("C_r") else None
    shares = scores[1].explained
    failed = [name for name, least in TARGET_EXPLAINED.items() if name in shares and not shares[name] >= least]
    sentence = _sentence(log, scores, starts, failed)
    evidence = [
        *log_report.model_evidence(scores, starts, context["Fitted to"], not failed),
        log_report.steady_evidence(log, found.values, chassis),
        log_report.windows_evidence(log, found.values, found.linear, chassis, starts),
        log_report.identification_evidence(found),
        log_report.envelope_evidence(envelope),
        log_report.replay_evidence(driven),
        log_report.log_table(log),
    ]
    ranges = [f"{low:g}-{high:g}" for low, high in RANGES]
    figures = {
        "log": log.name, "passed": not failed, "fitted_to": context["Fitted to"],
        "models": {
            s.model: {
                "explained": dict(s.explained), "explained_raw": dict(s.explained_raw),
                "offset_p95_m": {
                    name: p95(s.offset, c) for name, c in zip(ranges, by_range(starts), strict=True) if c.sum() >= 10
                },
            }
            for s in scores
        },
        "replay": summary(driven) if driven else None,
    }  # fmt: skip
    with written_to(out):
        tables = envelope.as_tables(log.name)
        write_text(out / "validity.json", strict_json({"command_line": context["Command"]} | tables))
        write_text(out / "summary.json", strict_json(figures))
    context = context | {"Version": f"sidestep {version('sidestep')}", "Vehicle": vehicle.name}
    title = f"Models against the measured log {log.name}"
    write_credibility_report(out / "report.html", title, sentence, evidence, log_report.NOT_COVERED, context)
    _print_table("Measured against each model", log_report.models_table(scores, starts))
    show(sentence, f"report: {out / 'report.html'}; limits for the controller: {out / 'validity.json'}")
    return 1 if failed else 0


def _sentence(log: MeasuredLog, scores: Sequence[Scores], starts: Starts, failed: Sequence[str]) -> str:
    best, linear = scores[1], scores[0]
    parts = [f"{share:.2%} of {name} (linear {linear.explained[name]:.2%})" for name, share in best.explained.items()]
    wanted = ", ".join(f"{name} {least:.0%}" for name, least in TARGET_EXPLAINED.items() if name in best.explained)
    hard = p95(best.offset, by_range(starts)[2])
    offset = "" if np.isnan(hard) else f"; at 7 to 10 m/s² its offset 1.5 s ahead is within {hard:.2f} m (95 %)"
    return (
        f"{'FAIL' if failed else 'PASS'}: over 3 s the identified car explains {', '.join(parts)} of {log.name} "
        f"({wanted} required){offset}."
    )


def _map(map_file: Path | None) -> LogMap:
    if map_file is None:
        raise InputError("--map", "missing beside --log", "a TOML file with [vehicle] mass, l_f and l_r, and [signals]")
    return read_map(map_file)


def _head(found: LogIdentification, mapping: LogMap, command_line: str) -> str:
    """Comment of the vehicle file: where each number is from."""
    lines = [f"Identified by: {command_line}"]
    for v in found.verdicts:
        if v.refused:
            lines.append(f"{v.parameter.name}: not identified: {v.refused}")
        else:
            interval = f"95 % {v.low:.5g} to {v.high:.5g}"
            lines.append(f"{v.parameter.name} = {v.value:.5g} {v.parameter.unit}, {interval}")
    told = ", ".join(sorted(mapping.told))
    return "\n".join([*lines, f"Told: {told}; what is neither told nor identified is a placeholder."])


def _print_parameters(found: LogIdentification, log: MeasuredLog) -> None:
    show(*(f"{log.name}: {note}" for note in found.notes))
    show(*(f"{name} is left out: {why}" for name, why in found.left_out.items()))
    shares = ", ".join(f"{name} {share:.2%}" for name, share in found.explained.items() if name not in found.left_out)
    _print_table(f"Identified; explained: {shares or 'nothing'}", log_report.parameter_table(found))


def _print_table(title: str, content: Table) -> None:
    table = new_table(title, *content.columns)
    for row in content.rows:
        table.add_row(*row)
    show(table)
