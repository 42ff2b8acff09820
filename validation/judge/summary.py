"""The numbers of a run, as `summary.json` holds them."""

import json
import math
import platform
from collections import Counter
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import Array, Recording
from sidestep.validation.scenarios.scenario import Scenario

_LIBRARIES = ("sidestep", "numpy", "scipy", "numba", "piqp", "mujoco", "fmpy", "python-can", "cantools", "shapely")


def summarise(scenario: Scenario, recording: Recording, judgement: Judgement, **about: Any) -> dict[str, Any]:
    """All figures of a run; lateral errors are those to the reference path.

    Args:
        scenario: What was driven.
        recording: What happened.
        judgement: What it is worth.
        about: Further entries: plant, CAN, command line.
    """
    time, offset = recording["time"], recording["l"] - scenario.controller.reference_offset
    steps = recording.steps["step_time"]
    duration = float(time[-1] - time[0])
    return {
        "scenario": scenario.name,
        "plant": scenario.plant.name,
        "estimated_signals": list(recording.estimated),
        "preset": scenario.controller_preset,
        "controller": scenario.controller_kind or "sidestep",
        "verdict": judgement.verdict.value,
        "label": judgement.label,
        "detail": judgement.detail,
        "end": recording.end.value,
        "notes": list(scenario.notes),
        "error": f"{type(recording.error).__name__}: {recording.error}" if recording.error else None,
        "duration_s": duration,
        **_progress(scenario, recording, judgement),
        "min_clearance_m": judgement.min_clearance,
        "min_clearance_obstacle": judgement.obstacle,
        "min_clearance_time_s": judgement.time,
        "min_clearance_station_m": judgement.s,
        "plant_contact": recording.contact,
        "min_edge_clearance_m": judgement.min_edge_clearance,
        "max_lateral_acceleration": _peak(recording["lateral_acceleration"]),
        "max_steer_angle": _peak(recording["steer_angle"]),
        "max_steer_rate": _peak(recording["steer_rate"]),
        "max_yaw_rate": _peak(recording["yaw_rate"]),
        "rms_lateral_error_m": _rms(offset),
        "final_rms_lateral_error_m": _rms(offset[time >= time[-1] - 1.0]),
        "min_speed": float(recording["v_x"].min()),
        "infeasible_steps": recording.infeasible_steps,
        "max_slack_m": float(recording.steps["slack_corridor"].max(initial=0.0)),
        "steps": len(steps),
        "solver_status": dict(Counter(plan.solver_status for plan in recording.plans)),
        "step_time_us": _quantiles(steps),
        "real_time_factor": duration / recording.wall_time if recording.wall_time > 0.0 else None,
        **about,
        "versions": versions(),
        "tables": scenario.tables,
        "folder": str(scenario.folder.absolute()),
    }


def _progress(scenario: Scenario, recording: Recording, judgement: Judgement) -> dict[str, Any]:
    """How far the drive went, and from where: what was asked and what the plant made of it, never one for the other."""
    went, asked = judgement.progress, asdict(scenario.start)
    return {
        "distance_m": went.distance,
        "asked_distance_m": went.asked_distance,
        "asked_speed": scenario.speed,
        "mean_speed": went.mean_speed,
        "held_speed": went.held_speed,
        "obstacles_ahead": list(went.ahead),
        "obstacles_reached": list(went.reached),
        "obstacles_passed": list(went.passed),
        "start": {
            "asked": asked,
            "got": {name: float(recording[name][0]) for name in asked},
            "not_taken": [departure.signal for departure in recording.departures],
        },
        "findings": [
            {"label": f.label, "verdict": f.verdict.value, "text": f.text} for f in judgement.findings
        ],
    }  # fmt: skip


def versions() -> dict[str, str]:
    """Of Python and of the libraries that a result may depend on."""
    return {"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}}


def strict_json(value: Any) -> str:
    """JSON without NaN and infinities: they become null."""
    return json.dumps(_finite(value), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(below) for key, below in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(below) for below in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _peak(values: Array) -> float:
    return float(np.abs(values).max())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _quantiles(steps: Array) -> dict[str, float | None]:
    if not len(steps):
        return {"median": None, "p99": None, "max": None}
    median, p99, top = np.percentile(steps, (50.0, 99.0, 100.0))
    return {"median": float(median), "p99": float(p99), "max": float(top)}
