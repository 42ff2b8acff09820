"""The library of cars: `presets/library.csv`, one car a row, and what is estimated where no public table has a number.

Yaw inertia and cornering stiffness are a Honda Civic's, scaled by mass, wheelbase and place of the centre of gravity,
as commaai/opendbc does (`scale_rot_inertia`, `scale_tire_stiffness`). The chassis is that of a typical car: shares of
mass and length between those of the CommonRoad sets, ride frequencies of 1.3 and 1.4 Hz, dampers of 0.3 of the critical
damping, and anti-roll bars so that the body leans 5 deg per g.
"""

import csv
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from sidestep.plant_models.vehicle.checks import GRAVITY

TABLE = Path(__file__).parent / "presets" / "library.csv"
ESTIMATE = "~"
"""Marks a number that the table's own source estimates."""

_CARGO = 136.0  # opendbc adds it to the curb weight before it scales, [kg]
_CIVIC_MASS, _CIVIC_WHEELBASE, _CIVIC_SHARE = 1326.0 + _CARGO, 2.70, 0.4
_CIVIC_INERTIA, _CIVIC_FRONT, _CIVIC_REAR = 2500.0, 192150.0, 202500.0
_CG_SHARE = 0.39  # of the height of the car
_UNSPRUNG = 0.11  # of the mass, both axles
_ROLL_INERTIA, _PITCH_INERTIA = 0.115, 0.23  # over sprung mass and mean track, wheelbase squared
_RIDE = {"front": 1.3, "rear": 1.4}  # [Hz]
_DAMPING, _LEAN = 0.3, math.radians(5.0)  # of critical; per g
_FRONT_BAR = 0.6  # of the roll stiffness that springs leave to bars
_TYRE_DEFLECTION = 0.017  # under the static load, [m]

_PUBLIC = {
    "mass": "opendbc CarSpecs, curb weight", "l_f": "opendbc CarSpecs", "l_r": "opendbc CarSpecs",
    "steering_ratio": "opendbc CarSpecs", "length": "Transport Canada", "width": "Transport Canada",
    "suspension.track_front": "Transport Canada", "suspension.track_rear": "Transport Canada",
}  # fmt: skip
_SCALED = "estimated: opendbc's Civic scaled by mass and axles"


@dataclass(frozen=True)
class Row:
    """One line of the table: numbers by column, and which of them the source marks as estimates."""

    name: str
    title: str
    years: str
    platform: str
    numbers: dict[str, float]
    estimated: frozenset[str]


@cache
def library() -> dict[str, Row]:
    """The rows of the table by the names of their cars."""
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return {row["name"]: _row(row) for row in csv.DictReader(lines)}


def library_cars() -> tuple[str, ...]:
    """Names of the cars of the table."""
    return tuple(library())


def library_car(name: str) -> dict[str, Any]:
    """The tables of a vehicle file for a car of `library_cars()`, with a `source` for every number."""
    row = library()[name]
    value = row.numbers
    mass, wheelbase, share = value["mass"], value["wheelbase"], value["l_f_share"]
    size = (mass + _CARGO) / _CIVIC_MASS
    front = _CIVIC_FRONT * size * (1.0 - share) / (1.0 - _CIVIC_SHARE) * value["tyre_factor"]
    height = _CG_SHARE * value["height"]
    return {
        "name": name,
        "mass": mass,
        "yaw_inertia": round(_CIVIC_INERTIA * mass / _CIVIC_MASS * (wheelbase / _CIVIC_WHEELBASE) ** 2, 1),
        "l_f": round(share * wheelbase, 4),
        "l_r": round((1.0 - share) * wheelbase, 4),
        "cornering_stiffness_front": round(front, 1),
        "cornering_stiffness_rear": round(_CIVIC_REAR * size * share / _CIVIC_SHARE * value["tyre_factor"], 1),
        "width": value["width"],
        "length": value["length"],
        "front_overhang": round(0.5 * (value["length"] - wheelbase), 4),
        "cg_height": round(height, 4),
        "steer_limit": 0.6,
        "steer_rate_limit": 0.4,
        "steering_ratio": value["steering_ratio"],
        "tyre": {"nominal_load": round(0.25 * mass * GRAVITY, 1)},
        "suspension": _chassis(value, height),
        "source": _sources(row),
    }


def _row(texts: dict[str, str]) -> Row:
    words = ("name", "title", "years", "opendbc")
    cells = {key: text for key, text in texts.items() if key not in words}
    numbers = {key: float(text.removeprefix(ESTIMATE)) for key, text in cells.items()}
    estimated = frozenset(key for key, text in cells.items() if text.startswith(ESTIMATE))
    return Row(texts["name"], texts["title"], texts["years"], texts["opendbc"], numbers, estimated)


def _chassis(value: dict[str, float], height: float) -> dict[str, float]:
    """Suspension data of a typical car of this mass, size and height of the centre of gravity [m]."""
    mass, wheelbase = value["mass"], value["wheelbase"]
    track = {axle: value[f"track_{axle}"] for axle in _RIDE}
    sprung, width = (1.0 - _UNSPRUNG) * mass, 0.5 * sum(track.values())
    loads = {"front": (1.0 - value["l_f_share"]) * mass, "rear": value["l_f_share"] * mass}
    corner = {axle: 0.5 * (load - 0.5 * _UNSPRUNG * mass) for axle, load in loads.items()}
    spring = {axle: (2.0 * math.pi * ride) ** 2 * corner[axle] for axle, ride in _RIDE.items()}
    held = mass * GRAVITY * height * (1.0 / _LEAN + 1.0)  # per rad, against lateral force and weight at 1 g
    bars = max(held - sum(0.5 * spring[axle] * track[axle] ** 2 for axle in _RIDE), 0.0)
    result = {
        "roll_inertia": _ROLL_INERTIA * sprung * width**2,
        "pitch_inertia": _PITCH_INERTIA * sprung * wheelbase**2,
        "tyre_stiffness": 0.25 * mass * GRAVITY / _TYRE_DEFLECTION,
        "anti_roll_front": _FRONT_BAR * bars,
        "anti_roll_rear": (1.0 - _FRONT_BAR) * bars,
        "wheel_radius": 0.344,
        "wheel_spin_inertia": 1.7,
    }
    for axle in _RIDE:
        result |= {
            f"unsprung_mass_{axle}": 0.5 * _UNSPRUNG * mass,
            f"spring_{axle}": spring[axle],
            f"damper_{axle}": 2.0 * _DAMPING * math.sqrt(spring[axle] * corner[axle]),
            f"track_{axle}": track[axle],
        }
    return {key: round(number, 4) for key, number in result.items()}


def _sources(row: Row) -> dict[str, str]:
    sources = {key: f"{text} ({row.platform})" if "opendbc" in text else text for key, text in _PUBLIC.items()}
    if "l_f_share" in row.estimated:
        sources["l_f"] = sources["l_r"] = f"estimated: opendbc's share for the make ({row.platform})"
    return sources | {
        "default": "estimated: typical",
        "yaw_inertia": _SCALED,
        "cornering_stiffness_front": _SCALED,
        "cornering_stiffness_rear": _SCALED,
        "front_overhang": "estimated: wheelbase centred in the length",
        "cg_height": f"estimated: {_CG_SHARE} of the height ({row.numbers['height']} m, Transport Canada)",
    }
