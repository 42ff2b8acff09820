"""The MuJoCo car on slopes, patches of ice and bumps, and its three tyres."""

import math
from dataclasses import astuple

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.mujoco.bodies import WHEELS, corners, sprung_body
from sidestep.plant_models.mujoco.car import TYRE_DAMPING, car_spec
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.mujoco.surface import FrictionPatch, HeightField, Surface, patch_table
from sidestep.plant_models.road.reference_path import Arc, ReferencePath
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.contact import TYRE_MODES, friction_at
from sidestep.plant_models.tyres.formula import magic_formula
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
PUBLISHED = BMW.on_tyres(BMW.tyre.without_load_sensitivity())
FLAT = HeightField(np.full((21, 81), 0.3), 1.0, -20.0, -10.0)


def drive(plant, state, seconds, steer, speed, dt=0.01):
    states = [plant.reset(state)]
    for _ in range(round(seconds / dt)):
        states.append(plant.step(SteeringCommand(states[-1].time, steer, speed), dt))
    return states


def loads(plant):
    signals = plant.signals()
    return np.array([signals[f"load_{name}"] for name in WHEELS])


@pytest.mark.parametrize(("grade", "bank"), [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.1), (0.2, 0.1)])
def test_the_brakes_hold_the_car_on_a_slope(grade, bank):
    plant = MujocoPlant(BMW, surface=Surface(grade, bank))
    *_, before, after = drive(plant, VehicleState(), 6.0, 0.0, 0.0)[::100]
    assert math.hypot(after.x - before.x, after.y - before.y) < 1e-6  # in one second
    assert math.hypot(after.x, after.y) < 0.03  # the tyres lean into it, and no more
    assert loads(plant).sum() == pytest.approx(BMW.mass * -plant.model.opt.gravity[2], rel=1e-6)


def test_the_speed_control_knows_the_slope():
    for grade in (-0.1, 0.15):
        end = drive(MujocoPlant(BMW, surface=Surface(grade)), VehicleState(v_x=10.0), 4.0, 0.0, 10.0)[-1]
        assert end.v_x == pytest.approx(10.0, abs=1e-3)


def test_loads_on_a_slope_carry_the_moment_of_the_pull():
    plant = MujocoPlant(BMW, surface=Surface(0.2, 0.0))
    drive(plant, VehicleState(), 6.0, 0.0, 0.0)
    normal, pull = (BMW.mass * GRAVITY / math.hypot(1.0, 0.2) * part for part in (1.0, 0.2))
    front = (normal * BMW.l_r - pull * plant.data.subtree_com[1, 2]) / BMW.wheelbase
    assert loads(plant)[:2].sum() == pytest.approx(front, rel=5e-3)


def test_the_last_patch_counts_and_its_edges_are_where_they_should_be():
    road = ReferencePath.from_segments([Arc(length=100.0, curvature=0.02)])
    patches = [FrictionPatch(50.0, 2.0, 4.0, 2.0, 0.3, heading=0.1), FrictionPatch(50.0, 2.0, 1.0, 1.0, 0.6)]
    table = patch_table(patches, road)
    (x, y), yaw = road.to_cartesian(50.0, 2.0), road.heading(50.0) + 0.1
    ahead, left = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
    for u, v, expected in [(1.99, 0.99, 0.3), (2.01, 0.0, 0.9), (0.0, -1.01, 0.9), (0.3, 0.3, 0.6)]:
        assert friction_at(*(np.array([x, y]) + u * ahead + v * left), 0.9, table) == expected


def test_braking_on_split_friction_turns_the_car_to_the_grip():
    ice = FrictionPatch(50.0, -5.0, 200.0, 10.0, 0.2)
    states = drive(MujocoPlant(BMW, surface=Surface(patches=[ice])), VehicleState(v_x=15.0), 1.0, 0.0, 0.0)
    assert states[-1].yaw > 0.1  # the left wheels hold
    both = FrictionPatch(50.0, 0.0, 200.0, 20.0, 0.2)
    plant, reference = MujocoPlant(BMW, surface=Surface(patches=[both])), MujocoPlant(BMW, friction=0.2)
    on_ice = [drive(p, VehicleState(v_x=15.0), 1.0, 0.02, 0.0)[-1] for p in (plant, reference)]
    assert on_ice[0] == on_ice[1]


def test_a_flat_height_field_is_the_plane():
    plane, field = (MujocoPlant(BMW, surface=s) for s in (Surface(), Surface(heights=FLAT)))
    runs = [np.array([astuple(s) for s in drive(p, VehicleState(v_x=10.0), 2.0, 0.05, 10.0)]) for p in (plane, field)]
    assert loads(field) == pytest.approx(loads(plane), rel=2e-3)
    assert np.abs(runs[0] - runs[1])[:, 1:4].max() < 1e-3
    drive(field, VehicleState(), 2.0, 0.0, 0.0)
    assert loads(field) == pytest.approx([c.load for c in corners(BMW)], rel=1e-4)
    assert field.data.qpos[2] == pytest.approx(0.3 + BMW.cg_height, abs=1e-4)


def test_bumps_lift_the_wheels():
    """Over a sine of 6 m the chassis follows with the wheel loads it takes; on average it weighs what it weighs."""
    x = np.arange(-20.0, 81.0, 0.25)
    bumps = HeightField(np.tile(0.02 * np.sin(x * 2.0 * math.pi / 6.0), (81, 1)), 0.25, -20.0, -10.0)
    plant, found = MujocoPlant(BMW, surface=Surface(heights=bumps)), []
    plant.reset(VehicleState(v_x=8.0))
    for _ in range(750):
        plant.step(SteeringCommand(0.0, 0.0, 8.0), 0.01)
        found.append(loads(plant))
    found = np.array(found)[150:]
    assert found.sum(axis=1).mean() == pytest.approx(BMW.mass * GRAVITY, rel=0.01)
    assert np.ptp(found, axis=0).min() > 0.2 * BMW.mass * GRAVITY / 4.0
    assert found.min() > 0.0


def test_wheel_loads_over_a_wave_are_those_of_the_linear_half_car():
    """Heave and pitch of the sprung mass, two axles on springs and tyres, as complex amplitudes at one frequency."""
    length, height, speed = 4.0, 0.005, 8.0
    x = np.arange(-8.0, 52.0, 0.05)
    wave = HeightField(np.tile(height * np.sin(2.0 * math.pi / length * x), (81, 1)), 0.05, -8.0, -2.0)
    plant = MujocoPlant(BMW, surface=Surface(heights=wave))
    states = drive(plant, VehicleState(v_x=speed), 2.5, 0.0, speed)  # until what it began with has died away
    phases, found = [], []
    for _ in range(200):  # four waves
        phases.append(2.0 * math.pi / length * states[-1].x)
        found.append(loads(plant))
        states.append(plant.step(SteeringCommand(0.0, 0.0, speed), 0.01))
    basis = np.column_stack([np.sin(phases), np.cos(phases), np.ones(len(phases))])
    sine, cosine, mean = np.linalg.lstsq(basis, np.array(found), rcond=None)[0]
    assert mean == pytest.approx([c.load for c in corners(BMW)], rel=0.01)
    assert np.abs(sine + 1j * cosine) == pytest.approx(half_car_loads(length, height, speed), rel=0.03)


def half_car_loads(length, height, speed):
    """Amplitude of the wheel loads, in [N]."""
    data, omega, stations = BMW.suspension, 2.0 * math.pi * speed / length, corners(BMW)
    mass, (offset, _, _), (_, inertia, _) = sprung_body(BMW)
    levers = np.array([station.x - offset for station in stations])
    suspension = np.array([station.spring + 1j * omega * station.damper for station in stations])
    tyre = data.tyre_stiffness + 1j * omega * TYRE_DAMPING
    road = height * np.exp(2j * math.pi / length * np.array([station.x for station in stations]))
    system, right = np.zeros((6, 6), complex), np.zeros(6, complex)  # heave, pitch (nose up), four wheels
    system[0, 0], system[1, 1] = -mass * omega**2, -inertia * omega**2
    for i, (lever, spring) in enumerate(zip(levers, suspension, strict=True)):
        stretch = np.zeros(6)
        stretch[[0, 1, 2 + i]] = 1.0, lever, -1.0
        system += spring * np.outer(stretch, stretch)
        system[2 + i, 2 + i] += tyre - stations[i].mass * omega**2
        right[2 + i] = tyre * road[i]
    return np.abs(tyre * (road - np.linalg.solve(system, right)[2:]))


def test_heights_between_the_grid_points_are_bilinear():
    field = HeightField(np.array([[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]]), 0.5, 1.0, 2.0)
    for x, y, expected in [(1.0, 2.0, 0.0), (1.25, 2.0, 0.5), (1.75, 2.25, 6.5), (9.0, 9.0, 12.0), (-1.0, 0.0, 0.0)]:
        assert field.at(x, y) == pytest.approx(expected)


@pytest.mark.parametrize("text", ["", "1,2\n3\n", "a,b\n"])
def test_a_file_without_a_matrix_is_named(text, tmp_path):
    file = tmp_path / "heights.csv"
    for _ in range(2):
        with pytest.raises(InputError, match="no matrix of heights") as error:
            HeightField.from_csv(file, 1.0)
        assert error.value.where == str(file)
        file.write_text(text)


@pytest.mark.parametrize(("mode", "spread"), [("magic-formula", 0.003), ("contact", 0.004)])
def test_tyres_of_both_kinds_have_the_formula_s_stiffness_at_any_speed(mode, spread):
    plant, p = MujocoPlant(PUBLISHED, tyre=mode), PUBLISHED.tyre.as_array()
    for speed in (5.0, 30.0):
        force, slip = front_axle(plant, speed)
        assert force == pytest.approx(2.0 * magic_formula(0.0, slip, corners(BMW)[0].load, 1.0, p)[1], rel=spread)


def test_stock_contact_is_a_damper_and_no_tyre():
    plant = MujocoPlant(PUBLISHED, tyre="stock-contact")
    slow, fast = (np.divide(*front_axle(plant, speed)) for speed in (5.0, 15.0))
    assert fast / slow == pytest.approx(3.0, rel=0.02)


def front_axle(plant, speed):
    """Force [N] and slip angle [rad] in a steady bend of 0.5 m/s^2."""
    s = drive(plant, VehicleState(v_x=speed), 5.0, 0.5 * BMW.wheelbase / speed**2, speed)[-1]
    assert plant.signals()["a_y"] == pytest.approx(s.v_x * s.yaw_rate, rel=2e-3)
    slip = s.steer_angle - math.atan2(s.v_y + BMW.l_f * s.yaw_rate, s.v_x)
    return BMW.mass * s.v_x * s.yaw_rate * BMW.l_r / BMW.wheelbase / math.cos(s.steer_angle), slip


@pytest.mark.parametrize(("mode", "rest"), list(zip(TYRE_MODES, (1e-3, 0.2, 1e-3), strict=True)))
def test_every_tyre_carries_the_static_loads_and_brakes(mode, rest):
    """The tuned contact is a damper at low speed: it creeps to rest."""
    plant = MujocoPlant(BMW, tyre=mode)
    drive(plant, VehicleState(), 2.0, 0.0, 0.0)
    assert loads(plant) == pytest.approx([c.load for c in corners(BMW)], rel=2e-3)
    run = drive(plant, VehicleState(v_x=15.0), 8.0, 0.0, 0.0)
    assert abs(run[-1].v_x) < rest
    assert 15.0**2 / 2.0 / BMW.max_braking < run[-1].x < 30.0


@pytest.mark.parametrize(
    ("build", "where"),
    [
        (lambda: MujocoPlant(BMW, tyre="rubber"), "plant.tyre"),
        (lambda: car_spec(BMW, tyre="contact", surface=Surface(heights=FLAT)), "plant.tyre"),
        (lambda: Surface(grade=math.nan), "plant.grade"),
        (lambda: Surface(bank=-2.0), "plant.bank"),
        (lambda: FrictionPatch(0.0, 0.0, 1.0, 1.0, 0.0), "patch.friction"),
        (lambda: FrictionPatch(math.inf, 0.0, 1.0, 1.0, 0.5), "patch.s"),
        (lambda: HeightField(np.zeros(5), 1.0), "heights"),
        (lambda: HeightField(np.zeros((3, 3)), 0.0), "heights.spacing"),
    ],
)
def test_what_is_no_surface_is_named(build, where):
    with pytest.raises(InputError) as error:
        build()
    assert error.value.where == where
