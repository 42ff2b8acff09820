"""A tyre test rig: the MuJoCo car led in a straight crab walk, or held over a moving belt."""

import math

import numpy as np

from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState

_STEP = 1e-3  # [s]
_NO_BRAKE = 0.06  # target speed that asks next to nothing of a standing car, [m/s]


def crab(plant: MujocoPlant, speed: float, slip_angle: float, on_belt: bool = False, seconds: float = 0.8) -> float:
    """Lateral force of the front axle, mean over the last fifth, in [N].

    Args:
        plant: On the level plane; its belt stands still again afterwards.
        speed: Of the road under the car, in [m/s].
        slip_angle: Of all wheels, in [rad].
        on_belt: Whether the road moves instead of the car.
        seconds: Time of the walk, in [s].
    """
    data = plant.data
    velocity = speed * np.array([math.cos(slip_angle), -math.sin(slip_angle), 0.0])
    start = plant.reset(VehicleState(v_x=velocity[0], v_y=velocity[1]))
    pose, forces = data.qpos[:7].copy(), []
    if on_belt:
        plant.move_road(-velocity[0], -velocity[1])
    command = SteeringCommand(start.time, 0.0, _NO_BRAKE if on_belt else velocity[0])
    count = round(seconds / _STEP)
    for k in range(count):
        data.qpos[:7], data.qvel[:6] = pose, 0.0
        if not on_belt:
            data.qpos[:3] += velocity * k * _STEP
            data.qvel[:3] = velocity
        plant.step(command, _STEP)
        if k >= 0.8 * count:
            signals = plant.signals()
            forces.append(signals["force_y_fl"] + signals["force_y_fr"])
    plant.move_road(0.0, 0.0)
    return float(np.mean(forces))
