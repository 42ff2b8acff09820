"""What a run leaves on disk, and report.html of a run and of the demo: one file each, nothing loaded from outside."""

from collections.abc import Sequence
from math import degrees
from typing import Any

from sidestep.validation.console import HEADS, cells, number, row_name
from sidestep.validation.files import write_text, written_to
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.run import Run
from sidestep.validation.judge.summary import strict_json
from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import STEP_UNITS, write_columns
from sidestep.validation.report.compare.comparison import Line, compared_signals, compared_top_view
from sidestep.validation.report.explore.scene_data import scene_data
from sidestep.validation.report.exports.junit import JunitCase, judged_case
from sidestep.validation.report.pages import page, picture
from sidestep.validation.report.signals_figure import signals_figure
from sidestep.validation.report.still import still
from sidestep.validation.report.style import BLUE, GREEN, ORANGE, PURPLE
from sidestep.validation.report.topview import LOOK_BACK, distance, top_view
from sidestep.validation.report.usage_figure import usage_figure

_COLOURS = {"linear": ORANGE, "single-track": GREEN, "mujoco": BLUE, "linear (paper)": PURPLE}


def write_run(run: Run) -> None:
    """Write recording.csv, steps.csv, summary.json and report.html; each is complete or not there.

    Raises:
        InputError: The folder cannot be written to.
    """
    with written_to(run.folder):
        write_columns(run.folder / "recording.csv", run.recording.samples, run.recording.units)
        write_columns(run.folder / "steps.csv", run.recording.steps, STEP_UNITS)
        write_text(run.folder / "summary.json", strict_json(run.summary))
        write_text(run.folder / "report.html", run_report(run))


def run_report(run: Run) -> str:
    """The page of one run: verdict and scene first, then the time slider, numbers, signals, and what was run."""
    s = run.summary
    files = ["summary.json", "recording.csv", "steps.csv", *(["can.blf"] if s["can"]["sent"] else [])]
    return page(
        "run.html",
        name=f"{s['scenario']} on {s['plant']}" + (f", preset {s['preset']}" if s["preset"] != "default" else ""),
        summary=s,
        verdict=_sentence(s),
        top_view=picture(top_view(run.scenario, run.recording, run.judgement)),
        signals=picture(signals_figure(run.scenario, run.recording, run.judgement)),
        scene=scene_data(run.scenario, [Line(row_name(s), BLUE, run.recording)], _before(run.judgement)),
        usage=picture(usage_figure(run.scenario, run.recording)),
        still=still(run.scenario, run.recording, run.judgement.time),
        numbers=_numbers(run),
        not_covered=_not_covered(run),
        provenance=_provenance(s),
        files=files,
    )


def _before(judgement: Judgement) -> float:
    """The moment that a page shows first, in [s]: shortly before the closest approach."""
    return 0.0 if judgement.time is None else judgement.time - LOOK_BACK


def _sentence(s: dict[str, Any]) -> str:
    """PASS, FAIL or INCONCLUSIVE, why, and the worst clearance with where and when."""
    words = f"{s['verdict'].upper()} ({s['label']})"
    if s["min_clearance_m"] is not None:
        words += (
            f": {distance(s['min_clearance_m'], 3)} at obstacles[{s['min_clearance_obstacle']}]"
            f", s = {s['min_clearance_station_m']:.1f} m, t = {s['min_clearance_time_s']:.2f} s"
        )
    if s["detail"]:
        words += f". {s['detail']}"
    if s["plant_contact"]:
        words += ", contact in the plant's own geometry"
    if s["error"]:
        words += f". {s['error']}"
    return words


def junit_case(run: Run) -> JunitCase:
    """A run as a test case of a build server."""
    s = run.summary
    group, name = f"sidestep.run.{s['scenario']}", row_name(s)
    if s["error"]:
        return JunitCase(group, name, error=s["error"])
    return judged_case(group, name, run.judgement.verdict, _sentence(s))


def _numbers(run: Run) -> list[tuple[str, str, str, str]]:
    """Name, value, PASS or FAIL if the verdict hangs on it, and what to compare it with."""
    s, config, vehicle = run.summary, run.scenario.controller, run.scenario.vehicle
    can, gap, broken = s["can"], s["min_clearance_m"], run.recording.error is not None
    median, p99, most = (number(s["step_time_us"][name], "µs", 0) for name in ("median", "p99", "max"))
    return [
        ("Run", f"{s['duration_s']:.2f} s simulated", _mark(not broken), s["end"]),
        ("Way", f"{s['distance_m']:.1f} m", "",
         f"{s['asked_distance_m']:.1f} m at the asked speed until time or road end"),
        ("Obstacles left behind", f"{len(s['obstacles_passed'])} of {len(s['obstacles_ahead'])} ahead", "",
         f"{len(s['obstacles_reached'])} reached"),
        ("Mean speed", number(s["mean_speed"], "m/s", 2), "", f"asked: {s['asked_speed']:g} m/s"),
        ("Start", "as asked" if not s["start"]["not_taken"] else _start(s), "",
         "what the plant made of it; --accept-start drives on from elsewhere"),
        *((f["label"].capitalize(), f["text"], f["verdict"].upper(), "seen beside the recording")
          for f in s["findings"]),
        ("Smallest clearance", number(gap, "m", 3), "" if gap is None else _mark(gap > 0.0 and not s["plant_contact"]),
         f"above 0; buffer {config.buffer:g} m; negative: overlap"),
        ("Smallest clearance to the road's edge", number(s["min_edge_clearance_m"], "m", 3),
         _mark(s["min_edge_clearance_m"] >= 0.0), "0 or more; of the car's corners"),
        ("Largest lateral acceleration", number(s["max_lateral_acceleration"], "m/s²", 2), "",
         "nuPlan counts up to 4.89 m/s² as comfortable"),
        ("Largest yaw rate", number(degrees(s["max_yaw_rate"]), "deg/s", 1), "", "nuPlan: 54 deg/s"),
        ("Largest steering angle", number(degrees(s["max_steer_angle"]), "deg", 2), "",
         f"limit {degrees(vehicle.steer_limit):.1f} deg"),
        ("Largest steering rate", number(degrees(s["max_steer_rate"]), "deg/s", 1), "",
         f"limit {degrees(vehicle.steer_rate_limit):.1f} deg/s"),
        ("Lateral error", number(s["rms_lateral_error_m"], "m", 3), "",
         "RMS to the reference path, avoidance included"),
        ("Lateral error in the last second", number(s["final_rms_lateral_error_m"], "m", 4), "", "RMS"),
        ("Infeasible steps", f"{s['infeasible_steps']} of {s['steps']}", "",
         "solver failed, or corridor slack above 1 mm"),
        ("Largest corridor slack", number(1e3 * s["max_slack_m"], "mm", 3), "", ""),
        ("Controller step", f"{median} median", "", f"p99 {p99}, largest {most}"),
        ("Real-time factor", number(s["real_time_factor"], "", 1), "", "controller, bus and plant, one thread"),
        ("CAN", f"{can['sent']} frames", "", f"{can['interface']}, {can['lost']} lost"),
    ]  # fmt: skip


def _start(s: dict[str, Any]) -> str:
    asked, got = s["start"]["asked"], s["start"]["got"]
    return ", ".join(f"{name} {got[name]:.4g}, asked {asked[name]:.4g}" for name in s["start"]["not_taken"])


def _mark(good: bool) -> str:
    return "PASS" if good else "FAIL"


def _not_covered(run: Run) -> list[str]:
    """What one run says nothing of."""
    plant, sentences = (
        run.scenario.plant,
        ["Any other scene, speed or seed: how often it fails is for a campaign to say."],
    )
    if run.recording.estimated:
        sentences.append(f"What the plant does not report but estimates: {', '.join(run.recording.estimated)}.")
    if not plant.noise and not plant.measured_offset:
        sentences.append("Noise and offset of the measured state: the controller gets the true state (plant.noise).")
    if not plant.delay and run.summary["coupling"] == "zero-delay":
        sentences.append("Delay: a command acts in the period in which it was computed (plant.delay, --coupling).")
    return [
        *sentences,
        "Obstacles that are seen late, wrongly or not at all: the controller knows them from the start.",
        "The plant model's own error against a real car.",
    ]


def _provenance(s: dict[str, Any]) -> list[tuple[str, str]]:
    versions = ", ".join(f"{name} {version}" for name, version in s["versions"].items())
    plant = s["tables"].get("plant", {})
    seed = f"noise of seed {plant.get('noise_seed', 0)}" if plant.get("noise") else "none"
    return [
        ("Command", s["command_line"] or "(library call)"),
        ("Coupling", s["coupling"]),
        ("Randomness", f"{seed}: the same inputs give the same recording"),
        ("Versions", versions),
    ]


def demo_report(runs: Sequence[Run], summaries: Sequence[dict[str, Any]], verdict: Verdict) -> str:
    """The page of the demo.

    Args:
        runs: What could be run.
        summaries: A summary of every row, also of what could not be run.
        verdict: On all that counts.
    """
    scenes = [_scene(name, runs, summaries) for name in dict.fromkeys(s["scenario"] for s in summaries)]
    counted = [s for s in summaries if s["preset"] == "default"]
    good = sum(s["verdict"] == "pass" for s in counted)
    clearances = [s["min_clearance_m"] for s in counted if s.get("min_clearance_m") is not None]
    worst = f", worst clearance {min(clearances):.3f} m" if clearances else ""
    return page(
        "demo.html",
        verdict=verdict.value,
        sentence=f"{verdict.value.upper()}: {good} of {len(counted)} runs passed{worst}",
        scenes=scenes,
        heads=HEADS,
        provenance=_provenance(runs[0].summary) if runs else [],
    )


def _scene(name: str, runs: Sequence[Run], summaries: Sequence[dict[str, Any]]) -> dict[str, Any]:
    shown = [run for run in runs if run.scenario.name == name]
    lines = [Line(row_name(run.summary), _COLOURS[row_name(run.summary)], run.recording) for run in shown]
    rows = [
        {
            "name": row_name(s),
            "verdict": s["verdict"],
            "label": f"{s['verdict']}: {s['label']}",
            "cells": cells(s),
            "link": s.get("report"),
        }
        for s in summaries
        if s["scenario"] == name
    ]
    if not shown:
        return {"name": name, "rows": rows}
    top_view = picture(compared_top_view(shown[0].scenario, lines))
    return {
        "name": name,
        "rows": rows,
        "top_view": top_view,
        "data": scene_data(shown[0].scenario, lines, _before(shown[0].judgement)),
        "signals": picture(compared_signals(lines)),
    }
