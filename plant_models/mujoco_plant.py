"""The MuJoCo plant: a multibody car with Magic Formula tyres on a plane road among real boxes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.contact_tyre import CAR, STATE, ackermann, advance, observe, relaxed_slip
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco_car import TYRE_DAMPING, WHEELS, car_spec, corners, suspension_of
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road import ReferencePath
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle import VehicleParameters

_FAR = 1e3  # clearance is not measured beyond, [m]
_LONG = 1e6  # time in which any tyre has relaxed, [s]


class MujocoPlant:
    """Multibody car whose tyre patches and wheel loads come from MuJoCo's contacts; a `Plant`.

    A command that is not finite is ignored: the actuators hold the last one that was. All that changes
    from step to step is in `data`, so that MuJoCo's integration state is the plant's.

    Attributes:
        model, data: MuJoCo's own, to look at.
    """

    def __init__(
        self,
        vehicle: VehicleParameters,
        path: ReferencePath | None = None,
        obstacles: Sequence[Obstacle] = (),
        friction: float = 1.0,
        time_step: float = 1e-3,
    ):
        """Build the car; `reset` it before the first step.

        Args:
            vehicle: The car, with suspension data.
            path: The road that the obstacles are given on; None for the x axis.
            obstacles: Boxes that the hull can hit.
            friction: Of the road, as a factor on the tyre's peak.
            time_step: Longest step of the integration, in [s].

        Raises:
            InputError: The vehicle cannot be built, or a value is out of range.
        """
        if not 0.0 < friction < math.inf:
            raise InputError("plant.friction", f"{friction}", "> 0")
        if not 0.0 < time_step <= 5e-3:
            raise InputError("plant.time_step", f"{time_step} s", "0 < value <= 0.005")
        self.model = car_spec(vehicle, obstacles).compile()
        self.data = d = mujoco.MjData(self.model)
        self._vehicle, self._path, self._obstacles = vehicle, path, tuple(obstacles)
        self._moves, self._time_step = any(obstacle.speed for obstacle in obstacles), time_step
        self._car, self._own = _record(vehicle, self.model, friction), d.userdata.view(STATE)
        self._planar = self._own["planar"][0]
        self._views = (
            d.sensordata, d.xipos, d.xmat, d.qpos, d.qvel, d.xfrc_applied, d.ctrl, d.mocap_pos
        )  # fmt: skip
        self._track = np.zeros((2, 0, 3))  # of the obstacles during one step
        self._is_reset = False

    def reset(self, state: VehicleState) -> VehicleState:
        """Put the car at `state`: on its springs, wheels rolling, the steering angle cut to its limit.

        Raises:
            PlantError: The state is not finite.
        """
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        mujoco.mj_resetData(self.model, self.data)
        limit, cos, sin = self._vehicle.steer_limit, math.cos(state.yaw), math.sin(state.yaw)
        state = replace(state, steer_angle=min(max(state.steer_angle, -limit), limit))
        position, velocity, own = self.data.qpos, self.data.qvel, self._own[0]
        self.data.time = state.time
        position[:2] = state.x, state.y
        position[3:7] = _quaternion(state.yaw)
        velocity[:2] = cos * state.v_x - sin * state.v_y, sin * state.v_x + cos * state.v_y
        velocity[5] = state.yaw_rate
        own["steer_angle"], own["steer_command"], own["target_speed"] = state.steer_angle, state.steer_angle, state.v_x
        self._set_rolling(state)
        self._place_obstacles(state.time)
        self._planar[2] = state.yaw  # the branch to stay on
        observe(self._car, self._own, position, velocity)
        self._is_reset = True
        return VehicleState(state.time, *self._planar.tolist())

    def _set_rolling(self, state: VehicleState) -> None:
        """Wheels that roll and tyres that slip as they do in a steady motion."""
        car, own = self._car[0], self._own[0]
        offsets = (car["steer_offset"], -car["steer_offset"])
        for i, corner in enumerate(corners(self._vehicle)):
            angle = ackermann(state.steer_angle, offsets[i]) if i < 2 else 0.0
            if i < 2:
                self.data.qpos[car["steer"][i]] = angle
            v_x, v_y = state.v_x - state.yaw_rate * corner.y, state.v_y + state.yaw_rate * corner.x
            along = math.cos(angle) * v_x + math.sin(angle) * v_y
            across = math.cos(angle) * v_y - math.sin(angle) * v_x
            own["load"][i], own["arm"][i] = corner.load, (corner.height + car["wheel_radius"]) / 2.0
            own["slip"][i] = relaxed_slip(own["deflection"][i], 0.0, across, along, _LONG, car["tyre"])
            self.data.qvel[car["spin"][i]] = along / own["arm"][i]

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds.

        Raises:
            PlantError: Not reset yet, or the simulation diverges.
            InputError: dt is not a positive number.
        """
        own, start = self._own, self.data.time
        if not self._is_reset:
            raise PlantError("step before reset")
        if not 0.0 < dt < math.inf:
            raise InputError("dt", f"{dt} s", "> 0")
        if math.isfinite(command.steer_angle):
            limit = self._vehicle.steer_limit
            own["steer_command"] = min(max(command.steer_angle, -limit), limit)
        if math.isfinite(command.target_speed):
            own["target_speed"] = command.target_speed
        steps = max(1, math.ceil(dt / self._time_step - 1e-9))
        self.model.opt.timestep = dt / steps
        if self._moves:
            before = self.data.mocap_pos.copy()
            self._place_obstacles(start + dt)
            self._track = np.stack((before, self.data.mocap_pos))
        advance(
            steps, dt / steps, self.model._address, self.data._address, self._car, own, *self._views, self._track
        )  # fmt: skip
        state = VehicleState(self.data.time, *self._planar.tolist())
        if not state.is_finite():
            raise PlantError(f"the MuJoCo simulation diverges after {start:.3f} s")
        return state

    def _place_obstacles(self, time: float) -> None:
        road = self._path
        for i, obstacle in enumerate(self._obstacles):
            box = obstacle.at(time)
            x, y, yaw = (box.s, box.l, 0.0) if road is None else (*road.to_cartesian(box.s, box.l), road.heading(box.s))
            self.data.mocap_pos[i] = x, y, 0.0
            self.data.mocap_quat[i] = _quaternion(yaw + box.heading)

    @property
    def collided(self) -> bool:
        """Whether the hull has touched an obstacle since the reset."""
        return bool(self._own["collided"][0])

    def clearance(self) -> float:
        """Distance of the hull from the nearest obstacle, in [m]; 0 in contact, infinite if there is none."""
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)  # poses are one step old after a step
        hull = model.geom("hull").id
        boxes = [model.geom(f"obstacle{i}").id for i in range(len(self._obstacles))]
        gaps = [mujoco.mj_geomDistance(model, data, hull, box, _FAR, None) for box in boxes]
        return max(min(gaps, default=math.inf), 0.0)

    def signals(self) -> dict[str, float]:
        """What a recording may want beyond the state: of the last step, in SI units and [rad].

        Roll (positive to the right side down) and pitch (positive nose down) of the chassis, acceleration
        of the centre of gravity along the yawed axes, and wheel load, slip ratio and slip angle per wheel.
        """
        own, q, car = self._own[0], self.data.qpos, self._car[0]
        w, x, y, z = q[3:7].tolist()
        force = self.data.xfrc_applied[car["wheel"], :2].sum(axis=0) / car["mass"]
        cos, sin = math.cos(self._planar[2]), math.sin(self._planar[2])
        result = {
            "roll": math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            "pitch": math.asin(2.0 * (w * y - x * z)),
            "a_x": cos * force[0] + sin * force[1],
            "a_y": cos * force[1] - sin * force[0],
        }
        for i, name in enumerate(WHEELS):
            result[f"load_{name}"] = own["load"][i]
            result[f"slip_ratio_{name}"], result[f"slip_angle_{name}"] = own["slip"][i]
        return {key: float(value) for key, value in result.items()}

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _quaternion(yaw: float) -> tuple[float, float, float, float]:
    return math.cos(yaw / 2.0), 0.0, 0.0, math.sin(yaw / 2.0)


def _record(vehicle: VehicleParameters, model: mujoco.MjModel, friction: float) -> NDArray[np.void]:
    """The car as the kernels take it, shape (1,) of `CAR`."""
    data, record = suspension_of(vehicle), np.zeros(1, CAR)
    joint = {name: model.joint(name) for name in (model.joint(i).name for i in range(model.njnt))}
    slides = [joint[f"suspension_{name}"] for name in WHEELS]
    gain = model.actuator(f"steer_{WHEELS[0]}").biasprm
    values = {
        "tyre": vehicle.tyre.as_array(),
        "friction": friction,
        "mass": vehicle.mass,
        "unsprung": [corner.mass for corner in corners(vehicle)],
        "tyre_stiffness": data.tyre_stiffness,
        "tyre_damping": TYRE_DAMPING,
        "wheel_radius": data.wheel_radius,
        "spin_inertia": data.wheel_spin_inertia,
        "steer_offset": data.track_front / 2.0 / vehicle.wheelbase,
        "steer_rate_limit": vehicle.steer_rate_limit,
        "steer_time_constant": vehicle.steer_time_constant,
        "steer_lead": gain[2] / gain[1],
        "max_braking": vehicle.max_braking,
        "max_acceleration": vehicle.max_acceleration,
        "wheel": [model.body(f"wheel_{name}").id for name in WHEELS],
        "hub": [model.body(f"hub_{name}").id for name in WHEELS],
        "spin": [joint[f"spin_{name}"].dofadr[0] for name in WHEELS],
        "slide": [(slide.qposadr[0], slide.dofadr[0]) for slide in slides],
        "steer": [joint[f"steer_{name}"].qposadr[0] for name in WHEELS[:2]],
    }
    for name, value in values.items():
        record[name] = value
    return record
