"""The one variable table of each native plant FMU; C header and both XML files are made from it.

A variable's value reference is its place in the table, assigned nowhere else. The C core keeps all
values in one flat array in that order, so that a value reference also is an array index.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.speed_control import SPEED_GAIN
from sidestep.plant_models.vehicle import GRAVITY, VehicleParameters

Kind = Literal["time", "input", "state", "hidden state", "derivative", "output", "tunable", "fixed"]

ATTRIBUTES: dict[Kind, tuple[str, str, str | None]] = {
    "time": ("independent", "continuous", None),
    "input": ("input", "continuous", None),
    "state": ("output", "continuous", "calculated"),
    "hidden state": ("local", "continuous", "calculated"),
    "derivative": ("local", "continuous", "calculated"),
    "output": ("output", "continuous", "calculated"),
    "tunable": ("parameter", "tunable", "exact"),
    "fixed": ("parameter", "fixed", "exact"),
}
"""FMI causality, variability and initial of each kind."""


@dataclass(frozen=True)
class Variable:
    """One row of the table; every variable is a double.

    Attributes:
        name: FMI name (structured naming convention).
        kind: Its role, from which causality, variability and initial follow.
        unit: A key of `UNITS`; empty for dimensionless.
        description: One line.
        start: Value before anything is set; None where it is calculated.
        minimum: Smallest value that may be set; None for no bound.
    """

    name: str
    kind: Kind
    unit: str
    description: str
    start: float | None = None
    minimum: float | None = None

    @property
    def constant(self) -> str:
        """Name of the value reference in C."""
        return self.name.upper().replace(".", "_").replace("(", "_").replace(")", "")


@dataclass(frozen=True)
class Model:
    """A native plant: what is common to its FMI 2.0 and FMI 3.0 form.

    Attributes:
        name: As the user calls it.
        description: One line for the XML files.
        variables: The table, in value-reference order; states stand together, and their
            derivatives together in the same order.
    """

    name: str
    description: str
    variables: tuple[Variable, ...]

    @property
    def identifier(self) -> str:
        """FMI model identifier: name of the binary, of the C core and of the documentation page."""
        return self.name.replace("-", "_")

    def of_kind(self, *kinds: Kind) -> list[tuple[int, Variable]]:
        """Value reference and row of every variable of these kinds."""
        return [(reference, row) for reference, row in enumerate(self.variables) if row.kind in kinds]


UNITS: dict[str, dict[str, int]] = {
    "s": {"s": 1},
    "1/s": {"s": -1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "kg": {"kg": 1},
    "kg.m2": {"kg": 1, "m": 2},
    "N": {"kg": 1, "m": 1, "s": -2},
}
"""Exponents of the SI base units."""

# name, unit, description, name of the start parameter
_STATES = (
    ("x", "m", "Position of the reference point in the world", "x_0"),
    ("y", "m", "Position of the reference point in the world, left of x", "y_0"),
    ("yaw", "rad", "Heading, positive to the left, not wrapped", "yaw_0"),
    ("v_x", "m/s", "Forward velocity of the reference point", "v_x_0"),
    ("v_y", "m/s", "Velocity of the reference point to the left", "v_y_0"),
    ("yaw_rate", "rad/s", "Yaw rate, positive to the left", "yaw_rate_0"),
    ("front_slip", "", "Sine of the front tyres' slip angle after relaxation", None),
    ("rear_slip", "", "Sine of the rear tyres' slip angle after relaxation", None),
    ("steer_angle", "rad", "Realised road-wheel angle, as a sensor reports it", "steer_angle_0"),
)

_DERIVATIVE_UNIT = {"": "1/s", "m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2"}

# attribute of VehicleParameters, unit, description, smallest value
_VEHICLE = (
    ("mass", "kg", "Total mass", 1.0),
    ("yaw_inertia", "kg.m2", "Total yaw inertia", 1.0),
    ("l_f", "m", "Centre of gravity to front axle", 0.01),
    ("l_r", "m", "Centre of gravity to rear axle", 0.01),
    ("cg_height", "m", "Height of the centre of gravity", 0.0),
    ("steer_limit", "rad", "Largest road-wheel angle", 0.0),
    ("steer_rate_limit", "rad/s", "Largest road-wheel rate", 0.0),
    ("steer_time_constant", "s", "First-order lag of the steering actuator, 0 for none", 0.0),
    ("max_braking", "m/s2", "Largest deceleration of the speed control", 0.0),
    ("max_acceleration", "m/s2", "Largest acceleration of the speed control", 0.0),
)

# attribute of TyreParameters, unit, description, smallest value; the rest of them concern
# longitudinal slip, which this model does not have
_TYRE = (
    ("nominal_load", "N", "Nominal wheel load F_z0", 1.0),
    ("p_dx1", "", "Peak longitudinal friction at nominal load", 0.0),
    ("p_dx2", "", "Its change with load", None),
    ("p_cy1", "", "Shape factor of the lateral force", 0.01),
    ("p_dy1", "", "Peak lateral friction at nominal load", 0.0),
    ("p_dy2", "", "Its change with load", None),
    ("p_ey1", "", "Curvature factor of the lateral force", None),
    ("p_ky1", "", "Cornering stiffness factor", 0.0),
    ("p_ky2", "", "Load, in units of nominal_load, of the largest cornering stiffness, 0 for none", 0.0),
    ("relaxation_y", "m", "Lateral relaxation length", 0.001),
)

INTERNAL_STEP = 0.004
"""Largest integration step, in [s]: an error of 1e-8 to 1e-6, 1e-5 where a limit begins to act within a step."""


def vehicle_values(vehicle: VehicleParameters) -> dict[str, float]:
    """The car's numbers by the FMU's parameter names, in SI units."""
    values = {name: getattr(vehicle, name) for name, *_ in _VEHICLE}
    return values | {f"tyre.{name}": getattr(vehicle.tyre, name) for name, *_ in _TYRE}


def _single_track() -> Iterator[Variable]:
    yield Variable("time", "time", "s", "Simulation time")
    yield Variable("steer_angle_command", "input", "rad", "Road-wheel angle to be realised", 0.0)
    yield Variable("target_speed", "input", "m/s", "Speed to hold; below zero counts as zero", 15.0)
    for name, unit, description, start in _STATES:
        yield Variable(name, "state" if start else "hidden state", unit, description)
    for name, unit, *_ in _STATES:
        yield Variable(f"der({name})", "derivative", _DERIVATIVE_UNIT[unit], f"Time derivative of {name}")
    yield Variable("lateral_acceleration", "output", "m/s2", "Acceleration of the reference point to the left")
    yield Variable("front_slip_angle", "output", "rad", "Slip angle that makes the front force, relaxation included")
    yield Variable("rear_slip_angle", "output", "rad", "Slip angle that makes the rear force, relaxation included")
    start_values = vehicle_values(VehicleParameters.preset("bmw-320i"))
    for prefix, table in (("", _VEHICLE), ("tyre.", _TYRE)):
        for name, unit, description, minimum in table:
            yield Variable(prefix + name, "tunable", unit, description, start_values[prefix + name], minimum)
    yield Variable("friction", "tunable", "", "Road friction as a factor on the tyres' peak", 1.0, 0.0)
    yield Variable(
        "steer_offset", "tunable", "rad", "Misalignment of the road wheels that the sensor does not see", 0.0
    )
    yield Variable("speed_gain", "tunable", "1/s", "Gain of the speed control", SPEED_GAIN, 0.0)
    yield Variable("internal_step", "fixed", "s", "Largest step of the Runge-Kutta integration", INTERNAL_STEP, 1e-6)
    for name, unit, _, start in _STATES:
        if start:
            yield Variable(start, "fixed", unit, f"Start value of {name}", 15.0 if name == "v_x" else 0.0)


MODELS = {
    model.name: model
    for model in (
        Model(
            "single-track",
            "Nonlinear single-track car: Magic-Formula tyres with relaxation, load transfer, steering actuator",
            tuple(_single_track()),
        ),
    )
}
"""Every native plant by name."""


def find_model(name: str) -> Model:
    """The native plant of this name.

    Raises:
        InputError: There is none.
    """
    if name not in MODELS:
        raise InputError("model", f"unknown native FMU {name!r}", ", ".join(MODELS))
    return MODELS[name]


def c_header(model: Model, token: str) -> str:
    """variables.h: value references, and the rows as initialisers of `Variable` in model.h."""
    references = "".join(f"    {row.constant},\n" for row in model.variables)
    rows = "".join(f"    {_c_row(row)}, \\\n" for row in model.variables)
    states = model.of_kind("state", "hidden state")
    return (
        "/* Generated from the variable table: do not edit. */\n"
        f'#define MODEL_TOKEN "{token}"\n#define GRAVITY {GRAVITY!r}\n'
        f"enum {{\n{references}    N_VARIABLES,\n"
        f"    FIRST_STATE = {states[0][1].constant},\n    N_STATES = {len(states)}\n}};\n"
        f"#define VARIABLE_ROWS {{ \\\n{rows}}}\n"
    )


def _c_row(row: Variable) -> str:
    kind = row.kind.upper().replace(" ", "_")
    minimum = "-HUGE_VAL" if row.minimum is None else repr(row.minimum)
    return f'{{"{row.name}", {kind}_KIND, {row.start or 0.0!r}, {minimum}}}'
