"""The MuJoCo model against the vehicle data it was built from."""

import math

import mujoco
import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.bodies import WHEELS, corners
from sidestep.plant_models.mujoco.car import car_spec
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters, vehicle_presets

PRESETS = vehicle_presets()
BMW = VehicleParameters.preset("bmw-320i")


def car(vehicle, obstacles=()):
    """Model and data, evaluated in the default pose."""
    model = car_spec(vehicle, obstacles).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def mass_matrix(model, data):
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


def suspension_dofs(model):
    return [model.joint(f"suspension_{name}").dofadr[0] for name in WHEELS]


@pytest.mark.parametrize("name", PRESETS)
def test_mass_centre_and_yaw_inertia_are_the_vehicle_s(name):
    vehicle = VehicleParameters.preset(name)
    model, data = car(vehicle)
    full = mass_matrix(model, data)
    assert model.body_mass.sum() == pytest.approx(vehicle.mass, rel=1e-12)
    assert full[5, 5] == pytest.approx(vehicle.yaw_inertia, rel=1e-12)
    assert data.subtree_com[model.body("chassis").id] == pytest.approx([0.0, 0.0, vehicle.cg_height], abs=1e-12)


@pytest.mark.parametrize("name", PRESETS)
def test_the_default_pose_is_the_settled_one(name):
    vehicle = VehicleParameters.preset(name)
    model, data = car(vehicle)
    assert np.abs(data.qacc[:6]).max() < 1e-9
    assert np.abs(data.qacc[suspension_dofs(model)]).max() < 1e-9
    force = np.zeros(6)
    for index, corner in enumerate(corners(vehicle)):
        mujoco.mj_contactForce(model, data, index, force)
        assert force[0] == pytest.approx(corner.load, rel=1e-9)


@pytest.mark.parametrize("name", PRESETS)
def test_static_loads_balance_weight_and_moment(name):
    vehicle = VehicleParameters.preset(name)
    stations = corners(vehicle)
    assert [c.name for c in stations] == list(WHEELS)
    assert sum(c.load for c in stations) == pytest.approx(vehicle.mass * GRAVITY, rel=1e-12)
    assert sum(c.load * c.x for c in stations) == pytest.approx(0.0, abs=1e-9)
    assert sum(c.load * c.y for c in stations) == pytest.approx(0.0, abs=1e-9)


def test_tyre_contact_is_a_linear_spring():
    """Up to the constraint's softness R: force = stiffness x penetration - acceleration / R."""
    model, data = car(BMW)
    radius, force = BMW.suspension.wheel_radius, np.zeros(6)
    for sink in (0.0, 1e-3, 5e-3):
        data.qpos[2] = BMW.cg_height - sink
        mujoco.mj_forward(model, data)
        mujoco.mj_contactForce(model, data, 0, force)
        penetration = radius - data.xpos[model.body("wheel_fl").id, 2]
        acceleration = data.efc_J.reshape(data.nefc, model.nv)[0] @ data.qacc
        spring = force[0] + acceleration / data.efc_R[0]
        assert spring == pytest.approx(BMW.suspension.tyre_stiffness * penetration, rel=1e-9)
        assert force[0] == pytest.approx(spring, rel=1e-4)


def test_springs_bars_and_bump_stops():
    model, data = car(BMW)
    dofs = suspension_dofs(model)
    slides = [model.joint(f"suspension_{name}").qposadr[0] for name in WHEELS]
    at_rest = data.qfrc_passive[dofs].copy()
    data.qpos[slides] = [0.01, -0.01, 0.01, -0.01]
    mujoco.mj_forward(model, data)
    change = data.qfrc_passive[dofs] - at_rest
    s = BMW.suspension
    front = 0.01 * s.spring_front + 0.02 * s.anti_roll_front / s.track_front**2
    rear = 0.01 * s.spring_rear + 0.02 * s.anti_roll_rear / s.track_rear**2
    assert change == pytest.approx([-front, front, -rear, rear], rel=1e-9)

    data.qpos[slides] = [0.09, 0.0, 0.0, 0.0]
    data.qpos[2] += 1.0  # off the road: the stop alone acts
    mujoco.mj_forward(model, data)
    assert data.qfrc_constraint[dofs] == pytest.approx([-0.01 * 2.0e5, 0.0, 0.0, 0.0], rel=1e-2)


def test_a_payload_and_a_shifted_centre_go_into_the_body():
    vehicle = BMW.with_(mass=1.2 * BMW.mass, cg_height=0.65)
    model, data = car(vehicle)
    assert model.body_mass.sum() == pytest.approx(vehicle.mass, rel=1e-12)
    assert data.subtree_com[1] == pytest.approx([0.0, 0.0, 0.65], abs=1e-12)
    assert np.abs(data.qacc[:6]).max() < 1e-9


def test_obstacles_are_boxes_of_their_size_that_only_the_hull_meets():
    model, data = car(BMW, [Obstacle(0.0, 0.0, 4.0, 2.0), Obstacle(50.0, 0.0, 1.0, 1.0)])
    assert model.geom("obstacle0").size[:2] == pytest.approx([2.0, 1.0])
    data.mocap_pos[:] = (0.0, 0.0, 0.0), (50.0, 0.0, 0.0)
    mujoco.mj_forward(model, data)
    hull, box = model.geom("hull").id, model.geom("obstacle0").id
    touching = {tuple(sorted(pair)) for pair in data.contact.geom.tolist()}
    others = {pair for pair in touching if model.geom("road").id not in pair}
    assert others == {tuple(sorted((hull, box)))}


def test_the_model_survives_its_own_xml():
    spec = car_spec(BMW)
    model = spec.compile()
    again = mujoco.MjModel.from_xml_string(spec.to_xml())
    data = mujoco.MjData(again)
    mujoco.mj_forward(again, data)
    assert (again.nq, again.nv, again.nu) == (model.nq, model.nv, model.nu)
    assert np.abs(data.qacc[:6]).max() < 1e-2


@pytest.mark.parametrize(
    ("overrides", "where"),
    [
        ({"suspension": None}, "vehicle.suspension"),
        ({"mass": 100.0}, "vehicle.mass"),
        ({"yaw_inertia": 800.0}, "vehicle.yaw_inertia"),
        ({"yaw_inertia": 4000.0}, "vehicle.yaw_inertia"),
    ],
)
def test_data_that_make_no_car_are_named(overrides, where):
    with pytest.raises(InputError) as error:
        car_spec(BMW.with_(**overrides))
    assert error.value.where == where
    assert error.value.allowed


@pytest.mark.parametrize("bound", [0, 1])
def test_the_bounds_of_the_yaw_inertia_are_those_mujoco_accepts(bound):
    with pytest.raises(InputError) as error:
        car_spec(BMW.with_(yaw_inertia=1.0))
    limits = [float(word) for word in error.value.allowed.split(",")[0].split(" ... ")]
    inside = limits[bound] + (1.0, -1.0)[bound]
    assert math.isfinite(car_spec(BMW.with_(yaw_inertia=inside)).compile().stat.meanmass)
