"""The multibody car as a MuJoCo specification, built from the vehicle data alone.

Free chassis, four vertical suspension slides with spring, damper, bump stops and anti-roll bars, two
four wheels, those in front steered. The frame of the body `chassis` is the total centre of gravity of the
car at rest, so that the default pose is the settled one, standing on the road plane z = 0.
"""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import mjtConDataField, mjtGeom, mjtJoint, mjtObj, mjtSensor, mjtTrn

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.bodies import WHEELS, Corner, corners, sprung_body, suspension_of, upright_inertia
from sidestep.plant_models.mujoco.looks import add_cabin, add_looks
from sidestep.plant_models.mujoco.obstacles import add_obstacle
from sidestep.plant_models.mujoco.surface import HeightField, Surface
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.tyres.contact import STATE, TYRE_MODES
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.plant_models.vehicle.suspension import SuspensionParameters

# Ours: what the CommonRoad sets lack. It hardly shows in the motion of the car.
_TYRE_WIDTH = 0.205  # [m]
TYRE_DAMPING = 200.0  # vertical, [N s/m]
_TRAVEL = 0.08  # of the suspension, either way, [m]
_STOP_STIFFNESS, _STOP_DAMPING = 2.0e5, 2.0e3  # [N/m], [N s/m]
_STEER_STIFFNESS = 3.0e5  # [N m/rad]
_DELAY_SAMPLES = 4000  # of the steering's delay line, per second: no step of the car is shorter
_HULL_BOTTOM, _HULL_TOP = 0.15, 0.9  # [m]; up to the belt line: the cabin above is narrower

_SOFT = 1e-4  # MuJoCo's least impedance: a constraint this soft is a plain spring and damper
_FRICTION_RATIO = 5.0  # impratio of the tuned contact; its shear is too small by _SOFT times this, and more
_DEEP = 0.25  # margin of a contact that is found but never pushes, [m]


def car_spec(
    vehicle: VehicleParameters,
    obstacles: Sequence[Obstacle] = (),
    tyre: str = "magic-formula",
    surface: Surface | None = None,
) -> mujoco.MjSpec:
    """The car on its road, with one box per obstacle (`obstacle0` ...) for the caller to place.

    Only the road and the tyres, and the hull and the obstacles, touch each other. With the Magic Formula the
    tyre contact is frictionless: it finds the patch and carries the load, shear is the business of
    `contact_tyre`. On a height field it only finds the patch. `to_xml()` of the result is MJCF.

    Args:
        vehicle: The car, with suspension data.
        obstacles: Boxes that the hull can hit.
        tyre: One of `TYRE_MODES`.
        surface: None for the level plane.

    Raises:
        InputError: No suspension data, masses and inertias that no rigid body can have, or unknown tyre.
    """
    surface = surface or Surface()
    if tyre not in TYRE_MODES:
        raise InputError("plant.tyre", f"{tyre!r}", ", ".join(TYRE_MODES))
    if surface.heights is not None and tyre != "magic-formula":
        raise InputError("plant.tyre", f"{tyre!r} on a height field", "magic-formula")
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = surface.gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_PGS  # springs this soft are solved in one sweep
    flags = mujoco.mjtDisableBit
    spec.option.disableflags |= flags.mjDSBL_ISLAND | flags.mjDSBL_AUTORESET  # one car; a blow-up must show
    spec.nuserdata = STATE.itemsize // 8
    _add_road(spec, surface.heights)
    add_looks(spec)
    chassis = _add_chassis(spec, vehicle)
    for corner in corners(vehicle):
        _add_corner(spec, chassis, corner, vehicle)
    _add_anti_roll_bars(spec, suspension_of(vehicle))
    _add_actuators(spec, suspension_of(vehicle))
    _add_sensors(spec, with_forces=tyre != "magic-formula")
    for index, obstacle in enumerate(obstacles):
        add_obstacle(spec, f"obstacle{index}", obstacle, touches=2)
    _calibrate(spec, suspension_of(vehicle))
    if tyre != "magic-formula":
        _add_friction(spec, vehicle, tyre == "contact")
    if surface.heights is not None:
        for pair in spec.pairs:
            pair.margin, pair.gap = -_DEEP, _DEEP
    return spec


def _add_road(spec: mujoco.MjSpec, heights: HeightField | None) -> None:
    road = spec.worldbody.add_geom(name="road", type=mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=0, conaffinity=0)
    if heights is None:
        return
    z, (rows, columns) = heights.heights, heights.heights.shape
    rise, reach = float(z.max() - z.min()), [(n - 1) * heights.spacing / 2.0 for n in (columns, rows)]
    spec.add_hfield(
        name="road", nrow=rows, ncol=columns, size=[*reach, rise or 1.0, 0.5],
        userdata=((z - z.min()) / (rise or 1.0)).ravel(),
    )  # fmt: skip
    road.type, road.hfieldname = mjtGeom.mjGEOM_HFIELD, "road"
    road.pos = [heights.x + reach[0], heights.y + reach[1], float(z.min())]


def _add_chassis(spec: mujoco.MjSpec, vehicle: VehicleParameters) -> mujoco.MjsBody:
    mass, offset, inertia = sprung_body(vehicle)
    chassis = spec.worldbody.add_body(name="chassis", pos=[0.0, 0.0, vehicle.cg_height])
    chassis.explicitinertial = True
    chassis.mass, chassis.inertia, chassis.ipos = mass, inertia, offset
    chassis.add_freejoint(name="chassis")
    centre = [(vehicle.front_extent - vehicle.rear_extent) / 2, 0.0, (_HULL_BOTTOM + _HULL_TOP) / 2 - vehicle.cg_height]
    size = [vehicle.length / 2.0, vehicle.width / 2.0, (_HULL_TOP - _HULL_BOTTOM) / 2.0]
    chassis.add_geom(
        name="hull", type=mjtGeom.mjGEOM_BOX, size=size, pos=centre, mass=0.0, contype=2, conaffinity=2,
        rgba=[0.1, 0.3, 0.7, 1.0],
    )  # fmt: skip
    add_cabin(chassis, vehicle, [centre[0], 0.0, _HULL_TOP - vehicle.cg_height])
    return chassis


def _add_corner(spec: mujoco.MjSpec, chassis: mujoco.MjsBody, corner: Corner, vehicle: VehicleParameters) -> None:
    data, name = suspension_of(vehicle), corner.name
    # Hub and wheel are one body, the spin its last joint: a round wheel turns without a change of inertia.
    wheel = chassis.add_body(name=f"wheel_{name}", pos=[corner.x, corner.y, corner.height - vehicle.cg_height])
    wheel.explicitinertial = True
    wheel.mass, wheel.ipos = corner.mass, [0.0, 0.0, 0.0]
    wheel.inertia = [upright_inertia(data), data.wheel_spin_inertia, upright_inertia(data)]
    across, up = corner.slide_axis
    slide = wheel.add_joint(name=f"suspension_{name}", type=mjtJoint.mjJNT_SLIDE, axis=[0, across, up])
    slide.stiffness[0], slide.damping[0] = up**2 * corner.spring, up**2 * corner.damper  # rates are the wheel's, upward
    slide.springref = (corner.mass * GRAVITY - corner.load) / (up * corner.spring)  # preload: rest is at zero
    slide.limited, slide.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-_TRAVEL, _TRAVEL]
    if name[0] == "f":
        wheel.add_joint(name=f"steer_{name}", type=mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    wheel.add_joint(name=f"spin_{name}", type=mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    # An ellipsoid: one contact, where a cylinder gives two and so doubles the stiffness.
    wheel.add_geom(
        name=f"tyre_{name}", type=mjtGeom.mjGEOM_ELLIPSOID, mass=0.0, contype=0, conaffinity=0,
        size=[data.wheel_radius, _TYRE_WIDTH / 2.0, data.wheel_radius], rgba=[0.1, 0.1, 0.1, 1.0],
    )  # fmt: skip
    spec.add_pair(name=f"tyre_{name}", geomname1="road", geomname2=f"tyre_{name}", condim=1)


def _add_anti_roll_bars(spec: mujoco.MjSpec, data: SuspensionParameters) -> None:
    for axle, stiffness, track, centre in (
        ("f", data.anti_roll_front, data.track_front, data.roll_centre_front),
        ("r", data.anti_roll_rear, data.track_rear, data.roll_centre_rear),
    ):
        bar = spec.add_tendon(name=f"anti_roll_{axle}")
        bar.wrap_joint(f"suspension_{axle}l", 1.0)
        bar.wrap_joint(f"suspension_{axle}r", -1.0)
        bar.stiffness[0] = stiffness / (track**2 + 4.0 * centre**2)  # of travel along the slides
        bar.springlength = [0.0, 0.0]


def _add_actuators(spec: mujoco.MjSpec, data: SuspensionParameters) -> None:
    damping = 2.0 * math.sqrt(_STEER_STIFFNESS * upright_inertia(data))  # critical
    for name in WHEELS[:2]:
        servo = spec.add_actuator(name=f"steer_{name}", target=f"steer_{name}", trntype=mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=_STEER_STIFFNESS, kv=damping)
        if data.steer_delay:  # of its angle, which is that of a delayed command
            servo.delay, servo.interp = data.steer_delay, 1  # linear
            servo.nsample = math.ceil(data.steer_delay * _DELAY_SAMPLES) + 2
    for name in WHEELS:
        motor = spec.add_actuator(name=f"torque_{name}", target=f"spin_{name}", trntype=mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()


def fill_delay_lines(model: mujoco.MjModel, data: mujoco.MjData, angles: Sequence[float]) -> None:
    """As if the steering servos, left and right, had stood at `angles` [rad] for long."""
    for i, angle in enumerate(angles):
        if count := int(model.actuator_history[i, 0]):
            times = data.time - np.arange(count, 0, -1.0) / _DELAY_SAMPLES
            mujoco.mj_initCtrlHistory(model, data, i, times, np.full((count, 1), angle))


def _add_sensors(spec: mujoco.MjSpec, with_forces: bool) -> None:
    """Four tyre patches (fields of `contact_tyre`, 14 numbers each), whether the hull touches anything, forces."""
    contact, geom = mjtSensor.mjSENS_CONTACT, mjtObj.mjOBJ_GEOM

    def add_tyres(fields: int, prefix: str) -> None:
        for name in WHEELS:
            sensor = spec.add_sensor(
                name=f"{prefix}_{name}",
                type=contact,
                objtype=geom,
                objname="road",
                reftype=geom,
                refname=f"tyre_{name}",
            )
            sensor.intprm[:3] = [fields, 1, 1]  # least distance, one contact

    add_tyres(_bits("FOUND", "DIST", "POS", "NORMAL", "TANGENT", "LINVEL"), "tyre")
    hull = spec.add_sensor(name="hull", type=contact, objtype=geom, objname="hull")
    hull.intprm[:3] = [_bits("FOUND"), 1, 1]
    if with_forces:
        add_tyres(_bits("FORCE"), "force")


def _bits(*names: str) -> int:
    return sum(1 << int(getattr(mjtConDataField, f"mjCONDATA_{name}")) for name in names)


def _add_friction(spec: mujoco.MjSpec, vehicle: VehicleParameters, tuned: bool) -> None:
    """Let the contact solver shear the tyres: ready for `contact_tyre` to tune, or as MuJoCo comes."""
    spec.option.solver, spec.option.cone = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = _FRICTION_RATIO if tuned else 1.0
    for corner in corners(vehicle):
        pair = spec.pair(f"tyre_{corner.name}")
        pair.condim, pair.friction[:2] = 3, [vehicle.tyre.p_dy1] * 2
        if tuned:
            pair.solreffriction = [-1e-9, 0.0]
        else:
            pair.solref, pair.solimp = [0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]
            radius = corner.height  # so stiff a tyre is not compressed
            spec.geom(f"tyre_{corner.name}").size = [radius, _TYRE_WIDTH / 2.0, radius]


def _calibrate(spec: mujoco.MjSpec, data: SuspensionParameters) -> None:
    """Give tyre contacts and bump stops their stiffness in [N/m]; MuJoCo scales it by the compiled masses."""
    model = spec.compile()
    for name in WHEELS:
        pair, slide = spec.pair(f"tyre_{name}"), spec.joint(f"suspension_{name}")
        weight = model.body(f"wheel_{name}").invweight0[0]
        pair.solref, pair.solimp = _spring(data.tyre_stiffness, TYRE_DAMPING, weight)
        weight = model.dof_invweight0[model.joint(f"suspension_{name}").dofadr[0]]
        slide.solref_limit, slide.solimp_limit = _spring(_STOP_STIFFNESS, _STOP_DAMPING, weight)


def damping_scale(model: mujoco.MjModel) -> list[float]:
    """Friction reference of each tyre pair per damping, in [m/N]: what `contact` mode tunes."""
    weights = [model.body(f"wheel_{name}").invweight0[0] for name in WHEELS]
    return [(1.0 - _SOFT) * weight / _FRICTION_RATIO for weight in weights]


def _spring(stiffness: float, damping: float, inverse_weight: float) -> tuple[list[float], list[float]]:
    """`solref` and `solimp` of a constraint that acts as this spring and damper."""
    scale = (1.0 - _SOFT) * inverse_weight  # R d, with R = (1 - d) / d times the inverse weight
    return [-stiffness * scale, -damping * scale], [_SOFT, _SOFT, 0.001, 0.5, 2.0]
