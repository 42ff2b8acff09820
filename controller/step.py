"""One control step: a function of memory, settings, road, obstacles and state.

Nothing here raises, and nothing outside its arguments is read or written. Where the solver is not compiled in, the
step comes in two halves, between which somebody solves the QP that is stacked in the work space.
"""

import math

from sidestep.controller.answer import answer, fall_back, take
from sidestep.controller.decision.decide import decide
from sidestep.controller.mpc.active_set.solver import solve_with_bounds
from sidestep.controller.mpc.condense import condense
from sidestep.controller.mpc.prediction import linearise
from sidestep.controller.mpc.stack import stack_costs, stack_limits
from sidestep.controller.mpc.status import INPUT, UNCONSTRAINED
from sidestep.controller.mpc.unconstrained import solve_freely
from sidestep.controller.perception.locate import locate
from sidestep.controller.records import STATES
from sidestep.controller.validity import slip_limits
from sidestep.plant_models.kernels import Array, Record, Records, kernel

TRUSTED_SLIP = 0.05
"""Excess over the slip bound, in [rad], from which on a prediction is nothing to take tangents at: they would only
lead deeper into it."""
CALMING_TIME = 0.2
"""In which sideslip, yaw rate and steering angle are taken to fall to 1 / e where no plan is trusted, in [s]."""
ANSWERED, SOLVED, BOUNDED = range(3)
"""What the first half leaves: an answer, the optimum, or a QP to be solved."""


FARTHEST, LATEST = 1e8, 1e12
"""Coordinates [m] and times [s] beyond these are no measurement; UTM's end at 1e7 m."""
FASTEST, BACKWARDS = 150.0, -10.0
"""Speeds [m/s] beyond these are none of a car; a car that rolls back at a start is one."""
MOST_TURNS, FASTEST_TURN = 1e6, 20.0
"""Heading [rad], which counts on over turns, and yaw rate [rad/s] likewise."""


@kernel
def usable(m: Record, state: Record) -> bool:
    """Whether a state is newer than the last one and may be a car's; what is no number never is."""
    placed = abs(state.x) < FARTHEST and abs(state.y) < FARTHEST and abs(state.yaw) < MOST_TURNS
    moves = BACKWARDS < state.v_x < FASTEST and abs(state.v_y) < FASTEST and abs(state.yaw_rate) < FASTEST_TURN
    return placed and moves and abs(state.steer_angle) < math.pi and m.heard < state.time < LATEST


@kernel
def look_back(m: Record, w: Record, c: Record, state: Record) -> None:
    """What the last good plan predicted; if there is none to be trusted, a car whose present motion calms down.

    What it turns and slips now would, at the speed of a later node, lie beyond the tyres' peak.
    """
    n = c.grid.nodes
    good = m.plans[max(m.good, 0)]
    trusted = m.good >= 0 and good.slack_slip < TRUSTED_SLIP
    w.age = state.time - good.time if trusted else 0.0
    for k in range(n + 1):
        share = math.exp(-c.grid.times[max(k - 1, 0)] / CALMING_TIME) if k > 0 else 1.0
        for i in range(STATES):
            calming = share if 2 <= i <= 4 else 1.0
            w.before[k, i] = good.states[k, i] if trusted else calming * w.x0[i]
        for i in range(2):
            w.before_roll[k, i] = good.roll[k, i] if trusted else 0.0


@kernel
def prepare(
    memory: Records, settings: Records, table: Array, period: float, boxes: Array, states: Records, work: Records
) -> int:
    """The first half of a step: locate, decide, bound, condense, and solve without bounds.

    Args:
        memory, settings, work: Records of `MEMORY`, `SETTINGS` and `WORK`, shape (1,).
        table, period: Of the ReferencePath.
        boxes: Obstacles, see `decision.decide`.
        states: Record of `STATE`, shape (1,).

    Returns:
        ANSWERED if the state cannot be used, SOLVED if no bound acts, BOUNDED if the QP has to be solved.
    """
    m, c, w, state, road = memory[0], settings[0], work[0], states[0], (table, period)
    if not usable(m, state):
        later = m.command.time + c.period if m.commanded else 0.0
        fall_back(m, c, later, INPUT, False)
        return ANSWERED
    m.heard = state.time
    if math.isnan(m.cruise):
        m.cruise = max(state.v_x, 0.0)
    locate(m, w, c, road, state)
    look_back(m, w, c, state)
    decide(m, w, c, road, boxes, state, m.plans[1 - max(m.good, 0)])
    if c.grid.literal:
        return BOUNDED
    slip_limits(state.v_x, w, c)
    linearise(w, c)
    condense(w, c)
    stack_costs(w, c)
    stack_limits(w, c)
    w.solver_status, w.iterations, w.primal_residual, w.dual_residual = UNCONSTRAINED, 0, 0.0, 0.0
    return SOLVED if solve_freely(w, c) else BOUNDED


@kernel
def finish(memory: Records, settings: Records, states: Records, work: Records, solved: bool) -> None:
    """The second half: predict with the moves found, choose the speed, answer; fall back if they are none."""
    m, c, w, state = memory[0], settings[0], work[0], states[0]
    if not c.grid.literal:
        take(m, w, c, solved)
    answer(m, w, c, state, solved)


@kernel
def begin(
    memory: Records, settings: Records, table: Array, period: float, boxes: Array, states: Records, work: Records
) -> int:
    """A step as far as it goes without a solver; arguments as of `prepare`.

    Returns:
        BOUNDED if the stacked QP has to be solved before `finish` can answer.
    """
    done = prepare(memory, settings, table, period, boxes, states, work)
    if done == SOLVED:
        finish(memory, settings, states, work, True)
    return done


@kernel
def step(
    memory: Records, settings: Records, table: Array, period: float, boxes: Array, states: Records, work: Records
) -> int:
    """A whole step, with the active set as solver; arguments and result as of `begin`."""
    done = prepare(memory, settings, table, period, boxes, states, work)
    if done == BOUNDED and solve_with_bounds(memory[0], work[0], settings[0]):
        done = SOLVED
    if done == SOLVED:
        finish(memory, settings, states, work, True)
    return done
