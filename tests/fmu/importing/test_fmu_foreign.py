"""FMUs by somebody else: driven by a mapping file alone, estimated, isolated, checked."""

import math
from dataclasses import astuple

import numpy as np
import pytest
from support.fmus.fmu_files import CAR, FOREIGN_MAP, QUICK, binary, changed, description, patched, slalom, unpacked

from sidestep.controller import SteeringController
from sidestep.fmu.compiling.platforms import compile_library
from sidestep.fmu.description.plants import find_model, model_values
from sidestep.fmu.importing.estimation import Estimator
from sidestep.fmu.importing.mapping import OUTPUTS, Mapping
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.native.build import build_fmu
from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario

START = VehicleState(time=1.0, yaw=3.1, v_x=15.0)


@pytest.mark.parametrize("name", ["single-obstacle", "double-obstacle"])
def test_both_scenes_by_a_mapping_file_alone(foreign, name):
    file, table = foreign
    scenario = load_scenario(name, [f"plant.kind={str(file)!r}", f"plant.map={str(table)!r}"])
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    with open_plant(scenario) as plant:
        recording = cosimulate(controller, plant, scenario)
    assert recording.error is None
    assert judge(recording, scenario).passed
    assert recording.estimated == ("yaw_rate",)
    assert recording.units["yaw_rate"] == "rad/s, estimated"


def test_foreign_units_signs_and_estimates_meet_our_own_car(foreign):
    with FmuPlant.from_file(*foreign) as theirs, native_plant(CAR, fmi=2) as ours:
        theirs.reset(START)
        ours.reset(START)
        found, expected = slalom(theirs, 200, 0.01), slalom(ours, 200, 0.01)
    columns = [0, 1, 2, 3, 4, 5, 7]
    np.testing.assert_allclose(found[:, columns], expected[:, columns], rtol=0, atol=1e-11)
    assert np.abs(np.diff(expected[:, 3])).max() < 0.1  # beyond pi, not wrapped
    assert expected[:, 3].max() > math.pi
    np.testing.assert_allclose(found[2:, 6], expected[2:, 6], rtol=0, atol=5e-3)


def test_a_step_that_the_fmu_cannot_make_is_refused(foreign):
    with FmuPlant.from_file(*foreign) as plant:
        plant.reset(START)
        plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.03)  # three steps of its own
        with pytest.raises(
            InputError, match=r"a step of 0\.025 s: this FMU only steps by 0\.01 s; .*multiples of 0\.01"
        ):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.025)


def test_variadic_log_messages_are_filled_in(foreign, tmp_path):
    with unpacked(foreign[0]) as fmu:
        xml = (fmu.folder / "modelDescription.xml").read_text()
    lying = changed(foreign[0], tmp_path / "lying.fmu",
                    {"modelDescription.xml": xml.replace('stepSize="0.01"', 'stepSize="0.02"').encode()})  # fmt: skip
    with FmuPlant.from_file(lying, Mapping.from_text(FOREIGN_MAP)) as plant:
        plant.reset(START)
        with pytest.raises(PlantError, match=r"status 3 \(error\); step of 0\.02 s is not 10 ms"):
            plant.step(SteeringCommand(0.0, 0.0, 15.0), 0.02)


@pytest.mark.parametrize(
    ("row", "value", "expected"),
    [
        ('{ variable = "u", unit = "deg", ratio = 16.0, sign = -1 }', 0.1, -math.degrees(1.6)),
        ('{ variable = "u", full_lock = 0.5 }', 0.25, 0.5),
        ('{ variable = "u", full_lock = 0.5 }', -2.0, -1.0),
        ('{ variable = "u", scale = 2.0, offset = 0.1 }', 0.5, 0.2),
    ],
)
def test_steering_as_road_wheel_steering_wheel_or_normalised(row, value, expected):
    mapping = Mapping.from_text(f"[inputs]\nsteer_angle = {row}\n")
    assert mapping.inputs["steer_angle"].from_signal(value) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[inputs]\ntarget_speed = 'v'", "inputs: no steer_angle"),
        ("[outputs]\nx = {variable = 'a', unit = 'deg'}", r"outputs\.x\.unit: 'deg'; allowed: m, mm, km"),
        ("[outputs]\nx = {variable = 'a', ratio = 16}", r"outputs\.x: unknown key 'ratio'"),
        ("[outputs]\nx = {variable = 'a', sign = 2}", r"outputs\.x\.sign: 2; allowed: 1, -1"),
        ("estimate = ['x']", r"estimate: \['x'\]; allowed: a list of yaw, v_x"),
        ("reference_point = 'rear'", "reference_point: 'rear'; allowed: a finite number"),
    ],
)
def test_bad_mapping(text, message):
    with pytest.raises(InputError, match=message):
        Mapping.from_text(text)


@pytest.mark.parametrize(
    ("missing", "tolerance"),
    [
        (("yaw",), 1e-5), (("yaw_rate",), 5e-4), (("v_x", "v_y"), 2e-3), (("v_y", "yaw_rate"), 2e-3),
        (("yaw", "yaw_rate"), 2e-2),
    ],
    ids=["yaw", "yaw_rate", "velocity", "lateral", "both"],
)  # fmt: skip
def test_estimates_converge_to_the_signals_as_the_step_shrinks(missing, tolerance):
    def worst(dt):
        plant, estimator, errors = LinearPlant(CAR), Estimator(missing), []
        state = plant.reset(VehicleState(v_x=15.0))
        estimator.reset(state, known(state))
        for k in range(round(1.0 / dt)):
            state = plant.step(SteeringCommand(0.0, 0.03 * math.sin(4.0 * k * dt), 15.0), dt)
            found = estimator.complete(state.time, known(state), state.steer_angle)
            errors.append([abs(found[name] - getattr(state, name)) for name in missing])
        return np.max(errors[5:])

    def known(state):
        return {name: getattr(state, name) for name in OUTPUTS if name not in missing}

    assert worst(0.01) < tolerance
    assert worst(0.0025) < 0.35 * worst(0.01)


def test_position_of_another_point_becomes_that_of_the_centre_of_gravity(foreign):
    rear = Mapping.from_text(f"reference_point = {-CAR.l_r}\n" + FOREIGN_MAP)
    with FmuPlant.from_file(foreign[0], rear) as plant:
        state = plant.reset(START)
    assert (state.x, state.y) == pytest.approx((CAR.l_r * math.cos(3.1), CAR.l_r * math.sin(3.1)))  # the car cannot


def test_motion_of_another_point_becomes_that_of_the_centre_of_gravity(foreign):
    """What is reported as speeds is how the reported position moves, whichever point of the body the FMU tells of."""
    for ahead in (-CAR.l_r, 0.0, CAR.l_f):
        mapping = Mapping.from_text(f"reference_point = {ahead}\n" + FOREIGN_MAP)
        with FmuPlant.from_file(foreign[0], mapping) as plant:
            plant.reset(VehicleState(v_x=15.0))
            rows = slalom(plant, 150, 0.01)
        yaw, v_x, v_y, yaw_rate = 0.5 * (rows[51:] + rows[50:-1]).T[3:7]
        east, north = (np.diff(rows[50:, 1:3], axis=0) / 0.01).T
        assert np.abs(yaw_rate).max() > 0.2
        assert np.abs(east * np.cos(yaw) + north * np.sin(yaw) - v_x).max() < 0.01
        assert np.abs(north * np.cos(yaw) - east * np.sin(yaw) - v_y).max() < 0.01


def test_a_start_is_that_of_the_centre_of_gravity_whichever_point_is_set():
    values = model_values(find_model("single-track"), CAR, 1.0)
    with FmuPlant(build_fmu(), Mapping(parameters=values, reference_point=-CAR.l_r)) as plant:
        asked = VehicleState(0.0, 2.0, 3.0, 0.4, 15.0, 0.1, 0.3, 0.01)
        assert astuple(plant.reset(asked)) == pytest.approx(astuple(asked))
        assert plant._signals["v_y"] == pytest.approx(0.1 - CAR.l_r * 0.3)  # the rear swings out


def test_pedals_follow_the_speed_control(tmp_path):
    text = description(3).replace('name="target_speed"', 'name="gas"').replace('name="steer_offset"', 'name="bremse"')
    text = text.replace('name="speed_gain"', 'name="Bremse"')
    foreign = changed(build_fmu(), tmp_path / "pedals.fmu", {"modelDescription.xml": text.encode()})
    mapping = Mapping.from_text(
        '[inputs]\nsteer_angle = "steer_angle_command"\nthrottle = { variable = "gas", scale = 3.0 }\n'
        'brake = { variable = "bremse", scale = 8.0 }\n[start]\nv_x = "v_x_0"\n'
    )
    with FmuPlant.from_file(foreign, mapping, CAR) as plant:
        plant.reset(VehicleState(v_x=15.0))
        for target, pedals in ((20.0, [0.0, 1.0, 0.0]), (14.0, [0.0, 0.0, 0.25]), (0.0, [0.0, 0.0, 1.0])):
            plant._hold(SteeringCommand(0.0, 0.0, target))
            assert list(plant._inputs.values) == pytest.approx(pedals)


def test_a_discarded_step_is_made_in_halves(tmp_path):
    for fmi in (2, 3):
        (tmp_path / str(fmi)).mkdir()
        picky = patched(tmp_path / str(fmi), fmi, "    Status status = engine_step(instance, time, duration);",
                        "    if (duration > 0.006) return DISCARD;\n"
                        "    Status status = engine_step(instance, time, duration);")  # fmt: skip
        with FmuPlant.from_file(picky, vehicle=CAR) as plant, native_plant(CAR, fmi=fmi) as free:
            plant.reset(START)
            free.reset(START)
            np.testing.assert_allclose(slalom(plant, 60), slalom(free, 60), rtol=0, atol=1e-6)


def test_an_early_return_is_taken_up_where_it_ended(tmp_path):
    early = patched(tmp_path, 3, "    fmi3Status status = (fmi3Status)do_step(c, time, duration);",
                    "    fmi3Boolean part = duration > 0.008;\n"
                    "    fmi3Status status = (fmi3Status)do_step(c, time, part ? 0.007 : duration);")  # fmt: skip
    file = tmp_path / "sources" / "fmi3.c"
    file.write_text(file.read_text().replace("*event = *end = *early = fmi3False;",
                                             "*event = *end = fmi3False, *early = part;"))  # fmt: skip
    compile_library(tmp_path / "sources", tmp_path / "binary", QUICK)
    changed(early, tmp_path / "early.fmu", {binary(3): (tmp_path / "binary").read_bytes()})
    with FmuPlant.from_file(tmp_path / "early.fmu", vehicle=CAR) as plant, native_plant(CAR) as whole:
        plant.reset(START)
        whole.reset(START)
        np.testing.assert_allclose(slalom(plant, 60), slalom(whole, 60), rtol=0, atol=1e-6)


def test_many_instances_leave_memory_as_it_was():
    with native_plant(CAR) as plant:

        def cycle(count):
            for _ in range(count):
                plant.reset(START)
            with open("/proc/self/statm") as statm:
                return int(statm.read().split()[1])

        before = cycle(500)
        after = cycle(10_000)
    assert after - before < 256  # pages of 4 KB
