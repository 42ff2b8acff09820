"""Prediction model of the MPC: Eq. (5) with affine axle forces and the steering actuator, discretised exactly.

State x = [l_s, e_phi, beta, gamma, delta, delta_c]: the paper's four plus realised and commanded road-wheel
angle. Held inputs w = [u, road turn rate, front force, rear force]: the steering rate u = delta_c' (a ramp
within each step), the heading rate of the road, and the axle forces at zero slip.
"""

import math

from sidestep.controller.mpc.car_model import axle_force, least_slope, slip_angles, tangent
from sidestep.controller.mpc.discretise import WIDTH
from sidestep.controller.mpc.roll import advance_roll, lateral_acceleration, roll_effects
from sidestep.controller.records import STATES
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY

RATE, TURN, FRONT, REAR = 6, 7, 8, 9
"""Columns of the inputs."""
SLOWEST = 1.0
"""Speed below which the model keeps the dynamics of this speed, in [m/s]: Eq. (5) divides by v."""
SIMULATION_STEP = 5e-3
"""Step of the nonlinear forward simulation, in [s]."""
LEAST_RADIUS = 0.2
"""Least distance from the centre of the road's bend, as a share of its radius, that progress is counted with."""
SETTLING_TIME = 0.1
"""How long slip angles may be larger than any steady motion keeps, in [s]."""
MOST_STEPS = 10_000
"""Bound on the steps of one command."""


@kernel
def model_block(speed: float, slope_f: float, slope_r: float, car: Record, a: Array) -> None:
    """Generator of [x; w]: the upper rows of [[A, B], [0, 0]].

    Args:
        speed: v, in [m/s].
        slope_f, slope_r: Slope of the axle forces, in [N/rad].
        car: Car.
        a: Filled, shape (6, 10).
    """
    v = max(speed, SLOWEST)
    m, i_z, l_f, l_r = car.mass, car.yaw_inertia, car.l_f, car.l_r
    moment = l_f * slope_f - l_r * slope_r
    a[:] = 0.0
    a[0, 1] = a[0, 2] = v
    a[1, 3], a[1, TURN] = 1.0, -1.0
    a[2, 2], a[2, 3], a[2, 4] = -(slope_f + slope_r) / (m * v), -moment / (m * v * v) - 1.0, slope_f / (m * v)
    a[2, FRONT] = a[2, REAR] = 1.0 / (m * v)
    a[3, 2], a[3, 3] = -moment / i_z, -(l_f * l_f * slope_f + l_r * l_r * slope_r) / (i_z * v)
    a[3, 4], a[3, FRONT], a[3, REAR] = l_f * slope_f / i_z, l_f / i_z, -l_r / i_z
    if car.lag > 1e-3:
        a[4, 4], a[4, 5] = -1.0 / car.lag, 1.0 / car.lag
    else:
        a[4, RATE] = 1.0
    a[5, RATE] = 1.0
    if car.relaxation > 0.0:
        _relax(a, v, slope_f, slope_r, car)


@kernel
def along_road(speed: float, curvature: float, offset: float, direction: float) -> float:
    """Speed along the reference of a car beside it, Eq. (1) with its denominator: v cos / (1 - kappa l), in [m/s].

    Args:
        speed: v, in [m/s].
        curvature: Of the road there, in [1/m].
        offset: l, in [m].
        direction: Of the car's way against the road, e + beta, in [rad].
    """
    return speed * max(math.cos(direction), 0.0) / max(1.0 - curvature * offset, LEAST_RADIUS)


@kernel
def tyre_lag(v: float, slopes: float, car: Record) -> float:
    """Time until forces follow slip, in [s].

    To first order that holds while it is short beside the car's own time constant, and matters there; below some
    8 m/s, where it is not short, it fades out.

    Args:
        v: Speed, in [m/s].
        slopes: Of both axle forces together, in [N/rad].
        car: Car.
    """
    lag = car.relaxation / v
    return lag / (1.0 + (2.0 * lag * slopes / (car.mass * v)) ** 2)


@kernel
def _relax(a, v, slope_f, slope_r, car):
    """Let axle forces lag behind their slip angles by the time the tyres take to roll their relaxation length.

    To first order, F = C (alpha - lag alpha'), which needs no states of its own: solved for beta' and gamma'.
    """
    m, i_z, l_f, l_r, total = car.mass, car.yaw_inertia, car.l_f, car.l_r, slope_f + slope_r
    lag = tyre_lag(v, total, car)
    moment = l_f * slope_f - l_r * slope_r
    own_b, own_r = 1.0 - lag * total / (m * v), 1.0 - lag * (l_f**2 * slope_f + l_r**2 * slope_r) / (i_z * v)
    cross_b, cross_r = -lag * moment / (m * v * v), -lag * moment / i_z
    determinant = own_b * own_r - cross_b * cross_r
    for j in range(WIDTH):
        late = lag * slope_f * a[4, j]  # what steering on the way is still short of
        b, r = a[2, j] - late / (m * v), a[3, j] - late * l_f / i_z
        a[2, j], a[3, j] = (own_r * b - cross_b * r) / determinant, (own_b * r - cross_r * b) / determinant


@kernel
def linearise(w: Record, c: Record) -> None:
    """Axle forces as lines through the slip angles that an earlier prediction expects.

    Args:
        w: Work space: `before`, `before_roll` and `age` of that prediction, `speed` [m/s] of the nodes and `forces`,
            filled: slope and force at zero slip, front and rear, in [N/rad] and [N], and what roll takes from both
            slip angles, in [rad].
        c: Settings.
    """
    grid, least = c.grid, least_slopes(c.car)
    for g in range(grid.groups):
        i, part = _place(grid, grid.force_times[g] + w.age)
        motion = _between(w.before, i, part, 2), _between(w.before, i, part, 3), _between(w.before, i, part, 4)
        rolled = _between(w.before_roll, i, part, 0), _between(w.before_roll, i, part, 1)
        most = _sustained(w.group_speed[g], grid.force_times[g], c.car)
        touch(motion, rolled, w.group_speed[g], least, c.car, w.forces[g], most)
        w.forces[g, 1] += w.disturbance[0]
        w.forces[g, 3] += w.disturbance[1]


@kernel
def _sustained(speed, time, car):
    """Slip angles that the tightest circle at a speed takes, front and rear, with a factor 2; infinite at first.

    No motion keeps more. Where the car brakes, a prediction made for a higher speed would have the tangents taken
    beyond the tyres' peak, and without their stiffness nothing brings it back.
    """
    if time < SETTLING_TIME:
        return math.inf, math.inf
    share = speed * speed * math.tan(car.steer_limit) / ((car.l_f + car.l_r) * GRAVITY)
    return 2.0 * share * car.load_f / car.stiffness_f, 2.0 * share * car.load_r / car.stiffness_r


@kernel
def least_slopes(car: Record) -> tuple[float, float]:
    """Slopes that tangents of the front and the rear axle have at least, in [N/rad]."""
    return least_slope(car.stiffness_f, car.load_f, car), least_slope(car.stiffness_r, car.load_r, car)


@kernel
def touch(
    motion: tuple[float, ...],
    rolled: tuple[float, float],
    speed: float,
    least: tuple[float, float],
    car: Record,
    line: Array,
    most: tuple[float, float] = (math.inf, math.inf),
) -> None:
    """Axle forces as lines that touch them at a motion of the car.

    Args:
        motion: beta, gamma and delta, in [rad] and [rad/s].
        rolled: Roll angle and rate, in [rad] and [rad/s].
        speed: v, in [m/s].
        least: See `least_slopes`.
        car: Car.
        line: Filled, shape (5,): see `linearise`.
        most: Largest slip angles, front and rear, at which tangents are taken, in [rad].
    """
    roll_slip, moved_f, moved_r = roll_effects(rolled[0], rolled[1], car.body)
    v = max(speed, SLOWEST)
    roll_slip /= v
    front, rear = slip_angles(motion[0] + roll_slip, motion[1], motion[2], v, car)
    front, rear = min(max(front, -most[0]), most[0]), min(max(rear, -most[1]), most[1])
    slope_f, force_f = tangent(front, least[0], car.stiffness_f, car.load_f, car, moved_f)
    slope_r, force_r = tangent(rear, least[1], car.stiffness_r, car.load_r, car, moved_r)
    line[0], line[1] = slope_f, force_f - slope_f * roll_slip
    line[2], line[3], line[4] = slope_r, force_r - slope_r * roll_slip, roll_slip


@kernel
def _place(grid, time):
    """Node after a time, 0 for now, and how far between the node before and that one the time is."""
    n = grid.nodes
    for i in range(n):
        if grid.times[i] >= time:
            before = grid.times[i - 1] if i > 0 else 0.0
            return i + 1, (time - before) / (grid.times[i] - before)
    return n, 1.0


@kernel
def _between(rows, i, part, column):
    return rows[i - 1, column] + part * (rows[i, column] - rows[i - 1, column])


@kernel
def sampled(rows: Array, column: int, time: float, grid: Record) -> float:
    """A column of a prediction at a time from its start [s], held beyond its end; rows of shape (N + 1, ...)."""
    i, part = _place(grid, time)
    return _between(rows, i, part, column)


@kernel
def _rates(x, effects, v, turn_rate, disturbance, command, car, rates):
    front, rear = slip_angles(x[2] + effects[0] / v, x[3], x[4], v, car)
    force_f = axle_force(front, car.stiffness_f, car.load_f, car, effects[1]) + disturbance[0]
    force_r = axle_force(rear, car.stiffness_r, car.load_r, car, effects[2]) + disturbance[1]
    rates[0] = v * (x[1] + x[2])
    rates[1] = x[3] - turn_rate
    rates[2] = (force_f + force_r) / (car.mass * v) - x[3]
    rates[3] = (car.l_f * force_f - car.l_r * force_r) / car.yaw_inertia
    if car.lag > 1e-3:
        rates[4] = min(max((command - x[4]) / car.lag, -car.rate_limit), car.rate_limit)
    else:
        rates[4] = 0.0
    rates[5] = 0.0


@kernel
def advance(
    x: Array,
    roll: Array,
    motion: tuple[float, ...],
    disturbance: Array | tuple[float, float],
    command: float,
    period: float,
    car: Record,
    work: Array,
) -> None:
    """Simulate the nonlinear model through a command that is already on its way (RK4).

    Args:
        x: State, shape (6,); overwritten.
        roll: Roll angle and rate, shape (2,), in [rad] and [rad/s]; overwritten.
        motion: Speed of the car, in [m/s], and turn rate of the road, in [rad/s]; held.
        disturbance: Forces to add at front and rear axle, in [N].
        command: Angle that takes effect, in [rad].
        period: How long it is held, in [s].
        car: Car.
        work: Shape (6, 6).
    """
    v, turn_rate = max(motion[0], SLOWEST), motion[1]
    fastest = (car.stiffness_f + car.stiffness_r) / (car.mass * v)  # of the poles at zero slip, nearly
    steps = int(min(math.ceil(period * max(1.0 / SIMULATION_STEP, fastest)), MOST_STEPS))
    h, middle, before = period / steps, work[4], work[5]
    x[5] = command
    if car.lag <= 1e-3:
        x[4] = command
    for _ in range(steps):
        effects = roll_effects(roll[0], roll[1], car.body)
        for i in range(STATES):
            before[i] = middle[i] = x[i]
        for stage in range(4):
            _rates(middle, effects, v, turn_rate, disturbance, command, car, work[stage])
            share = 1.0 if stage == 2 else 0.5
            for i in range(STATES):
                middle[i] = x[i] + share * h * work[stage, i]
        for i in range(STATES):
            x[i] += h / 6.0 * (work[0, i] + 2.0 * work[1, i] + 2.0 * work[2, i] + work[3, i])
        roll[0], roll[1] = advance_roll(roll[0], roll[1], lateral_acceleration(before, x, v, h), h, car.body)


@kernel
def steady_gain(speed: float, car: Record) -> float:
    """Steady lateral acceleration per road-wheel angle, v^2 / (L + K v^2), in [m/s^2/rad], of the linear car."""
    wheelbase = car.l_f + car.l_r
    understeer = car.mass / wheelbase * (car.l_r / car.stiffness_f - car.l_f / car.stiffness_r)
    return speed * speed / max(wheelbase + understeer * speed * speed, 0.2 * wheelbase)
