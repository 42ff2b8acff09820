"""The MuJoCo plant: a multibody car with Magic Formula tyres on a road among real boxes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.mujoco.bodies import WHEELS, corners, suspension_of
from sidestep.plant_models.mujoco.car import TYRE_DAMPING, car_spec, damping_scale, fill_delay_lines
from sidestep.plant_models.mujoco.loop import ackermann, advance, observe
from sidestep.plant_models.mujoco.obstacles import place_obstacles, yaw_quaternion
from sidestep.plant_models.mujoco.surface import Surface, patch_table
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.speed_control import drive_asked
from sidestep.plant_models.tyres.contact import CAR, PATCH, STATE, TYRE_MODES, relaxed_slip
from sidestep.plant_models.vehicle.parameters import VehicleParameters

_FAR = 1e3  # clearance is not measured beyond, [m]
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
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
        tyre: str = "magic-formula",
        surface: Surface | None = None,
    ):
        """Build the car; `reset` it before the first step.

        Args:
            vehicle: The car, with suspension data.
            path: The road that the obstacles are given on; None for the x axis.
            obstacles: Boxes that the hull can hit.
            friction: Of the road, as a factor on the tyre's peak.
            time_step: Longest step of the integration, in [s].
            tyre: Who shears the tyres, one of `TYRE_MODES`: the law; MuJoCo's contact tuned to the law (no
                relaxation, no camber thrust, creeps at rest); MuJoCo's contact as it comes, which is no tyre.
            surface: Tilt, patches and bumps of the road; None for none.

        Raises:
            InputError: The vehicle cannot be built, or a value is out of range.
        """
        if not 0.0 < friction < math.inf:
            raise InputError("plant.friction", f"{friction}", "> 0")
        if not 0.0 < time_step <= 5e-3:
            raise InputError("plant.time_step", f"{time_step} s", "0 < value <= 0.005")
        self._surface = surface = surface or Surface()
        self.model = car_spec(vehicle, obstacles, tyre, surface).compile()
        self.data = d = mujoco.MjData(self.model)
        self._vehicle, self._path, self._obstacles = vehicle, path, tuple(obstacles)
        self._moves, self._time_step = any(obstacle.moves for obstacle in obstacles), time_step
        self._car, self._own = _record(vehicle, self.model, friction), d.userdata.view(STATE)
        self._car["mode"], self._car["bears_load"] = TYRE_MODES.index(tyre), surface.heights is not None
        self._patches = patch_table(surface.patches, path)
        self._planar = self._own["planar"][0]
        self._views = (
            d.sensordata, d.xipos, d.xmat, d.qpos, d.qvel, d.qfrc_applied, d.ctrl, d.mocap_pos,
            self.model.pair_friction, self.model.pair_solreffriction,
        )  # fmt: skip
        self._tuned = (self.model.pair_friction.copy(), self.model.pair_solreffriction.copy())
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
        self.model.pair_friction[:], self.model.pair_solreffriction[:] = self._tuned
        limit, cos, sin = self._vehicle.steer_limit, math.cos(state.yaw), math.sin(state.yaw)
        state = replace(state, steer_angle=min(max(state.steer_angle, -limit), limit))
        self.data.time, position, velocity, own = state.time, self.data.qpos, self.data.qvel, self._own[0]
        position[:2] = state.x, state.y
        if self._surface.heights is not None:
            position[2] += self._surface.heights.at(state.x, state.y)
        position[3:7] = yaw_quaternion(state.yaw)
        velocity[:2] = cos * state.v_x - sin * state.v_y, sin * state.v_x + cos * state.v_y
        own["steer_angle"] = own["steer_command"] = state.steer_angle
        own["target_speed"], own["acceleration"], velocity[5] = state.v_x, math.nan, state.yaw_rate
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
                self.data.qpos[car["steer"][i, 0]] = angle
            v_x, v_y = state.v_x - state.yaw_rate * corner.y, state.v_y + state.yaw_rate * corner.x
            along = math.cos(angle) * v_x + math.sin(angle) * v_y
            across = math.cos(angle) * v_y - math.sin(angle) * v_x
            own["friction"][i] = car["friction"]
            own["load"][i], own["arm"][i] = corner.load, (corner.height + car["wheel_radius"]) / 2.0
            x, y, kappa, alpha = relaxed_slip(0.0, 0.0, 0.0, across, along, _LONG, car["tyre"])
            own["deflection"][i], own["slip"][i] = (x, y), (kappa, alpha)
            self.data.qvel[car["spin"][i]] = along / own["arm"][i]
        fill_delay_lines(self.model, self.data, self.data.qpos[car["steer"][:, 0]])

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
        own[["target_speed", "acceleration"]] = drive_asked(command, own[["target_speed", "acceleration"]][0].item())
        steps = max(1, math.ceil(dt / self._time_step - 1e-9))
        self.model.opt.timestep = dt / steps
        if self._moves:
            before = self.data.mocap_pos.copy()
            self._place_obstacles(start + dt)
            self._track = np.stack((before, self.data.mocap_pos))
        advance(
            steps, dt / steps, self.model._address, self.data._address, self._car, own, *self._views, self._track,
            self._patches,
        )  # fmt: skip
        state = VehicleState(self.data.time, *self._planar.tolist())
        if not state.is_finite():
            raise PlantError(f"the MuJoCo simulation diverges after {start:.3f} s")
        return state

    def _place_obstacles(self, time: float) -> None:
        place_obstacles(self.data.mocap_pos, self.data.mocap_quat, self._obstacles, self._path, time)

    def move_road(self, v_x: float, v_y: float) -> None:
        """Let the road move under the car, in [m/s]: a belt; not part of what `save` keeps."""
        road = self.model.geom("road").id
        self.model.geom_surfacevel[road, :2] = self._car[0]["belt"][:] = v_x, v_y
        self.model.flg_surfacevel = int(v_x != 0.0 or v_y != 0.0)

    def save(self) -> bytes:
        """All that the future depends on, for `restore` of a plant built alike; the continuation is the same bits.

        Raises:
            PlantError: Not reset yet.
        """
        if not self._is_reset:
            raise PlantError("save before reset")
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return b"".join(part.tobytes() for part in (state, *self._beside_state()))

    def restore(self, saved: bytes) -> VehicleState:
        """Go back to where `save` was called, and return the state there.

        Raises:
            PlantError: Saved by a plant of another make.
        """
        parts = [np.empty(mujoco.mj_stateSize(self.model, _STATE)), *self._beside_state()]
        if len(saved) != sum(part.nbytes for part in parts):
            raise PlantError(f"cannot restore {len(saved)} bytes: they were saved by another plant")
        values = np.frombuffer(saved)
        for part in parts:
            part.flat, values = values[: part.size], values[part.size :]
        mujoco.mj_setState(self.model, self.data, parts[0], _STATE)
        self._is_reset = True
        return VehicleState(self.data.time, *self._planar.tolist())

    def _beside_state(self) -> tuple[NDArray[np.float64], ...]:
        """What MuJoCo's own state has not: the tuned contacts and the forces that they answer to."""
        return self.model.pair_friction, self.model.pair_solreffriction, self.data.sensordata

    @property
    def spot(self) -> tuple[float, float, float, float]:
        """Where a camera looks for the car: x, y, z [m] and yaw [rad]."""
        mujoco.mj_kinematics(self.model, self.data)  # poses are one step old after a step
        x, y, z = self.data.qpos[:3].tolist()
        return x, y, z, float(self._planar[2])

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
        of the centre of gravity along the yawed axes, and wheel load, slip ratio, slip angle and shear
        along and across the wheel, per wheel.
        """
        own, q, car = self._own[0], self.data.qpos, self._car[0]
        w, x, y, z = q[3:7].tolist()
        force = self._shear() / car["mass"] + car["gravity"][:2]
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
            result[f"force_x_{name}"], result[f"force_y_{name}"] = own["shear"][i]
        return {key: float(value) for key, value in result.items()}

    def _shear(self) -> NDArray[np.float64]:
        """Sum of the forces along the road in the last step, in the world's axes, shape (2,), in [N]."""
        if self._car[0]["mode"] == 0:
            return self.data.qfrc_applied[:2]
        patches = self.data.sensordata[: 4 * PATCH].reshape(4, PATCH)
        forces = self.data.sensordata[-12:].reshape(4, 3)
        normal, tangent = patches[:, 5:8], patches[:, 8:11]
        world = forces[:, 1:2] * tangent + forces[:, 2:] * np.cross(normal, tangent)
        return world[:, :2].sum(axis=0)

    def close(self) -> None:
        """Nothing is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _record(vehicle: VehicleParameters, model: mujoco.MjModel, friction: float) -> NDArray[np.void]:
    """The car as the kernels take it, shape (1,) of `CAR`."""
    data, record = suspension_of(vehicle), np.zeros(1, CAR)
    (_, stiffness, damping), joints = model.actuator_biasprm[0, :3], [model.joint(i) for i in range(model.njnt)]
    places = {joint.name: (joint.qposadr[0], joint.dofadr[0]) for joint in joints}
    values = {
        "tyre": vehicle.tyre.as_array(),
        "tyre_scale": [vehicle.tyre_scale(axle) for axle in ("front", "front", "rear", "rear")],
        "friction": friction,
        "gravity": model.opt.gravity,
        "damping_scale": damping_scale(model),
        "mass": vehicle.mass,
        "unsprung": [corner.mass for corner in corners(vehicle)],
        "tyre_stiffness": data.tyre_stiffness,
        "tyre_damping": TYRE_DAMPING,
        "wheel_radius": data.wheel_radius,
        "spin_inertia": data.wheel_spin_inertia,
        "steer_offset": data.track_front / 2.0 / vehicle.wheelbase,
        "steer_rate_limit": vehicle.steer_rate_limit,
        "steer_time_constant": vehicle.steer_time_constant,
        "steer_lead": damping / stiffness,
        "max_braking": vehicle.max_braking,
        "max_acceleration": vehicle.max_acceleration,
        "chassis": model.body("chassis").id,
        "wheel": [model.body(f"wheel_{name}").id for name in WHEELS],
        "spin": [places[f"spin_{name}"][1] for name in WHEELS],
        "slide_axis": [corner.slide_axis for corner in corners(vehicle)],
        "slide": [places[f"suspension_{name}"] for name in WHEELS],
        "steer": [places[f"steer_{name}"] for name in WHEELS[:2]],
    }
    for name, value in values.items():
        record[name] = value
    return record
