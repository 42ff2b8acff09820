"""What the controller may believe of somebody else's car: masses and sizes of the model, tyres and steering driven out.

MuJoCo's contact friction is no tyre: its stiffness grows with the speed. So it is measured, in one gentle bend, at the
speed of the drive.
"""

import math

import mujoco
import numpy as np

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.foreign.anatomy import Array, touches
from sidestep.plant_models.mujoco.foreign.plant import MjcfPlant
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

LARGEST_RATE = 1.0
"""Steering rate that is believed at most, in [rad/s]: servos in models are often without any limit."""

_DT = 0.01
_HELD = 0.9  # share of the speed that counts as held
_LOOKS, _STEADY = 20, 0.01  # looks at a speed that changes, at most, and change of a steady one
_BEND, _GRIP_USED = 1.0, 0.2  # lateral acceleration [m/s^2], and share of the grip, of the bend, at most
_STRAIGHT, _LONG, _LOOK = 0.3, 2.0, 0.5  # times before, in and at the end of it, in [s]
_SOFTEST, _STIFFEST = 3.0, 100.0  # cornering stiffness over load, in [1/rad]
_SLOW, _LOCK_TIME = 2.0, 1.0  # speed and time of a turn to the lock, in [m/s] and [s]
_NO_RELAXATION = 0.02  # of a contact, in [m]


def vehicle_of(plant: MjcfPlant, speed: float) -> VehicleParameters:
    """The car as the linear model sees it at a speed [m/s].

    Args:
        plant: Without obstacles; is driven.
        speed: Of the bend, in [m/s].

    Raises:
        InputError: No car that can be steered so: a size or mass out of range.
        PlantError: It cannot be driven.
    """
    stance, car = plant.stance, plant.car
    l_f, l_r = (float(s * stance.places[list(w), 0].mean()) for s, w in ((1.0, car.front), (-1.0, car.rear)))
    if min(l_f, l_r) <= 0.0:
        raise InputError(
            f"{car.label}: wheels",
            f"the centre of gravity is {l_f:.3g} m behind the front axle and {l_r:.3g} m ahead of the other",
            "a car that stands on both",
        )  # fmt: skip
    require_speed(plant, speed, car.label)
    mass = float(plant.model.body_subtreemass[plant.root])
    front, rear, left, right = _sizes(plant)
    stiffness_f, stiffness_r, lag = _bend(plant, speed, mass, l_f, l_r)
    tyre = TyreParameters(
        nominal_load=max(mass * GRAVITY / len(car.wheels), 1.0), p_dx1=_peak(stance.friction),
        p_dy1=_peak(stance.friction), p_dx2=0.0, p_dy2=0.0, p_ky2=0.0, relaxation_x=_NO_RELAXATION,
        relaxation_y=_NO_RELAXATION,
    )  # fmt: skip
    try:
        return VehicleParameters(
            name=car.label.rpartition(".")[0] or car.label,
            mass=mass,
            yaw_inertia=_yaw_inertia(plant),
            l_f=l_f,
            l_r=l_r,
            cornering_stiffness_front=stiffness_f,
            cornering_stiffness_rear=stiffness_r,
            width=2.0 * max(left, right),
            length=max(front, l_f + 0.001) + max(rear, l_r),
            front_overhang=max(front - l_f, 0.001),
            cg_height=stance.height,
            steer_limit=min(plant.steering.limit, 1.5),
            steer_rate_limit=_rate(plant, speed),
            steer_time_constant=lag,
            max_braking=max(plant.drive.max_braking, 1e-6),
            max_acceleration=max(plant.drive.max_acceleration, 1e-6),
            tyre=tyre,
        )
    except InputError as error:
        raise InputError(f"{car.label}: {error.where}", error.problem, error.allowed) from error


def require_speed(plant: Plant, speed: float, label: str) -> None:
    """Drive straight on until the speed is steady.

    Raises:
        InputError: It is not the one to hold, in [m/s].
        PlantError: The car cannot be driven.
    """
    state = plant.reset(VehicleState(v_x=speed))
    for _ in range(_LOOKS):
        before = state.v_x
        for _ in range(round(_LOOK / _DT)):
            state = plant.step(SteeringCommand(state.time, 0.0, speed), _DT)
        if abs(state.v_x - before) <= _STEADY * speed:
            break
    if not _HELD <= state.v_x / speed <= 2.0 - _HELD or abs(state.yaw) > 1.0:
        spins = " and has spun round" if abs(state.yaw) > 1.0 else ""
        problem = (
            f"{speed:g} m/s: told to hold that straight on, the car of {label} ends up at {state.v_x:.3g} m/s{spins}"
        )
        raise InputError("speed", problem, "a speed that it can hold (--set speed=...), in a scene of its size")


def _peak(friction: float) -> float:
    return min(max(friction, 0.01), 1e3)


def _sizes(plant: MjcfPlant) -> tuple[float, float, float, float]:
    """Reach to the front, rear, left and right of the centre of gravity at rest, in [m]."""
    model, data, root = plant.model, plant.data, plant.root
    data.qpos[:] = plant.stance.pose
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    cos, sin = plant.heading()
    axes, centre = np.array([[cos, sin], [-sin, cos]]), data.subtree_com[root]
    corners: list[Array] = []
    for geom in range(model.ngeom):
        is_seen = model.geom_rgba[geom, 3] > 0.0 or touches(model, geom)
        if model.body_rootid[model.geom_bodyid[geom]] != root or not is_seen:
            continue
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        points = (middle + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        corners.append((points - centre)[:, :2] @ axes.T)
    reach = np.concatenate(corners)
    (front, left), (rear, right) = reach.max(axis=0), -reach.min(axis=0)
    return float(front), float(rear), float(left), float(right)


def _yaw_inertia(plant: MjcfPlant) -> float:
    """Of all bodies about the upright through the centre of gravity, in the pose of `plant.data`, in [kg m^2]."""
    model, data = plant.model, plant.data
    inertia = 0.0
    for body in range(model.nbody):
        if model.body_rootid[body] == plant.root:
            frame = data.ximat[body].reshape(3, 3)
            x, y = (data.xipos[body] - data.subtree_com[plant.root])[:2]
            inertia += float(frame[2] ** 2 @ model.body_inertia[body] + model.body_mass[body] * (x * x + y * y))
    return inertia


def _bend(plant: MjcfPlant, speed: float, mass: float, l_f: float, l_r: float) -> tuple[float, float, float]:
    """Cornering stiffness of both axles [N/rad], and how late the wheels follow, in the mean, in [s]."""
    wheelbase = l_f + l_r
    sideways = min(_BEND, _GRIP_USED * plant.stance.friction * GRAVITY)
    asked = min(sideways * wheelbase / max(speed, 0.5) ** 2, 0.5 * plant.steering.limit)
    state = plant.reset(VehicleState(v_x=speed))
    for _ in range(round(_STRAIGHT / _DT)):
        state = plant.step(SteeringCommand(state.time, 0.0, speed), _DT)
    before, states = state.steer_angle, []
    for _ in range(round(_LONG / _DT)):
        state = plant.step(SteeringCommand(state.time, asked, speed), _DT)
        states.append(state)
    last = states[-round(_LOOK / _DT) :]
    v_x, v_y, rate, steer = (
        float(np.mean([getattr(s, name) for s in last])) for name in ("v_x", "v_y", "yaw_rate", "steer_angle")
    )
    if steer - before < 0.2 * asked:
        raise PlantError(
            f"{plant.car.label}: at {speed:g} m/s the wheels turn by {steer - before:.3g} rad when told "
            f"{asked:.3g} rad: the steering is too weak, or is not what steers"
        )
    if v_x > 0.2 * speed and rate < 0.1 * v_x * steer / wheelbase:
        raise PlantError(
            f"{plant.car.label}: at {v_x:.3g} m/s with the wheels {steer:.3g} rad to the left the car turns at "
            f"{rate:.3g} rad/s: it does not follow its wheels"
        )
    lag = sum(1.0 - (s.steer_angle - before) / (steer - before) for s in states) * _DT
    force = mass * v_x * rate / wheelbase  # over the other axle's lever
    stiffness = []
    for share, slip in ((l_r, steer - (v_y + l_f * rate) / v_x), (l_f, (l_r * rate - v_y) / v_x)):
        load = mass * GRAVITY * share / wheelbase
        found = force * share / slip if slip > 1e-9 else math.inf
        stiffness.append(min(max(found, _SOFTEST * load, 1.0), max(_STIFFEST * load, 1.0)))
    return stiffness[0], stiffness[1], min(max(lag, 0.0), 0.9)


def _rate(plant: MjcfPlant, speed: float) -> float:
    """Fastest turn of the wheels on the way to the lock, as far as it is believed, in [rad/s]."""
    slow = min(speed, _SLOW)
    state, angles = plant.reset(VehicleState(v_x=slow)), []
    for _ in range(round(_LOCK_TIME / _DT)):
        state = plant.step(SteeringCommand(state.time, plant.steering.limit, slow), _DT)
        angles.append(state.steer_angle)
    return min(max(float(np.diff(angles, prepend=0.0).max()) / _DT, 0.01), LARGEST_RATE)
