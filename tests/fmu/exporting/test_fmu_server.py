"""The Python side of the controller's FMU, in this process: its messages over a pair of sockets."""

import json
import os
import signal
import socket
import struct
import threading
import zipfile
from dataclasses import asdict, astuple, replace

import numpy as np
import pytest

from sidestep.controller import SteeringController
from sidestep.fmu.exporting import controller_server
from sidestep.fmu.exporting.controller_server import NOTHING_NEAR, ControllerServer, clearance, serve
from sidestep.fmu.exporting.controller_variables import NAMES, OUTPUTS, controller_model
from sidestep.fmu.exporting.export import export_controller
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.validation.geometry import boxes, signed_clearance
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("double-obstacle")
START, STEP, SAVE, RESTORE = 1, 2, 3, 4
AT = {name: index for index, name in enumerate(NAMES)}
OK, ERROR = 0, 3


@pytest.fixture(scope="module")
def description():
    """resources/controller.json as the FMU has it."""
    scene = SCENE
    file = export_controller(scene.name, scene.vehicle, scene.path, scene.obstacles, scene.controller, scene.start)
    with zipfile.ZipFile(file) as archive:
        return json.loads(archive.read("resources/controller.json"))


@pytest.fixture
def ask(description):
    """Sends a request to a server and receives its answer, as process.c does."""
    ours, theirs = socket.socketpair()
    thread = threading.Thread(target=serve, args=(ControllerServer(description), theirs))
    thread.start()

    def call(code, data=b""):
        ours.sendall(struct.pack("=qQ", code, len(data)) + data)
        status, size = struct.unpack("=qQ", ours.recv(16, socket.MSG_WAITALL))
        return status, ours.recv(size, socket.MSG_WAITALL) if size else b""

    with theirs, ours:
        yield call
        ours.shutdown(socket.SHUT_WR)
        thread.join(60.0)
    assert not thread.is_alive()  # it ends with the connection


def values(state, **settings):
    """A request's data: all variables in the order of the table."""
    config = replace(SCENE.controller, cruise_speed=SCENE.start.v_x)
    model = controller_model("any", asdict(SCENE.start), config)
    row = np.array([variable.start or 0.0 for variable in model.variables])
    row[: len(astuple(state))] = astuple(state)
    for name, value in settings.items():
        row[AT[name]] = value
    return row.tobytes()


def answered(data):
    row = np.frombuffer(data)
    return [row[AT["steer_angle_command"]], row[AT["target_speed"]], row[AT["acceleration"]], int(row[AT["status"]])]


def drive(controller, count):
    plant = LinearPlant(SCENE.vehicle)
    state, rows = plant.reset(SCENE.start), []
    for _ in range(count):
        command = controller.step(state)
        rows.append((state, [command.steer_angle, command.target_speed, command.acceleration, command.status]))
        state = plant.step(command, 0.02)
    return rows


def controller_of(**settings):
    return SteeringController(SCENE.vehicle, SCENE.path, SCENE.obstacles, replace(SCENE.controller, **settings))


@pytest.fixture(scope="module")
def driven():
    return drive(controller_of(), 12)


def test_it_answers_with_the_bits_of_the_controller_and_leaves_all_else(ask, driven):
    for code, (state, expected) in zip([START, *[STEP] * 11], driven, strict=True):
        sent = values(state)
        status, data = ask(code, sent)
        assert status == OK
        assert answered(data) == expected
        before, after = np.frombuffer(sent), np.frombuffer(data)
        others = [index for name, index in AT.items() if name not in {name for name, *_ in OUTPUTS}]
        np.testing.assert_array_equal(after[others], before[others])
        assert after[AT["sample_time"]] == state.time
        assert 0.0 <= after[AT["solve_time"]] < after[AT["step_time"]]
        assert after[AT["qp_status"]] == 0.0


def test_a_saved_memory_takes_it_back(ask, driven):
    ask(START, values(driven[0][0]))
    for state, _ in driven[1:6]:
        ask(STEP, values(state))
    status, memory = ask(SAVE)
    assert status == OK
    for _ in range(2):
        for state, expected in driven[6:]:
            assert answered(ask(STEP, values(state))[1]) == expected
        assert ask(RESTORE, memory) == (OK, b"")


def test_changed_settings_hold_from_then_on_and_keep_the_memory(ask, driven):
    tuned, original = controller_of(buffer=0.5), controller_of()
    ask(START, values(driven[0][0]))
    original.step(driven[0][0])
    tuned.restore(original.save())
    for state, _ in driven[1:]:
        command = tuned.step(state)
        found = answered(ask(STEP, values(state, buffer=0.5))[1])
        assert found == [command.steer_angle, command.target_speed, command.acceleration, command.status]


def test_errors_are_answers_after_which_it_goes_on(ask, driven):
    assert ask(STEP, values(SCENE.start)) == (ERROR, b"controller: not started")
    assert ask(SAVE) == (ERROR, b"controller: not started")
    status, reason = ask(START, values(SCENE.start, friction=0.0))
    assert status == ERROR
    assert b"controller.friction: 0.0; allowed: 0.01 to 5" in reason
    assert answered(ask(START, values(driven[0][0]))[1]) == driven[0][1]


def test_an_input_that_cannot_be_used_is_told(ask, driven):
    ask(START, values(driven[0][0]))
    status, data = ask(STEP, values(replace(driven[1][0], y=float("nan"))))
    assert status == OK
    row = np.frombuffer(data)
    assert (row[AT["status"]], row[AT["qp_status"]]) == (1.0, 2.0)  # the former plan goes on
    assert np.isfinite(row[AT["steer_angle_command"]])


def test_an_fmu_of_another_version_is_refused(description):
    with pytest.raises(InputError, match=r"its variables are not this version's; allowed: export"):
        ControllerServer(description | {"variables": description["variables"][:-1]})


def test_a_vehicle_without_suspension_and_a_free_road(description):
    bare = description | {"vehicle": description["vehicle"] | {"suspension": None}, "obstacles": []}
    row = np.frombuffer(ControllerServer(bare).start(values(SCENE.start)))
    assert row[AT["clearance"]] == NOTHING_NEAR


def test_clearance_follows_an_obstacle_that_moves(description):
    moving = [Obstacle(30.0, 0.0, 4.0, 2.0, speed=5.0).to_plain()]
    server = ControllerServer(description | {"obstacles": moving})
    gaps = []
    for time in (0.0, 1.0):
        data = values(replace(SCENE.start, time=time, x=0.0, y=0.0, yaw=0.0))
        gaps.append(np.frombuffer(server.start(data))[AT["clearance"]])
    assert gaps[0] == pytest.approx(30.0 - 2.0 - SCENE.vehicle.front_extent, abs=1e-9)
    assert gaps[1] - gaps[0] == pytest.approx(5.0, abs=1e-9)


def test_clearance_is_that_of_the_judge():
    random = np.random.default_rng(7)
    for _ in range(40):
        places = random.uniform([-6, -6, -4], [6, 6, 4], (3, 3))
        car = boxes(np.zeros(1), np.zeros(1), np.array([0.4]), 2.5, 1.5, 1.8)
        others = [boxes(np.array([x]), np.array([y]), np.array([yaw]), 1.0, 1.0, 3.0) for x, y, yaw in places]
        expected = max(min(float(signed_clearance(car, other)[0]) for other in others), 0.0)
        rows = np.column_stack([places, np.full(3, 1.0), np.full(3, 1.5)])
        assert clearance(0.0, 0.0, 0.4, 0.5, 2.0, 0.9, rows) == pytest.approx(expected, abs=1e-9)


def test_the_program_serves_on_the_descriptor_that_it_inherits(description, tmp_path, monkeypatch):
    ours, theirs = socket.socketpair()
    (tmp_path / "controller.json").write_text(json.dumps(description))
    handlers, ended = [], []
    monkeypatch.setattr(controller_server, "SOCKET", theirs.detach())
    monkeypatch.setattr(signal, "signal", lambda *what: handlers.append(what))
    monkeypatch.setattr(os, "_exit", ended.append)
    with ours:
        ours.sendall(struct.pack("=qQ", SAVE, 0))
        ours.shutdown(socket.SHUT_WR)
        controller_server.main(tmp_path)
        assert ours.recv(16)[:8] == struct.pack("=q", ERROR)
    assert handlers == [(signal.SIGINT, signal.SIG_IGN)]  # the host's Ctrl-C is not for it
    assert ended == [0]
