"""The controller as an FMU: the same bits as in this process, and every way in which its process can fail."""

import os
import signal
import time
from contextlib import contextmanager
from dataclasses import astuple, replace
from pathlib import Path

import pytest
from support.fmus.fmu_files import patched, reported_here

from sidestep.controller import SteeringController
from sidestep.fmu.exporting.controller_variables import STATE
from sidestep.fmu.exporting.export import export_controller
from sidestep.fmu.importing.checks import findings
from sidestep.fmu.importing.checks.findings import check_fmu
from sidestep.fmu.importing.instance import FmuInstance
from sidestep.plant_models.errors import PlantError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("double-obstacle")
COMMAND = ["steer_angle_command", "target_speed", "acceleration", "status"]


def export(fmi):
    scene = SCENE
    return export_controller(scene.name, scene.vehicle, scene.path, scene.obstacles, scene.controller, scene.start, fmi)


def in_process(**settings):
    config = replace(SCENE.controller, **settings)
    return SteeringController(SCENE.vehicle, SCENE.path, SCENE.obstacles, config)


@contextmanager
def running(fmi, file=None, **parameters):
    fmu = FmuInstance(file or export(fmi))
    try:
        fmu.start(0.0, parameters)
        yield fmu
    finally:
        fmu.close()


class Driver:
    """Steps the FMU as a master does, without delay."""

    def __init__(self, fmu, further=()):
        self.fmu, self.further = fmu, list(further)
        self.inputs = fmu.port([name for name, *_ in STATE])
        self.outputs = fmu.port([*COMMAND, *further])

    def step(self, state, dt=0.02):
        self.inputs.values[:] = astuple(state)[1:]
        self.fmu.set(self.inputs)
        self.fmu.step(state.time, dt)
        self.fmu.get(self.outputs)
        return self.outputs.values[:]


def drive(controller, count=60):
    """States and commands of a drive in this process."""
    plant = LinearPlant(SCENE.vehicle)
    state, rows = plant.reset(SCENE.start), []
    for _ in range(count):
        command = controller.step(state)
        rows.append((state, [command.steer_angle, command.target_speed, command.acceleration, float(command.status)]))
        state = plant.step(command, 0.02)
    return rows


@pytest.fixture(scope="module")
def driven():
    return drive(in_process())


@pytest.mark.parametrize("fmi", [2, 3])
def test_nothing_is_found_in_it(fmi, monkeypatch):
    monkeypatch.setattr(findings, "reported", reported_here)
    assert check_fmu(export(fmi)) == []


@pytest.mark.parametrize("fmi", [2, 3])
def test_same_bits_as_in_this_process_and_back_from_a_saved_state(fmi, driven):
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
        again = slave.deserializeFMUState(data)
        slave.setFMUState(again)
        slave.freeFMUState(again)
        assert [driver.step(state) for state, _ in driven[30:]] == [expected for _, expected in driven[30:]]


def test_first_answer_is_there_after_initialisation_and_follows_the_inputs_until_the_first_step(driven):
    with running(3, y=0.5) as fmu:
        driver = Driver(fmu)
        fmu.get(driver.outputs)
        moved = in_process().step(replace(SCENE.start, y=0.5))
        assert driver.outputs.values[0] == moved.steer_angle
        assert driver.step(driven[0][0]) == driven[0][1]


def test_samples_are_held_for_a_period_and_status_outputs_tell_of_it(driven):
    with running(3) as fmu:
        driver = Driver(fmu, ["sample_time", "clearance", "qp_status", "iterations", "solve_time", "step_time"])
        first = driver.step(driven[0][0], 0.01)
        held = driver.step(replace(driven[0][0], time=0.01, y=1.0), 0.01)
        assert held == first
        assert driver.step(driven[1][0], 0.01)[:4] == [*driven[1][1], 0.02]
    obstacle = SCENE.obstacles[0]
    assert first[4] == pytest.approx(obstacle.s - obstacle.length / 2 - SCENE.vehicle.front_extent, abs=1e-9)
    assert first[5] == 0.0
    assert first[6] == 0.0  # no bound acts, PIQP is not asked
    assert 0.0 <= first[7] < first[8]  # no solver was asked


def test_tuning_while_it_runs_keeps_the_memory(driven):
    original = in_process()
    for state, _ in driven[:20]:
        original.step(state)
    tuned = in_process(buffer=0.5, weight_offset=9.0)
    tuned.restore(original.save())
    with running(2) as fmu:
        driver = Driver(fmu)
        for state, _ in driven[:20]:
            driver.step(state)
        port = fmu.port(["buffer", "weight_offset"])
        port.values[:] = [0.5, 9.0]
        fmu.set(port)
        for state, _ in driven[20:40]:
            found, command = driver.step(state), tuned.step(state)
            assert found == [command.steer_angle, command.target_speed, command.acceleration, float(command.status)]
        assert found != driven[39][1]


def test_a_setting_that_cannot_be_is_an_error_with_its_reason():
    with pytest.raises(PlantError, match=r"controller\.friction: 0\.0; allowed: 0\.01 to 5"), running(3, friction=0.0):
        pass


def children():
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def test_a_child_that_is_killed_is_fatal_at_once_and_leaves_no_zombie(driven):
    before = children()
    with running(3) as fmu:
        driver = Driver(fmu)
        driver.step(driven[0][0])
        (child,) = children() - before
        os.kill(int(child), signal.SIGKILL)
        began = time.monotonic()
        with pytest.raises(PlantError, match=r"status 4 \(fatal\); the controller's process was killed"):
            driver.step(driven[1][0])
        assert time.monotonic() - began < 2.0
    assert children() == before


def test_a_child_that_sleeps_for_ever_is_ended_after_the_limit(tmp_path, monkeypatch):
    limits = "START_LIMIT = 300000, STEP_LIMIT = 30000"
    hasty = patched(tmp_path, 3, limits, "START_LIMIT = 400, STEP_LIMIT = 400", export(3), "steering_controller")
    monkeypatch.setenv("SIDESTEP_PYTHON", interpreter(tmp_path, "exec sleep 600"))
    before = children()
    with pytest.raises(PlantError, match=r"the controller's process hangs: it was ended"), running(3, hasty):
        pass
    assert children() == before


def test_every_instance_ends_with_its_process():
    before = children()
    with running(2), running(3):
        assert len(children() - before) == 2
    assert children() == before


def interpreter(folder, text):
    file = folder / "python"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    return str(file)


def test_an_interpreter_that_fails_says_why(tmp_path, monkeypatch):
    monkeypatch.setenv("SIDESTEP_PYTHON", "/no/such/python")
    with pytest.raises(PlantError, match=r"/no/such/python cannot be started: No such file.*set SIDESTEP_PYTHON"), \
            running(3):  # fmt: skip
        pass
    monkeypatch.setenv("SIDESTEP_PYTHON", interpreter(tmp_path, "echo 100% lost >&2; exit 3"))
    for fmi in (2, 3):
        with pytest.raises(PlantError, match=r"process ended: 100% lost \(exit status 3\)"), running(fmi):
            pass


def test_its_environment_is_clean_and_ours_untouched(tmp_path, monkeypatch):
    monkeypatch.setenv("LD_PRELOAD_X", "host")
    monkeypatch.setenv("PYTHONHOME_X", "host")
    monkeypatch.setenv("KEPT", "yes")
    monkeypatch.setenv("SIDESTEP_PYTHON", interpreter(tmp_path, "env | grep -c '=host$' >&2; echo $KEPT $1 >&2"))
    before = dict(os.environ)
    with pytest.raises(PlantError, match=r"; 0; yes -I; the controller's process ended"), running(3):
        pass
    assert dict(os.environ) == before
