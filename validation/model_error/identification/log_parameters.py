"""What can be identified from a log: names, units, where each begins, and how much is known of it beforehand.

Every parameter has a prior, wide enough that data which tell anything override it: the fit always ends, and what the
data do not tell shows as an uncertainty that is still the prior's.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.model_error.identification.car_kernel import Chassis, Values

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of `Values`.

    Attributes:
        name: In `Values`.
        unit: SI.
        words: What it is.
        positive: Fitted as a logarithm; `spread` and `known` are relative then.
        spread: Standard deviation beforehand.
        known: Largest standard deviation with which it counts as identified.
        least: Standard deviation that stays however long the log is: what fits to cars of known parameters were off by,
            as the model leaves out what such cars have (compliance, spinning wheels, load moved across).
        needs: Signal without which it means nothing, if any.
        linear: Whether the linear model has it.
    """

    name: str
    unit: str
    words: str
    positive: bool
    spread: float
    known: float
    least: float = 0.0
    needs: str = ""
    linear: bool = True


PARAMETERS = (
    Parameter("C_f", "N/rad", "cornering stiffness, front axle", True, 0.7, 0.1, 0.015),
    Parameter("C_r", "N/rad", "cornering stiffness, rear axle", True, 0.7, 0.1, 0.015),
    Parameter("mu_f", "-", "tyre peak, front axle", True, 0.3, 0.1, 0.02, linear=False),
    Parameter("mu_r", "-", "tyre peak, rear axle", True, 0.3, 0.1, 0.02, linear=False),
    Parameter("e_f", "-", "curvature of the force, front axle", False, 0.7, 0.3, linear=False),
    Parameter("e_r", "-", "curvature of the force, rear axle", False, 0.7, 0.3, linear=False),
    Parameter("load_exponent", "-", "growth of stiffness with load", False, 0.4, 0.15, linear=False),
    Parameter("relaxation", "m", "relaxation length", True, 0.7, 0.25, 0.08, linear=False),
    Parameter("I_z", "kg m²", "yaw inertia", True, 0.3, 0.1, 0.02),
    Parameter("cg_height", "m", "height of the centre of gravity", True, 0.3, 0.15, linear=False),
    Parameter("cg_offset", "m", "centre of gravity left of the middle", False, 0.03, 0.012, linear=False),
    Parameter("steer_gain", "-", "road-wheel angle per measured angle", True, 0.1, 0.05),
    Parameter("steer_offset", "rad", "steering offset", False, 0.02, 0.005),
    Parameter("steer_delay", "s", "steering before yaw rate", False, 0.03, 0.01, 0.001),
    Parameter("yaw_rate_offset", "rad/s", "yaw-rate offset", False, 0.02, 0.005),
    Parameter("a_y_offset", "m/s²", "acceleration offset", False, 0.4, 0.15, needs="a_y"),
    Parameter("roll_gain", "rad/(m/s²)", "roll per lateral acceleration", False, 0.006, 0.002, needs="a_y"),
    Parameter("sideslip_offset", "rad", "sideslip offset", False, 0.02, 0.005, needs="v_y"),
    Parameter("a_y_delay", "s", "acceleration after yaw rate", False, 0.05, 0.01, 0.001, needs="a_y"),
    Parameter("v_y_delay", "s", "sideslip after yaw rate", False, 0.05, 0.01, 0.001, needs="v_y"),
    Parameter("roll_frequency", "rad/s", "undamped roll", True, 0.3, 0.15, needs="a_y", linear=False),
    Parameter("roll_damping", "-", "damping ratio of roll", True, 0.5, 0.25, needs="a_y", linear=False),
)
BY_NAME = {p.name: p for p in PARAMETERS}
_PER_LOAD = 16.0
"""Stiffness of an axle over its load to begin with, in [1/rad]: passenger cars have 10 to 25."""


PLAUSIBLE_STIFFNESS, PLAUSIBLE_INERTIA = (4.0, 60.0), (0.5, 2.0)
"""Stiffness of an axle over its load, in [1/rad], and yaw inertia over m l_f l_r, beyond which no car is."""


def implausible(values: Values, chassis: Chassis) -> dict[str, str]:
    """Parameters that no car has, and why, by name."""
    weight, length = chassis.mass * GRAVITY, chassis.l_f + chassis.l_r
    ratios = {
        "C_f": (values.C_f * length / (weight * chassis.l_r), PLAUSIBLE_STIFFNESS, "of its load per rad"),
        "C_r": (values.C_r * length / (weight * chassis.l_f), PLAUSIBLE_STIFFNESS, "of its load per rad"),
        "I_z": (values.I_z / (chassis.mass * chassis.l_f * chassis.l_r), PLAUSIBLE_INERTIA, "of m l_f l_r"),
    }
    return {
        name: f"implausible: {ratio:.2g} times {words}, cars have {low:g} to {high:g}"
        for name, (ratio, (low, high), words) in ratios.items()
        if not low <= ratio <= high
    }


def begin(chassis: Chassis, steer_gain: float, cg_height: float) -> Values:
    """Where a fit begins.

    Args:
        chassis: Mass and geometry.
        steer_gain: Road-wheel angle per measured angle, told or guessed.
        cg_height: In [m].
    """
    weight, length = chassis.mass * GRAVITY, chassis.l_f + chassis.l_r
    return Values(
        C_f=_PER_LOAD * weight * chassis.l_r / length, C_r=_PER_LOAD * weight * chassis.l_f / length,
        mu_f=1.1, mu_r=1.1, e_f=0.0, e_r=0.0, load_exponent=0.7, relaxation=0.35,
        I_z=chassis.mass * chassis.l_f * chassis.l_r, cg_height=cg_height, cg_offset=0.0,
        steer_gain=steer_gain, steer_offset=0.0, steer_delay=0.0, yaw_rate_offset=0.0,
        a_y_offset=0.0, roll_gain=0.005, sideslip_offset=0.0, a_y_delay=0.0, v_y_delay=0.0, roll_frequency=10.0,
        roll_damping=0.35,
    )  # fmt: skip


def free_parameters(signals: Collection[str], linear: bool, told: Collection[str] = ()) -> tuple[Parameter, ...]:
    """Those that a fit moves: with their signal, of the model, and not told."""
    return tuple(
        p for p in PARAMETERS if (not p.needs or p.needs in signals) and (p.linear or not linear) and p.name not in told
    )


def moved(start: Values, free: Sequence[Parameter], steps: Array) -> Values:
    """The values that many prior deviations away from where they began; `steps` of shape (q,)."""
    found = start._asdict()
    for p, step in zip(free, (float(s) for s in steps), strict=True):
        change = step * p.spread
        found[p.name] = found[p.name] * math.exp(change) if p.positive else found[p.name] + change
    return Values(**found)
