"""Ten minutes of the MuJoCo car on a closed road with obstacles: nothing may drift, lift off, gain energy or be NaN."""

import math
from dataclasses import astuple, dataclass, field

import mujoco
import numpy as np

from sidestep.plant_models.mujoco.bodies import WHEELS, corners
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.geometry import Array
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.model_error.mujoco.checks import Check
from sidestep.validation.scenarios.scenario import parse_scenario

_RADIUS, _TURN_IN, _SPEED = 50.0, 40.0, 14.0  # [m], [m], [m/s]
_ARC = math.pi * _RADIUS - _TURN_IN  # with the two clothoids, half a turn
_HALF = f"""
    {{ type = "line", length = 120.0 }},
    {{ type = "clothoid", length = {_TURN_IN}, curvature_start = 0.0, curvature_end = {1.0 / _RADIUS} }},
    {{ type = "arc", length = {_ARC}, curvature = {1.0 / _RADIUS} }},
    {{ type = "clothoid", length = {_TURN_IN}, curvature_start = {1.0 / _RADIUS}, curvature_end = 0.0 }},
"""
_SCENE = f"""
name = "closed-road"
speed = {_SPEED}
duration = 600.0
obstacles = [
    {{ s = 60.0, l = -1.5, length = 4.5, width = 1.8 }},
    {{ s = 200.0, l = 2.0, length = 3.0, width = 2.0 }},
    {{ s = 400.0, l = 0.8, length = 4.5, width = 1.8 }},
]
road = {{ width_left = 4.0, width_right = 4.0, segments = [{_HALF}{_HALF}] }}
"""
_STOP, _STAND = 5.0, 5.0  # seconds to come to rest, and to stand still in
_PERIOD = 0.02  # of the controller, [s]


@dataclass
class _Log:
    """What is seen under way: all states, and the worst of the rest."""

    static: Array
    states: list[VehicleState] = field(default_factory=list)
    relief: float = 0.0
    apart: float = 0.0
    turned: float = 0.0
    not_finite: int = 0


def long_drive(seconds: float = 600.0) -> list[Check]:
    """Drive, stop and stand.

    Args:
        seconds: Time of the drive; a lap takes 44.
    """
    scenario, s = parse_scenario(_SCENE, "closed-road"), 0.0
    path, log = scenario.path, _Log(np.array([corner.load for corner in corners(scenario.vehicle)]))
    controller = open_controller(scenario)
    with open_plant(scenario) as plant:
        assert isinstance(plant, MujocoPlant)
        state = plant.reset(scenario.start)
        for _ in range(round(seconds / _PERIOD)):
            state = plant.step(controller.step(state), _PERIOD)
            s += math.remainder(path.project(state.x, state.y)[0] - s, path.length)
            _look(log, plant, state)
        gain, collided = _energy_gain(plant), plant.collided
    laps, station = divmod(s, path.length)
    turned = state.yaw - scenario.start.yaw - float(path.heading(station))
    name = f"15 {laps:.0f} laps"
    return [
        Check(f"{name}: numbers that are not finite", log.not_finite, 0, ""),
        Check(f"{name}: obstacle touched (1 = yes)", float(collided), 0, ""),
        Check(f"{name}: load that a wheel loses, at most", 100.0 * log.relief, 99.0, "%"),
        Check(f"{name}: state against the bodies' centre of gravity", 1e3 * log.apart, 1e-6, "mm"),
        Check(f"{name}: yaw against the chassis", log.turned, 1e-9, "rad"),
        Check(f"{name}: turns of the car against laps", abs(turned / (2.0 * math.pi) - laps), 0.05, ""),
        Check(f"{name}: integrated velocity against the way", _way_error(log.states), 0.01, "%"),
        Check("15 then standing: kinetic energy gained", gain, 0.0, "J"),
    ]


def _look(log: _Log, plant: MujocoPlant, state: VehicleState) -> None:
    """Into MuJoCo's own coordinates, which the plant's state must agree with."""
    model, data, signals = plant.model, plant.data, plant.signals()
    log.states.append(state)
    loads = np.array([signals[f"load_{name}"] for name in WHEELS])
    log.relief = max(log.relief, float((1.0 - loads / log.static).max()))
    log.not_finite += int(np.count_nonzero(~np.isfinite([*astuple(state), *signals.values()])))
    mujoco.mj_kinematics(model, data)  # poses are one step old after a step
    mujoco.mj_comPos(model, data)
    chassis = data.body("chassis")
    x, y, _ = chassis.subtree_com
    log.apart = max(log.apart, math.hypot(x - state.x, y - state.y))
    yaw = math.atan2(chassis.xmat[3], chassis.xmat[0])
    log.turned = max(log.turned, abs(math.remainder(state.yaw - yaw, 2.0 * math.pi)))


def _way_error(states: list[VehicleState]) -> float:
    """Distance between the end and the integral of the velocities, over the way driven, in [%]."""
    time, x, y, yaw, v_x, v_y = np.array([astuple(state) for state in states]).T[:6]
    velocity = (v_x + 1j * v_y) * np.exp(1j * yaw)
    integral = np.sum((velocity[1:] + velocity[:-1]) / 2.0 * np.diff(time))
    steps = np.diff(x + 1j * y)
    return float(100.0 * np.abs(integral - steps.sum()) / np.abs(steps).sum())


def _energy_gain(plant: MujocoPlant) -> float:
    """Kinetic energy while standing, the most of the second half less the most of the first, in [J]."""
    energies, hold = [], SteeringCommand(0.0, 0.0, 0.0)
    plant.step(hold, _STOP)
    for _ in range(round(_STAND / _PERIOD)):
        plant.step(hold, _PERIOD)
        mujoco.mj_energyVel(plant.model, plant.data)
        energies.append(plant.data.energy[1])
    first, second = np.reshape(energies, (2, -1)).max(axis=1)
    return float(second - first)
