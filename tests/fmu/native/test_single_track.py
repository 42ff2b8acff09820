"""The single-track core: its equations, written again here, and what physics says of any car."""

import ctypes
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from support.fmus.integration import integrate
from support.fmus.native_drive import drive, read

from sidestep.fmu.compiling.platforms import compile_library
from sidestep.fmu.description.plants import MODELS, vehicle_values
from sidestep.fmu.native.build import source_files
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.formula import cornering_stiffness, lateral_force, tyre_forces
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters

CAR = VehicleParameters.preset("bmw-320i")
VAN = VehicleParameters.preset("vw-vanagon")
MODEL = MODELS["single-track"]
REFERENCE = {row.name: reference for reference, row in enumerate(MODEL.variables)}
STATES = ["x", "y", "yaw", "v_x", "v_y", "yaw_rate", "front_slip", "rear_slip", "steer_angle"]
COMMON = [0, 1, 2, 3, 4, 5, 8]  # those of the states that VehicleState holds, in its order


def rates(state, steer_command, target_speed, car, friction):
    """The equations of documentation/index.html."""
    _, _, yaw, v_x, v_y, r, z_f, z_r, delta = state
    p = car.tyre.as_array()

    def axle(name, u, w, z, load, asked):
        dfz = load / 2 / car.tyre.nominal_load - 1
        d_x = max(car.tyre.p_dx1 + car.tyre.p_dx2 * dfz, 0.1) * friction * load
        d_y = max(car.tyre.p_dy1 + car.tyre.p_dy2 * dfz, 0.1) * friction * load / 2
        scale, speed, sigma = car.tyre_scale(name), math.hypot(u, w), car.tyre.relaxation_y
        stiffness = scale * cornering_stiffness(load / 2, p)
        q, damping = (z * stiffness / d_y) ** 2, 0.05 * max(1 - speed, 0) ** 2 * stiffness / sigma
        f_y = lateral_force(math.asin(z), load / 2, friction, p, scale) - damping * w
        part = min(max(asked / d_x, -0.9), 0.9)
        f_y = 2 * min(max(f_y, -d_y), d_y) * math.sqrt(1 - part**2)
        return part * d_x, f_y, (1 + q / (1 + q * speed / 60)) * (-w - speed * z) / sigma

    grip = 0.9 * car.tyre.p_dx1 * friction * GRAVITY
    a_x = min(max(2.0 * (target_speed - v_x), -car.max_braking), car.max_acceleration)
    a_x = min(max(a_x, -grip), grip)
    load_f = car.mass * (GRAVITY * car.l_r - a_x * car.cg_height) / car.wheelbase
    load_r = car.mass * GRAVITY - load_f
    c, s = math.cos(delta), math.sin(delta)
    front, rear = v_y + car.l_f * r, v_y - car.l_r * r
    x_f, y_f, dz_f = axle("front", v_x * c + front * s, front * c - v_x * s, z_f, load_f, a_x / GRAVITY * load_f)
    x_r, y_r, dz_r = axle("rear", v_x, rear, z_r, load_r, a_x / GRAVITY * load_r)
    body_x, body_y = x_f * c - y_f * s, x_f * s + y_f * c
    turn = (min(max(steer_command, -car.steer_limit), car.steer_limit) - delta) / car.steer_time_constant
    return [
        v_x * math.cos(yaw) - v_y * math.sin(yaw),
        v_x * math.sin(yaw) + v_y * math.cos(yaw),
        r,
        (body_x + x_r) / car.mass + v_y * r,
        (body_y + y_r) / car.mass - v_x * r,
        (car.l_f * body_y - car.l_r * y_r) / car.yaw_inertia,
        dz_f,
        dz_r,
        min(max(turn, -car.steer_rate_limit), car.steer_rate_limit),
    ]


@pytest.mark.parametrize(
    ("car", "friction", "start", "command"),
    [
        (CAR, 1.0, VehicleState(v_x=15.0), lambda t: (0.07 * math.sin(3 * t), 15.0)),
        (CAR, 0.5, VehicleState(v_x=20.0, yaw=1.0, x=3.0), lambda t: (0.15 if t < 0.5 else -0.1, 20.0)),
        (VAN, 0.8, VehicleState(v_x=18.0), lambda t: (0.06, 10.0)),
        (CAR, 1.0, VehicleState(v_x=3.0), lambda t: (0.4, 1.0)),
    ],
    ids=["slalom", "slide", "brake-in-turn", "slow"],
)
def test_fmu_equals_an_independent_integration(car, friction, start, command):
    expected = integrate(lambda *now: rates(*now, car, friction), start, 2, command, 1.6)
    with native_plant(car, friction=friction, internal_step=0.0005) as plant:
        found = drive(plant, start, command, 1.6)
    np.testing.assert_allclose(found[:, 1:], expected[:, COMMON], rtol=0, atol=1e-6)
    assert np.abs(expected[:, 4]).max() > 0.05  # the manoeuvre is one


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """The core alone, with its tyre law made visible."""
    folder = tmp_path_factory.mktemp("core")
    for name, data in source_files(MODEL).items():
        if name.endswith(".h"):
            (folder / name).write_bytes(data)
    law = (
        '\n__attribute__((visibility("default")))'
        " double law(double a, double f, double side, double scale, const double v[])"
        "{ return lateral(a, f, side, scale, v).force; }\n"
    )
    (folder / "core.c").write_bytes(source_files(MODEL)["tyre.c"] + law.encode())
    for name in ("car.c", "single_track.c"):
        (folder / name).write_bytes(source_files(MODEL)[name])
    compile_library(folder, folder / "core.so")
    library = ctypes.CDLL(str(folder / "core.so"))
    library.law.restype = ctypes.c_double
    return library.law


@pytest.mark.parametrize(
    "tyre",
    [
        CAR.tyre,
        TyreParameters(p_dy2=-2.0, p_ey1=-1.5),
        CAR.tyre.without_load_sensitivity(),
        replace(CAR.tyre, p_ey1=-0.6, p_ey2=-0.9, p_ky4=1.7),
        replace(CAR.tyre, p_hy1=0.003, p_hy2=-0.001, p_vy1=0.03, p_vy2=0.02, p_ey1=-1.0, p_ey2=3.0, p_ey3=0.2),
    ],
    ids=["default", "guarded", "insensitive", "curvature and stiffness", "shifted"],
)
def test_tyre_law_is_the_one_of_the_tyre_module(core, tyre):
    values = (ctypes.c_double * len(MODEL.variables))()
    for name, value in vehicle_values(replace(CAR, tyre=tyre)).items():
        if name in REFERENCE:
            values[REFERENCE[name]] = value
    left, right = tyre.as_array(), tyre.mirrored().as_array()
    angles, loads, frictions = np.linspace(-1.5, 1.5, 41), [-1.0, 0.0, 300.0, 2681.3, 9000.0], [0.0, 0.3, 1.0]
    for angle, load, friction in itertools.product(angles, loads, frictions):
        values[REFERENCE["friction"]] = friction
        for side, mounted in ((1.0, left), (-1.0, right)):
            for scale in (1.0, 1.3):
                found = core(*map(ctypes.c_double, (angle, load, side, scale)), values)
                expected = tyre_forces(0.0, angle, 0.0, load, friction, mounted, scale)[1]
                assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.fixture
def plant():
    with native_plant(CAR) as plant:
        yield plant


def test_splitting_a_step_changes_nothing(plant):
    def command(t):
        return 0.1 if t < 0.4 else -0.05, 12.0

    whole = drive(plant, VehicleState(v_x=15.0), command, 2.0, 0.02)
    split = drive(plant, VehicleState(v_x=15.0), command, 2.0, 0.005)[::4]
    np.testing.assert_allclose(split[:, 1:], whole[:, 1:], rtol=0, atol=1e-11)


def test_steps_that_are_no_multiple_of_the_internal_step(plant):
    rows = drive(plant, VehicleState(v_x=15.0), lambda t: (0.05, 15.0), 1.4, 0.007)
    even = drive(plant, VehicleState(v_x=15.0), lambda t: (0.05, 15.0), 1.4, 0.02)
    np.testing.assert_allclose(rows[-1], even[-1], rtol=0, atol=1e-6)


def test_integration_is_of_fourth_order():
    def end(step):
        with native_plant(CAR, internal_step=step) as plant:
            return drive(plant, VehicleState(v_x=15.0), lambda t: (0.03 * math.sin(t), 15.0), 1.0, 0.02)[-1, 1:7]

    fine, errors = end(0.0002), []
    for step in (0.005, 0.0025):
        errors.append(np.abs(end(step) - fine).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize("speed", [5.0, 15.0, 25.0])
def test_small_angle_gain_is_that_of_the_bicycle(plant, speed):
    a, b, _ = continuous(CAR, speed)
    expected = -np.linalg.solve(a[2:, 2:], b[2:]) * 1e-3
    end = drive(plant, VehicleState(v_x=speed), lambda t: (1e-3, speed), 5.0)[-1]
    assert end[5] / end[4] == pytest.approx(expected[0], rel=1e-3)
    assert end[6] == pytest.approx(expected[1], rel=1e-3)
    assert read(plant, "lateral_acceleration")[0] == pytest.approx(speed * expected[1], rel=1e-3)


def test_signs_are_those_of_iso_8855(plant):
    end = drive(plant, VehicleState(v_x=15.0), lambda t: (0.04, 15.0), 2.0)[-1]
    assert (end[[2, 3, 6, 7]] > 0).all()
    acceleration, front, rear = read(plant, "lateral_acceleration", "front_slip_angle", "rear_slip_angle")
    assert acceleration > 0
    assert front > 0
    assert rear > 0


def test_left_and_right_are_mirror_images_to_the_last_bit(plant):
    left, right = (
        drive(plant, VehicleState(v_x=15.0), lambda t, s=s: (s * 0.2 * math.sin(2 * t), 8.0), 3.0) for s in (1, -1)
    )
    np.testing.assert_array_equal(left, right * [1, 1, -1, -1, 1, -1, -1, -1])


@pytest.mark.parametrize("friction", [1.0, 0.3])
def test_friction_limits_lateral_acceleration(friction):
    with native_plant(CAR, friction=friction) as plant:
        drive(plant, VehicleState(v_x=20.0), lambda t: (0.2, 20.0), 1.5)
        acceleration = read(plant, "lateral_acceleration")[0]
    limit = CAR.tyre.p_dy1 * friction * GRAVITY
    assert 0.8 * limit < acceleration < 1.03 * limit  # lighter tyres have the better coefficient


def test_braking_ends_at_standstill_and_stays(plant):
    rows = drive(plant, VehicleState(v_x=12.0), lambda t: (0.3, -5.0), 12.0)
    assert rows[:, 4].min() >= 0.0
    still = [plant.step(SteeringCommand(0.0, -0.3, 0.0), 0.02) for _ in range(1500)]
    assert math.hypot(still[-1].x - still[0].x, still[-1].y - still[0].y) < 1e-6
    assert abs(still[-1].v_x) + abs(still[-1].v_y) + abs(still[-1].yaw_rate) < 1e-9
    assert still[-1].steer_angle == pytest.approx(-0.3)


def test_a_standing_car_moves_off(plant):
    rows = drive(plant, VehicleState(), lambda t: (0.0, 5.0), 6.0)
    assert rows[-1, 4] == pytest.approx(5.0, abs=1e-3)
    assert not rows[:, [2, 3, 5, 6]].any()


@pytest.mark.parametrize("start", [VehicleState(v_y=5.0), VehicleState(v_y=-0.5, yaw_rate=0.4)])
def test_a_sideways_slide_ends_where_friction_has_eaten_the_energy(plant, start):
    rows = drive(plant, start, lambda t: (0.0, 0.0), 4.0)
    energy = CAR.mass * (rows[:, 4] ** 2 + rows[:, 5] ** 2) / 2 + CAR.yaw_inertia * rows[:, 6] ** 2 / 2
    grip = CAR.tyre.p_dy1 * CAR.mass * GRAVITY
    stiffness = CAR.cornering_stiffness_front + CAR.cornering_stiffness_rear
    spring = grip**2 * CAR.tyre.relaxation_y / stiffness  # twice what linear tyres hold at the limit, in [J]
    assert np.all(energy[1:] <= np.minimum.accumulate(energy)[:-1] + spring)
    assert energy[-1] < 1e-3
    if start.v_y == 5.0:
        stop = 5.0**2 / (2 * CAR.tyre.p_dy1 * GRAVITY)
        assert rows[-1, 2] == pytest.approx(stop, rel=0.15)


def test_steering_keeps_its_limits(plant):
    rows = drive(plant, VehicleState(v_x=2.0), lambda t: (3.0, 2.0), 4.0)
    assert np.diff(rows[:, 7]).max() == pytest.approx(0.02 * CAR.steer_rate_limit)
    assert rows[-1, 7] == pytest.approx(CAR.steer_limit, abs=1e-9)
    assert rows[:, 7].max() <= CAR.steer_limit


def test_steering_without_lag_stops_on_the_command():
    with native_plant(CAR.with_(steer_time_constant=0.0)) as plant:
        rows = drive(plant, VehicleState(v_x=2.0), lambda t: (-0.1, 2.0), 0.4)
        np.testing.assert_allclose(rows[:, 7], -np.minimum(0.4 * rows[:, 0], 0.1), atol=1e-15)
        assert read(plant, "der(steer_angle)")[0] == 0.0


def test_a_misaligned_steering_turns_the_car_unseen():
    with native_plant(CAR, steer_offset=0.02) as plant, native_plant(CAR) as straight:
        hidden = drive(plant, VehicleState(v_x=10.0), lambda t: (0.0, 10.0), 3.0)[-1]
        true = drive(straight, VehicleState(v_x=10.0, steer_angle=0.02), lambda t: (0.02, 10.0), 3.0)[-1]
    np.testing.assert_allclose(hidden[:7], true[:7], rtol=0, atol=1e-12)
    assert hidden[7] == 0.0


def test_directional_derivatives_are_those_of_the_equations(plant):
    drive(plant, VehicleState(v_x=15.0), lambda t: (0.05, 14.0), 1.0)
    state = read(plant, *STATES)
    command = read(plant, "steer_angle_command", "target_speed")
    knowns = [REFERENCE[name] for name in (*STATES, "target_speed")]
    unknowns = [REFERENCE[f"der({name})"] for name in STATES]

    def right_hand_side(x):
        return np.array(rates(x[:9], command[0], x[9], CAR, 1.0))

    x = np.append(state, command[1])
    for column in range(10):
        found = plant._fmu._slave.getDirectionalDerivative(unknowns, [knowns[column]], [1.0])
        step = np.zeros(10)
        step[column] = 1e-5
        expected = (right_hand_side(x + step) - right_hand_side(x - step)) / 2e-5
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)
