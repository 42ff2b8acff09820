"""The time loop of the MuJoCo car, with its actuators and the state it reports, as kernels.

Between `mj_step1` (positions, velocities, contacts) and `mj_step2` (forces, motion) the tyres, the speed
control and the steering act. MuJoCo's own two C functions are linked by name, so that a whole control
period is one compiled call that holds no lock and can be cached; they are those of `library`'s copy.
"""

import ctypes
import math
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import config, types

from sidestep.plant_models.kernels import Array, kernel
from sidestep.plant_models.linear.plant import steered
from sidestep.plant_models.mujoco.library import load_own_copy
from sidestep.plant_models.speed_control import HOLD_SPEED, limited_acceleration
from sidestep.plant_models.tyres.contact import PATCH, dot, tyres

_GRIP_USED = 0.9  # share of the peak that drive and brakes ask for
_SLIP_RELEASE = 0.2  # slip at which drive and brakes let go (anti-lock)
_HOLD_TARGET = 0.05  # brakes hold a car that hardly moves when less than this is asked, [m/s]
_ABSURD = 1e5  # no joint moves that fast, [m/s] or [rad/s]

_LIBRARY = load_own_copy()


def _native(name: str) -> Any:
    """MuJoCo's C function of (mjModel*, mjData*), as compiled or, without numba, as plain Python calls it."""
    function = getattr(_LIBRARY, name)
    if config.DISABLE_JIT:  # pyright: ignore[reportAttributeAccessIssue]  (numba fills config at run time)
        function.argtypes, function.restype = [ctypes.c_void_p, ctypes.c_void_p], None
        return function
    own_name = f"sidestep_{name}"
    llvm.add_symbol(own_name, ctypes.cast(function, ctypes.c_void_p).value)
    return types.ExternalFunction(own_name, types.void(types.intp, types.intp))


_mj_step1, _mj_step2 = _native("mj_step1"), _native("mj_step2")


@kernel
def ackermann(angle: float, offset: float) -> float:
    """Angle of a wheel whose kingpin is `offset` wheelbases left of the axle's middle, in [rad]."""
    return math.atan2(math.sin(angle), math.cos(angle) - offset * math.sin(angle))


@kernel
def _demand(car, state, speed):
    """Acceleration asked for, in [m/s^2], and whether the car is to stand when it hardly moves any more.

    As commanded, or by the speed control. Brakes need no fading here: they are dry friction at each wheel.
    """
    target, wanted = state["target_speed"], state["acceleration"]
    if math.isfinite(wanted):
        return min(max(wanted, -car["max_braking"]), car["max_acceleration"]), wanted < 0.0
    return limited_acceleration(speed, target, car["max_braking"], car["max_acceleration"]), target < _HOLD_TARGET


@kernel
def _wheel_torques(dt, car, state, qvel, ctrl):
    """Drive on the rear axle, brakes on all wheels by their load, both within the grip."""
    speed = state["planar"][3]
    demand, holds = _demand(car, state, speed)
    if holds and abs(speed) < HOLD_SPEED:
        demand = -car["max_braking"]
    force = demand * (car["mass"] + 4.0 * car["spin_inertia"] / car["wheel_radius"] ** 2)
    yaw = state["planar"][2]  # what pulls the car downhill is no business of the speed control
    force -= car["mass"] * (car["gravity"][0] * math.cos(yaw) + car["gravity"][1] * math.sin(yaw))
    total = max(state["load"].sum(), 1.0)
    for i in range(4):
        load, arm, fx, fy = state["load"][i], state["arm"][i], state["shear"][i, 0], state["shear"][i, 1]
        grip = (_GRIP_USED * car["tyre"][0]["p_dx1"] * state["friction"][i] * load) ** 2 - fy**2
        if abs(state["slip"][i, 0]) > _SLIP_RELEASE:
            grip = 0.0
        grip = math.sqrt(max(grip, 0.0))
        if force >= 0.0:
            ctrl[2 + i] = min(0.5 * force, grip) * arm if i >= 2 else 0.0
            continue
        # Dry friction: never more than what stops the wheel within this step.
        stop = fx * arm - car["spin_inertia"] * qvel[car["spin"][i]] / dt
        limit = min(-force * load / total, grip) * arm
        ctrl[2 + i] = min(max(stop, -limit), limit)


@kernel
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


@kernel
def observe(cars: Any, states: Array, qpos: Any, qvel: Any) -> None:
    """Write the planar state of the total centre of gravity to `planar` of the state.

    From the coordinates themselves: MuJoCo's derived quantities are one step old after a step.
    """
    car, planar = cars[0], states[0]["planar"]
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    row_x = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y))
    row_y = (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x))
    height = climb = aside = drift = 0.0  # of the centre of gravity in the chassis frame, by suspension travel
    for i in range(4):
        travel = car["unsprung"][i] * qpos[car["slide"][i, 0]] / car["mass"]
        speed = car["unsprung"][i] * qvel[car["slide"][i, 1]] / car["mass"]
        aside, height = aside + car["slide_axis"][i, 0] * travel, height + car["slide_axis"][i, 1] * travel
        drift, climb = drift + car["slide_axis"][i, 0] * speed, climb + car["slide_axis"][i, 1] * speed
    relative = (
        height * qvel[4] - aside * qvel[5],
        drift - height * qvel[3],
        climb + aside * qvel[3],
    )
    v_x, v_y = qvel[0] + dot(row_x, relative), qvel[1] + dot(row_y, relative)
    yaw = math.atan2(row_y[0], row_x[0])
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn_x = row_x[1] * qvel[5] - row_x[2] * qvel[4]  # rate of the chassis' x axis
    turn_y = row_y[1] * qvel[5] - row_y[2] * qvel[4]
    planar[0] = qpos[0] + row_x[1] * aside + row_x[2] * height
    planar[1] = qpos[1] + row_y[1] * aside + row_y[2] * height
    planar[2] += (yaw - planar[2] + math.pi) % (2.0 * math.pi) - math.pi
    planar[3], planar[4] = cos * v_x + sin * v_y, cos * v_y - sin * v_x
    planar[5] = (row_x[0] * turn_y - row_y[0] * turn_x) / (row_x[0] ** 2 + row_y[0] ** 2)
    offset = car["steer_offset"]
    left, right = qpos[car["steer"][0, 0]], qpos[car["steer"][1, 0]]
    planar[6] = 0.5 * (ackermann(left, -offset) + ackermann(right, offset))


@kernel
def _is_sane(qvel):
    """Whether no velocity is NaN or absurd: MuJoCo would go on and fill the screen with warnings."""
    total = 0.0
    for rate in qvel:  # np.dot takes longer for so few
        total += rate * rate
    return total < _ABSURD**2


@kernel
def advance(
    steps: Any,
    dt: float,
    model: Any,
    data: Any,
    cars: Any,
    states: Array,
    sensors: Any,
    xipos: Any,
    xmat: Any,
    qpos: Any,
    qvel: Any,
    qfrc: Any,
    ctrl: Any,
    mocap_pos: Any,
    pairs: Any,
    damping: Any,
    track: Any,
    patches: Any,
) -> None:
    """Step the car under the held command of the state.

    Args:
        steps: Number of steps.
        dt: One step, in [s]; the model's.
        model, data: Addresses of mjModel and mjData.
        cars, states: One record each, of `CAR` and `STATE`.
        sensors, xipos, xmat, qpos, qvel, qfrc, ctrl, mocap_pos: Views of MjData's arrays; `qfrc` takes the tyres'
            forces.
        pairs, damping: Views of the pairs' friction and friction reference in mjModel.
        track: Position of the obstacles at the beginning and the end, shape (2, n, 3); n = 0 if they
            all stand still.
        patches: See `contact_tyre.friction_at`.
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
        tyres(dt, car, state, sensors, xipos, xmat, qpos, qvel, qfrc, pairs, damping, patches)
        _wheel_torques(dt, car, state, qvel, ctrl)
        _steer(dt, car, state, ctrl)
        if sensors[4 * PATCH] > 0.0:
            state["collided"] = 1.0
        _mj_step2(model, data)
    observe(cars, states, qpos, qvel)
    if not _is_sane(qvel):
        state["planar"][:] = np.nan
