"""Somebody else's car, put together: where it points, which wheels steer, which actuators steer and drive."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from mujoco import mjtJoint, mjtObj, mjtTrn

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.foreign.anatomy import Anatomy, Array, Wheel, find_car, names_of, require
from sidestep.plant_models.mujoco.foreign.bench import OTHER, POSITION, RATE, TORQUE, Bench, Response
from sidestep.plant_models.mujoco.foreign.car_map import CarMap
from sidestep.plant_models.mujoco.foreign.file import free_car, part_overlaps, read_model, without_freedom
from sidestep.plant_models.vehicle.parameters import GRAVITY

_UPRIGHT = 0.8  # cosine between a kingpin and the vertical
_SERVO_ARM, _SERVO_RATE = 10.0, 0.5  # stiffness over weight times radius; natural rate times time step
_ORDER = (POSITION, RATE, TORQUE)


@dataclass(frozen=True)
class ForeignCar:
    """A car in a model that drives.

    Attributes:
        label: The file.
        told: What was told of it.
        spec: With the actuators that it was given.
        root, chassis: Bodies.
        wheels: All of them.
        forward: Direction ahead in the root's axes.
        senses: +1 where a wheel's joint points to the left, else -1.
        front, rear: Numbers of the steered wheels in front, and of the others.
        steers, drives: Actuators.
        wheelbase: Between the means of both, in [m].
        notes: What was changed or assumed, as sentences.
    """

    label: str
    told: CarMap
    spec: mujoco.MjSpec
    root: str
    chassis: str
    wheels: tuple[Wheel, ...]
    forward: Array
    senses: tuple[int, ...]
    front: tuple[int, ...]
    rear: tuple[int, ...]
    steers: tuple[Response, ...]
    drives: tuple[Response, ...]
    wheelbase: float
    notes: tuple[str, ...]

    def bench(self) -> Bench:
        """The car on a bench."""
        return Bench(without_freedom(self.spec, self.anatomy), self.anatomy, self.told.hold)

    @property
    def anatomy(self) -> Anatomy:
        """Its parts."""
        return Anatomy(self.root, self.chassis, self.wheels)


def read_car(path: str | Path, told: CarMap | None = None) -> ForeignCar:
    """The car of an MJCF file.

    Raises:
        InputError: The file cannot be used, or what makes a car is not found in it; says what was found.
    """
    told, label = told or CarMap(), Path(path).name
    spec, model = read_model(path)
    anatomy = find_car(model, told, label)
    for name in told.hold:
        require(model, mjtObj.mjOBJ_ACTUATOR, name, f"{label}: hold")
    notes = [*free_car(spec, anatomy, label), *part_overlaps(spec, model, anatomy)]
    notes += _added(spec, model, anatomy, told, label)
    steers, drives, responses = _chosen(spec, anatomy, told, label)
    if not steers and (kingpins := _kingpins(model, anatomy)):
        notes += _add_servos(spec, model, anatomy, kingpins)
        steers, drives, responses = _chosen(spec, anatomy, told, label)
    if not steers:
        raise InputError(f"{label}: steering", *_nothing_steers(anatomy, responses))
    turned = sorted({wheel for steer in steers for wheel in steer.turned})
    forward, senses, front, rear = _directions(model, anatomy, told, turned, label)
    drives = tuple(drive for drive in drives if abs(push(drive, senses)) > 0.0)
    if not drives:
        if told.drive:
            raise InputError(f"{label}: drive", *_nothing_drives(told.drive, responses))
        notes += _add_motors(spec, [anatomy.wheels[i].joint for i in rear])
        _, drives, _ = _chosen(spec, anatomy, CarMap(hold=told.hold), label)
        drives = tuple(drive for drive in drives if abs(push(drive, senses)) > 0.0)
    steers = tuple(steer for steer in steers if set(steer.turned) <= set(front))
    if not steers:
        raise InputError(f"{label}: steering", "one actuator steers front and rear", "actuators of the front wheels")
    ahead = np.array([wheel.centre @ (_root_frame(model, anatomy) @ forward) for wheel in anatomy.wheels])
    return ForeignCar(
        label, told, spec, anatomy.root, anatomy.chassis, anatomy.wheels, forward, senses, front, rear, steers, drives,
        float(ahead[list(front)].mean() - ahead[list(rear)].mean()), tuple(notes),
    )  # fmt: skip


def push(drive: Response, senses: Sequence[int]) -> float:
    """Speed of an actuator per rate of its wheels ahead; 0 if it turns them against each other."""
    ahead = [senses[i] * rate for i, rate in drive.spun]
    if not ahead or abs(sum(ahead)) < 0.5 * sum(map(abs, ahead)):
        return 0.0
    return drive.rate / (sum(ahead) / len(ahead))


def _root_frame(model: mujoco.MjModel, car: Anatomy) -> Array:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data.xmat[model.body(car.root).id].reshape(3, 3).copy()


def _added(spec: mujoco.MjSpec, model: mujoco.MjModel, car: Anatomy, told: CarMap, label: str) -> list[str]:
    """Servos and motors for the joints that a mapping file names."""
    actuators, joints = names_of(model, mjtObj.mjOBJ_ACTUATOR), names_of(model, mjtObj.mjOBJ_JOINT)
    for key in ("steering", "drive"):
        for name in getattr(told, key):
            if name not in actuators and name not in joints:
                require(model, mjtObj.mjOBJ_ACTUATOR, name, f"{label}: {key}")
    servos = [name for name in told.steering if name not in actuators]
    motors = [name for name in told.drive if name not in actuators]
    notes = _add_servos(spec, model, car, servos) if servos else []
    return notes + (_add_motors(spec, motors) if motors else [])


def _chosen(
    spec: mujoco.MjSpec, car: Anatomy, told: CarMap, label: str
) -> tuple[tuple[Response, ...], tuple[Response, ...], list[Response]]:
    """Actuators that steer, that drive, and all."""
    bench = Bench(without_freedom(spec, car), car, told.hold)
    names = names_of(bench.model, mjtObj.mjOBJ_ACTUATOR)
    responses = [bench.response(i) for i, name in enumerate(names) if name not in told.hold]
    named = {response.name: response for response in responses}
    wanted = [named[name] if name in named else named[servo_name(name)] for name in told.steering]
    for response in wanted:
        if not response.turned or response.kind == OTHER:
            raise InputError(f"{label}: steering", *_nothing_steers(car, responses, response))
    steers = tuple(wanted) or _best(response for response in responses if response.turned)
    wheels = [named[name] if name in named else named[motor_name(name)] for name in told.drive]
    drives = tuple(wheels) or tuple(response for response in responses if response.spun)
    return steers, tuple(drive for drive in drives if drive.kind in (RATE, TORQUE)), responses


def _best(found: object) -> tuple[Response, ...]:
    """Per wheel the kind that is easiest to lead; what steers beside it stays at rest."""
    responses, covered, best = list(found), set(), []  # type: ignore[call-overload]
    for kind in _ORDER:
        fresh = [r for r in responses if r.kind == kind and not set(r.turned) <= covered]
        best += fresh
        covered |= {wheel for r in fresh for wheel in r.turned}
    return tuple(best)


def _directions(
    model: mujoco.MjModel, car: Anatomy, told: CarMap, turned: list[int], label: str
) -> tuple[Array, tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Ahead in the root's axes, senses of the axles, wheels in front and behind."""
    axles = np.array([wheel.axle for wheel in car.wheels])
    signs = np.where(axles @ axles[0] < 0.0, -1, 1)
    left = (signs[:, None] * axles).mean(axis=0)
    if min(abs(axles @ left)) < 0.8 * np.linalg.norm(left):
        raise InputError(f"{label}: wheels", "their axles point in different directions", "wheels of one car")
    ahead = np.cross(left, [0.0, 0.0, 1.0])
    ahead /= np.linalg.norm(ahead)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    chassis = data.xmat[model.body(car.chassis).id].reshape(3, 3)
    places = np.array([wheel.centre for wheel in car.wheels]) @ ahead
    others = [i for i in range(len(places)) if i not in turned]
    if told.forward:
        asked = chassis[:, "xyz".index(told.forward[-1])] * (-1.0 if told.forward[0] == "-" else 1.0)
        if abs(asked @ ahead) < 0.7:
            along = [a for a in ("x", "y", "z") if abs(chassis[:, "xyz".index(a)] @ ahead) >= 0.7]
            allowed = ", ".join(f"{a}, -{a}" for a in along)
            raise InputError(f"{label}: forward", f"{told.forward!r}: the axles point along it", allowed)
        sign = math.copysign(1.0, asked @ ahead)
    elif others:
        sign = math.copysign(1.0, places[turned].mean() - places[others].mean())
    else:  # all wheels steer
        along = max(chassis.T, key=lambda axis: abs(axis @ ahead))
        sign = math.copysign(1.0, along @ ahead)
    places = sign * places
    middle = 0.5 * (places.max() + places.min())
    front = tuple(i for i in turned if others or places[i] > middle)
    rear = tuple(i for i in range(len(places)) if i not in front)
    if places[list(front)].min() <= max(places[i] for i in rear):
        names = ", ".join(repr(car.wheels[i].joint) for i in front)
        problem = f"the steered wheels ({names}) are not ahead of the others"
        raise InputError(f"{label}: steering", problem, "a car that steers in front; forward = another axis")
    root = data.xmat[model.body(car.root).id].reshape(3, 3)
    left_now = sign * left
    senses = tuple(1 if axle @ left_now > 0.0 else -1 for axle in axles)
    return root.T @ (sign * ahead), senses, front, rear


def _kingpins(model: mujoco.MjModel, car: Anatomy) -> list[str]:
    """Upright hinges between the car's root and a wheel."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, None] = {}
    for wheel in car.wheels:
        body, root = model.body(wheel.body).id, model.body(car.root).id
        while body not in (0, root):
            first, count = model.body_jntadr[body], model.body_jntnum[body]
            for joint in range(first, first + count):
                is_hinge = model.jnt_type[joint] == mjtJoint.mjJNT_HINGE
                if is_hinge and abs(data.xaxis[joint][2]) > _UPRIGHT and model.joint(joint).name != wheel.joint:
                    found[model.joint(joint).name] = None
            body = model.body_parentid[body]
    return list(found)


def servo_name(joint: str) -> str:
    """Of the servo that a joint gets."""
    return f"sidestep servo {joint}"


def motor_name(joint: str) -> str:
    """Of the motor that a joint gets."""
    return f"sidestep motor {joint}"


def _add_servos(spec: mujoco.MjSpec, model: mujoco.MjModel, car: Anatomy, joints: Sequence[str]) -> list[str]:
    radius = max(wheel.radius for wheel in car.wheels)
    weight = GRAVITY * float(model.body_subtreemass[model.body(car.root).id])
    for name in joints:
        joint = model.joint(name)
        inertia = float(model.dof_M0[joint.dofadr[0]])
        stiffest = inertia * (_SERVO_RATE / model.opt.timestep) ** 2
        stiffness = min(_SERVO_ARM * weight * radius, stiffest)
        servo = spec.add_actuator(name=servo_name(name), target=name, trntype=mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=stiffness, kv=2.0 * math.sqrt(stiffness * inertia))
    return [f"steering: {', '.join(map(repr, joints))} got servos"]


def _add_motors(spec: mujoco.MjSpec, joints: Sequence[str]) -> list[str]:
    for name in joints:
        motor = spec.add_actuator(name=motor_name(name), target=name, trntype=mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
    return [f"drive: {', '.join(map(repr, joints))} got motors"]


def _nothing_steers(car: Anatomy, responses: Sequence[Response], asked: Response | None = None) -> tuple[str, str]:
    wheels = ", ".join(repr(wheel.joint) for wheel in car.wheels)
    said = f"{asked.name!r} steers no wheel" if asked else "nothing steers: no upright hinge carries a wheel"
    return (
        f"{said}; found {len(car.wheels)} wheels ({wheels}) on {car.root!r} and {_acts(car, responses)}",
        "steering = [...]: actuators that turn wheels about their kingpins, or hinges that do",
    )


def _nothing_drives(names: Sequence[str], responses: Sequence[Response]) -> tuple[str, str]:
    able = [r.name for r in responses if r.spun and r.kind in (RATE, TORQUE)]
    return f"{', '.join(map(repr, names))} push no wheel ahead", ", ".join(
        able
    ) or "motors or velocity servos of wheels"


def _acts(car: Anatomy, responses: Sequence[Response]) -> str:
    def does(response: Response) -> str:
        if response.turned:
            return f"steers {', '.join(repr(car.wheels[i].joint) for i in response.turned)} (control: {response.kind})"
        return (
            f"spins {', '.join(repr(car.wheels[i].joint) for i, _ in response.spun)}" if response.spun else "moves none"
        )

    if not responses:
        return "no actuator"
    return f"{len(responses)} actuators: " + "; ".join(f"{response.name!r} {does(response)}" for response in responses)
