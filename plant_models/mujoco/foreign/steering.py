"""How somebody else's car is steered: an angle at the wheels, through whatever actuators it has.

A servo is told the place that stands for the angle on the bench, and a trim for what the road makes it give way. An
actuator that is told a rate or a torque gets a control loop around the angle that the wheels have.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.foreign.anatomy import Array
from sidestep.plant_models.mujoco.foreign.bench import POSITION, RATE, TORQUE, Bench, Response, control_range
from sidestep.plant_models.mujoco.foreign.car import ForeignCar
from sidestep.plant_models.mujoco.foreign.layout import Layout

_LARGEST = 0.7  # road-wheel angle that is looked for, in [rad]
_PLACES = 15  # of a servo that are tried
_SETTLED, _PATIENCE = 1e-5, 2.0  # change of angle in a settled while [rad], longest wait [s]
_RATE_GAIN, _RATE_SHARE = 20.0, 0.2  # of the loop around a rate, in [1/s]; at most over the time step
_NATURAL, _NATURAL_SHARE = 50.0, 0.15  # the same around a torque, in [rad/s]
_TRIM_TIME, _TRIM = 0.5, 0.03  # in which a servo's lasting error is trimmed away [s], and how much of it [rad]
_RESET_TIME = 0.1  # of the loops' integrals, in [s]
_WINDUP = 0.1  # error up to which they integrate, in [rad]


@dataclass(frozen=True)
class Lock:
    """One steering actuator between its stops.

    Attributes:
        response: The actuator.
        angles: Road-wheel angles, rising, in [rad].
        controls: Of a servo at these angles.
        places: Of the joints that it moves at these angles, by name; rows of `qpos`.
        gain: Change of the angle's rate per control [1/s], or of its acceleration [1/s^2]; 1 of a servo.
    """

    response: Response
    angles: Array
    controls: Array
    places: dict[str, Array]
    gain: float


class Steering:
    """The steering of the car in one model."""

    def __init__(self, model: mujoco.MjModel, car: ForeignCar, locks: tuple[Lock, ...]):
        """Find the actuators of `locks` in a model."""
        self._model, self._layout, self._locks = model, Layout(model, car), locks
        self._actuators = [model.actuator(lock.response.name).id for lock in locks]
        self.reset()

    @property
    def limit(self) -> float:
        """Largest angle that all of them reach, either way, in [rad]."""
        return float(min(min(-lock.angles[0], lock.angles[-1]) for lock in self._locks))

    def reset(self) -> None:
        """Forget the past."""
        self._sums = [0.0] * len(self._locks)
        self._before = [math.nan] * len(self._locks)

    def place(self, data: mujoco.MjData, angle: float) -> None:
        """Set joints, controls and activations as if the wheels had stood at an angle [rad] for long."""
        for lock, actuator in zip(self._locks, self._actuators, strict=True):
            for name, rows in lock.places.items():
                joint = self._model.joint(name)
                for k in range(rows.shape[1]):
                    data.qpos[joint.qposadr[0] + k] = np.interp(angle, lock.angles, rows[:, k])
            control = float(np.interp(angle, lock.angles, lock.controls))
            data.ctrl[actuator] = control
            if (activation := self._model.actuator_actadr[actuator]) >= 0:
                mujoco.mj_kinematics(self._model, data)
                mujoco.mj_transmission(self._model, data)
                is_servo = lock.response.kind == POSITION
                data.act[activation] = control if is_servo else data.actuator_length[actuator]
                if lock.response.kind == TORQUE:
                    data.act[activation] = 0.0

    def act(self, data: mujoco.MjData, angle: float, dt: float) -> None:
        """Set the controls for an angle [rad] in the next step of dt [s]."""
        for i, (lock, actuator) in enumerate(zip(self._locks, self._actuators, strict=True)):
            now = self._layout.steer_angle(data, lock.response.turned)
            if lock.response.kind == POSITION:
                trim = self._sums[i] + dt / _TRIM_TIME * (min(max(angle, lock.angles[0]), lock.angles[-1]) - now)
                self._sums[i] = min(max(trim, -_TRIM), _TRIM)
                data.ctrl[actuator] = np.interp(angle + self._sums[i], lock.angles, lock.controls)
                continue
            rate = 0.0 if math.isnan(self._before[i]) else (now - self._before[i]) / dt
            self._before[i], error = now, min(max(angle, lock.angles[0]), lock.angles[-1]) - now
            if abs(error) < _WINDUP:
                self._sums[i] += error * dt
            data.ctrl[actuator] = min(max(self._asked(lock, i, error, rate, dt), lock.response.low), lock.response.high)

    def _asked(self, lock: Lock, i: int, error: float, rate: float, dt: float) -> float:
        if lock.response.kind == RATE:
            gain = min(_RATE_GAIN, _RATE_SHARE / dt)
            return gain * (error + self._sums[i] / _RESET_TIME) / lock.gain
        natural = min(_NATURAL, _NATURAL_SHARE / dt)
        return natural * (natural * (error + self._sums[i] / _RESET_TIME) - 2.0 * rate) / lock.gain

    def angle(self, data: mujoco.MjData) -> float:
        """Road-wheel angle now, in [rad]."""
        return self._layout.steer_angle(data)


def locks_of(car: ForeignCar) -> tuple[Lock, ...]:
    """Move every steering actuator from stop to stop on the bench.

    Raises:
        InputError: One does not reach the wheels' straight-ahead, or hardly turns them.
    """
    bench = car.bench()
    return tuple(_lock(car, bench, response) for response in car.steers)


def _lock(car: ForeignCar, bench: Bench, response: Response) -> Lock:
    actuator = bench.model.actuator(response.name).id
    sweep = _servo if response.kind == POSITION else _ends
    rows = sorted(sweep(car, bench, response, actuator), key=lambda row: row[0])
    angles = np.array([angle for angle, _, _ in rows])
    keep = np.concatenate([[True], np.diff(angles) > 1e-6])
    keep &= np.abs(angles) <= _LARGEST + 0.1
    angles = angles[keep]
    if len(angles) < 2 or not angles[0] < 0.0 < angles[-1]:
        found = f"{angles[0]:.3g} to {angles[-1]:.3g} rad" if len(angles) else "no angle"
        raise InputError(
            f"{car.label}: steering", f"{response.name!r} turns its wheels from {found}, not to both sides",
            "an actuator that does",
        )  # fmt: skip
    places = _places(car, bench, np.array([pose for _, _, pose in rows])[keep])
    gain = 1.0 if response.kind == POSITION else _gain(car, bench, response, actuator)
    return Lock(response, angles, np.array([control for _, control, _ in rows])[keep], places, gain)


def _places(car: ForeignCar, bench: Bench, poses: Array) -> dict[str, Array]:
    """The joints that moved from pose to pose, but for the wheels' own, with their rows of `qpos`."""
    spins, places = {wheel.joint for wheel in car.wheels}, {}
    for number in range(bench.model.njnt):
        joint = bench.model.joint(number)
        first, width = joint.qposadr[0], 4 if joint.type[0] == mujoco.mjtJoint.mjJNT_BALL else 1
        moved = poses[:, first : first + width]
        if joint.name not in spins and np.ptp(moved, axis=0).max() > 1e-6:
            places[joint.name] = moved
    return places


def _servo(car: ForeignCar, bench: Bench, response: Response, actuator: int) -> list[tuple[float, float, Array]]:
    """Angle, control and pose at controls spread over the range."""
    low, high = response.low, response.high
    low = -_stop(car, bench, response, actuator, -1.0) if math.isinf(low) else low
    high = _stop(car, bench, response, actuator, 1.0) if math.isinf(high) else high
    bench.reset()
    return [
        (_settled(car, bench, response, actuator, control), control, bench.data.qpos.copy())
        for control in np.linspace(low, high, _PLACES).tolist()
    ]


def _stop(car: ForeignCar, bench: Bench, response: Response, actuator: int, way: float) -> float:
    """Size of the control beyond which a servo without a range turns its wheels no further, or far enough."""
    size, before = 0.05, 0.0
    bench.reset()
    for _ in range(40):
        angle = abs(_settled(car, bench, response, actuator, way * size))
        if angle >= _LARGEST or (before > 0.05 and angle < before * 1.02):
            return size
        size, before = 1.3 * size, angle
    return size


def _settled(car: ForeignCar, bench: Bench, response: Response, actuator: int, control: float) -> float:
    layout, data = Layout(bench.model, car), bench.data
    data.ctrl[actuator] = control
    last = math.inf
    for _ in range(round(_PATIENCE / 0.1)):
        bench.step(bench.steps(0.1))
        mujoco.mj_kinematics(bench.model, data)
        angle = layout.steer_angle(data, response.turned)
        if abs(angle - last) < _SETTLED:
            break
        last = angle
    return layout.steer_angle(data, response.turned)


def _ends(car: ForeignCar, bench: Bench, response: Response, actuator: int) -> list[tuple[float, float, Array]]:
    """Angle, control at rest and pose on the way from stop to stop, led there by the joints' own motion."""
    layout, rows = Layout(bench.model, car), []
    rest = bench.neutral[actuator]
    for way in (1.0, -1.0):
        bench.reset()
        low, high = control_range(bench.model, actuator)
        end = high if way > 0.0 else low
        bench.data.ctrl[actuator] = end if math.isfinite(end) else rest + way
        most = -math.inf
        for _ in range(bench.steps(3.0)):
            bench.step()
            mujoco.mj_kinematics(bench.model, bench.data)
            angle = layout.steer_angle(bench.data, response.turned)
            if abs(angle) > _LARGEST:
                break
            if abs(angle) > most + 0.005:
                most = abs(angle)
                rows.append((angle, rest, bench.data.qpos.copy()))
    return rows


def _gain(car: ForeignCar, bench: Bench, response: Response, actuator: int) -> float:
    """What a unit of control does to the angle: its rate where that is told, else its acceleration."""
    layout, data, found = Layout(bench.model, car), bench.data, []
    low, high = response.low, response.high
    size = min(-low, high, 1.0)
    size = size if math.isfinite(size) and size > 0.0 else 1.0
    steps = bench.steps(0.05) if response.kind == RATE else 1
    for control in (size, -size):
        bench.reset()
        mujoco.mj_forward(bench.model, data)
        data.ctrl[actuator] = control
        bench.step(steps)
        mujoco.mj_kinematics(bench.model, data)
        before = layout.steer_angle(data, response.turned)
        bench.step()
        mujoco.mj_kinematics(bench.model, data)
        found.append((layout.steer_angle(data, response.turned) - before) / bench.model.opt.timestep)
    change = (found[0] - found[1]) / 2.0
    if response.kind == RATE:
        return change / size
    return change / bench.model.opt.timestep / size
