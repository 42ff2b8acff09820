"""What a log told, as files: vehicle.toml for controller and plants, and a JSON file with all values and intervals."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from sidestep.plant_models.documents import read_json
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.model_error.identification.car_kernel import SHAPE, Chassis, Values
from sidestep.validation.model_error.identification.log_identification import LogIdentification, Verdict
from sidestep.validation.model_error.identification.log_parameters import BY_NAME

_LARGEST_CURVATURE = 0.99
_LEAST_GAIN = 0.5  # road wheel over measured angle, below which a steering wheel was measured
_SAME_LOAD = 0.05  # relative difference of the axles' loads below which one tyre has one peak


class IdentifiedFile(msgspec.Struct, forbid_unknown_fields=True):
    """The JSON file.

    Attributes:
        log: That was fitted.
        values, linear: By name, as the fits have them: the car with tyre peaks, and the best linear one.
        chassis: What was told.
        parameters: Value, 95 % interval, unit and refusal of each parameter.
        explained: Share of variance by signal.
        left_out: Signals that contradict the others.
    """

    log: str
    values: dict[str, float]
    linear: dict[str, float]
    chassis: dict[str, float]
    parameters: dict[str, dict[str, Any]]
    explained: dict[str, float]
    left_out: dict[str, str]


def identified_json(found: LogIdentification, chassis: Chassis, log: str) -> str:
    """The JSON file's text."""
    parameters = {
        v.parameter.name: {
            "value": v.value, "low": _finite(v.low), "high": _finite(v.high), "unit": v.parameter.unit,
            "refused": v.refused,
        }
        for v in found.verdicts
    }  # fmt: skip
    content = IdentifiedFile(
        log, found.values._asdict(), found.linear._asdict(), chassis._asdict(), parameters, dict(found.explained),
        dict(found.left_out),
    )  # fmt: skip
    return json.dumps(msgspec.to_builtins(content), indent=1) + "\n"


def read_identified(path: Path) -> tuple[LogIdentification, Chassis, str]:
    """What was found, what was told, and the name of the log that was fitted.

    Raises:
        InputError: No such file, or none that `identify --log` wrote.
    """
    table = read_json(path, "a file of `sidestep identify --log`")
    try:
        content = msgspec.convert(table, IdentifiedFile)
        verdicts = tuple(
            Verdict(BY_NAME[name], p["value"], _number(p["low"]), _number(p["high"]), p["refused"])
            for name, p in content.parameters.items()
        )
        found = LogIdentification(
            Values(**content.values), Values(**content.linear), verdicts, content.explained, content.left_out, "", ()
        )  # fmt: skip
        return found, Chassis(**content.chassis), content.log
    except (msgspec.MsgspecError, TypeError, KeyError) as error:
        raise InputError("--identified", f"{str(path)!r}: {error}", "a file of `sidestep identify --log`") from error


def identified_vehicle(found: LogIdentification, vehicle: VehicleParameters) -> VehicleParameters:
    """The vehicle with what the log told; what it did not tell stays as it was told.

    The file has one tyre for both axles, which each axle's stiffness scales; its peak is that of either axle where
    their loads differ, its curvature that of both together.
    """
    v, changes = found.values, {}
    for name, key, value in (
        ("I_z", "yaw_inertia", v.I_z), ("C_f", "cornering_stiffness_front", v.C_f),
        ("C_r", "cornering_stiffness_rear", v.C_r), ("cg_height", "cg_height", v.cg_height),
    ):  # fmt: skip
        if found.known(name):
            changes[key] = value
    if found.known("steer_gain") and v.steer_gain < _LEAST_GAIN:
        changes["steering_ratio"] = 1.0 / v.steer_gain
    vehicle = vehicle.with_(**changes)
    tyre = vehicle.tyre
    if found.known("relaxation"):
        tyre = replace(tyre, relaxation_y=v.relaxation)
    if found.known("mu_f") and found.known("mu_r"):
        tyre = replace(tyre, **_peaks(v, vehicle))
    return vehicle.with_(tyre=tyre)


def _peaks(v: Values, vehicle: VehicleParameters) -> dict[str, float]:
    share_f, share_r = vehicle.l_r / vehicle.wheelbase, vehicle.l_f / vehicle.wheelbase
    middle = share_f * v.mu_f + share_r * v.mu_r
    curvature = min(share_f * v.e_f + share_r * v.e_r, _LARGEST_CURVATURE)
    load = 0.25 * vehicle.mass * GRAVITY
    slope = 0.0
    if abs(share_r - share_f) > _SAME_LOAD:
        slope = min(max((v.mu_r - v.mu_f) / (2.0 * (share_r - share_f)), -0.3), 0.3)
    return {"nominal_load": load, "p_cy1": SHAPE, "p_ey1": curvature, "p_dy1": middle, "p_dy2": slope}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else value
