"""The car on a bench, wheels in the air: what each actuator moves, and by how much.

Asking the model instead of its names finds servos behind racks, tie rods, tendons, gears and coupled joints alike.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import mjtBias, mjtDyn, mjtGain
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.foreign.anatomy import Anatomy

Array = NDArray[np.float64]

POSITION, RATE, TORQUE, OTHER = "position", "rate", "torque", "other"
"""What an actuator's control means: where to, how fast, how hard; or none of these."""

ABSURD = 1e5
"""No joint moves that fast, in [m/s] or [rad/s]."""

_TEST = 0.3  # time of a test, in [s]
_SHARE = 0.3  # of the control's range that a test asks for
_TURNS, _SPINS = 0.02, 0.1  # of a wheel about its kingpin [rad], of its rim [m/s]: what counts as moved
_GENTLE = 500.0  # acceleration of a joint that a test may ask for at most, in [rad/s^2]


@dataclass(frozen=True)
class Response:
    """What an actuator moves.

    Attributes:
        name: Of the actuator.
        kind: POSITION, RATE, TORQUE or OTHER.
        low, high: Range of its control, infinite for none.
        turned: Numbers of the wheels that it turns about their kingpins.
        spun: Number and rate [rad/s] of the wheels that it spins, about their joints' axes.
        rate: Of the actuator then.
    """

    name: str
    kind: str
    low: float
    high: float
    turned: tuple[int, ...]
    spun: tuple[tuple[int, float], ...]
    rate: float


class Bench:
    """A model whose root is fixed, without gravity and contacts.

    Attributes:
        model, data: To be stepped.
    """

    def __init__(self, model: mujoco.MjModel, car: Anatomy, hold: dict[str, float]):
        """Put a model on the bench.

        Args:
            model: See `file.without_freedom`.
            car: Its parts.
            hold: Controls that actuators have all the time.
        """
        self.model, self.data, self.car = model, mujoco.MjData(model), car
        self.joints = [model.joint(wheel.joint).id for wheel in car.wheels]
        self._left = np.array([wheel.axle for wheel in car.wheels])
        self.neutral = np.array([hold.get(model.actuator(i).name, at_rest(model, i)) for i in range(model.nu)])

    def reset(self) -> None:
        """Back to the pose of the file, all controls at rest."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.ctrl[:] = self.neutral

    def steps(self, duration: float) -> int:
        """Number of steps that last so long, in [s]."""
        return max(1, round(duration / self.model.opt.timestep))

    def step(self, count: int = 1) -> None:
        """Make steps.

        Raises:
            InputError: The model diverges.
        """
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            if not np.abs(self.data.qvel).max(initial=0.0) < ABSURD:
                raise InputError(
                    "model", f"diverges on a bench after {self.data.time:.3f} s, root fixed and wheels in the air",
                    "softer servos, or a shorter option.timestep",
                )  # fmt: skip

    def axles(self) -> Array:
        """Axle directions now, shape (n, 3)."""
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.xaxis[self.joints].copy()

    def spins(self) -> Array:
        """Spin rates of the wheels, in [rad/s]."""
        return self.data.qvel[self.model.jnt_dofadr[self.joints]].copy()

    def response(self, actuator: int) -> Response:
        """Ask an actuator for a little, one way and the other, and see what moves."""
        turned, spun, rate = self._moved(actuator)
        rims = np.array([wheel.radius for wheel in self.car.wheels]) * spun
        moved = np.flatnonzero(np.abs(rims) > max(_SPINS, 0.1 * np.abs(rims).max()))
        steers = tuple(np.flatnonzero(turned > max(_TURNS, 0.1 * turned.max())).tolist())
        return Response(
            self.model.actuator(actuator).name, kind_of(self.model, actuator), *control_range(self.model, actuator),
            turned=steers, spun=() if steers else tuple((int(i), float(spun[i])) for i in moved), rate=rate,
        )  # fmt: skip

    def _moved(self, actuator: int) -> tuple[Array, Array, float]:
        """By how much each wheel turned and, at the end, spun, and the actuator's speed then."""
        turned, spun, rate = np.zeros(len(self.joints)), np.zeros(len(self.joints)), 0.0
        rest_axles, rest_spins, _ = self._test(actuator, self.neutral[actuator])
        for way in (1.0, -1.0):
            axles, spins, pace = self._test(actuator, self._asked(actuator, way))
            turned = np.maximum(turned, np.abs([_angle(a, b) for a, b in zip(rest_axles, axles, strict=True)]))
            if np.abs(spins - rest_spins).max() > np.abs(spun).max():
                spun, rate = spins - rest_spins, pace
        return turned, spun, rate

    def _asked(self, actuator: int, way: float) -> float:
        """A gentle control, on one side of the one at rest."""
        low, high = control_range(self.model, actuator)
        rest, limit = self.neutral[actuator], high if way > 0.0 else low
        asked = _SHARE * (limit - rest) if math.isfinite(limit) else way * (0.3 if self._is_servo(actuator) else 10.0)
        if self._is_servo(actuator):
            return rest + asked
        self.reset()
        mujoco.mj_forward(self.model, self.data)
        before = self.data.qacc.copy()
        self.data.ctrl[actuator] = rest + asked
        mujoco.mj_forward(self.model, self.data)
        most = np.abs(self.data.qacc - before).max(initial=0.0)
        is_rate = kind_of(self.model, actuator) == RATE
        return rest + asked * (1.0 if is_rate else min(1.0, _GENTLE / max(most, 1e-9)))

    def _is_servo(self, actuator: int) -> bool:
        return kind_of(self.model, actuator) == POSITION

    def _test(self, actuator: int, control: float) -> tuple[Array, Array, float]:
        self.reset()
        self.data.ctrl[actuator] = control
        self.step(self.steps(_TEST))
        mujoco.mj_forward(self.model, self.data)  # velocities of actuators are one step old after a step
        return self.axles(), self.spins(), float(self.data.actuator_velocity[actuator])


def kind_of(model: mujoco.MjModel, actuator: int) -> str:
    """What an actuator's control means."""
    if model.actuator_gaintype[actuator] != mjtGain.mjGAIN_FIXED:
        is_pid = model.actuator_gaintype[actuator] == mjtGain.mjGAIN_PID
        return POSITION if is_pid else OTHER
    dynamics, bias = model.actuator_dyntype[actuator], model.actuator_biastype[actuator]
    if bias == mjtBias.mjBIAS_NONE:
        return OTHER if dynamics == mjtDyn.mjDYN_INTEGRATOR else TORQUE
    if bias != mjtBias.mjBIAS_AFFINE:
        return OTHER
    _, stiffness, damping = model.actuator_biasprm[actuator, :3]
    if stiffness != 0.0:
        return RATE if dynamics == mjtDyn.mjDYN_INTEGRATOR else POSITION
    return RATE if damping != 0.0 else TORQUE


def control_range(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Lowest and highest control, infinite for none."""
    if not model.actuator_ctrllimited[actuator]:
        return -math.inf, math.inf
    low, high = model.actuator_ctrlrange[actuator]
    return float(low), float(high)


def at_rest(model: mujoco.MjModel, actuator: int) -> float:
    """The control that asks for nothing: zero, or what of its range is next to it."""
    low, high = control_range(model, actuator)
    return min(max(0.0, low), high)


def _angle(a: Array, b: Array) -> float:
    """Between two axles as seen from above, in [rad]."""
    return math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
