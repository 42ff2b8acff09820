"""The controller as an FMU: its variable table."""

from collections.abc import Iterator

from sidestep.controller import ControllerConfig
from sidestep.fmu.description.variables import MOTION, Model, Variable

IDENTIFIER = "steering_controller"

STATE = (*MOTION, ("steer_angle", "rad", "Realised road-wheel angle"))
"""Inputs: VehicleState but its time, in its order."""

OUTPUTS = (
    ("steer_angle_command", "rad", "Road-wheel angle to be realised"),
    ("target_speed", "m/s", "Speed to hold, for plants that know nothing else"),
    ("acceleration", "m/s2", "Acceleration wanted now, negative to brake"),
    ("status", "", "0 tracking, 1 degraded, 2 blocked, 3 fault"),
    ("clearance", "m", "From the car to the nearest obstacle, 0 on contact, 1000 where there is none"),
    ("qp_status", "", "0 solved, 1 not solved, 2 not asked because the input could not be used"),
    ("iterations", "", "Of the QP solver"),
    ("slack_corridor", "m", "How far the prediction leaves the corridor"),
    ("slack_slip", "rad", "How far the prediction leaves the slip bound"),
    ("solve_time", "s", "Time that the QP solver took"),
    ("step_time", "s", "Time that the whole controller step took"),
    ("sample_time", "s", "Time of the state that this answers"),
)

# field of ControllerConfig, unit, description
TUNABLE = (
    ("cruise_speed", "m/s", "Speed to hold on a free road"),
    ("reference_offset", "m", "Offset from the reference path that is preferred"),
    ("buffer", "m", "Clearance to obstacles and road edges"),
    ("tightening", "m", "Clearance asked on top of the buffer half a second ahead and later"),
    ("margin_time", "s", "Extra distance that the planner keeps per speed"),
    ("safe_distance", "m", "Distance from which on an obstacle costs"),
    ("weight_reference", "", "Planner: weight of the offset from the reference"),
    ("weight_continuity", "", "Planner: weight of lateral speed"),
    ("weight_obstacle", "", "Planner: weight of closeness to obstacles"),
    ("side_hysteresis", "", "Planner: cost of changing the passing side"),
    ("max_lateral_speed", "m/s", "Planner: largest lateral speed"),
    ("max_slope", "", "Planner: largest slope of the path"),
    ("weight_offset", "", "MPC: weight of the lateral offset"),
    ("weight_lateral_speed", "", "MPC: weight of lateral speed"),
    ("weight_acceleration", "", "MPC: weight of lateral acceleration"),
    ("weight_jerk", "", "MPC: weight of lateral jerk"),
    ("weight_rate", "", "MPC: weight of the steering rate"),
    ("corridor_penalty", "", "MPC: cost of leaving the corridor"),
    ("slip_penalty", "", "MPC: cost of leaving the slip bound"),
    ("slip_share", "", "Bound on slip angles as a share of the angle at the peak"),
    ("friction", "", "Road friction that the controller believes"),
    ("comfort_braking", "m/s2", "Deceleration used where the distance allows it"),
    ("standstill_gap", "m", "Distance left to what blocks the road"),
    ("max_lateral_acceleration", "m/s2", "Preset paper only: largest lateral acceleration"),
    ("weight_steer", "", "Preset paper only: weight of the steering angle"),
)
FIXED = (
    ("period", "s", "Control period: inputs are sampled when it has passed since the last sample"),
    ("input_delay_steps", "", "Periods until a command takes effect, 1 in masters that couple with one step of delay"),
)

NAMES = ("time", *(name for name, *_ in (*STATE, *OUTPUTS, *TUNABLE, *FIXED)))
"""All variables, in the order of their values."""


def controller_model(name: str, start: dict[str, float], config: ControllerConfig) -> Model:
    """The variable table of one scenario's controller.

    Args:
        name: Of the scenario.
        start: Start values of the inputs, by name.
        config: Start values of the parameters.
    """
    text = f"Obstacle avoidance by corridor planning and model predictive control: {name}"
    return Model(f"controller-{name}", text, tuple(_variables(start, config)), ("process.c",), IDENTIFIER)


def _variables(start: dict[str, float], config: ControllerConfig) -> Iterator[Variable]:
    yield Variable("time", "time", "s", "Simulation time")
    for name, unit, description in STATE:
        yield Variable(name, "input", unit, description, start[name])
    for name, unit, description in OUTPUTS:
        yield Variable(name, "sampled", unit, description)
    for name, unit, description in TUNABLE:
        low = None if name == "reference_offset" else 0.0
        yield Variable(name, "tunable", unit, description, float(getattr(config, name)), low)
    for name, unit, description in FIXED:
        yield Variable(name, "fixed", unit, description, float(getattr(config, name)), 0.0)
