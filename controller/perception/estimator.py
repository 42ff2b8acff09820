"""The state estimator as a Python object: measurements in, VehicleState and covariance out."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.memory import packed, unpacked
from sidestep.controller.mpc.car_model import Car, least_slope
from sidestep.controller.perception.filter_history import look, step, tell
from sidestep.controller.perception.state_estimator import (
    BIAS,
    ESTIMATE,
    ESTIMATOR,
    FILTER,
    LATERAL,
    MEASUREMENT,
    NAMES,
    SIGNAL_NAMES,
    SLOTS,
    STATES,
)  # fmt: skip
from sidestep.controller.records import CAR, filled, record
from sidestep.plant_models.ranges import Range, check
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

VERSION = 1
"""Of the record; rises with every change of `ESTIMATE`."""
_NAME = b"estimate"


@dataclass(frozen=True, slots=True)
class Measurement:
    """What sensors say at one time; NaN where they say nothing.

    Attributes:
        time: Of all signals but the pose, in [s].
        x, y, yaw: Pose of the reference point, in [m] and [rad].
        v_x, v_y: Velocity of the reference point, in [m/s]; v_x from the wheels.
        yaw_rate: In [rad/s].
        steer_angle: Road-wheel angle, in [rad].
        lateral_acceleration: That an accelerometer feels, gravity included, in [m/s^2].
        pose_time: Of x, y and yaw, in [s]; NaN if they are of `time`.
    """

    time: float
    x: float = math.nan
    y: float = math.nan
    yaw: float = math.nan
    v_x: float = math.nan
    v_y: float = math.nan
    yaw_rate: float = math.nan
    steer_angle: float = math.nan
    lateral_acceleration: float = math.nan
    pose_time: float = math.nan


@dataclass(frozen=True)
class EstimatorConfig:
    """What the filter believes of sensors and model.

    Attributes:
        position_noise, yaw_noise, v_x_noise, v_y_noise, yaw_rate_noise, steer_noise, lateral_noise: Standard deviations
            of the signals, white from sample to sample: x and y each, yaw, speeds, yaw rate, steering angle, lateral
            acceleration.
        position_walk, yaw_walk, v_x_walk, v_y_walk, yaw_rate_walk, steer_walk: What the model does not know of the
            motion: standard deviation of the random walk that each state does in a second.
        force_doubt: What the tyre law does not know of an axle's force, as a share of it: standard deviation of the
            random walk of the momentum it gives in a second.
        free_steer_walk: That of the steering angle where no command is known.
        bias_walk, offset_walk, share_walk: That of the yaw-rate bias, of both steering offsets, of the lateral force.
        start_v_y, start_bias, start_offset, start_share: Standard deviations before anything is known.
        gate: Share of good measurements that pass.
        patience: Measurements of a signal rejected in a row after which the sensor is believed, not the filter.
        reach: Lateness of a measurement that is still used, in [s].
        front_stiffness, rear_stiffness: Cornering stiffness of the axle over that of its tyres: what steering and
            suspension give way.
        lever: Distance of the accelerometer ahead of the reference point, in [m].
        rolling, sliding: Speeds up to which the car rolls where its wheels point, and from which on it slides as its
            tyres do, in [m/s].
        rolling_v_y, rolling_yaw_rate: Standard deviations about the rolling car.
    """

    position_noise: Annotated[float, Range(1e-4, 1e3, "m")] = 0.02
    yaw_noise: Annotated[float, Range(1e-5, 3.2, "rad")] = 0.0035
    v_x_noise: Annotated[float, Range(1e-4, 1e2, "m/s")] = 0.05
    v_y_noise: Annotated[float, Range(1e-4, 1e2, "m/s")] = 0.1
    yaw_rate_noise: Annotated[float, Range(1e-6, 10.0, "rad/s")] = 0.005
    steer_noise: Annotated[float, Range(1e-6, 1.0, "rad")] = 0.001
    lateral_noise: Annotated[float, Range(1e-4, 1e2, "m/s²")] = 0.2
    position_walk: Annotated[float, Range(0.0, 1e2, "m/√s")] = 0.001
    yaw_walk: Annotated[float, Range(0.0, 1.0, "rad/√s")] = 1e-4
    v_x_walk: Annotated[float, Range(0.0, 1e2, "m/s/√s")] = 1.0
    v_y_walk: Annotated[float, Range(0.0, 1e2, "m/s/√s")] = 0.05
    yaw_rate_walk: Annotated[float, Range(0.0, 1e2, "rad/s/√s")] = 0.02
    steer_walk: Annotated[float, Range(0.0, 10.0, "rad/√s")] = 0.002
    free_steer_walk: Annotated[float, Range(0.0, 10.0, "rad/√s")] = 0.1
    force_doubt: Annotated[float, Range(0.0, 1.0, "√s")] = 0.05
    bias_walk: Annotated[float, Range(0.0, 1.0, "rad/s/√s")] = 1e-4
    offset_walk: Annotated[float, Range(0.0, 1.0, "rad/√s")] = 1e-4
    share_walk: Annotated[float, Range(0.0, 1.0, "1/√s")] = 0.002
    start_v_y: Annotated[float, Range(0.0, 100.0, "m/s")] = 0.5
    start_bias: Annotated[float, Range(0.0, 1.0, "rad/s")] = 0.01
    start_offset: Annotated[float, Range(0.0, 1.0, "rad")] = 0.005
    start_share: Annotated[float, Range(0.0, 1.0)] = 0.02
    gate: Annotated[float, Range(0.5, 1.0 - 1e-12)] = 0.999
    patience: Annotated[int, Range(1, 1_000_000)] = 10
    reach: Annotated[float, Range(0.0, 0.5, "s")] = 0.5
    front_stiffness: Annotated[float, Range(0.1, 10.0)] = 1.0
    rear_stiffness: Annotated[float, Range(0.1, 10.0)] = 1.0
    lever: Annotated[float, Range(-50.0, 50.0, "m")] = 0.0
    rolling: Annotated[float, Range(0.5, 10.0, "m/s")] = 2.0
    sliding: Annotated[float, Range(0.6, 20.0, "m/s")] = 4.0
    rolling_v_y: Annotated[float, Range(1e-4, 10.0, "m/s")] = 0.05
    rolling_yaw_rate: Annotated[float, Range(1e-4, 10.0, "rad/s")] = 0.02

    def __post_init__(self) -> None:
        check(self, "estimator")
        Range(self.rolling + 0.1, 20.0, "m/s").check(self.sliding, "estimator.sliding")


def estimator_settings(car: Car, c: EstimatorConfig) -> NDArray[np.void]:
    """Record of `ESTIMATOR`, shape (1,)."""
    return filled(ESTIMATOR, {
        "noise": [c.position_noise, c.position_noise, c.yaw_noise, c.v_x_noise, c.v_y_noise, c.yaw_rate_noise,
                  c.steer_noise, c.lateral_noise],
        "walk": [c.position_walk, c.position_walk, c.yaw_walk, c.v_x_walk, c.v_y_walk, c.yaw_rate_walk, c.steer_walk,
                 c.bias_walk, c.offset_walk, c.offset_walk, c.share_walk],
        "start": [1e3, 1e3, math.pi, 50.0, c.start_v_y, 1.0, 0.5, c.start_bias, c.start_offset, c.start_offset,
                  c.start_share],
        "free_steer": c.free_steer_walk, "doubt": c.force_doubt, "kinematic": (c.rolling_v_y, c.rolling_yaw_rate),
        "gate": (NormalDist().inv_cdf(0.5 + 0.5 * c.gate) ** 2, -2.0 * math.log(1.0 - c.gate)),
        "patience": c.patience, "reach": c.reach, "lever": c.lever, "steer_limit": car.steer_limit,
        "least": (least_slope(car.stiffness_f, car.load_f, car), least_slope(car.stiffness_r, car.load_r, car)),
        "stiffness": (c.front_stiffness, c.rear_stiffness), "blend": (c.rolling, c.sliding),
    })  # fmt: skip


class StateEstimator:
    """An extended Kalman filter behind `reset` and `step`.

    Deterministic: the same measurements give the same states, bit for bit. Nothing raises in `step`: what does not fit
    is left out and counted.
    """

    def __init__(self, vehicle: VehicleParameters, config: EstimatorConfig | None = None, friction: float = 1.0):
        """Load the kernels.

        Args:
            vehicle: The car.
            config: What is believed of its sensors.
            friction: That is believed of the road, as a factor on the tyre's peak.
        """
        self.config = config or EstimatorConfig()
        car = Car.of(vehicle, True, friction)
        self._car = filled(CAR, car._asdict() | {"body": car.body._asdict()})
        self._settings = estimator_settings(car, self.config)
        self._work, self._measured, self._out = record(FILTER), record(MEASUREMENT), np.zeros(STATES + 1)
        self.reset()
        self.step(Measurement(0.0, v_x=10.0))  # so that nothing is left to be loaded on the road
        self.tell(0.0)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._estimate = record(ESTIMATE)
        self._estimate["misfits"][0, :LATERAL] = self.config.patience  # the first of each is believed
        self._out[:] = 0.0

    def step(self, measurement: Measurement) -> VehicleState:
        """Take a measurement, in time or late.

        Returns:
            The state at the newest time that was measured, its steering angle that of the tyres; zeros before the first
            time that can be used.
        """
        m, taken = measurement, self._measured[0]
        taken["time"], taken["pose_time"] = m.time, m.pose_time
        taken["z"] = m.x, m.y, m.yaw, m.v_x, m.v_y, m.yaw_rate, m.steer_angle, m.lateral_acceleration
        step(self._estimate, self._settings, self._car, self._measured, self._work, self._out)
        return self.state

    def tell(self, steer_angle: float, acceleration: float = math.nan) -> None:
        """What the car is told at the newest time, to hold until it is told something else.

        Args:
            steer_angle: Road-wheel angle commanded, in [rad]; NaN, as before the first call: nobody knows.
            acceleration: Change of v_x that is expected, in [m/s^2]; NaN if none is.
        """
        tell(self._estimate, steer_angle, acceleration)

    @property
    def state(self) -> VehicleState:
        """At the newest time that was measured."""
        return VehicleState(*self._out[:8].tolist())

    @property
    def disturbances(self) -> dict[str, float]:
        """What the model does not know, by name: see `state_estimator`."""
        return dict(zip(NAMES[BIAS:], self._out[1 + BIAS :].tolist(), strict=True))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of the states in the order of `state_estimator.NAMES`, shape (11, 11), SI units; zeros before the first."""
        e = self._estimate[0]
        if not e["count"]:
            return np.zeros((STATES, STATES))
        return e["slots"]["P"][(e["first"] + e["count"] - 1) % SLOTS].copy()

    @property
    def rejected(self) -> dict[str, int]:
        """How many measurements did not fit, by signal; how many came too late; how many had no usable time."""
        e = self._estimate[0]
        counts = dict(zip(SIGNAL_NAMES, e["rejected"].tolist(), strict=True))
        return counts | {"too_late": int(e["too_late"]), "unusable": int(e["unusable"])}

    @property
    def innovations(self) -> NDArray[np.float64]:
        """Innovation and its variance of each signal of the last record, shape (8, 2); NaN where it has none."""
        e = self._estimate[0]
        return np.column_stack([e["innovation"], e["innovation_variance"]])

    @property
    def normalised_square(self) -> tuple[float, int]:
        """Normalised innovations squared of the last record, and their degrees of freedom."""
        return float(self._estimate["nis"][0]), int(self._estimate["degrees"][0])

    def save(self) -> bytes:
        """All that is kept from step to step, for `restore`."""
        return packed(self._estimate, _NAME, VERSION)

    def restore(self, memory: bytes) -> None:
        """Go on from where `save` was called, bit for bit, with an estimator of the same car and settings.

        Raises:
            InputError: The bytes are not of an estimator of this version, or damaged.
        """
        self._estimate = unpacked(memory, ESTIMATE, _NAME, VERSION)
        look(self._estimate, self._out)
