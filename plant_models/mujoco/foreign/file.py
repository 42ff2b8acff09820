"""Somebody else's MJCF file as a specification that can be changed and whose every part has a name."""

from pathlib import Path

import mujoco
import numpy as np
from mujoco import mjtJoint

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.foreign.anatomy import Anatomy

_NO_COMPLAINT = (ValueError, RuntimeError, OSError, mujoco.FatalError)

_SHARE = 1.5  # of the damping that overshoots without end, twice what stops at once
_FINEST = 20.0  # by which a time step may be too long for an actuator


def read_model(path: str | Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Specification and compiled model; what has no name in the file is called by kind and number.

    Keyframes are left out: they would not fit what is added to the model.

    Raises:
        InputError: No file, no MJCF, or a model that MuJoCo does not take.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(str(path), f"no file {str(file.absolute())!r}", "a MuJoCo model (MJCF, .xml)")
    try:
        spec, model = _prepared(file)
    except _NO_COMPLAINT as error:
        raise InputError(str(path), f"MuJoCo does not take it ({' '.join(str(error).split())})", "MJCF") from error
    if model.opt.gravity[2] > 0.0 or abs(model.opt.gravity[:2]).max() > 1e-3:
        raise InputError(f"{path}: option.gravity", f"{model.opt.gravity.tolist()}", "along -z")
    return spec, model


def _prepared(file: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    spec = mujoco.MjSpec.from_file(str(file))
    for key in list(spec.keys):
        spec.delete(key)
    _name_all(spec)
    if spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER:  # stiff servos are not stable with it
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()
    if (longest := _stable_step(model)) < spec.option.timestep:
        spec.option.timestep = longest
        model = spec.compile()
    return spec, model


def _stable_step(model: mujoco.MjModel) -> float:
    """Longest step with which no damping by an actuator overshoots, in [s].

    The implicit integrator looks after actuators on joints; what acts by a tendon or a site it takes joint by joint.
    """
    data, longest = mujoco.MjData(model), float(model.opt.timestep)
    mujoco.mj_forward(model, data)
    moments, solved = np.zeros((model.nu, model.nv)), np.zeros((1, model.nv))
    mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    for actuator, moment in enumerate(moments):
        damping = -float(model.actuator_biasprm[actuator, 2])
        if damping > 0.0 and np.count_nonzero(moment) > 1:
            mujoco.mj_solveM(model, data, solved, moment[None])
            longest = min(longest, _SHARE / (damping * float(moment @ solved[0])))
    return max(longest, model.opt.timestep / _FINEST)


def _name_all(spec: mujoco.MjSpec) -> None:
    for kind, parts in (
        ("body", spec.bodies[1:]), ("geom", spec.geoms), ("joint", spec.joints), ("actuator", spec.actuators)
    ):  # fmt: skip
        taken = {part.name for part in parts}
        for number, part in enumerate(parts):
            if not part.name:
                name = f"{kind} {number}"
                while name in taken:
                    name += "'"
                part.name = name
                taken.add(name)


def free_car(spec: mujoco.MjSpec, car: Anatomy, label: str) -> list[str]:
    """See that the car's root has a free joint, and what was changed for that, as sentences.

    Raises:
        InputError: Its own joints are in use and cannot be taken away.
    """
    root = spec.body(car.root)
    joints = list(root.joints)
    if any(joint.type == mjtJoint.mjJNT_FREE for joint in joints):
        return []
    names = [joint.name for joint in joints]
    if spins := {wheel.joint for wheel in car.wheels} & set(names):
        raise InputError(
            f"{label}: chassis", f"the wheel on {min(spins)!r} is fixed to the world, there is no body that carries it",
            "a body with a free joint",
        )  # fmt: skip
    for joint in joints:
        spec.delete(joint)
    root.add_freejoint(name="sidestep free")
    try:
        spec.compile()
    except _NO_COMPLAINT as error:
        raise InputError(
            f"{label}: chassis", f"{car.root!r} hangs on {', '.join(map(repr, names))}, which other parts refer to",
            "a free joint on it",
        ) from error  # fmt: skip
    was = f"hung on {', '.join(map(repr, names))}" if names else "was fixed to the world"
    return [f"chassis: {car.root!r} {was}; it has a free joint now"]


def part_overlaps(spec: mujoco.MjSpec, model: mujoco.MjModel, car: Anatomy) -> list[str]:
    """Let bodies of the car that overlap in the pose of the file, and so would jam, not touch; says which."""
    data, root = mujoco.MjData(model), model.body(car.root).id
    mujoco.mj_forward(model, data)
    jammed: dict[tuple[str, str], None] = {}
    for k in range(data.ncon):
        bodies = [int(model.geom_bodyid[geom]) for geom in data.contact.geom[k]]
        if all(model.body_rootid[body] == root for body in bodies):
            jammed[model.body(min(bodies)).name, model.body(max(bodies)).name] = None
    for one, other in jammed:
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return [f"contact: {one!r} and {other!r} overlap and do not touch each other" for one, other in jammed]


def without_freedom(spec: mujoco.MjSpec, car: Anatomy) -> mujoco.MjModel:
    """The model on a bench: root fixed, no gravity, no contact."""
    bench = spec.copy()
    for joint in list(bench.body(car.root).joints):
        bench.delete(joint)
    bench.option.gravity = [0.0, 0.0, 0.0]
    bench.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return bench.compile()
