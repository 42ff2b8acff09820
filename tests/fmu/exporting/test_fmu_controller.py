"""The controller as an FMU: the same bits as in this process, obstacles as inputs, state save and restore."""

import math
from dataclasses import replace

import pytest
from support.component import drive as drive_here
from support.component import in_process, scene_of
from support.fmus.controller_fmu import Driver, answer_of, export, numbers, obstacle_names, running
from support.fmus.fmu_files import reported_here

from sidestep.controller.records import LAYERS, OBSTACLES
from sidestep.fmu.exporting.export import export_controller
from sidestep.fmu.importing.checks import findings
from sidestep.fmu.importing.checks.findings import check_fmu
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.obstacle import Obstacle


@pytest.fixture(scope="module")
def driven():
    rows, _ = drive_here(scene_of("double-obstacle"), 60)
    return [(state, numbers(command)) for state, command in rows]


@pytest.mark.parametrize("fmi", [2, 3])
def test_nothing_is_found_in_it(fmi, monkeypatch):
    monkeypatch.setattr(findings, "reported", reported_here)
    assert check_fmu(export(fmi)) == []


@pytest.mark.parametrize("name", ["single-obstacle", "double-obstacle", "moose"])
@pytest.mark.parametrize("fmi", [2, 3])
def test_a_drive_has_the_bits_of_the_one_in_this_process(fmi, name):
    rows, _ = drive_here(scene_of(name))
    with running(fmi, export(fmi, name)) as fmu:
        driver = Driver(fmu)
        for state, command in rows:
            assert driver.step(state) == numbers(command)


@pytest.mark.parametrize("fmi", [2, 3])
def test_back_from_a_saved_state_in_another_instance(fmi, driven):
    with running(fmi) as fmu, running(fmi, buffer=0.4) as wary:
        driver, other = Driver(fmu), Driver(wary)
        for state, expected in driven[:30]:
            assert driver.step(state) == expected
            other.step(state)
        slave = fmu._slave
        saved = slave.getFMUState()
        data = slave.serializeFMUState(saved)
        slave.freeFMUState(saved)
        for state, expected in driven[30:]:
            assert driver.step(state) == expected
        for target, stepped in ((slave, driver), (wary._slave, other)):
            again = target.deserializeFMUState(data)
            target.setFMUState(again)
            target.freeFMUState(again)
            assert [stepped.step(state) for state, _ in driven[30:]] == [expected for _, expected in driven[30:]]


def test_a_serialised_state_of_another_build_or_damaged_is_refused(driven):
    with running(3) as fmu, running(3, export(3, "moose")) as other:
        Driver(fmu).step(driven[0][0])
        Driver(fmu).step(driven[1][0])
        data = fmu._slave.serializeFMUState(fmu._slave.getFMUState())
        with pytest.raises(Exception, match="status 3"):
            other._slave.deserializeFMUState(data)
        damaged = fmu._slave.deserializeFMUState(data[:-40] + b"\x55" + data[-39:])
        with pytest.raises(Exception, match="status 3"):
            fmu._slave.setFMUState(damaged)


@pytest.mark.parametrize("fmi", [2, 3])
def test_obstacles_that_appear_while_it_runs(fmi):
    """As a controller whose obstacles change, on a road that was exported without any."""
    scene = replace(scene_of("double-obstacle"), obstacles=())
    controller = in_process(scene)
    rows, _ = drive_here(scene, 60)
    seen = Obstacle(45.0, 0.3, 4.5, 1.8, 0.1, 2.0)
    with running(fmi, export(fmi, obstacles=())) as fmu:
        driver = Driver(fmu)
        box = fmu.port(["obstacle_count", *obstacle_names(fmi, 0)])
        for k, (state, _) in enumerate(rows):
            if k == 20:
                box.values[:] = [1.0, seen.s, seen.l, seen.length, seen.width, seen.heading, seen.speed, 0.0]
                fmu.set(box)
                with_it = in_process(replace(scene, obstacles=(seen,)))
                with_it.restore(controller.save())
                controller = with_it
            assert driver.step(state) == answer_of(controller, state)
        assert driver.outputs.values[0] != rows[-1][1][1]  # it does act


def test_first_answer_is_there_after_initialisation_and_follows_the_inputs_until_the_first_step(driven):
    scene = scene_of("double-obstacle")
    with running(3, y=0.5) as fmu:
        driver = Driver(fmu)
        fmu.get(driver.outputs)
        assert driver.outputs.values[:] == answer_of(in_process(scene), replace(scene.start, y=0.5))
        assert driver.step(driven[0][0]) == driven[0][1]


def test_samples_are_held_for_a_period_and_outputs_tell_of_it(driven):
    scene = scene_of("double-obstacle")
    with running(3) as fmu:
        driver = Driver(fmu, ["sample_time", "clearance", "solver_status", "iterations", "path_count"])
        first = driver.step(driven[0][0], 0.01)
        held = driver.step(replace(driven[0][0], time=0.01, y=1.0), 0.01)
        assert held == first
        assert driver.step(driven[1][0], 0.01)[:5] == [*driven[1][1], 0.02]
    obstacle = scene.obstacles[0]
    assert first[5] == pytest.approx(obstacle.s - obstacle.length / 2 - scene.vehicle.front_extent, abs=1e-9)
    assert first[6:8] == [1.0, 0.0]  # no bound acts, no solver was asked
    assert 1.0 < first[8] <= LAYERS + 1


@pytest.mark.parametrize("fmi", [2, 3])
def test_path_corridor_and_prediction_are_those_of_the_plan(fmi, driven):
    controller = in_process(scene_of("double-obstacle"))
    for state, _ in driven:
        controller.step(state)
    plan, nodes = controller.plan, len(controller.plan.states) - 1

    def element(array, i):
        owner, field = array.split(".")
        return f"{owner}[{i + 1}].{field}" if fmi == 2 else f"{array}[{i}]"

    expected = {}
    for name, values in (("path.s", plan.s), ("path.l", plan.l), ("path.left", plan.left), ("path.right", plan.right),
                         ("predicted.s", plan.states_s[1:]), ("predicted.l", plan.states[1:, 0]),
                         ("predicted.heading", plan.states[1:, 1]), ("predicted.steer_angle", plan.states[1:, 4]),
                         ("predicted.time", plan.states_time[1:])):  # fmt: skip
        expected |= {element(name, i): float(value) for i, value in enumerate(values)}
    assert len(expected) == 4 * len(plan.s) + 5 * nodes
    with running(fmi) as fmu:
        driver = Driver(fmu, expected)
        for state, _ in driven:
            found = driver.step(state)
    assert found[4:] == list(expected.values())


def test_tuning_while_it_runs_keeps_the_memory(driven):
    scene = scene_of("double-obstacle")
    original = in_process(scene)
    for state, _ in driven[:20]:
        original.step(state)
    tuned = in_process(scene, buffer=0.5, weight_offset=9.0, bend_acceleration=3.0)
    tuned.restore(original.save())
    with running(2) as fmu:
        driver = Driver(fmu)
        for state, _ in driven[:20]:
            driver.step(state)
        port = fmu.port(["buffer", "weight_offset", "bend_acceleration"])
        port.values[:] = [0.5, 9.0, 3.0]
        fmu.set(port)
        for state, _ in driven[20:40]:
            found = driver.step(state)
            assert found == answer_of(tuned, state)
        assert found != driven[39][1]


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_state_that_is_not_measured(fmi, driven):
    controller = in_process(scene_of("double-obstacle"))
    with running(fmi) as fmu:
        driver = Driver(fmu)
        for state, _ in driven[:20]:
            driver.step(state)
            controller.step(state)
        for k in range(12):
            lost = replace(driven[20 + k][0], y=math.nan)
            assert driver.step(lost) == answer_of(controller, lost)
        assert driver.outputs.values[3] == 3.0
        assert driver.step(driven[32][0]) == answer_of(controller, driven[32][0])


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("friction", 0.0, "friction must be at least 0.01, not 0"),
        ("input_delay_steps", 51.0, "input_delay_steps must be at most 50, not 51"),
        ("obstacle_count", 17.0, "obstacle_count must be at most 16, not 17"),
        ("period", 0.01, "period is not an input or a parameter"),
    ],
)
@pytest.mark.parametrize("fmi", [2, 3])
def test_a_value_that_cannot_be_is_an_error_with_what_is_allowed(fmi, name, value, problem):
    with pytest.raises(PlantError, match=problem), running(fmi, **{name: value}):
        pass


def test_there_is_room_for_all_obstacles_of_a_scene():
    crowd = [Obstacle(20.0 + 3.0 * k, 3.5, 1.0, 1.0) for k in range(30)]
    scene = replace(scene_of("double-obstacle"), obstacles=crowd)
    rows, _ = drive_here(scene, 10)
    with running(3, export(3, obstacles=crowd)) as fmu:
        driver = Driver(fmu)
        assert [driver.step(state) for state, _ in rows] == [numbers(command) for _, command in rows]
    assert len(crowd) < OBSTACLES


def test_the_literal_paper_cannot_be_exported():
    scene = scene_of("double-obstacle", "controller.preset=paper")
    with pytest.raises(InputError, match=r"controller\.formulation: 'paper': its solver is not compiled"):
        export_controller(scene.name, scene.vehicle, scene.path, (), scene.controller, scene.start, 3)
