"""The tyres of the MuJoCo car, as kernels: what each contact patch is asked and what it answers.

Every tyre reads its `contact` sensor after `mj_step1`. By mode it answers with the Magic Formula's shear, or
tunes MuJoCo's own friction to be that shear at the present speed, or leaves that friction as it comes.
"""

import math
from typing import Any

import numpy as np

from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.tyres.formula import tyre_forces
from sidestep.plant_models.tyres.parameters import TYRE

Vector = tuple[float, float, float]

TYRE_MODES = ("magic-formula", "contact", "stock-contact")
"""Who supplies the shear: the law with relaxation, MuJoCo's contact tuned to the law, MuJoCo's contact."""

_CONTACT, _STOCK = 1, 2  # places in TYRE_MODES
_LOW_SPEED = 3.0  # below it, the deflection is bounded and damped, [m/s]
_SLIP_AT_REST = 0.1  # deflection over relaxation length where every tyre has reached its peak
_DAMPING_SPEED = 15.0  # sliding speed that damps as much as unit slip holds, [m/s]
_SLOWEST_SLIDE = 1e-3  # below it, the contact's friction keeps its damping, [m/s]

CAR = np.dtype(
    [
        ("tyre", TYRE, (1,)),  # TyreParameters.as_array()
        ("tyre_scale", np.float64, 4),  # VehicleParameters.tyre_scale of each wheel's axle
        ("mode", np.int64),  # place in TYRE_MODES
        ("bears_load", np.int64),  # whether the tyre carries the car, not MuJoCo's solver
        ("damping_scale", np.float64, 4),  # friction reference per damping of a tyre pair, [m/N]
        ("gravity", np.float64, 3),
        ("belt", np.float64, 2),  # velocity of the road: MuJoCo's sensor does not know that it moves
        ("friction", np.float64),
        ("mass", np.float64),
        ("unsprung", np.float64, 4),  # masses, [kg]
        ("tyre_stiffness", np.float64),
        ("tyre_damping", np.float64),
        ("wheel_radius", np.float64),
        ("spin_inertia", np.float64),
        ("steer_offset", np.float64),  # of the kingpins from the middle, in wheelbases
        ("steer_rate_limit", np.float64),
        ("steer_time_constant", np.float64),
        ("steer_lead", np.float64),  # damping over stiffness of the steering servos, [s]
        ("max_braking", np.float64),
        ("max_acceleration", np.float64),
        ("chassis", np.int64),  # body
        ("wheel", np.int64, 4),  # bodies
        ("spin", np.int64, 4),  # joint velocities
        ("slide", np.int64, (4, 2)),  # joint positions and velocities
        ("slide_axis", np.float64, (4, 2)),  # y and z in the chassis
        ("steer", np.int64, (2, 2)),  # joint positions and velocities
    ]
)
"""What the kernels know of the car; a record, because it crosses into compiled code as one argument."""

STATE = np.dtype(
    [
        ("deflection", np.float64, (4, 2)),  # of the carcass, longitudinal and lateral, [m]
        ("steer_command", np.float64),
        ("target_speed", np.float64),
        ("acceleration", np.float64),  # NaN for none
        ("steer_angle", np.float64),  # of the steering actuator
        ("collided", np.float64),
        ("planar", np.float64, 7),  # x, y, yaw, v_x, v_y, yaw_rate, steer_angle of VehicleState
        ("friction", np.float64, 4),  # of the road under each wheel
        ("load", np.float64, 4),  # of the last step, as are the next two
        ("slip", np.float64, (4, 2)),  # kappa, alpha
        ("shear", np.float64, (4, 2)),  # in the wheel's axes
        ("arm", np.float64, 4),  # rolling radius: wheel centre to patch
    ]
)
"""The plant's own state, laid over `MjData.userdata`: a snapshot of the integration state holds it."""

PATCH = 14  # found, dist, pos (3), normal (3), tangent (3), linvel (3) in the contact frame
_FORCE = 4 * PATCH + 1  # behind the hull's: contact force of the last step (3) per tyre, in the contact modes


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product of two vectors of three."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product, as a tuple."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def vector(values: Array, start: int) -> Vector:
    """Three numbers of an array as a tuple; a slice would count references, which costs more than the numbers."""
    return values[start], values[start + 1], values[start + 2]


@kernel
def relaxed_slip(
    deflection_x: Any, deflection_y: Any, slide_x: Any, slide_y: Any, rolling: Any, dt: float, tyre: Any
) -> Any:
    """Advance the carcass deflection by one implicit step of u' = -v_s - |v_x| u / sigma.

    At rest u' = -v_s is a spring without a damper and without an end, so that at low speed the deflection
    is bounded where the force saturates, and the sliding speed damps (Pacejka, section 8.6).

    Args:
        deflection_x, deflection_y: u, in [m].
        slide_x, slide_y: Sliding velocity of the patch, in [m/s].
        rolling: Speed of the wheel centre along the wheel, in [m/s].
        dt: Step, in [s].
        tyre: `TyreParameters.as_array()`.

    Returns:
        The deflection after the step (2), slip ratio kappa, in [-], and slip angle alpha, in [rad].
    """
    length_x, length_y, rolling = tyre[0]["relaxation_x"], tyre[0]["relaxation_y"], abs(rolling)
    x = (deflection_x - dt * slide_x) / (length_x + dt * rolling)
    y = (deflection_y - dt * slide_y) / (length_y + dt * rolling)
    shrink = min(1.0, (_SLIP_AT_REST + rolling / _LOW_SPEED) / max(math.hypot(x, y), 1e-9))
    x, y, damping = shrink * x, shrink * y, 0.0
    if rolling < _LOW_SPEED:
        damping = 0.5 * (1.0 + math.cos(math.pi * rolling / _LOW_SPEED)) / _DAMPING_SPEED
    return x * length_x, y * length_y, x - damping * slide_x, math.atan(y - damping * slide_y)


@kernel
def friction_at(x: Array, y: Any, friction: float, patches: Any) -> Any:
    """Road friction at a point, in [-].

    Args:
        x, y: The point, in [m].
        friction: Outside all patches.
        patches: Rows of centre x, y, cosine and sine of the heading, half length, half width, friction;
            shape (n, 7). Where they overlap, the last one counts.
    """
    for k in range(patches.shape[0] - 1, -1, -1):
        row = patches[k]
        dx, dy = x - row[0], y - row[1]
        if abs(dx * row[2] + dy * row[3]) <= row[4] and abs(dy * row[2] - dx * row[3]) <= row[5]:
            return row[6]
    return friction


@kernel
def _axes(axle, normal):
    """Directions ahead and left of a wheel in the road's plane, and the sine of its camber."""
    ahead = cross(axle, normal)
    length = math.sqrt(dot(ahead, ahead))
    ahead = (ahead[0] / length, ahead[1] / length, ahead[2] / length)
    return ahead, cross(normal, ahead), dot(axle, normal)


@kernel
def _lift(i, state):
    state["load"][i] = 0.0
    state["deflection"][i, :] = 0.0
    state["slip"][i, :] = 0.0
    state["shear"][i, :] = 0.0


@kernel
def _law(i, kappa, alpha, camber, load, friction, car):
    """The law on wheel `i`; those on the right are mirror images."""
    side = 1.0 if i % 2 == 0 else -1.0
    p, scale = car["tyre"], car["tyre_scale"][i]
    fx, fy, moment = tyre_forces(kappa, side * alpha, side * camber, load, friction, p, scale)
    return fx, side * fy, side * moment


@kernel
def _contact_damping(i, slide_x, slide_y, rolling, camber, load, friction, car):
    """Damping of the contact's friction that gives the law's force at this speed and slip, in [N s/m]."""
    slide, speed = math.hypot(slide_x, slide_y), max(abs(rolling), _LOW_SPEED)
    if slide < _SLOWEST_SLIDE:
        slide_x, slide_y, slide = 0.0, _SLOWEST_SLIDE, _SLOWEST_SLIDE
    fx, fy, _ = _law(i, -slide_x / speed, math.atan(-slide_y / speed), camber, load, friction, car)
    return math.hypot(fx, fy) / slide


@kernel
def tyres(
    dt: float, car: Record, state: Record, sensors: Array, xipos: Array, xmat: Array, qpos: Array, qvel: Array,
    qfrc: Array, pairs: Array, damping: Array, patches: Array,
) -> None:  # fmt: skip
    """Shear of the wheels from their contact patches: a wrench on the joints, or tuned contacts.

    All four in one call, because every call counts references to its arrays.

    Args:
        dt: Step, in [s].
        car, state: Records of `CAR` and `STATE`.
        sensors, xipos, xmat, qpos, qvel, qfrc: Views of MjData's arrays; `qfrc` is written.
        pairs, damping: Friction and friction reference of the tyre pairs in mjModel; written in `contact` mode.
        patches: See `friction_at`.
    """
    for k in range(len(qfrc)):
        qfrc[k] = 0.0
    for i in range(4):
        at, wheel = PATCH * i, car["wheel"][i]
        depth, velocity = sensors[at + 1], vector(sensors, at + 11)
        load = -car["tyre_stiffness"] * depth - car["tyre_damping"] * velocity[0]
        if car["mode"] == _STOCK:
            load = sensors[_FORCE + 3 * i]
        if sensors[at] == 0.0 or load <= 0.0:
            _lift(i, state)
            continue
        point, normal, tangent = vector(sensors, at + 2), vector(sensors, at + 5), vector(sensors, at + 8)
        ahead, left, lean = _axes((xmat[wheel, 1], xmat[wheel, 4], xmat[wheel, 7]), normal)
        second = cross(normal, tangent)
        along, across = (dot(tangent, ahead), dot(second, ahead)), (dot(tangent, left), dot(second, left))
        slide_x = velocity[1] * along[0] + velocity[2] * along[1]
        slide_y = velocity[1] * across[0] + velocity[2] * across[1]
        slide_x -= car["belt"][0] * ahead[0] + car["belt"][1] * ahead[1]
        slide_y -= car["belt"][0] * left[0] + car["belt"][1] * left[1]
        arm = (point[0] - xipos[wheel, 0], point[1] - xipos[wheel, 1], point[2] - xipos[wheel, 2])
        radius = math.sqrt(dot(arm, arm))
        rolling, camber = slide_x + qvel[car["spin"][i]] * radius, math.asin(lean)
        friction = friction_at(point[0], point[1], car["friction"], patches)
        state["friction"][i], state["load"][i], state["arm"][i] = friction, load, radius
        u = state["deflection"]
        u[i, 0], u[i, 1], kappa, alpha = relaxed_slip(u[i, 0], u[i, 1], slide_x, slide_y, rolling, dt, car["tyre"])
        state["slip"][i, 0], state["slip"][i, 1] = kappa, alpha
        if car["mode"] == 0:
            fx, fy, moment = _law(i, kappa, alpha, camber, load, friction, car)
            state["shear"][i, 0], state["shear"][i, 1] = fx, fy
            borne = load if car["bears_load"] != 0 else 0.0
            force, torque = _wrench(arm, ahead, left, normal, depth, fx, fy, moment, borne)
            push(i, car, xipos, xmat, qpos, qfrc, force, torque)
            continue
        _, solved_x, solved_y = vector(sensors, _FORCE + 3 * i)
        state["shear"][i, 0] = solved_x * along[0] + solved_y * along[1]
        state["shear"][i, 1] = solved_x * across[0] + solved_y * across[1]
        if car["mode"] == _CONTACT:
            c = _contact_damping(i, slide_x, slide_y, rolling, camber, load, friction, car)
            damping[i, 1] = -c * car["damping_scale"][i]
            pairs[i, 0] = pairs[i, 1] = friction * max(car["tyre"][0]["p_dx1"], car["tyre"][0]["p_dy1"])


@kernel
def _wrench(arm, ahead, left, normal, depth, fx, fy, moment, borne):
    """Force and moment on the wheel's body, about its centre."""
    # The patch lies half the penetration below the road, where the wheel rolls; the car leans on the road.
    rise = -0.5 * depth
    road = (arm[0] + rise * normal[0], arm[1] + rise * normal[1], arm[2] + rise * normal[2])
    drive, lean, carry = cross(arm, ahead), cross(road, left), cross(arm, normal)
    force = (
        fx * ahead[0] + fy * left[0] + borne * normal[0],
        fx * ahead[1] + fy * left[1] + borne * normal[1],
        fx * ahead[2] + fy * left[2] + borne * normal[2],
    )
    torque = (
        fx * drive[0] + fy * lean[0] + borne * carry[0] + moment * normal[0],
        fx * drive[1] + fy * lean[1] + borne * carry[1] + moment * normal[1],
        fx * drive[2] + fy * lean[2] + borne * carry[2] + moment * normal[2],
    )
    return force, torque


@kernel
def push(i: int, car: Record, xipos: Any, xmat: Any, qpos: Any, qfrc: Any, force: Any, torque: Any) -> None:
    """Add a wrench on wheel `i` to the joints that carry it.

    `xfrc_applied` would do the same by way of Jacobians of all joints, at a twentieth of the whole step.

    Args:
        i: Place in the wheels.
        car: Record of `CAR`.
        xipos, xmat, qpos, qfrc: Views of MjData's arrays; `qfrc` is written.
        force, torque: About the wheel's centre, in the world's axes, in [N] and [N m].
    """
    wheel, chassis = car["wheel"][i], car["chassis"]
    offset = (xipos[wheel, 0] - qpos[0], xipos[wheel, 1] - qpos[1], xipos[wheel, 2] - qpos[2])
    lever = cross(offset, force)
    for k in range(3):
        qfrc[k] += force[k]
        for j in range(3):  # the free joint turns about the chassis' own axes
            qfrc[3 + k] += xmat[chassis, 3 * j + k] * (torque[j] + lever[j])
    up = (xmat[chassis, 2], xmat[chassis, 5], xmat[chassis, 8])
    left = (xmat[chassis, 1], xmat[chassis, 4], xmat[chassis, 7])
    qfrc[car["slide"][i, 1]] += car["slide_axis"][i, 0] * dot(left, force) + car["slide_axis"][i, 1] * dot(up, force)
    if i < 2:
        qfrc[car["steer"][i, 1]] += dot(up, torque)
    qfrc[car["spin"][i]] += dot((xmat[wheel, 1], xmat[wheel, 4], xmat[wheel, 7]), torque)
