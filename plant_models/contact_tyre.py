"""The tyres, the actuators and the time loop of the MuJoCo car, as kernels.

Between `mj_step1` (positions, velocities, contacts) and `mj_step2` (forces, motion) every tyre reads its
`contact` sensor and answers with the Magic Formula's shear. MuJoCo's own two C functions are linked by
name, so that a whole control period is one compiled call that holds no lock and can be cached.
"""

import ctypes
import math
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import config, njit, types

from sidestep.plant_models.linear_plant import steered
from sidestep.plant_models.speed_control import limited_acceleration
from sidestep.plant_models.tyre import TYRE, tyre_forces

_LOW_SPEED = 3.0  # below it, the deflection is bounded and damped, [m/s]
_SLIP_AT_REST = 0.1  # deflection over relaxation length where every tyre has reached its peak
_DAMPING_SPEED = 15.0  # sliding speed that damps as much as unit slip holds, [m/s]
_GRIP_USED = 0.9  # share of the peak that drive and brakes ask for
_SLIP_RELEASE = 0.2  # slip at which drive and brakes let go (anti-lock)
_HOLD_SPEED, _HOLD_TARGET = 0.1, 0.05  # brakes hold the car below the one when the other is asked, [m/s]
_ABSURD = 1e5  # no joint moves that fast, [m/s] or [rad/s]

CAR = np.dtype(
    [
        ("tyre", TYRE, (1,)),  # TyreParameters.as_array()
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
        ("wheel", np.int64, 4),  # bodies
        ("hub", np.int64, 4),
        ("spin", np.int64, 4),  # joint velocities
        ("slide", np.int64, (4, 2)),  # joint positions and velocities
        ("steer", np.int64, 2),  # joint positions
    ]
)
"""What the kernels know of the car; a record, because it crosses into compiled code as one argument."""

STATE = np.dtype(
    [
        ("deflection", np.float64, (4, 2)),  # of the carcass, longitudinal and lateral, [m]
        ("steer_command", np.float64),
        ("target_speed", np.float64),
        ("steer_angle", np.float64),  # of the steering actuator
        ("collided", np.float64),
        ("planar", np.float64, 7),  # x, y, yaw, v_x, v_y, yaw_rate, steer_angle of VehicleState
        ("load", np.float64, 4),  # of the last step, as are the next two
        ("slip", np.float64, (4, 2)),  # kappa, alpha
        ("shear", np.float64, (4, 2)),  # in the wheel's axes
        ("arm", np.float64, 4),  # rolling radius: wheel centre to patch
    ]
)
"""The plant's own state, laid over `MjData.userdata`: a snapshot of the integration state holds it."""

_PATCH = 14  # found, dist, pos (3), normal (3), tangent (3), linvel (3) in the contact frame


def _native(name: str) -> Any:
    """MuJoCo's C function of (mjModel*, mjData*), as compiled or, without numba, as plain Python calls it."""
    folder = Path(mujoco.__file__).parent
    library = next(file for pattern in ("libmujoco*", "mujoco.dll") for file in folder.glob(pattern))
    if config.DISABLE_JIT:  # pyright: ignore[reportAttributeAccessIssue]  (numba fills config at run time)
        function = getattr(ctypes.CDLL(str(library)), name)
        function.argtypes, function.restype = [ctypes.c_void_p, ctypes.c_void_p], None
        return function
    llvm.load_library_permanently(str(library))
    return types.ExternalFunction(name, types.void(types.intp, types.intp))


_mj_step1, _mj_step2 = _native("mj_step1"), _native("mj_step2")


@njit(cache=True, nogil=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def ackermann(angle, offset):
    """Angle of a wheel whose kingpin is `offset` wheelbases left of the axle's middle, in [rad]."""
    return math.atan2(math.sin(angle), math.cos(angle) - offset * math.sin(angle))


@njit(cache=True, nogil=True)
def relaxed_slip(deflection, slide_x, slide_y, rolling, dt, tyre):
    """Advance the carcass deflection by one implicit step of u' = -v_s - |v_x| u / sigma.

    At rest u' = -v_s is a spring without a damper and without an end, so that at low speed the deflection
    is bounded where the force saturates, and the sliding speed damps (Pacejka, section 8.6).

    Args:
        deflection: u, longitudinal and lateral, in [m]; shape (2,), overwritten.
        slide_x, slide_y: Sliding velocity of the patch, in [m/s].
        rolling: Speed of the wheel centre along the wheel, in [m/s].
        dt: Step, in [s].
        tyre: `TyreParameters.as_array()`.

    Returns:
        Slip ratio kappa, in [-], and slip angle alpha, in [rad].
    """
    length_x, length_y, rolling = tyre[0]["relaxation_x"], tyre[0]["relaxation_y"], abs(rolling)
    x = (deflection[0] - dt * slide_x) / (length_x + dt * rolling)
    y = (deflection[1] - dt * slide_y) / (length_y + dt * rolling)
    shrink = min(1.0, (_SLIP_AT_REST + rolling / _LOW_SPEED) / max(math.hypot(x, y), 1e-9))
    x, y = shrink * x, shrink * y
    deflection[0], deflection[1] = x * length_x, y * length_y
    damping = 0.5 * (1.0 + math.cos(math.pi * min(rolling / _LOW_SPEED, 1.0))) / _DAMPING_SPEED
    return x - damping * slide_x, math.atan(y - damping * slide_y)


@njit(cache=True, nogil=True)
def _tyre(i, dt, car, state, sensors, xipos, xmat, qvel, xfrc):
    """Shear of wheel `i` from its contact patch, as a force and a moment on the wheel's body."""
    patch, wheel = sensors[_PATCH * i : _PATCH * (i + 1)], car["wheel"][i]
    force = xfrc[wheel]
    normal, tangent, velocity = patch[5:8], patch[8:11], patch[11:14]
    load = -car["tyre_stiffness"] * patch[1] - car["tyre_damping"] * velocity[0]
    if patch[0] == 0.0 or load <= 0.0:
        state["load"][i] = 0.0
        state["deflection"][i, :] = 0.0
        state["slip"][i, :] = 0.0
        state["shear"][i, :] = 0.0
        force[:] = 0.0
        return
    axle = xmat[car["hub"][i]]
    ahead = _cross((axle[1], axle[4], axle[7]), normal)
    length = math.sqrt(_dot(ahead, ahead))
    ahead = (ahead[0] / length, ahead[1] / length, ahead[2] / length)
    left = _cross(normal, ahead)
    second = _cross(normal, tangent)
    slide_x = velocity[1] * _dot(tangent, ahead) + velocity[2] * _dot(second, ahead)
    slide_y = velocity[1] * _dot(tangent, left) + velocity[2] * _dot(second, left)
    arm = (patch[2] - xipos[wheel, 0], patch[3] - xipos[wheel, 1], patch[4] - xipos[wheel, 2])
    radius = math.sqrt(_dot(arm, arm))
    rolling = slide_x + qvel[car["spin"][i]] * radius
    kappa, alpha = relaxed_slip(state["deflection"][i], slide_x, slide_y, rolling, dt, car["tyre"])
    fx, fy, _ = tyre_forces(kappa, alpha, 0.0, load, car["friction"], car["tyre"])
    for k in range(3):
        force[k] = fx * ahead[k] + fy * left[k]
    # The patch lies half the penetration below the road, where the wheel rolls; the car leans on the road.
    rise = -0.5 * patch[1]
    road = (arm[0] + rise * normal[0], arm[1] + rise * normal[1], arm[2] + rise * normal[2])
    drive, lean = _cross(arm, ahead), _cross(road, left)
    for k in range(3):
        force[3 + k] = fx * drive[k] + fy * lean[k]
    state["load"][i], state["arm"][i] = load, radius
    state["slip"][i, 0], state["slip"][i, 1] = kappa, alpha
    state["shear"][i, 0], state["shear"][i, 1] = fx, fy


@njit(cache=True, nogil=True)
def _wheel_torques(dt, car, state, qvel, ctrl):
    """Speed hold: drive on the rear axle, brakes on all wheels by their load, both within the grip."""
    target, speed = state["target_speed"], state["planar"][3]
    demand = limited_acceleration(speed, target, car["max_braking"], car["max_acceleration"])
    if target < _HOLD_TARGET and abs(speed) < _HOLD_SPEED:
        demand = -car["max_braking"]
    force = demand * (car["mass"] + 4.0 * car["spin_inertia"] / car["wheel_radius"] ** 2)
    total = max(state["load"].sum(), 1.0)
    for i in range(4):
        load, arm, fx, fy = state["load"][i], state["arm"][i], state["shear"][i, 0], state["shear"][i, 1]
        grip = (_GRIP_USED * car["tyre"][0]["p_dx1"] * car["friction"] * load) ** 2 - fy**2
        if abs(state["slip"][i, 0]) > _SLIP_RELEASE:
            grip = 0.0
        grip = math.sqrt(max(grip, 0.0))
        if demand >= 0.0:
            ctrl[2 + i] = min(0.5 * force, grip) * arm if i >= 2 else 0.0
            continue
        # Dry friction: never more than what stops the wheel within this step.
        stop = fx * arm - car["spin_inertia"] * qvel[car["spin"][i]] / dt
        limit = min(-force * load / total, grip) * arm
        ctrl[2 + i] = min(max(stop, -limit), limit)


@njit(cache=True, nogil=True)
def _steer(dt, car, state, ctrl):
    """Advance the steering actuator and lead the servos so that the hinges follow it without a lag."""
    before = state["steer_angle"]
    angle = steered(before, state["steer_command"], dt, car["steer_time_constant"], car["steer_rate_limit"])
    state["steer_angle"] = angle
    offset = car["steer_offset"]
    for i in range(2):
        now = ackermann(before, offset)  # where the hinge is; it then arrives with the actuator
        ctrl[i] = now + car["steer_lead"] * (ackermann(angle, offset) - now) / dt
        offset = -offset


@njit(cache=True, nogil=True)
def observe(cars, states, qpos, qvel):
    """Write the planar state of the total centre of gravity to `planar` of the state.

    From the coordinates themselves: MuJoCo's derived quantities are one step old after a step.
    """
    car, planar = cars[0], states[0]["planar"]
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    row_x = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y))
    row_y = (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x))
    height = climb = 0.0  # of the centre of gravity in the chassis frame, by suspension travel
    for i in range(4):
        height += car["unsprung"][i] * qpos[car["slide"][i, 0]] / car["mass"]
        climb += car["unsprung"][i] * qvel[car["slide"][i, 1]] / car["mass"]
    relative = (height * qvel[4], -height * qvel[3], climb)
    v_x, v_y = qvel[0] + _dot(row_x, relative), qvel[1] + _dot(row_y, relative)
    yaw = math.atan2(row_y[0], row_x[0])
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn_x = row_x[1] * qvel[5] - row_x[2] * qvel[4]  # rate of the chassis' x axis
    turn_y = row_y[1] * qvel[5] - row_y[2] * qvel[4]
    planar[0] = qpos[0] + row_x[2] * height
    planar[1] = qpos[1] + row_y[2] * height
    planar[2] += (yaw - planar[2] + math.pi) % (2.0 * math.pi) - math.pi
    planar[3], planar[4] = cos * v_x + sin * v_y, cos * v_y - sin * v_x
    planar[5] = (row_x[0] * turn_y - row_y[0] * turn_x) / (row_x[0] ** 2 + row_y[0] ** 2)
    offset = car["steer_offset"]
    left, right = qpos[car["steer"][0]], qpos[car["steer"][1]]
    planar[6] = 0.5 * (ackermann(left, -offset) + ackermann(right, offset))


@njit(cache=True, nogil=True)
def _is_sane(qvel):
    """Whether no velocity is NaN or absurd: MuJoCo would go on and fill the screen with warnings."""
    return np.dot(qvel, qvel) < _ABSURD**2


@njit(cache=True, nogil=True)
def advance(steps, dt, model, data, cars, states, sensors, xipos, xmat, qpos, qvel, xfrc, ctrl, mocap_pos, track):
    """Step the car under the held command of the state.

    Args:
        steps: Number of steps.
        dt: One step, in [s]; the model's.
        model, data: Addresses of mjModel and mjData.
        cars, states: One record each, of `CAR` and `STATE`.
        sensors, xipos, xmat, qpos, qvel, xfrc, ctrl, mocap_pos: Views of MjData's arrays.
        track: Position of the obstacles at the beginning and the end, shape (2, n, 3); n = 0 if they
            all stand still.
    """
    car, state = cars[0], states[0]
    for step in range(steps):
        if not _is_sane(qvel):
            break
        share = (step + 1.0) / steps
        for k in range(track.shape[1]):
            mocap_pos[k] = (1.0 - share) * track[0, k] + share * track[1, k]
        _mj_step1(model, data)
        observe(cars, states, qpos, qvel)
        for i in range(4):
            _tyre(i, dt, car, state, sensors, xipos, xmat, qvel, xfrc)
        _wheel_torques(dt, car, state, qvel, ctrl)
        _steer(dt, car, state, ctrl)
        if sensors[4 * _PATCH] > 0.0:
            state["collided"] = 1.0
        _mj_step2(model, data)
    observe(cars, states, qpos, qvel)
    if not _is_sane(qvel):
        state["planar"][:] = np.nan
