"""The controller's records: what lasts from step to step, what holds for a drive, and work space.

A step is one compiled function over records of fixed size, so that it can be saved by copying bytes and makes
object code that needs nothing of its host. Arrays have room for the finest grid; counts say what is in use.
"""

import numpy as np
from numba.core import config
from numpy.typing import NDArray

from sidestep.plant_models.tyres.parameters import TYRE

STATES = 6
"""l_s, e_phi, beta, gamma, delta, delta_c: the paper's four, realised and commanded road-wheel angle."""
NODES, MOVES, GROUPS, SLIP_NODES = 48, 24, 48, 16
"""Room for prediction nodes, moves, groups of nodes with one tangent, and nodes with slip limits: control periods of
0.5 ms and more."""
SLACKS = 2
PADDING, WIDTH = 16, 32
"""Vectors of the active set are padded to multiples of this; room for moves and slacks."""
LINES = 2 * NODES + 2 * SLIP_NODES + MOVES
DELAYS = 64
"""Room for commands on their way."""
LAYERS = 60
"""Of the lattice over the road."""
OBSTACLES = 64
"""Most obstacles that count in a step, the nearest first."""
PROFILE = 128
"""Stations of a speed profile."""
SPEEDS = 64
"""Room for the speeds of a validity table."""

F, N, B = np.float64, np.int64, np.bool_

STATE = np.dtype([(name, F) for name in ("time", "x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle")], align=True)
"""As VehicleState."""

COMMAND = np.dtype(
    [("time", F), ("steer_angle", F), ("acceleration", F), ("target_speed", F), ("status", N)], align=True
)
"""As SteeringCommand."""

PLAN = np.dtype(
    [
        ("time", F), ("status", N), ("s", F, (LAYERS + 1,)), ("l", F, (LAYERS + 1,)), ("left", F, (LAYERS + 1,)),
        ("right", F, (LAYERS + 1,)), ("states", F, (NODES + 1, STATES)), ("roll", F, (NODES + 1, 2)),
        ("states_s", F, (NODES + 1,)), ("layers", N), ("solver_status", N), ("iterations", N), ("primal_residual", F),
        ("dual_residual", F), ("slack_corridor", F), ("slack_slip", F), ("feasible", B), ("stop_distance", F),
        ("acceleration", F), ("target_speed", F), ("ids", N, (OBSTACLES,)), ("sides", N, (OBSTACLES,)),
        ("obstacles", N),
    ],
    align=True,
)  # fmt: skip
"""As Plan; `layers` of the path and `obstacles` are in use."""

DISTURBANCE = np.dtype([("actuator", F), ("sensor", F), ("share", F), ("steps", F)], align=True)
"""See `perception.observer`."""

ACTIVE_SET = np.dtype([("active", N, (MOVES + SLACKS,)), ("count", N)], align=True)
"""Bounds that act, in the order in which they came: line i, or lines + i for variable i, at its upper bound; the same
number's complement, ~i, at the lower."""

MEMORY = np.dtype(
    [
        ("command", COMMAND), ("commanded", B),
        ("heard", F),  # time of the last state that could be used; -inf before the first
        ("sent", F, (DELAYS,)), ("on_the_way", N),  # the angle in force, then those on their way
        ("station", F),  # NaN before the first step
        ("cruise", F), ("ids", N, (OBSTACLES,)), ("sides", N, (OBSTACLES,)), ("obstacles", N), ("held_up", B),
        ("narrow", B),  # whether the last step followed a narrow way
        ("before_time", F), ("before", F, (STATES,)),  # time and state of the last step; NaN before it
        ("disturbance", DISTURBANCE), ("roll", F, (2,)),
        ("plans", PLAN, (2,)), ("last", N), ("good", N),  # indices into plans, -1 if there is none
        ("moves", F, (MOVES,)), ("active", ACTIVE_SET),
    ],
    align=True,
)  # fmt: skip
"""All that one step leaves to the next."""

BODY = np.dtype(
    [("height", F), ("gain", F), ("stiffness", F), ("damping", F), ("front", F, (2,)), ("rear", F, (2,))], align=True
)
"""As Body."""

CAR = np.dtype(
    [
        *((name, F) for name in (
            "mass", "yaw_inertia", "l_f", "l_r", "stiffness_f", "stiffness_r", "lag", "load_f", "load_r", "steer_limit",
            "rate_limit",
        )),
        ("affine", B), ("tyre", TYRE, (1,)), ("friction", F), ("body", BODY), ("relaxation", F),
    ],
    align=True,
)  # fmt: skip
"""As Car."""

PLANNER = np.dtype(
    [(name, F) for name in (
        "front", "rear", "reach", "half_width", "buffer", "tightening", "margin_time", "safe_distance", "reference",
        "right_edge", "left_edge", "weight_reference", "weight_continuity", "weight_obstacle", "hysteresis",
        "max_lateral_speed", "max_slope", "acceleration", "braking", "comfort_braking", "least_clearance",
        "most_curvature", "turning",
    )],
    align=True,
)  # fmt: skip
"""As PlannerSettings."""

GRID = np.dtype(
    [
        ("nodes", N), ("moves", N), ("groups", N), ("times", F, (NODES,)), ("steps", F, (NODES,)),
        ("level", N, (NODES,)), ("block", N, (NODES,)), ("group", N, (NODES,)), ("force_times", F, (GROUPS,)),
        ("first", N), ("slip_nodes", N, (SLIP_NODES,)), ("slips", N), ("swerve", N),
        ("clearance", F, (NODES,)), ("levers", F, (2,)), ("literal", B),
    ],
    align=True,
)  # fmt: skip
"""The prediction grid, see `mpc.grid`, and what the corridor asks at its nodes."""

WEIGHTS = np.dtype(
    [(name, F) for name in ("offset", "lateral_speed", "acceleration", "jerk", "rate", "corridor", "slip")], align=True
)

SETTINGS = np.dtype(
    [
        ("car", CAR), ("planner", PLANNER), ("grid", GRID), ("weights", WEIGHTS), ("slip_limits", F, (2,)),
        ("peaks", F, (2,)),
        ("valid", N), ("valid_speeds", F, (SPEEDS,)), ("valid_accelerations", F, (SPEEDS,)),
        ("period", F), ("cruise", F), ("delay", N), ("rolls", B), ("rejects", B), ("buffer", F), ("tightening", F),
        ("comfort_braking", F), ("bend_acceleration", F), ("standstill_gap", F), ("front", F),
    ],
    align=True,
)  # fmt: skip
"""What holds for a drive; `valid` counts the speeds of the validity table, `cruise` is NaN for that of the start."""

ROWS = -(-LINES // PADDING) * PADDING
ACTIVE = np.dtype(
    [
        ("moves", N), ("slacks", N), ("width", N), ("x_lower", F, (MOVES,)), ("x_upper", F, (MOVES,)),
        ("price", F, (SLACKS,)), ("curvature", F, (SLACKS,)),
        ("ends", N, (SLACKS,)), ("factor", F, (MOVES, WIDTH)), ("J", F, (MOVES + SLACKS, WIDTH)),
        ("R", F, (MOVES + SLACKS, WIDTH)), ("columns", F, (MOVES, ROWS)),
        *((name, F, (WIDTH,)) for name in ("x", "step", "normal", "along", "z", "r", "u", "rhs", "multipliers")),
        *((name, F, (ROWS + WIDTH,)) for name in ("low", "high", "weight", "value", "excess")),
        ("line", N, (ROWS + WIDTH,)), ("place", N, (LINES + WIDTH,)), ("edges", N, (SLACKS,)),
        ("active", N, (WIDTH,)), ("held", N, (ROWS + WIDTH,)),
    ],
    align=True,
)  # fmt: skip
"""Work space of the active set: `factor` holds P and -q in elimination; rows of `J` and `R` are the matrices' columns,
`columns` the slopes of the lines that have a bound, one row per move; x, step, normal, along, z, r, u, rhs: variables,
their change, a normal, J'normal, the part of the normal that is new, change of the multipliers, multipliers, a
right-hand side; low to excess of the lines left, padded, then of the variables; `line` is the number of each of these
in `ACTIVE_SET`, `place` where that number is here (-1 if left out); `edges` ends the lines of each slack here."""

WORK = np.dtype(
    [
        ("station", F), ("time", F), ("x0", F, (STATES,)), ("roll", F, (2,)), ("rolled", F, (2,)),
        ("before", F, (NODES + 1, STATES)), ("before_roll", F, (NODES + 1, 2)), ("age", F),
        ("speed", F, (NODES,)), ("turn_rate", F, (NODES,)), ("path", F, (NODES,)), ("heading", F, (NODES,)),
        ("tracking_share", F, (NODES,)), ("stations", F, (NODES,)),
        ("bounds", F, (4, NODES)), ("slowing_bounds", F, (4, NODES)),
        ("profile_speed", F, (PROFILE,)), ("profile_step", F), ("bend_speed", F),
        ("gap", F), ("gap_speed", F), ("blocked", B),
        ("slip_limits", F, (2,)), ("forces", F, (GROUPS, 5)), ("generator", F, (STATES, 10)),
        ("exponential", F, (STATES, 10)), ("products", F, (4, STATES, 10)), ("runge_kutta", F, (6, STATES)),
        ("group_speed", F, (GROUPS,)), ("disturbance", F, (2,)),
        ("free", F, (NODES, STATES)), ("response", F, (NODES, STATES, MOVES)),
        ("residual", F, (3,)), ("gradient", F, (3, MOVES)), ("weight", F, (3,)),
        ("P", F, (MOVES + SLACKS, MOVES + SLACKS)), ("q", F, (MOVES + SLACKS,)),
        ("lines", F, (LINES,)), ("slopes", F, (LINES, MOVES)), ("low", F, (LINES,)), ("high", F, (LINES,)),
        ("slack", N, (LINES,)), ("count", N), ("elimination", F, (MOVES, MOVES + 1)),
        ("z", F, (MOVES + SLACKS,)), ("states", F, (NODES + 1, STATES)),
        ("solver_status", N), ("iterations", N), ("primal_residual", F), ("dual_residual", F),
        ("slack_corridor", F), ("slack_slip", F), ("active", ACTIVE),
    ],
    align=True,
)  # fmt: skip
"""Work space of one step: nothing in it lasts."""


def record(dtype: np.dtype) -> NDArray[np.void]:
    """One record of zeros, shape (1,), whose fields kernels reach by name."""
    made = np.zeros(1, dtype)
    without_compiler = bool(getattr(config, "DISABLE_JIT", False))
    return made.view(np.recarray) if without_compiler else made


def filled(dtype: np.dtype, values: dict) -> NDArray[np.void]:
    """One record with fields set; shorter arrays fill the front of their room."""
    made = record(dtype)
    for name, value in values.items():
        field = made[name]
        if isinstance(value, dict):
            field[:] = filled(dtype[name], value)
        elif np.ndim(value) == 0:
            field[:] = value
        else:
            array = np.asarray(value)
            field[(0, *(slice(length) for length in array.shape))] = array
    return made
