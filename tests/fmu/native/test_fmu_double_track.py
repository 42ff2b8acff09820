"""The double-track core: its equations, written again here, what physics says of any car, and its limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.fmus.fmu_files import CAR
from support.fmus.integration import integrate
from support.fmus.native_drive import drive, read

from sidestep.fmu.exporting.export import start_plant
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.checks.check_plant import check_plant
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.formula import cornering_stiffness, lateral_force
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario

SUSPENSION = CAR.suspension
COMMON = [0, 1, 2, 3, 4, 5, 12]  # those of the states that VehicleState holds, in its order
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
LOADS = [f"{wheel}_load" for wheel in WHEELS]
assert CAR.suspension
RAISED = CAR.with_(suspension=replace(CAR.suspension, roll_centre_front=0.06, roll_centre_rear=0.15))
SHIFTED = replace(CAR.tyre, p_hy1=0.002, p_vy1=0.02, p_vy2=0.01, p_ey1=-1.0, p_ey2=0.5, p_ey3=0.1, p_ky4=1.8)


def plant_of(car=CAR, **parameters):
    return native_plant(car, model="double-track", **parameters)


def rates(state, steer_command, target_speed, car, friction):
    """The equations of documentation/index.html."""
    forces, _ = once(state, steer_command, target_speed, car, friction, {"front": 0.0, "rear": 0.0})
    return once(state, steer_command, target_speed, car, friction, forces)[1]


def once(state, steer_command, target_speed, car, friction, through):
    """Lateral force of the axles, and the rates, with the forces `through` the roll centres."""
    _, _, yaw, v_x, v_y, r, roll, roll_rate, *slips, delta = state
    springs, weight, tyre = car.suspension, car.mass * GRAVITY, car.tyre
    a_x = min(max(2.0 * (target_speed - v_x), -car.max_braking), car.max_acceleration)
    grip = 0.9 * tyre.p_dx1 * friction * GRAVITY
    a_x = min(max(a_x, -grip), grip)
    front = (weight * car.l_r - car.mass * a_x * car.cg_height) / car.wheelbase
    force, yaw_moment, roll_moment, slip_rates, axles = np.zeros(2), 0.0, 0.0, [], {"front": 0.0, "rear": 0.0}
    for axle, x, axle_load, angle in (("front", car.l_f, front, delta), ("rear", -car.l_r, weight - front, 0.0)):
        spring, damper, bar, track, centre = (
            getattr(springs, f"{n}_{axle}") for n in ("spring", "damper", "anti_roll", "track", "roll_centre")
        )
        transfer = ((spring * track**2 / 2 + bar) * roll + damper * track**2 / 2 * roll_rate) / track
        transfer += through[axle] * centre / track
        lever = car.cg_height - centre
        roll_moment += axle_load * lever * roll
        transfer = min(max(transfer, -axle_load / 2), axle_load / 2)
        roll_moment -= transfer * track
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        for side in (1, -1):
            y, load = side * track / 2, axle_load / 2 - side * transfer
            u, w = turn.T @ [v_x - y * r, v_y + lever * roll_rate + x * r]
            law = (tyre if side > 0 else tyre.mirrored()).as_array()
            z, speed, dfz = slips[len(slip_rates)], math.hypot(u, w), load / tyre.nominal_load - 1
            d_x = max(tyre.p_dx1 + tyre.p_dx2 * dfz, 0.1) * friction * load
            d_y = max(tyre.p_dy1 + tyre.p_dy2 * dfz, 0.1) * friction * load
            q = (z * car.tyre_scale(axle) * cornering_stiffness(load, law) / d_y) ** 2
            slip_rates.append((1 + q / (1 + q * speed / 60)) * (-w - speed * z) / tyre.relaxation_y)
            part = min(max(a_x / GRAVITY * load / d_x, -0.9), 0.9)
            lateral = lateral_force(math.asin(z), load, friction, law, car.tyre_scale(axle)) * math.sqrt(1 - part**2)
            f = turn @ [part * d_x, lateral]
            force += f
            axles[axle] += f[1]
            yaw_moment += x * f[1] - y * f[0]
    roll_rates = (roll_moment + car.cg_height * force[1]) / springs.roll_inertia
    turn = (min(max(steer_command, -car.steer_limit), car.steer_limit) - delta) / car.steer_time_constant
    return axles, [
        v_x * math.cos(yaw) - v_y * math.sin(yaw), v_x * math.sin(yaw) + v_y * math.cos(yaw), r,
        force[0] / car.mass + v_y * r, force[1] / car.mass - v_x * r,
        yaw_moment / car.yaw_inertia, roll_rate, roll_rates, *slip_rates,
        min(max(turn, -car.steer_rate_limit), car.steer_rate_limit),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("car", "friction", "start", "command"),
    [
        (CAR, 1.0, VehicleState(v_x=15.0), lambda t: (0.07 * math.sin(3 * t), 15.0)),
        (RAISED, 0.9, VehicleState(v_x=15.0), lambda t: (0.07 * math.sin(3 * t), 12.0)),
        (CAR.with_(tyre=SHIFTED), 0.5, VehicleState(v_x=20.0, yaw=1.0), lambda t: (0.15 if t < 0.3 else -0.1, 16.0)),
    ],
    ids=["slalom", "raised-roll-centres", "braking-slide-on-shifted-tyres"],
)
def test_fmu_equals_an_independent_integration(car, friction, start, command):
    expected = integrate(lambda *now: rates(*now, car, friction), start, 6, command, 0.6)
    with plant_of(car, friction=friction, internal_step=0.001) as plant:
        found = drive(plant, start, command, 0.6)
        roll = read(plant, "roll")[0]
    np.testing.assert_allclose(found[:, 1:], expected[:, COMMON], rtol=0, atol=1e-6)
    assert roll == pytest.approx(expected[-1, 6], abs=1e-7)
    assert np.abs(expected[:, 6]).max() > 0.02  # the manoeuvre is one


def test_it_is_a_plant_of_the_command_line():
    scenario = load_scenario("single-obstacle", ["plant.kind=double-track", "plant.friction=0.8"])
    with open_plant(scenario) as plant:
        assert check_plant(plant, scenario.vehicle) == []
        assert plant.mapping.parameters["friction"] == 0.8


@pytest.mark.parametrize("target", [15.0, 5.0, 25.0], ids=["rolling", "braking", "accelerating"])
def test_loads_sum_to_the_weight_and_stand_as_statics_have_it(target):
    with plant_of() as plant:
        plant.reset(VehicleState(v_x=15.0))
        static = CAR.mass * GRAVITY / CAR.wheelbase / 2 * np.array([CAR.l_r, CAR.l_r, CAR.l_f, CAR.l_f])
        np.testing.assert_allclose(read(plant, *LOADS), static, rtol=1e-14)
        for k in range(50):
            plant.step(SteeringCommand(0.0, 0.2 * math.sin(0.2 * k), target), 0.02)
            loads = read(plant, *LOADS)
            assert loads.sum() == pytest.approx(CAR.mass * GRAVITY, rel=1e-13)
            assert loads.min() >= 0.0


def test_load_transfer_of_a_steady_turn_is_what_the_moments_about_the_ground_ask_for():
    with plant_of() as plant:
        drive(plant, VehicleState(v_x=15.0), lambda t: (0.05, 15.0), 8.0)
        loads, (a_y, roll) = read(plant, *LOADS), read(plant, "lateral_acceleration", "roll")
    transfer = (loads[1] - loads[0]) / 2 * SUSPENSION.track_front + (loads[3] - loads[2]) / 2 * SUSPENSION.track_rear
    assert transfer == pytest.approx(CAR.mass * CAR.cg_height * (a_y + GRAVITY * roll), rel=1e-6)
    assert a_y > 3.0
    track = SUSPENSION.track_front
    stiff = replace(
        SUSPENSION, anti_roll_front=1e9, anti_roll_rear=1e9, damper_front=3e7, damper_rear=3e7, roll_inertia=1e6,
        track_rear=track,
    )  # fmt: skip
    with plant_of(CAR.with_(suspension=stiff)) as plant:
        drive(plant, VehicleState(v_x=15.0), lambda t: (0.05, 15.0), 8.0)
        loads, a_y = read(plant, *LOADS), read(plant, "lateral_acceleration")[0]
    transfer = (loads[1] - loads[0] + loads[3] - loads[2]) / 2
    assert transfer == pytest.approx(CAR.mass * a_y * CAR.cg_height / track, rel=1e-4)


def test_signs_are_those_of_iso_8855():
    with plant_of() as plant:
        end = drive(plant, VehicleState(v_x=15.0), lambda t: (0.04, 15.0), 2.0)[-1]
        a_y, roll, *angles = read(plant, "lateral_acceleration", "roll", *(f"{w}_slip_angle" for w in WHEELS))
        left_front, right_front, left_rear, right_rear = read(plant, *LOADS)
    assert (end[[2, 3, 6, 7]] > 0).all()  # to the left
    assert a_y > 0
    assert roll > 0  # to the right
    assert min(angles) > 0
    assert left_front < right_front
    assert left_rear < right_rear


@pytest.mark.parametrize("tyre", [CAR.tyre, SHIFTED], ids=["symmetric", "shifted"])
def test_left_and_right_are_mirror_images_to_the_last_bit(tyre):
    with plant_of(CAR.with_(tyre=tyre)) as plant:
        left, right = (
            drive(plant, VehicleState(v_x=15.0), lambda t, s=s: (s * 0.2 * math.sin(2 * t), 8.0), 2.0) for s in (1, -1)
        )
    np.testing.assert_allclose(left, right * [1, 1, -1, -1, 1, -1, -1, -1], rtol=0, atol=1e-12)


def narrow(track):
    """The car with its centre of gravity near the ground: it does not roll and shifts no load."""
    springs = replace(SUSPENSION, track_front=track, track_rear=track)
    return CAR.with_(cg_height=1e-9, suspension=springs)


def test_without_width_and_height_it_is_the_single_track():
    def command(t):
        return 0.15 * math.sin(3 * t), 12.0

    with native_plant(narrow(1.0)) as single:
        expected = drive(single, VehicleState(v_x=15.0), command, 2.0)
    gaps = []
    for track in (0.5, 0.25):
        with plant_of(narrow(track)) as plant:
            gaps.append(np.abs(drive(plant, VehicleState(v_x=15.0), command, 2.0) - expected).max())
    assert gaps[0] < 0.05
    assert gaps[1] / gaps[0] == pytest.approx(0.25, rel=0.1)  # falls with the square of the track
    with plant_of(narrow(0.05)) as plant:
        assert np.abs(drive(plant, VehicleState(v_x=15.0), command, 2.0) - expected).max() < 0.012 * gaps[0]


def test_load_transfer_costs_grip_where_tyres_are_sensitive_to_load_and_only_there():
    stiff = replace(SUSPENSION, track_front=0.1, track_rear=0.1, anti_roll_front=1e6, anti_roll_rear=1e6,
                    damper_front=4e6, damper_rear=4e6)  # fmt: skip
    low = CAR.with_(cg_height=0.04, suspension=stiff)  # its wheels are as fast left as right, its loads are not

    def accelerations(tyre):
        """At the limit, on two tracks and on one, in [m/s^2]."""
        car = low.with_(tyre=tyre)
        with plant_of(car) as double, native_plant(car) as single:
            for plant in (double, single):
                drive(plant, VehicleState(v_x=20.0), lambda t: (0.2, 20.0), 1.5)
            loads = read(double, *LOADS)
            assert loads[1] > 2.0 * loads[0]
            return [read(plant, "lateral_acceleration")[0] for plant in (double, single)]

    double, single = accelerations(CAR.tyre.without_load_sensitivity())
    assert double == pytest.approx(single, rel=1e-3)
    double, single = accelerations(replace(CAR.tyre, p_dy2=-0.4))
    assert double < 0.98 * single


def test_a_tall_car_lifts_its_inner_wheels_and_falls_over():
    tall = CAR.with_(cg_height=1.2)
    with plant_of(tall) as plant:
        drive(plant, VehicleState(v_x=20.0), lambda t: (0.1, 20.0), 1.5)
        loads, roll = read(plant, *LOADS), read(plant, "roll")[0]
    assert loads[0] == loads[2] == 0.0
    assert roll > 0.3
    with plant_of() as plant:
        drive(plant, VehicleState(v_x=20.0), lambda t: (0.1, 20.0), 1.5)
        assert read(plant, "roll")[0] < 0.15


def test_braking_in_a_turn_ends_at_standstill_and_stays():
    with plant_of() as plant:
        rows = drive(plant, VehicleState(v_x=12.0), lambda t: (0.2, -5.0), 5.0)
        still = [plant.step(SteeringCommand(0.0, -0.2, 0.0), 0.02) for _ in range(200)]
        roll = read(plant, "roll", "roll_rate")
    assert rows[:, 4].min() >= 0.0
    assert math.hypot(still[-1].x - still[0].x, still[-1].y - still[0].y) < 1e-3
    assert np.abs(roll).max() < 0.01


def test_a_car_without_suspension_data_is_refused():
    bare = VehicleParameters.preset("bmw-320i", suspension=None)
    for build in (plant_of, lambda car: start_plant("double-track", car, VehicleState(v_x=15.0))):
        with pytest.raises(InputError, match=r"vehicle\.suspension: bmw-320i has none; double-track needs it"):
            build(bare)
