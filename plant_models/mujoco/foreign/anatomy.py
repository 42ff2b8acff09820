"""The parts of somebody else's car, found in the compiled model by geometry: root body and wheels.

A wheel is a hinge that may turn for ever about a level axis, with a geom that is round about that axis, touches things
and reaches down as far as the others. Names count only where a mapping file gives them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import mjtGeom, mjtJoint, mjtObj
from numpy.typing import NDArray

from sidestep.plant_models.errors import InputError, did_you_mean
from sidestep.plant_models.mujoco.foreign.car_map import CarMap

Array = NDArray[np.float64]

_LEVEL = 0.35  # sine by which a wheel's axle may rise
_ALIGNED = 0.99  # cosine between a geom's axis and the joint's
_ROUND = 0.1  # how far round may be off, over the radius
_LIFT = 0.5  # by which a wheel may stand higher than the lowest one, over its radius
_SECTORS = 12  # in which a mesh is looked at


@dataclass(frozen=True)
class Wheel:
    """A wheel in the pose of the file.

    Attributes:
        joint, body: Names.
        geoms: Names of its round geoms that touch things.
        centre: In the world, in [m].
        axle: Direction of the joint's axis in the world.
        radius: Of the largest of its geoms, in [m].
        width: Along the axle, in [m].
    """

    joint: str
    body: str
    geoms: tuple[str, ...]
    centre: Array
    axle: Array
    radius: float
    width: float


@dataclass(frozen=True)
class Anatomy:
    """The car in the model.

    Attributes:
        root: Body that carries all of it, a child of the world.
        chassis: Body to whose axes `forward` refers.
        wheels: At least three.
    """

    root: str
    chassis: str
    wheels: tuple[Wheel, ...]


def find_car(model: mujoco.MjModel, told: CarMap, label: str) -> Anatomy:
    """Root body and wheels of the car.

    Args:
        model: In which everything has a name.
        told: What is known beforehand.
        label: What errors call the file.

    Raises:
        InputError: No car, more than one, or a name that is not in the model.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    wheels = _told_wheels(model, data, told, label) if told.wheels else _found_wheels(model, data)
    roots = [int(model.body_rootid[model.body(wheel.body).id]) for wheel in wheels]
    if told.chassis:
        root = int(model.body_rootid[require(model, mjtObj.mjOBJ_BODY, told.chassis, f"{label}: chassis")])
    else:
        root = max(set(roots), key=roots.count) if roots else 0
    own = tuple(wheel for wheel, its in zip(wheels, roots, strict=True) if its == root)
    name = model.body(root).name
    if len(own) < 3:
        what = f"{len(own)} wheels found" + (f" on {name!r}" if root else "") + _listed(w.joint for w in own)
        raise InputError(
            f"{label}: wheels", f"{what}; among {_inventory(model)}",
            "wheels = [...]: at least three geoms, bodies or joints; a wheel is a hinge without a range about a level "
            "axis, with a geom that is round about it and touches things",
        )  # fmt: skip
    others = {model.body(its).name for its in set(roots) - {root} if roots.count(its) >= 3}
    if others and not told.chassis and not told.wheels:
        raise InputError(f"{label}: chassis", f"more than one car: {', '.join(sorted({name} | others))}", "one of them")
    return Anatomy(name, told.chassis or name, own)


def require(model: mujoco.MjModel, kind: mjtObj, name: str, where: str) -> int:
    """Number of a named part.

    Raises:
        InputError: There is none of that name.
    """
    if (number := mujoco.mj_name2id(model, kind, name)) < 0:
        known = names_of(model, kind)
        raise InputError(where, f"no {kind.name[6:].lower()} {name!r}{did_you_mean(name, known)}", ", ".join(known))
    return number


def names_of(model: mujoco.MjModel, kind: mjtObj) -> list[str]:
    """Names of all parts of a kind, in order."""
    counts = {
        mjtObj.mjOBJ_BODY: model.nbody, mjtObj.mjOBJ_GEOM: model.ngeom, mjtObj.mjOBJ_JOINT: model.njnt,
        mjtObj.mjOBJ_ACTUATOR: model.nu,
    }  # fmt: skip
    return [mujoco.mj_id2name(model, kind, i) for i in range(counts[kind])]


def touches(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom can touch anything."""
    in_pair = geom in model.pair_geom1 or geom in model.pair_geom2
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom]) or in_pair


def _found_wheels(model: mujoco.MjModel, data: mujoco.MjData) -> list[Wheel]:
    found = [wheel for joint in range(model.njnt) if (wheel := _wheel(model, data, joint))]
    by_root: dict[int, float] = {}
    for wheel in found:  # the lowest of each car
        root = int(model.body_rootid[model.body(wheel.body).id])
        by_root[root] = min(by_root.get(root, np.inf), wheel.centre[2] - wheel.radius)
    return [
        wheel for wheel in found
        if wheel.centre[2] - wheel.radius
        <= by_root[int(model.body_rootid[model.body(wheel.body).id])] + _LIFT * wheel.radius
    ]  # fmt: skip


def _wheel(model: mujoco.MjModel, data: mujoco.MjData, joint: int, told: bool = False) -> Wheel | None:
    """The wheel on a joint; None if it is none. One that is told may be of any shape."""
    if model.jnt_type[joint] != mjtJoint.mjJNT_HINGE:
        return None
    axle, anchor = data.xaxis[joint].copy(), data.xanchor[joint]
    turns = not model.jnt_limited[joint] or np.ptp(model.jnt_range[joint]) >= 2.0 * np.pi
    if not told and (not turns or abs(axle[2]) > _LEVEL):
        return None
    rounds = _rounds(model, data, joint, told)
    if not rounds:
        return None
    geoms = [geom for geom, _, _ in rounds]
    along = np.mean([(data.geom_xpos[geom] - anchor) @ axle for geom in geoms])
    return Wheel(
        joint=model.joint(joint).name,
        body=model.body(model.jnt_bodyid[joint]).name,
        geoms=tuple(model.geom(geom).name for geom in geoms),
        centre=anchor + along * axle,
        axle=axle,
        radius=max(radius for _, radius, _ in rounds),
        width=max(width for _, _, width in rounds),
    )


def _rounds(model: mujoco.MjModel, data: mujoco.MjData, joint: int, told: bool) -> list[tuple[int, float, float]]:
    """Geoms that turn with a hinge, touch things and are round about it, with radius and width."""
    weld, found = model.body_weldid[model.jnt_bodyid[joint]], []
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] == weld and touches(model, geom):
            size = _round_about(model, data, geom, data.xanchor[joint], data.xaxis[joint], told)
            found += [(geom, *size)] if size else []
    return found


def _round_about(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, anchor: Array, axle: Array, told: bool
) -> tuple[float, float] | None:
    """Radius and width of a geom about an axle; None if it is not round about it."""
    kind, size = mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    frame, offset = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom] - anchor
    off_axle = float(np.linalg.norm(offset - (offset @ axle) * axle))
    if kind == mjtGeom.mjGEOM_MESH:
        return _round_mesh(model, geom, frame, data.geom_xpos[geom], anchor, axle, told)
    cosines = np.abs(frame.T @ axle)
    nearest = int(np.argmax(cosines))
    if kind == mjtGeom.mjGEOM_SPHERE:
        radius, width, is_round = size[0], 2.0 * size[0], True
    elif kind in (mjtGeom.mjGEOM_CYLINDER, mjtGeom.mjGEOM_CAPSULE):
        ends = size[0] if kind == mjtGeom.mjGEOM_CAPSULE else 0.0
        radius, width, is_round = size[0], 2.0 * (size[1] + ends), cosines[2] >= _ALIGNED
    elif kind == mjtGeom.mjGEOM_ELLIPSOID:
        across = np.delete(size, nearest)
        radius, width = across.max(), 2.0 * size[nearest]
        is_round = (cosines[nearest] >= _ALIGNED and np.ptp(across) <= _ROUND * radius) or np.ptp(size) <= 1e-6
    else:
        if not told:
            return None
        radius, width, is_round = np.delete(size, nearest).max(), 2.0 * size[nearest], True
    if not told and (not is_round or off_axle > _ROUND * radius):
        return None
    return float(radius), float(width)


def _round_mesh(
    model: mujoco.MjModel, geom: int, frame: Array, centre: Array, anchor: Array, axle: Array, told: bool
) -> tuple[float, float] | None:
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = model.mesh_vert[first : first + count] @ frame.T + centre - anchor
    along = points @ axle
    across = points - along[:, None] * axle
    reach = np.linalg.norm(across, axis=1)
    side = np.cross(axle, np.eye(3)[np.argmin(np.abs(axle))])
    side /= np.linalg.norm(side)
    angle = np.arctan2(across @ np.cross(axle, side), across @ side)
    sector = np.floor((angle + np.pi) / (2.0 * np.pi) * _SECTORS).astype(int) % _SECTORS
    most = np.array([reach[sector == k].max(initial=0.0) for k in range(_SECTORS)])
    radius = most.max()
    if not told and most.min() < (1.0 - 2.0 * _ROUND) * radius:
        return None
    return float(radius), float(np.ptp(along))


def _told_wheels(model: mujoco.MjModel, data: mujoco.MjData, told: CarMap, label: str) -> list[Wheel]:
    wheels = []
    for name in told.wheels:
        joint = _joint_of(model, name, f"{label}: wheels")
        wheel = _wheel(model, data, joint, told=True)
        if wheel is None:
            raise InputError(f"{label}: wheels", f"{name!r} has no geom that touches anything", "others")
        wheels.append(wheel)
    return wheels


def _joint_of(model: mujoco.MjModel, name: str, where: str) -> int:
    """The hinge of a wheel that a geom, body or joint names: the one whose axis is most level."""
    joint = mujoco.mj_name2id(model, mjtObj.mjOBJ_JOINT, name)
    if joint >= 0 and model.jnt_type[joint] == mjtJoint.mjJNT_HINGE:
        return joint
    body = mujoco.mj_name2id(model, mjtObj.mjOBJ_BODY, name)
    if body < 0 and (geom := mujoco.mj_name2id(model, mjtObj.mjOBJ_GEOM, name)) >= 0:
        body = int(model.geom_bodyid[geom])
    if body < 0:
        known = [
            n for kind in (mjtObj.mjOBJ_GEOM, mjtObj.mjOBJ_BODY, mjtObj.mjOBJ_JOINT) for n in names_of(model, kind)
        ]
        raise InputError(where, f"nothing named {name!r}{did_you_mean(name, known)}", "geoms, bodies or joints")
    weld = model.body_weldid[body]
    level = [
        j for j in range(model.njnt)
        if model.jnt_type[j] == mjtJoint.mjJNT_HINGE and model.body_weldid[model.jnt_bodyid[j]] == weld
    ]  # fmt: skip
    if not level:
        raise InputError(where, f"{name!r} does not turn: it has no hinge", "geoms, bodies or joints of wheels")
    return min(level, key=lambda j: abs(model.jnt_axis[j][2]) + (0.5 if model.jnt_limited[j] else 0.0))


def _inventory(model: mujoco.MjModel) -> str:
    names = ("free", "ball", "slide", "hinge")
    joints = [f"{names[model.jnt_type[j]]} {model.joint(j).name!r}" for j in range(model.njnt)]
    return f"{len(joints)} joints" + _listed(joints)


def _listed(names: Iterator[str] | list[str]) -> str:
    listed = list(names)
    more = f", and {len(listed) - 12} more" if len(listed) > 12 else ""
    return f" ({', '.join(listed[:12])}{more})" if listed else ""
