"""How somebody else's car is driven: a speed to hold, through its motors or velocity servos.

The acceleration that our speed control asks for becomes a force at the rims; an integral makes up for what rolling
costs. Motors are told a torque; servos of velocity are told the speed that they have and, on top, what their gain makes
of that torque.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import mjtDyn

from sidestep.plant_models.mujoco.foreign.bench import Response
from sidestep.plant_models.mujoco.foreign.car import ForeignCar, push
from sidestep.plant_models.mujoco.foreign.layout import Layout
from sidestep.plant_models.speed_control import limited_acceleration

MAX_BRAKING, MAX_ACCELERATION = 8.0, 3.0
"""What the speed control asks for at most, where motors and grip allow it, in [m/s^2]."""
_GRIP = 0.8  # share of it that is asked for
_INTEGRAL, _WINDUP = 1.0, 0.5  # of the speed error, in [1/s^2]; error up to which it counts, in [m/s]
_LET_GO = (0.15, 0.3)  # slip at which the wheels are let go, over the speed and in [m/s]
_AHEAD = 0.1  # by which an integrating servo's speed leads, in [s]


@dataclass(frozen=True)
class _Unit:
    actuator: int
    is_rate: bool
    integrates: bool
    ratio: float  # speed of the actuator over the rate of its wheels
    speed: float  # of the actuator per speed of the car, in [1/m]
    gain: float  # force per control
    damping: float  # force per speed of the actuator
    low: float  # force at the rims, in [N]
    high: float
    wheels: tuple[int, ...]


class Drive:
    """The drive of the car in one model.

    Attributes:
        max_braking, max_acceleration: What it can do, in [m/s^2].
    """

    def __init__(self, model: mujoco.MjModel, car: ForeignCar, grip: float, radii: np.ndarray):
        """Find the actuators in a model.

        Args:
            model: The car in its world.
            car: Its parts.
            grip: Friction times load of all driven wheels, in [N].
            radii: Rolling radii of the wheels, in [m].
        """
        self._layout, self._radii = Layout(model, car), radii
        self._units = [_unit(model, drive, push(drive, car.senses), radii) for drive in car.drives]
        self._driven = sorted({wheel for drive in car.drives for wheel, _ in drive.spun})
        spins = sum(float(model.dof_M0[self._layout.spins[i]]) / radii[i] ** 2 for i in range(len(radii)))
        self._mass = float(model.body_subtreemass[self._layout.root]) + spins
        most, least = _GRIP * grip, -_GRIP * grip
        forward = min(most, sum(unit.high for unit in self._units))
        backward = max(least, sum(unit.low for unit in self._units))
        self.max_acceleration = float(min(MAX_ACCELERATION, forward / self._mass))
        self.max_braking = float(min(MAX_BRAKING, -backward / self._mass))
        self._forward, self._backward = forward, backward
        self.reset()

    @property
    def driven(self) -> list[int]:
        """Numbers of the driven wheels."""
        return self._driven

    def reset(self) -> None:
        """Forget the past."""
        self._sum = 0.0

    def act(self, data: mujoco.MjData, speed: float, target: float, dt: float, slope: float = 0.0) -> None:
        """Set the controls for a target speed.

        Args:
            data: The car in its world.
            speed: Now, in [m/s].
            target: In [m/s].
            dt: Of the next step, in [s].
            slope: Acceleration along the car by the road's slope, in [m/s^2].
        """
        demand = limited_acceleration(speed, target, self.max_braking, self.max_acceleration)
        if abs(target - speed) < _WINDUP:
            self._sum += _INTEGRAL * (target - speed) * dt
        force = min(max(self._mass * (demand + self._sum - slope), self._backward), self._forward)
        force = 0.0 if self._slips(data, speed, force) else force
        able = [unit for unit in self._units if (unit.high if force > 0.0 else -unit.low) > 0.0]
        share = sum(unit.speed**2 for unit in able)
        for unit in self._units:
            own = force * unit.speed / share if unit in able else 0.0  # force of the actuator
            data.ctrl[unit.actuator] = _control(unit, own, self._rolling(data, unit), demand)

    def _rolling(self, data: mujoco.MjData, unit: _Unit) -> float:
        """Speed of the actuator now, from its wheels: MuJoCo's own is one step old."""
        rates = [self._layout.senses[i] * data.qvel[self._layout.spins[i]] for i in unit.wheels]
        return unit.ratio * float(sum(rates)) / len(rates)

    def _slips(self, data: mujoco.MjData, speed: float, force: float) -> bool:
        limit = max(_LET_GO[0] * abs(speed), _LET_GO[1])
        for i in self._driven:
            rim = self._layout.senses[i] * data.qvel[self._layout.spins[i]] * self._radii[i]
            if (rim - speed) * math.copysign(1.0, force) > limit:
                return True
        return False


def _control(unit: _Unit, force: float, rolling: float, demand: float) -> float:
    if unit.integrates:
        return rolling + _AHEAD * unit.speed * demand
    if unit.is_rate:
        return (force + unit.damping * rolling) / unit.gain
    return force / unit.gain


def _unit(model: mujoco.MjModel, drive: Response, ratio: float, radii: np.ndarray) -> _Unit:
    """An actuator, with the least and largest force at the rims that it can make when the car stands."""
    actuator, wheels = int(model.actuator(drive.name).id), tuple(i for i, _ in drive.spun)
    speed = ratio / float(np.mean(radii[list(wheels)]))
    gain, damping = float(model.actuator_gainprm[actuator, 0]), -float(model.actuator_biasprm[actuator, 2])
    is_rate, integrates = damping > 0.0, model.actuator_dyntype[actuator] == mjtDyn.mjDYN_INTEGRATOR
    forces = [-math.inf, math.inf]
    if model.actuator_ctrllimited[actuator] and not is_rate:
        forces = sorted(gain * float(end) for end in model.actuator_ctrlrange[actuator])
    if model.actuator_forcelimited[actuator]:
        low, high = model.actuator_forcerange[actuator]
        forces = [max(forces[0], float(low)), min(forces[1], float(high))]
    low, high = sorted(force * speed for force in forces)
    return _Unit(actuator, is_rate, bool(integrates), ratio, speed, gain, damping, low, high, wheels)
