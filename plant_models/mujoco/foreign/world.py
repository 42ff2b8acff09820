"""The world of somebody else's car: a level road with the properties of its own floor, obstacles, nothing else.

What else stands in the file's world would be hit without being in the scenario: it is left to be seen, not touched.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import mjtConDataField, mjtGeom, mjtObj, mjtSensor

from sidestep.plant_models.mujoco.foreign.anatomy import names_of, require, touches
from sidestep.plant_models.mujoco.foreign.car import ForeignCar
from sidestep.plant_models.mujoco.looks import add_looks
from sidestep.plant_models.mujoco.obstacles import add_obstacle
from sidestep.plant_models.mujoco.surface import Surface
from sidestep.plant_models.obstacle import Obstacle

ROAD = "sidestep road"
ALL_BITS = 2**31 - 1
"""Of MuJoCo's contact filter."""

_FLOORS = (mjtGeom.mjGEOM_PLANE, mjtGeom.mjGEOM_HFIELD, mjtGeom.mjGEOM_BOX)
_UPWARDS = 0.999  # cosine of a floor's tilt
_PROPERTIES = (
    "friction",
    "solref",
    "solimp",
    "condim",
    "margin",
    "gap",
    "priority",
    "solmix",
    "contype",
    "conaffinity",
)


@dataclass(frozen=True)
class World:
    """A car on its road.

    Attributes:
        model: Compiled.
        obstacles: Rows of the obstacles in `mocap_pos`.
        touched: Their places in `sensordata`: positive where something touches one.
        notes: What of the file's world was left out, as sentences.
    """

    model: mujoco.MjModel
    obstacles: list[int]
    touched: list[int]
    notes: tuple[str, ...]


def build_world(car: ForeignCar, obstacles: Sequence[Obstacle], surface: Surface) -> World:
    """Put the car into a world with a road through z = 0.

    Raises:
        InputError: The floor that was told is not in the file.
    """
    spec = car.spec.copy()
    before = spec.compile()
    floor = _floor(before, car)
    _add_road(spec, before, floor)
    add_looks(spec, ROAD)
    spec.option.gravity = surface.gravity
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a blow-up must show
    for pair in spec.pairs:
        for end in ("geomname1", "geomname2"):
            if floor is not None and getattr(pair, end) == before.geom(floor).name:
                setattr(pair, end, ROAD)
    names = [f"sidestep obstacle {i}" for i in range(len(obstacles))]
    for name, obstacle in zip(names, obstacles, strict=True):
        add_obstacle(spec, name, obstacle, ALL_BITS)
        sensor = spec.add_sensor(
            name=name, type=mjtSensor.mjSENS_CONTACT, objtype=mjtObj.mjOBJ_GEOM, objname=name
        )  # fmt: skip
        sensor.intprm[:3] = [1 << int(mjtConDataField.mjCONDATA_FOUND), 1, 1]
    model = spec.compile()
    return World(
        model,
        [int(model.body_mocapid[model.body(name).id]) for name in names],
        [int(model.sensor_adr[model.sensor(name).id]) for name in names],
        _clear(model, car, set(names), "" if floor is None else before.geom(floor).name),
    )


def _floor(model: mujoco.MjModel, car: ForeignCar) -> int | None:
    """The geom that the car would stand on: planes before other shapes, the highest below its wheels first."""
    if car.told.road:
        return require(model, mjtObj.mjOBJ_GEOM, car.told.road, f"{car.label}: road")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    x, y = np.mean([wheel.centre[:2] for wheel in car.wheels], axis=0)
    bottom = min(wheel.centre[2] - wheel.radius for wheel in car.wheels)
    found = []
    for geom in range(model.ngeom):
        kind = mjtGeom(model.geom_type[geom])
        fixed = model.body_weldid[model.geom_bodyid[geom]] == 0
        if not fixed or kind not in _FLOORS or not touches(model, geom) or data.geom_xmat[geom][8] < _UPWARDS:
            continue
        px, py, pz = data.geom_xpos[geom]
        size = model.geom_size[geom]
        if kind == mjtGeom.mjGEOM_BOX and (abs(x - px) > size[0] or abs(y - py) > size[1]):
            continue
        top = pz + (size[2] if kind == mjtGeom.mjGEOM_BOX else 0.0)
        found.append((kind == mjtGeom.mjGEOM_PLANE, top <= bottom + 0.5 * car.wheels[0].radius, top, geom))
    return max(found)[3] if found else None


def _add_road(spec: mujoco.MjSpec, model: mujoco.MjModel, floor: int | None) -> None:
    road = spec.worldbody.add_geom(name=ROAD, type=mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    if floor is None:
        road.contype = road.conaffinity = ALL_BITS
        return
    for name in _PROPERTIES:
        setattr(road, name, getattr(model, f"geom_{name}")[floor].copy())


def _clear(model: mujoco.MjModel, car: ForeignCar, obstacles: set[str], floor: str) -> tuple[str, ...]:
    """Let the car touch nothing but road and obstacles."""
    root, left_out = model.body(car.root).id, []
    kept = {ROAD, *obstacles}
    for geom, name in enumerate(names_of(model, mjtObj.mjOBJ_GEOM)):
        if name in kept or model.body_rootid[model.geom_bodyid[geom]] == root or not touches(model, geom):
            continue
        model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
        is_floor = name == floor
        model.geom_rgba[geom, 3] *= 0.0 if is_floor else 0.25  # a ghost: it is no obstacle
        if is_floor:
            model.geom_matid[geom] = -1
            continue
        left_out.append(name)
    return (*_left_out(left_out), *_left_behind(model, root))


def _left_out(geoms: list[str]) -> list[str]:
    if not geoms:
        return []
    more = f" and {len(geoms) - 5} more" if len(geoms) > 5 else ""
    listed = ", ".join(map(repr, geoms[:5]))
    return [f"world: the car does not touch {listed}{more}: obstacles are the scenario's"]


def _left_behind(model: mujoco.MjModel, root: int) -> list[str]:
    """What else moves in the file's world: it has no road to stand on."""
    tops = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0 and body != root]
    moving = [repr(model.body(body).name) for body in tops if model.body_weldid[body] != 0]
    return [f"world: {', '.join(moving)} are not part of the car and have no road"] if moving else []
