"""Where the wheels of somebody else's car point, in a model that it is part of."""

import math

import mujoco
import numpy as np

from sidestep.plant_models.mujoco.foreign.car import ForeignCar
from sidestep.plant_models.mujoco.loop import ackermann


class Layout:
    """Numbers of the car's parts in one model.

    Attributes:
        root: Body.
        joints: Of the wheels.
        spins: Their velocities in `qvel`.
        senses: +1 where the joint points to the left.
        offsets: Of the wheels from the middle of the car, over the wheelbase, left positive.
    """

    def __init__(self, model: mujoco.MjModel, car: ForeignCar):
        self.root = model.body(car.root).id
        self.joints = [int(model.joint(wheel.joint).id) for wheel in car.wheels]
        self.spins = [int(model.jnt_dofadr[joint]) for joint in self.joints]
        self.senses, self._forward, self.front = car.senses, car.forward.tolist(), car.front
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        cos, sin = self.heading(data)
        places = np.array([wheel.centre[:2] for wheel in car.wheels]) @ [-sin, cos]
        self.offsets = ((places - 0.5 * (places.max() + places.min())) / car.wheelbase).tolist()

    def heading(self, data: mujoco.MjData) -> tuple[float, float]:
        """Cosine and sine of the car's yaw."""
        m, (a, b, c) = data.xmat[self.root].tolist(), self._forward
        x, y = m[0] * a + m[1] * b + m[2] * c, m[3] * a + m[4] * b + m[5] * c
        length = math.hypot(x, y)
        return x / length, y / length

    def wheel_angle(self, data: mujoco.MjData, wheel: int) -> float:
        """Of one wheel against the car's heading, left positive, in [rad]."""
        (cos, sin), sense = self.heading(data), self.senses[wheel]
        x, y, _ = data.xaxis[self.joints[wheel]].tolist()
        return math.atan2(-sense * (x * cos + y * sin), sense * (y * cos - x * sin))

    def centre_angle(self, data: mujoco.MjData, wheel: int) -> float:
        """The same of a wheel in the middle of the axle that turns about the same point."""
        return float(ackermann(self.wheel_angle(data, wheel), -self.offsets[wheel]))

    def steer_angle(self, data: mujoco.MjData, wheels: tuple[int, ...] = ()) -> float:
        """Road-wheel angle: mean of the centre angles of some wheels, all in front if none are named."""
        chosen = wheels or self.front
        return sum(self.centre_angle(data, wheel) for wheel in chosen) / len(chosen)
