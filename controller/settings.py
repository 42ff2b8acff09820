"""What holds for a drive, as the step takes it: car, planner, grid, weights and limits in one record."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.decision.corridor import FIRST_CORRIDOR_TIME
from sidestep.controller.decision.planner import PlannerSettings
from sidestep.controller.decision.stopping import SWERVE_TIME
from sidestep.controller.mpc.car_model import Car, peak_slip
from sidestep.controller.mpc.grid import grid
from sidestep.controller.mpc.roll import Body
from sidestep.controller.paper import HORIZON as PAPER_HORIZON
from sidestep.controller.paper import STEP as PAPER_STEP
from sidestep.controller.records import MOVES, NODES, SETTINGS, SLIP_NODES, SPEEDS, filled
from sidestep.controller.validity import Validity
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

BEND_SHARE = 0.7
"""Most of friction times gravity that a bend may take: the rest is for what lies in it."""
TIGHTENING_TIME = 0.5
"""Time ahead from which on the full tightening is asked, in [s]."""


def settings_of(vehicle: VehicleParameters, c: ControllerConfig) -> NDArray[np.void]:
    """Record of `SETTINGS`, shape (1,).

    Raises:
        InputError: The car cannot roll, the validity file cannot be used, or the period asks for too many nodes.
    """
    car = Car.of(vehicle, c.tyre_model == "affine", c.friction, Body.of(vehicle) if c.body_roll else None)
    peaks = peak_slip(car.stiffness_f, car.load_f, car), peak_slip(car.stiffness_r, car.load_r, car)
    return filled(SETTINGS, {
        "car": _fields(car), "planner": PlannerSettings.of(vehicle, c)._asdict(), "grid": _grid(vehicle, c),
        "weights": {
            "offset": c.weight_offset, "lateral_speed": c.weight_lateral_speed, "acceleration": c.weight_acceleration,
            "jerk": c.weight_jerk, "rate": c.weight_rate, "corridor": c.corridor_penalty, "slip": c.slip_penalty,
        },
        "peaks": peaks, "slip_limits": [c.slip_share * peak for peak in peaks], **_valid(c),
        "period": c.period, "cruise": math.nan if c.cruise_speed is None else c.cruise_speed,
        "delay": c.input_delay_steps, "rolls": c.body_roll, "rejects": c.reject_disturbance, "buffer": c.buffer,
        "tightening": c.tightening, "comfort_braking": c.comfort_braking, "standstill_gap": c.standstill_gap,
        "bend_acceleration": min(c.bend_acceleration, BEND_SHARE * c.friction * GRAVITY, _least_valid(c)),
        "front": vehicle.front_extent,
    })  # fmt: skip


def _least_valid(c: ControllerConfig) -> float:
    """Lateral acceleration up to which the prediction is valid at any speed; infinite if nothing is known of that."""
    validity = Validity.of(c)
    return float(validity.by_speed(c.friction).min()) if validity else math.inf


def _fields(car: Car) -> dict[str, Any]:
    return car._asdict() | {"body": car.body._asdict(), "affine": bool(car.affine)}


def _valid(c: ControllerConfig) -> dict[str, Any]:
    validity = Validity.of(c)
    if validity is None or c.formulation == "paper":
        return {}
    count = len(validity.speeds)
    if count > SPEEDS:
        raise InputError("controller.validity", f"{count} speeds", f"at most {SPEEDS}")
    return {
        "valid": count, "valid_speeds": validity.speeds, "valid_accelerations": validity.by_speed(c.friction),
    }  # fmt: skip


def _grid(vehicle: VehicleParameters, c: ControllerConfig) -> dict[str, Any]:
    """The prediction grid; the paper's bounds the centre point only, and by nothing more than (13)."""
    literal = c.formulation == "paper"
    if literal:
        level = np.zeros(PAPER_HORIZON, dtype=np.int64)
        block = group = np.zeros(PAPER_HORIZON, dtype=np.int64)
        times = PAPER_STEP * np.arange(1.0, PAPER_HORIZON + 1)
    else:
        level, block, group = grid(c.period)
        times = np.cumsum(c.period * 2.0**level, dtype=np.float64)
    nodes = len(level)
    if nodes > NODES or block[-1] + 1 > MOVES:
        raise InputError("controller.period", f"{c.period} s asks for {nodes} prediction nodes", f"at most {NODES}")
    slip_nodes = np.arange(2, min(nodes, SLIP_NODES + 1), 2)
    begins = np.searchsorted(group, np.arange(int(group[-1]) + 2))
    edges = np.concatenate([[0.0], times])[begins]
    tightening = 0.0 if literal else c.tightening
    return {
        "nodes": nodes, "moves": int(block[-1]) + 1, "groups": len(edges) - 1, "times": times,
        "steps": np.diff(times, prepend=0.0) if literal else c.period * 2.0**level,
        "level": level, "block": block, "group": group, "force_times": 0.5 * (edges[1:] + edges[:-1]),
        "first": int(np.searchsorted(times, FIRST_CORRIDOR_TIME)), "slip_nodes": slip_nodes, "slips": len(slip_nodes),
        "swerve": int(np.searchsorted(np.concatenate([[0.0], times]), SWERVE_TIME)),
        "clearance": 0.5 * vehicle.width + c.buffer + tightening * np.minimum(times / TIGHTENING_TIME, 1.0),
        "levers": (0.0, 0.0) if literal else (vehicle.front_extent, -vehicle.rear_extent), "literal": literal,
    }  # fmt: skip
