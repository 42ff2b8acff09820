"""How somebody else's car stands on a level road: let down onto it, and left alone until it rests."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sidestep.plant_models.errors import PlantError
from sidestep.plant_models.mujoco.foreign.anatomy import Array
from sidestep.plant_models.mujoco.foreign.bench import at_rest
from sidestep.plant_models.mujoco.foreign.car import ForeignCar
from sidestep.plant_models.mujoco.foreign.layout import Layout
from sidestep.plant_models.mujoco.foreign.steering import Steering
from sidestep.plant_models.mujoco.foreign.world import ROAD
from sidestep.plant_models.vehicle.parameters import GRAVITY

_LONGEST, _LOOK = 8.0, 0.5  # time to settle, and between looks, in [s]
_RESTS = 2e-3  # speed of the centre of gravity at which it rests, in [m/s]
_UPRIGHT = 0.94  # cosine of the largest lean, against the pose of the file


@dataclass(frozen=True)
class Stance:
    """The car at rest on a level road.

    Attributes:
        pose, controls: `qpos` and `ctrl`.
        radii: Of the wheels: height of their centres, in [m].
        loads: Of the wheels, in [N].
        friction: Between wheels and road.
        places: Of the wheels from the centre of gravity: ahead, left; shape (n, 2), in [m].
        height: Of the centre of gravity, in [m].
    """

    pose: Array
    controls: Array
    radii: Array
    loads: Array
    friction: float
    places: Array
    height: float


def settle(model: mujoco.MjModel, car: ForeignCar, steering: Steering) -> Stance:
    """Let the car down onto the level road and wait.

    Raises:
        PlantError: It does not come to rest, not on its wheels, or leans over.
    """
    data, layout, gravity = mujoco.MjData(model), Layout(model, car), model.opt.gravity.copy()
    model.opt.gravity[:] = 0.0, 0.0, -GRAVITY
    for i in range(model.nu):
        data.ctrl[i] = car.told.hold.get(model.actuator(i).name, at_rest(model, i))
    steering.place(data, 0.0)
    base = model.jnt_qposadr[model.body_jntadr[layout.root]]
    mujoco.mj_kinematics(model, data)
    before = data.xmat[layout.root].reshape(3, 3)[2].copy()
    data.qpos[base + 2] -= min(wheel.centre[2] - wheel.radius for wheel in car.wheels)
    for _ in range(round(_LONGEST / _LOOK)):
        for _ in range(max(1, round(_LOOK / model.opt.timestep))):
            steering.act(data, 0.0, model.opt.timestep)
            mujoco.mj_step(model, data)
        mujoco.mj_subtreeVel(model, data)
        if not np.isfinite(data.qpos).all():
            raise PlantError(f"{car.label}: the simulation diverges while the car settles on the road")
        if abs(data.subtree_linvel[layout.root][2]) < _RESTS:
            break
    mujoco.mj_forward(model, data)
    stance = _stance(model, data, car, layout)
    model.opt.gravity[:] = gravity
    if data.xmat[layout.root].reshape(3, 3)[2] @ before < _UPRIGHT:
        raise PlantError(f"{car.label}: the car leans over when it is let down onto the road")
    steering.reset()
    return stance


def _stance(model: mujoco.MjModel, data: mujoco.MjData, car: ForeignCar, layout: Layout) -> Stance:
    number = {model.geom(name).id: i for i, wheel in enumerate(car.wheels) for name in wheel.geoms}
    road, loads, frictions, force = model.geom(ROAD).id, np.zeros(len(car.wheels)), [], np.empty(6)
    strangers = set()
    for k in range(data.ncon):
        contact = data.contact[k]
        if road not in (contact.geom1, contact.geom2):
            continue
        other = contact.geom1 if contact.geom2 == road else contact.geom2
        mujoco.mj_contactForce(model, data, k, force)
        if other in number:
            loads[number[other]] += force[0]
            frictions.append(float(contact.friction[0]))
        elif force[0] > 0.02 * GRAVITY * model.body_subtreemass[layout.root]:
            strangers.add(model.geom(other).name)
    lifted = [repr(wheel.joint) for wheel, load in zip(car.wheels, loads, strict=True) if load <= 0.0]
    if lifted and len(lifted) > len(car.wheels) - 3:
        on = f"; it stands on {', '.join(map(repr, sorted(strangers)))}" if strangers else ""
        raise PlantError(f"{car.label}: {', '.join(lifted)} do not touch the road when the car is let down onto it{on}")
    cos, sin = layout.heading(data)
    geoms = [[model.geom(name).id for name in wheel.geoms] for wheel in car.wheels]
    centres = np.array([data.geom_xpos[ids].mean(axis=0) for ids in geoms])
    centre = data.subtree_com[layout.root]
    apart = centres[:, :2] - centre[:2]
    return Stance(
        pose=data.qpos.copy(),
        controls=data.ctrl.copy(),
        radii=np.array([max(z, 1e-3) for z in centres[:, 2]]),
        loads=loads,
        friction=float(np.mean(frictions)) if frictions else 0.0,
        places=np.stack([apart @ [cos, sin], apart @ [-sin, cos]], axis=1),
        height=float(centre[2]),
    )
