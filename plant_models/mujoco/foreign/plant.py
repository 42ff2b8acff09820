"""Somebody else's MJCF car as a plant."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import mujoco
import numpy as np

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.foreign.bench import ABSURD
from sidestep.plant_models.mujoco.foreign.car import ForeignCar, read_car
from sidestep.plant_models.mujoco.foreign.car_map import CarMap
from sidestep.plant_models.mujoco.foreign.driving import Drive
from sidestep.plant_models.mujoco.foreign.layout import Layout
from sidestep.plant_models.mujoco.foreign.settling import settle
from sidestep.plant_models.mujoco.foreign.steering import Steering, locks_of
from sidestep.plant_models.mujoco.foreign.world import ROAD, build_world
from sidestep.plant_models.mujoco.obstacles import place_obstacles, yaw_quaternion
from sidestep.plant_models.mujoco.surface import Surface
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters


class MjcfPlant:
    """A car from an MJCF file, on its own contacts and tyres, led by its own actuators; a `Plant`.

    A command that is not finite is ignored: the last one that was holds.

    Attributes:
        model, data: MuJoCo's own, to look at.
        car: What was found in the file.
        stance: How it stands.
        root: Number of the body that carries it.
        steering, drive: How it is led.
        notes: What was changed or assumed, as sentences.
    """

    def __init__(
        self,
        file: str | Path | ForeignCar,
        told: CarMap | None = None,
        vehicle: VehicleParameters | None = None,
        path: ReferencePath | None = None,
        obstacles: Sequence[Obstacle] = (),
        friction: float = 1.0,
        surface: Surface | None = None,
    ):
        """Find the car in the file and put it on a road; `reset` it before the first step.

        Args:
            file: The MJCF file, or the car in it.
            told: What is known of it beforehand.
            vehicle: Whose limits of steering angle, braking and acceleration hold; None for the car's own.
            path: The road that the obstacles are given on; None for the x axis.
            obstacles: Boxes that the car can hit.
            friction: Of the road, as a factor on that of the file.
            surface: Grade and bank of the road; None for none.

        Raises:
            InputError: The file cannot be used, or what makes a car is not found in it.
            PlantError: The car does not stand on its wheels.
        """
        if not 0.0 < friction < math.inf:
            raise InputError("plant.friction", f"{friction}", "> 0")
        self.car = car = file if isinstance(file, ForeignCar) else read_car(file, told)
        self._surface = surface or Surface()
        world = build_world(car, obstacles, self._surface)
        self.model, self.data = world.model, mujoco.MjData(world.model)
        self._boxes, self._touched, self._obstacles, self._path = world.obstacles, world.touched, obstacles, path
        self._time_step = world.model.opt.timestep
        locks = locks_of(car)
        self._layout, self.steering = Layout(self.model, car), Steering(self.model, car, locks)
        _scale_friction(self.model, friction)
        self.stance = settle(self.model, car, self.steering)
        self.drive = Drive(self.model, car, self._grip(), self.stance.radii)
        if vehicle:
            self.drive.max_braking = min(self.drive.max_braking, vehicle.max_braking)
            self.drive.max_acceleration = min(self.drive.max_acceleration, vehicle.max_acceleration)
        self._limit = min(self.steering.limit, vehicle.steer_limit if vehicle else math.inf)
        self.notes = (*car.notes, *world.notes)
        self.root, self._base = self._layout.root, int(self.model.body_jntadr[self._layout.root])
        self._is_reset, self._collided, self._yaw = False, False, 0.0

    def _grip(self) -> float:
        driven = {wheel for drive in self.car.drives for wheel, _ in drive.spun}
        return self.stance.friction * float(sum(self.stance.loads[i] for i in driven))

    def reset(self, state: VehicleState) -> VehicleState:
        """Put the car at `state`: settled, wheels rolling, the steering angle cut to its limit.

        Raises:
            PlantError: The state is not finite.
        """
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.time = state.time
        self._target, self._angle = state.v_x, min(max(state.steer_angle, -self._limit), self._limit)
        data.ctrl[:] = self.stance.controls
        data.qpos[:] = self.stance.pose
        self.steering.reset()
        self.drive.reset()
        self.steering.place(data, self._angle)
        self._turn_and_move(state)
        self._roll(state)
        self._place_obstacles(state.time)
        mujoco.mj_forward(model, data)
        self._yaw, self._collided, self._is_reset = state.yaw, False, True
        return self._seen()

    def _turn_and_move(self, state: VehicleState) -> None:
        """Yaw about the vertical, then the centre of gravity over the place."""
        model, data, at = self.model, self.data, int(self.model.jnt_qposadr[self._base])
        mujoco.mj_kinematics(model, data)
        cos, sin = self._layout.heading(data)
        turn, result = np.array(yaw_quaternion(state.yaw - math.atan2(sin, cos))), np.empty(4)
        mujoco.mju_mulQuat(result, turn, data.qpos[at + 3 : at + 7])
        data.qpos[at + 3 : at + 7] = result
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        data.qpos[at : at + 2] += [state.x, state.y] - data.subtree_com[self.root][:2]

    def _roll(self, state: VehicleState) -> None:
        """One rigid motion of all parts, and wheels that roll with it."""
        model, data, dof = self.model, self.data, int(self.model.jnt_dofadr[self._base])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        cos, sin = math.cos(state.yaw), math.sin(state.yaw)
        along = np.array([cos * state.v_x - sin * state.v_y, sin * state.v_x + cos * state.v_y])
        x, y = data.xpos[self.root][:2] - data.subtree_com[self.root][:2]
        data.qvel[dof : dof + 2] = along + state.yaw_rate * np.array([-y, x])
        frame = data.xmat[self.root].reshape(3, 3)
        data.qvel[dof + 3 : dof + 6] = frame.T @ [0.0, 0.0, state.yaw_rate]
        for i, joint in enumerate(self._layout.joints):
            angle = state.yaw + self._layout.wheel_angle(data, i)
            x, y = data.xanchor[joint][:2] - data.subtree_com[self.root][:2]
            v = along + state.yaw_rate * np.array([-y, x])
            speed = v @ [math.cos(angle), math.sin(angle)]
            data.qvel[self._layout.spins[i]] = self._layout.senses[i] * speed / self.stance.radii[i]

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds.

        Raises:
            PlantError: Not reset yet, or the simulation diverges.
            InputError: dt is not a positive number.
        """
        if not self._is_reset:
            raise PlantError("step before reset")
        if not 0.0 < dt < math.inf:
            raise InputError("dt", f"{dt} s", "> 0")
        self._hear(command)
        count, start = max(1, math.ceil(dt / self._time_step - 1e-9)), self.data.time
        self.model.opt.timestep = h = dt / count
        for k in range(count):
            if self._obstacles:
                self._place_obstacles(start + (k + 1) * h)
            self._lead(h)
            mujoco.mj_step(self.model, self.data)
            if not np.abs(self.data.qvel).max() < ABSURD:
                raise PlantError(f"{self.car.label}: the simulation diverges after {self.data.time:.3f} s")
            self._collided |= any(self.data.sensordata[i] > 0.0 for i in self._touched)
        self.data.time = start + dt
        return self._seen()

    def _hear(self, command: SteeringCommand) -> None:
        if math.isfinite(command.steer_angle):
            self._angle = min(max(command.steer_angle, -self._limit), self._limit)
        if math.isfinite(command.target_speed):
            self._target = command.target_speed

    def _lead(self, h: float) -> None:
        """Set all controls for the next step."""
        speed, _, cos, sin = self._velocity()
        slope = self._surface.gravity[0] * cos + self._surface.gravity[1] * sin
        self.steering.act(self.data, self._angle, h)
        self.drive.act(self.data, speed, self._target, h, slope)

    def _velocity(self) -> tuple[float, float, float, float]:
        """Of the centre of gravity along the yawed axes, and their direction; as old as the derived quantities."""
        mujoco.mj_subtreeVel(self.model, self.data)
        cos, sin = self._layout.heading(self.data)
        x, y, _ = self.data.subtree_linvel[self.root].tolist()
        return cos * x + sin * y, cos * y - sin * x, cos, sin

    def _yaw_rate(self) -> float:
        spatial = np.empty(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, self.root, spatial, 0)
        w_x, w_y, w_z = spatial[:3].tolist()
        x, y, z = (self.data.xmat[self.root].reshape(3, 3) @ self.car.forward).tolist()
        return (x * (w_z * x - w_x * z) - y * (w_y * z - w_z * y)) / (x * x + y * y)

    def _seen(self) -> VehicleState:
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)  # poses are one step old after a step
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        v_x, v_y, cos, sin = self._velocity()
        self._yaw += math.remainder(math.atan2(sin, cos) - self._yaw, math.tau)
        x, y, _ = data.subtree_com[self.root].tolist()
        state = VehicleState(data.time, x, y, self._yaw, v_x, v_y, self._yaw_rate(), self.steering.angle(data))
        if not state.is_finite():
            raise PlantError(f"{self.car.label}: the simulation diverges after {data.time:.3f} s")
        return state

    def _place_obstacles(self, time: float) -> None:
        boxes = self._boxes
        if boxes:
            rows = slice(boxes[0], boxes[-1] + 1)
            place_obstacles(self.data.mocap_pos[rows], self.data.mocap_quat[rows], self._obstacles, self._path, time)

    def heading(self) -> tuple[float, float]:
        """Cosine and sine of the yaw."""
        return self._layout.heading(self.data)

    @property
    def spot(self) -> tuple[float, float, float, float]:
        """Where a camera looks for the car: x, y, z [m] and yaw [rad]."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        x, y, z = self.data.subtree_com[self.root].tolist()
        return x, y, z, self._yaw

    @property
    def collided(self) -> bool:
        """Whether the car has touched an obstacle since the reset."""
        return self._collided

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _scale_friction(model: mujoco.MjModel, factor: float) -> None:
    """Sliding friction between the car and the road; that of everything, as MuJoCo takes the larger of two."""
    model.geom_friction[:, 0] *= factor
    road = model.geom(ROAD).id
    for pair in range(model.npair):
        if road in (model.pair_geom1[pair], model.pair_geom2[pair]):
            model.pair_friction[pair, :2] *= factor
