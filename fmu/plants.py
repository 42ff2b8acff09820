"""The plants that come as FMUs: their variable tables."""

from collections.abc import Iterator

from sidestep.fmu.variables import Model, Variable
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.speed_control import SPEED_GAIN
from sidestep.plant_models.vehicle import VehicleParameters

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
    ("steer_angle", "rad", "Realised road-wheel angle, as a sensor at the steering rack reports it", "steer_angle_0"),
)
_HIDDEN = ("front_slip", "rear_slip")

_DERIVATIVE_UNIT = {"": "1/s", "m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2"}

# attribute of VehicleParameters, unit, description, smallest value
_VEHICLE = (
    ("mass", "kg", "Total mass", 1.0),
    ("yaw_inertia", "kg.m2", "Total yaw inertia", 1.0),
    ("l_f", "m", "Centre of gravity to front axle", 0.01),
    ("l_r", "m", "Centre of gravity to rear axle", 0.01),
    ("steer_limit", "rad", "Largest road-wheel angle", 0.0),
    ("steer_rate_limit", "rad/s", "Largest road-wheel rate", 0.0),
    ("steer_time_constant", "s", "First-order lag of the steering actuator, 0 for none", 0.0),
    ("max_braking", "m/s2", "Largest deceleration of the speed control", 0.0),
    ("max_acceleration", "m/s2", "Largest acceleration of the speed control", 0.0),
)
_CG_HEIGHT = ("cg_height", "m", "Height of the centre of gravity", 0.0)
_STIFFNESS = (
    ("cornering_stiffness_front", "N/rad", "Cornering stiffness of the front axle, both tyres", 0.0),
    ("cornering_stiffness_rear", "N/rad", "Cornering stiffness of the rear axle, both tyres", 0.0),
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

INTERNAL_STEP = {"single-track": 0.004, "linear": 0.002}
"""Largest integration step, in [s]: an error of 1e-8 to 1e-6, 1e-5 where a limit begins to act within a step."""


def vehicle_values(vehicle: VehicleParameters) -> dict[str, float]:
    """The car's numbers by the parameter names of all plants, in SI units."""
    values = {name: getattr(vehicle, name) for name, *_ in (*_VEHICLE, _CG_HEIGHT, *_STIFFNESS)}
    return values | {f"tyre.{name}": getattr(vehicle.tyre, name) for name, *_ in _TYRE}


def _motion(states: tuple[tuple[str, str, str, str | None], ...]) -> Iterator[Variable]:
    yield Variable("time", "time", "s", "Simulation time")
    yield Variable("steer_angle_command", "input", "rad", "Road-wheel angle to be realised", 0.0)
    yield Variable("target_speed", "input", "m/s", "Speed to hold; below zero counts as zero", 15.0)
    for name, unit, description, start in states:
        yield Variable(name, "state" if start else "hidden state", unit, description)
    for name, unit, *_ in states:
        yield Variable(f"der({name})", "derivative", _DERIVATIVE_UNIT[unit], f"Time derivative of {name}")
    yield Variable("lateral_acceleration", "output", "m/s2", "Acceleration of the reference point to the left")


def _parameters(table: tuple[tuple[str, str, str, float | None], ...], prefix: str = "") -> Iterator[Variable]:
    values = vehicle_values(VehicleParameters.preset("bmw-320i"))
    for name, unit, description, minimum in table:
        yield Variable(prefix + name, "tunable", unit, description, values[prefix + name], minimum)


def _settings(model: str) -> Iterator[Variable]:
    yield Variable(
        "steer_offset", "tunable", "rad", "Misalignment of the road wheels that the sensor does not see", 0.0
    )
    yield Variable("speed_gain", "tunable", "1/s", "Gain of the speed control", SPEED_GAIN, 0.0)
    step = INTERNAL_STEP[model]
    yield Variable("internal_step", "fixed", "s", "Largest step of the Runge-Kutta integration", step, 1e-6)
    for name, unit, _, start in _STATES:
        if start:
            yield Variable(start, "fixed", unit, f"Start value of {name}", 15.0 if name == "v_x" else 0.0)


def _single_track() -> Iterator[Variable]:
    yield from _motion(_STATES)
    yield Variable("front_slip_angle", "output", "rad", "Slip angle that makes the front force, relaxation included")
    yield Variable("rear_slip_angle", "output", "rad", "Slip angle that makes the rear force, relaxation included")
    yield from _parameters((*_VEHICLE, _CG_HEIGHT))
    yield from _parameters(_TYRE, "tyre.")
    yield Variable("friction", "tunable", "", "Road friction as a factor on the tyres' peak", 1.0, 0.0)
    yield from _settings("single-track")


def _linear() -> Iterator[Variable]:
    yield from _motion(tuple(row for row in _STATES if row[0] not in _HIDDEN))
    yield from _parameters((*_VEHICLE, *_STIFFNESS))
    yield from _settings("linear")


_C_FILES = ("plant.c", "model.h", "car.c", "car.h")

MODELS = {
    model.name: model
    for model in (
        Model(
            "single-track",
            "Nonlinear single-track car: Magic-Formula tyres with relaxation, load transfer, steering actuator",
            tuple(_single_track()),
            (*_C_FILES, "single_track.c"),
            "single_track",
        ),
        Model(
            "linear",
            "Single-track car with linear tyres: the model of the controller, with steering actuator and speed control",
            tuple(_linear()),
            (*_C_FILES, "linear.c"),
            "linear",
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
