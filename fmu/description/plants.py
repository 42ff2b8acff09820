"""The plants that come as FMUs: their variable tables."""

from collections.abc import Iterator

from sidestep.fmu.description.variables import ACCELERATION_START, MOTION, NO_ACCELERATION, Model, Variable
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.speed_control import SPEED_GAIN
from sidestep.plant_models.vehicle.parameters import AXLES, VehicleParameters
from sidestep.plant_models.vehicle.suspension import SuspensionParameters

# name, unit, description
_ROLL = (
    ("roll", "rad", "Roll angle, positive to the right, as in a turn to the left"),
    ("roll_rate", "rad/s", "Roll rate, positive to the right"),
)
_STEERING = ("steer_angle", "rad", "Realised road-wheel angle, as a sensor at the steering rack reports it")
_WHEELS = ("front left", "front right", "rear left", "rear right")

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

# made of SuspensionParameters by _suspension_values, unit, description, smallest value
_SUSPENSION = (
    ("roll_inertia", "kg.m2", "Roll inertia about the centre of gravity", 1.0),
    ("track_front", "m", "Track width of the front axle", 0.001),
    ("track_rear", "m", "Track width of the rear axle", 0.001),
    ("roll_centre_front", "m", "Height of the roll centre of the front axle", 0.0),
    ("roll_centre_rear", "m", "Height of the roll centre of the rear axle", 0.0),
    ("roll_stiffness_front", "N.m/rad", "Roll stiffness of the front axle, springs and anti-roll bar", 0.0),
    ("roll_stiffness_rear", "N.m/rad", "Roll stiffness of the rear axle, springs and anti-roll bar", 0.0),
    ("roll_damping_front", "N.m.s/rad", "Roll damping of the front axle", 0.0),
    ("roll_damping_rear", "N.m.s/rad", "Roll damping of the rear axle", 0.0),
)

# attribute of TyreParameters, unit, description, smallest value; the rest of them concern
# longitudinal slip, camber and aligning moment, which these models do not have
_TYRE = (
    ("nominal_load", "N", "Nominal wheel load F_z0", 1.0),
    ("p_dx1", "", "Peak longitudinal friction at nominal load", 0.0),
    ("p_dx2", "", "Its change with load", None),
    ("p_cy1", "", "Shape factor of the lateral force", 0.01),
    ("p_dy1", "", "Peak lateral friction at nominal load", 0.0),
    ("p_dy2", "", "Its change with load", None),
    ("p_ey1", "", "Curvature factor of the lateral force", None),
    ("p_ey2", "", "Its change with load", None),
    ("p_ey3", "", "Its difference between left and right slip", None),
    ("p_ky1", "", "Cornering stiffness factor", 0.0),
    ("p_ky2", "", "Load, in units of nominal_load, of the largest cornering stiffness, 0 for none", 0.0),
    ("p_ky4", "", "Shape factor of the cornering stiffness over load", 0.01),
    ("p_hy1", "", "Horizontal shift of the lateral force", None),
    ("p_hy2", "", "Its change with load", None),
    ("p_vy1", "", "Vertical shift of the lateral force, over load", None),
    ("p_vy2", "", "Its change with load", None),
    ("relaxation_y", "m", "Lateral relaxation length", 0.001),
)
_SCALE = (
    ("scale_front", "", "Factor on the cornering stiffness of the front tyres", 0.0),
    ("scale_rear", "", "Factor on the cornering stiffness of the rear tyres", 0.0),
)

INTERNAL_STEP = {"single-track": 0.005, "double-track": 0.005, "linear": 0.002}
"""Largest integration step, in [s]: an error of 1e-8 to 1e-6, 1e-5 where a limit begins to act within a step."""


def vehicle_values(vehicle: VehicleParameters) -> dict[str, float]:
    """The car's numbers by the parameter names of all plants, in SI units."""
    values = {name: getattr(vehicle, name) for name, *_ in (*_VEHICLE, _CG_HEIGHT, *_STIFFNESS)}
    values |= {f"tyre.{name}": getattr(vehicle.tyre, name) for name, *_ in _TYRE}
    values |= {f"tyre.scale_{axle}": vehicle.tyre_scale(axle) for axle in AXLES}
    return values | (_suspension_values(vehicle.suspension) if vehicle.suspension else {})


def model_values(model: Model, vehicle: VehicleParameters, friction: float) -> dict[str, float]:
    """Those of the car's and the road's numbers that are parameters of the model, in SI units.

    Raises:
        InputError: The car lacks suspension data that the model needs.
    """
    known = {row.name for row in model.variables}
    values = vehicle_values(vehicle) | {"friction": friction}
    if "roll_inertia" in known - values.keys():
        raise InputError("vehicle.suspension", f"{vehicle.name} has none; {model.name} needs it", "[suspension]")
    return {name: value for name, value in values.items() if name in known}


def _suspension_values(car: SuspensionParameters) -> dict[str, float]:
    values = {name: getattr(car, name) for name, *_ in _SUSPENSION[:5]}
    for axle in AXLES:
        values[f"roll_stiffness_{axle}"], values[f"roll_damping_{axle}"] = car.roll_of_axle(axle)
    return values


def _slip(places: tuple[str, ...]) -> tuple[tuple[str, str, str], ...]:
    rows = (f"Sine of the slip angle of the {place} tyre after relaxation" for place in places)
    return tuple((_name(place, "slip"), "", row) for place, row in zip(places, rows, strict=True))


def _name(place: str, quantity: str) -> str:
    return f"{place} {quantity}".replace(" ", "_")


def _motion(outputs: tuple[tuple[str, str, str], ...], hidden: tuple[tuple[str, str, str], ...]) -> Iterator[Variable]:
    yield Variable("time", "time", "s", "Simulation time")
    yield Variable("steer_angle_command", "input", "rad", "Road-wheel angle to be realised", 0.0)
    yield Variable("target_speed", "input", "m/s", "Speed to hold; below zero counts as zero", 15.0)
    text = f"Acceleration to be realised, negative to brake; {NO_ACCELERATION:g} and more: none, target_speed is held"
    yield Variable("acceleration", "input", "m/s2", text, ACCELERATION_START)
    states = (*outputs, *hidden, _STEERING)
    for row in states:
        yield Variable(row[0], "hidden state" if row in hidden else "state", *row[1:])
    for name, unit, _ in states:
        yield Variable(f"der({name})", "derivative", _DERIVATIVE_UNIT[unit], f"Time derivative of {name}")
    yield Variable("lateral_acceleration", "output", "m/s2", "Acceleration of the reference point to the left")


def _slip_angles(places: tuple[str, ...]) -> Iterator[Variable]:
    for place in places:
        text = f"Slip angle that makes the force of the {place} tyre, relaxation included"
        yield Variable(_name(place, "slip_angle"), "output", "rad", text)


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
    for name, unit, _ in (*MOTION, _STEERING):
        yield Variable(f"{name}_0", "fixed", unit, f"Start value of {name}", 15.0 if name == "v_x" else 0.0)


def _on_tyres(
    model: str, roll: tuple[tuple[str, str, str], ...], places: tuple[str, ...], *further: Variable
) -> Iterator[Variable]:
    yield from _motion((*MOTION, *roll), _slip(places))
    yield from _slip_angles(places)
    yield from further
    yield from _parameters((*_VEHICLE, _CG_HEIGHT, *(_SUSPENSION if roll else ())))
    yield from _parameters((*_TYRE, *_SCALE), "tyre.")
    yield Variable("friction", "tunable", "", "Road friction as a factor on the tyres' peak", 1.0, 0.0)
    yield from _settings(model)


def _linear() -> Iterator[Variable]:
    yield from _motion(MOTION, ())
    yield from _parameters((*_VEHICLE, *_STIFFNESS))
    yield from _settings("linear")


_LOADS = tuple(Variable(_name(place, "load"), "output", "N", f"Load of the {place} wheel") for place in _WHEELS)
_C_FILES = ("plant.c", "model.h", "car.c", "car.h")
_TYRE_FILES = (*_C_FILES, "tyre.c", "tyre.h")

MODELS = {
    model.name: model
    for model in (
        Model(
            "single-track",
            "Nonlinear single-track car: Magic-Formula tyres with relaxation, load transfer, steering actuator",
            tuple(_on_tyres("single-track", (), AXLES)),
            (*_TYRE_FILES, "single_track.c"),
            "single_track",
        ),
        Model(
            "double-track",
            "Car on four wheels: roll, load transfer, Magic-Formula tyres with relaxation, steering actuator",
            tuple(_on_tyres("double-track", _ROLL, _WHEELS, *_LOADS)),
            (*_TYRE_FILES, "double_track.c"),
            "double_track",
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
