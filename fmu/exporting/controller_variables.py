"""The controller as an FMU: its variable table, and where each output stands in the controller's records."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sidestep.controller import ControllerConfig
from sidestep.controller.mpc.status import NAMES as SOLVER_STATUS
from sidestep.controller.records import COMMAND, LAYERS, OBSTACLES, PLAN
from sidestep.fmu.component.records import OBSTACLE, PARAMETER_FIELDS, obstacle_rows
from sidestep.fmu.description.variables import MOTION, Model, Variable, elements
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.ranges import bounded_fields

IDENTIFIER = "steering_controller"

STATE = (*MOTION, ("steer_angle", "rad", "Realised road-wheel angle"))
"""Inputs: VehicleState but its time, in its order."""

LEAST_ROOM = 16
"""Obstacles that there is room for at least."""
_OBSTACLE = {
    "s": ("m", "Arc length along the road of an obstacle's centre"),
    "l": ("m", "Offset from the road's reference of an obstacle's centre, positive to the left"),
    "length": ("m", "Size of an obstacle along its heading"),
    "width": ("m", "Size of an obstacle across its heading"),
    "heading": ("rad", "Direction of an obstacle relative to the road's"),
    "speed": ("m/s", "Speed of an obstacle along the road"),
    "time": ("s", "When an obstacle was at s"),
}

# field of COMMAND: name, unit, description
_COMMAND = {
    "steer_angle": ("steer_angle_command", "rad", "Road-wheel angle to be realised"),
    "acceleration": ("acceleration", "m/s2", "Acceleration wanted now, negative to brake"),
    "target_speed": ("target_speed", "m/s", "Speed to hold, for plants that know nothing else"),
    "status": ("status", "", "0 tracking, 1 degraded, 2 blocked, 3 fault"),
}
_SOLVER_WORDS = (f"{i} {(word or 'not asked').lower().replace('_', ' ')}" for i, word in enumerate(SOLVER_STATUS))
# name, field of PLAN, unit, description
_PLAN = (
    ("solver_status", "solver_status", "", ", ".join(_SOLVER_WORDS)),
    ("iterations", "iterations", "", "Of the QP solver"),
    ("primal_residual", "primal_residual", "", "Of the QP solver"),
    ("dual_residual", "dual_residual", "", "Of the QP solver"),
    ("slack_corridor", "slack_corridor", "m", "How far the prediction leaves the corridor"),
    ("slack_slip", "slack_slip", "rad", "How far the prediction leaves the slip bound"),
    ("path_count", "layers", "", "Elements of the path's arrays that are in use"),
)  # fmt: skip
_PATH = (
    ("path.s", "s", "m", "Stations of the planned path along the road"),
    ("path.l", "l", "m", "Planned lateral offset"),
    ("path.left", "left", "m", "Corridor of the car's centre, left bound"),
    ("path.right", "right", "m", "Corridor of the car's centre, right bound"),
)
# name, column of the predicted states, unit, description
_PREDICTED = (
    ("predicted.l", 0, "m", "Predicted lateral offset"),
    ("predicted.heading", 1, "rad", "Predicted heading relative to the road"),
    ("predicted.sideslip", 2, "rad", "Predicted sideslip angle"),
    ("predicted.yaw_rate", 3, "rad/s", "Predicted yaw rate"),
    ("predicted.steer_angle", 4, "rad", "Predicted road-wheel angle"),
)
_ENGINE = (
    ("clearance", "m", "From the car to the nearest obstacle, 0 on contact, 1000 where there is none"),
    ("sample_time", "s", "Time of the state that this answers"),
)

# field of ControllerConfig: unit, description
_TEXTS: tuple[tuple[str, tuple[str, str]], ...] = (
    ("cruise_speed", ("m/s", "Speed to hold on a free road")),
    ("reference_offset", ("m", "Offset from the reference path that is preferred")),
    ("buffer", ("m", "Clearance to obstacles and road edges")),
    ("least_clearance", ("m", "Clearance that a slow way past what stands close may go down to")),
    ("tightening", ("m", "Clearance asked on top of the buffer half a second ahead and later")),
    ("margin_time", ("s", "Extra distance that the planner keeps per speed")),
    ("safe_distance", ("m", "Distance from which on an obstacle costs")),
    ("weight_reference", ("", "Planner: weight of the offset from the reference")),
    ("weight_continuity", ("", "Planner: weight of lateral speed")),
    ("weight_obstacle", ("", "Planner: weight of closeness to obstacles")),
    ("side_hysteresis", ("", "Planner: cost of changing the passing side")),
    ("max_lateral_speed", ("m/s", "Planner: largest lateral speed")),
    ("max_slope", ("", "Planner: largest slope of the path")),
    ("weight_offset", ("", "MPC: weight of the lateral offset")),
    ("weight_lateral_speed", ("", "MPC: weight of lateral speed")),
    ("weight_acceleration", ("", "MPC: weight of lateral acceleration")),
    ("weight_jerk", ("", "MPC: weight of lateral jerk")),
    ("weight_rate", ("", "MPC: weight of the steering rate")),
    ("corridor_penalty", ("", "MPC: cost of leaving the corridor")),
    ("slip_penalty", ("", "MPC: cost of leaving the slip bound")),
    ("slip_share", ("", "Bound on slip angles as a share of the angle at the peak")),
    ("friction", ("", "Road friction that the controller believes")),
    ("comfort_braking", ("m/s2", "Deceleration used where the distance allows it")),
    ("bend_acceleration", ("m/s2", "Lateral acceleration that sets the speed in bends")),
    ("standstill_gap", ("m", "Distance left to what blocks the road")),
    (
        "input_delay_steps",
        ("", "Periods until a command takes effect, 1 in masters that couple with one step of delay"),
    ),
)
_PERIOD = "Control period: inputs are sampled when it has passed since the last sample"


def controller_model(
    name: str, start: dict[str, float], config: ControllerConfig, obstacles: Sequence[Obstacle],
    times: Sequence[float], revision: str,
) -> Model:  # fmt: skip
    """The variable table of one scenario's controller.

    Args:
        name: Of the scenario.
        start: Start values of the inputs, by name.
        config: Start values of the parameters.
        obstacles: Start values of the obstacles.
        times: Of the prediction's nodes, in [s].
        revision: Of what the binary is compiled from.
    """
    text = f"Obstacle avoidance by corridor planning and model predictive control: {name}"
    room = min(max(LEAST_ROOM, len(obstacles)), OBSTACLES)
    rows = tuple(
        [
            *_inputs(start, obstacles, room), *_outputs(len(times)), *_parameters(config),
            Variable("period", "constant", "s", _PERIOD, config.period),
            *elements("predicted.time", "constant", "s", "Times of the predicted states after the sample", times),
        ]
    )  # fmt: skip
    return Model(
        f"controller-{name}", text, rows, ("controller_fmu.c",), IDENTIFIER, takes_nan=True,
        c_lines=_c_lines(rows, room, len(times), revision),
    )  # fmt: skip


def _inputs(start: dict[str, float], obstacles: Sequence[Obstacle], room: int) -> Iterator[Variable]:
    yield Variable("time", "time", "s", "Simulation time")
    for name, unit, description in STATE:
        yield Variable(name, "input", unit, description, start[name])
    count = float(min(len(obstacles), room))
    yield Variable("obstacle_count", "input", "", "Obstacles that there are: the first of the arrays", count, 0.0, room)
    table = obstacle_rows(obstacles[:room])
    for name in OBSTACLE.names or ():
        given, filling = table[name].tolist(), 1.0 if name in ("length", "width") else 0.0
        unit, description = _OBSTACLE[name]
        yield from elements(f"obstacle.{name}", "input", unit, description, given + [filling] * (room - len(given)))


def _outputs(nodes: int) -> Iterator[Variable]:
    for field in _command_fields():
        name, unit, description = _COMMAND[field]
        yield Variable(name, "sampled", unit, description)
    for name, unit, description in _ENGINE:
        yield Variable(name, "sampled", unit, description)
    for name, _, unit, description in _PLAN:
        yield Variable(name, "sampled", unit, description)
    for name, _, unit, description in _PATH:
        yield from elements(name, "sampled", unit, description, [None] * (LAYERS + 1))
    yield from elements("predicted.s", "sampled", "m", "Predicted stations along the road", [None] * nodes)
    for name, _, unit, description in _PREDICTED:
        yield from elements(name, "sampled", unit, description, [None] * nodes)


def _command_fields() -> list[str]:
    return [name for name in COMMAND.names or () if name != "time"]


def _parameters(config: ControllerConfig) -> Iterator[Variable]:
    limits, texts = {field.name: field.range for field in bounded_fields(ControllerConfig)}, dict(_TEXTS)
    for name in PARAMETER_FIELDS:
        unit, description = texts[name]
        kind = "fixed" if name == "input_delay_steps" else "tunable"
        value, bounds = float(getattr(config, name)), limits[name]
        yield Variable(name, kind, unit, description, value, bounds.low, bounds.high)


def _c_lines(rows: Sequence[Variable], room: int, nodes: int, revision: str) -> str:
    """What controller_fmu.c needs to know of the table and of the records."""
    place = {row.array or row.name: reference for reference, row in reversed(list(enumerate(rows)))}
    sources = [(place[_COMMAND[name][0]], *_source("FROM_COMMAND", COMMAND, name, 1)) for name in _command_fields()]
    sources += [(place[name], *_source("FROM_PLAN", PLAN, field, 1)) for name, field, *_ in _PLAN]
    sources += [(place[name], *_source("FROM_PLAN", PLAN, field, LAYERS + 1)) for name, field, *_ in _PATH]
    sources.append((place["predicted.s"], *_source("FROM_PLAN", PLAN, "states_s", nodes, begin=1)))
    sources += [
        (place[name], *_source("FROM_PLAN", PLAN, "states", nodes, begin=1, column=column))
        for name, column, *_ in _PREDICTED
    ]
    lines = "".join(f"    {{{', '.join(map(str, source))}}}, \\\n" for source in sources)
    return (
        f"enum {{\n    FIRST_SIGNAL = {place[STATE[0][0]]},\n    FIRST_OBSTACLE = {place['obstacle.s']},\n"
        f"    OBSTACLE_ROOM = {room},\n    OBSTACLE_FIELDS = {len(OBSTACLE.names or ())},\n"
        f"    FIRST_PARAMETER = {place[PARAMETER_FIELDS[0]]}\n}};\n"
        f"#define OUTPUT_SOURCES {{ \\\n{lines}}} /* revision {revision} */\n"
    )


def _source(
    record: str, dtype: np.dtype, field: str, count: int, begin: int = 0, column: int = 0
) -> tuple[str, str, int, int, int]:
    """Record, type, offset, number and distance of values in it."""
    fields: Any = dtype.fields
    part, offset = fields[field][:2]
    width = int(np.prod(part.shape[1:])) * part.base.itemsize
    kind = {"f": "NUMBERS", "i": "INTEGERS", "b": "FLAGS"}[part.base.kind]
    return record, kind, offset + begin * width + column * part.base.itemsize, count, width
