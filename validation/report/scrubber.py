"""What the page's time slider shows: car, corridor, plan and prediction at many moments of a run, as JSON."""

import json
import math
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from sidestep.plant_models.signals import Status
from sidestep.validation.geometry import Array, car_boxes, obstacle_boxes, signed_clearance
from sidestep.validation.judge.verdict import Judgement
from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.topview import LOOK_BACK, driven_extent
from sidestep.validation.scenarios.scenario import Scenario

MOST_FRAMES = 300
"""Moments that are shown at most: keeps a page of a long run small."""


def scrubber_data(scenario: Scenario, recording: Recording, judgement: Judgement) -> Markup | None:
    """JSON for `templates/scrubber.js`, safe within a script element; None without a single plan."""
    if not recording.plans:
        return None
    times = recording.steps["time"]
    shown = np.array(
        [
            k
            for k in range(0, len(recording.plans), math.ceil(len(recording.plans) / MOST_FRAMES))
            if _is_finite(recording.plans[k])
        ],
        dtype=np.intp,
    )
    if not len(shown):
        return None
    start = judgement.time - LOOK_BACK if judgement.time is not None else 0.0
    data = {
        "road": _road(scenario, recording),
        "car": _flat(car_boxes(scenario.vehicle, 0.0, 0.0, 0.0)[0]),
        "driven": _flat(np.column_stack([recording["x"], recording["y"]])[::5]),
        "start": int(np.argmin(np.abs(times[shown] - start))),
        "frames": _frames(scenario, recording, shown),
    }
    return Markup(json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _is_finite(plan: Any) -> bool:
    """Whether a plan can be drawn: that of a car whose model overflows cannot."""
    return all(
        np.isfinite(values).all() for values in (plan.s, plan.l, plan.left, plan.right, plan.states_s, plan.states)
    )


def _flat(points: Array) -> list[float]:
    """x, y, x, y, ... in centimetres' precision, as an SVG path takes it."""
    return np.round(np.asarray(points, dtype=float), 2).ravel().tolist()


def _road(scenario: Scenario, recording: Recording) -> dict[str, list[float]]:
    s = np.linspace(*driven_extent(recording), 300)
    path = scenario.path
    widths = path.widths(s)
    left, middle, right = (
        np.column_stack(path.to_cartesian(s, offset)) for offset in (widths[0], np.zeros_like(s), -widths[1])
    )
    return {"left": _flat(left), "middle": _flat(middle), "right": _flat(right)}


def _frames(scenario: Scenario, recording: Recording, shown: NDArray[np.intp]) -> list[dict[str, Any]]:
    at = np.minimum(
        np.searchsorted(recording["time"], recording.steps["time"][shown] - 1e-9), len(recording["time"]) - 1
    )
    car = car_boxes(scenario.vehicle, *(recording[name][at] for name in ("x", "y", "yaw")))
    boxes = [obstacle_boxes(scenario.path, obstacle, recording["time"][at]) for obstacle in scenario.obstacles]
    gaps = np.min([signed_clearance(car, box) for box in boxes], axis=0) if boxes else None
    return [
        {
            "t": round(float(recording["time"][i]), 3),
            "pose": [round(float(recording[name][i]), 4) for name in ("x", "y", "yaw")],
            "boxes": [_flat(box[k]) for box in boxes],
            **_plan(scenario, recording.plans[shown[k]]),
            "words": _words(recording, i, None if gaps is None else float(gaps[k])),
        }
        for k, i in enumerate(at)
    ]


def _plan(scenario: Scenario, plan: Any) -> dict[str, list[float]]:
    path = scenario.path
    widths = path.widths(plan.s)
    left, right = (np.clip(bound, -widths[1], widths[0]) for bound in (plan.left, plan.right))
    band = np.vstack([
        np.column_stack(path.to_cartesian(plan.s, left)),
        np.column_stack(path.to_cartesian(plan.s, right))[::-1],
    ])  # fmt: skip
    return {
        "corridor": _flat(band),
        "planned": _flat(np.column_stack(path.to_cartesian(plan.s, plan.l))),
        "predicted": _flat(np.column_stack(path.to_cartesian(plan.states_s, plan.states[:, 0]))),
    }


def _words(recording: Recording, i: int, gap: float | None) -> list[str]:
    return [
        f"{recording['time'][i]:.2f} s",
        f"{recording['v_x'][i]:.1f} m/s",
        f"steering {math.degrees(recording['steer_angle'][i]):+.2f}°",
        f"a_y {recording['lateral_acceleration'][i]:+.2f} m/s²",
        "no obstacle" if gap is None else f"clearance {gap:.2f} m",
        Status(int(recording["status"][i])).name.lower(),
    ]
