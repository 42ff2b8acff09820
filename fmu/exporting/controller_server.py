"""The Python side of the controller's FMU: answers the requests of sources/process.c, one after the other.

Started by the FMU's binary as resources/server.py, with the socket as file descriptor 3; ends when that is closed.
"""

import json
import math
import os
import signal
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.fmu.exporting.controller_variables import FIXED, NAMES, OUTPUTS, STATE, TUNABLE
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.widths import Widths
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import SuspensionParameters, VehicleParameters

SOCKET = 3
OK, ERROR = 0, 3
_ELSEWHERE = 1e7  # where an obstacle is that is not there, in [m]
NOTHING_NEAR = 1000.0
"""Clearance where there is no obstacle, in [m]."""
_HEAD = struct.Struct("=qQ")
_START, _STEP, _SAVE, _RESTORE = 1, 2, 3, 4
_STATE, _OUTPUTS = struct.Struct(f"={1 + len(STATE)}d"), struct.Struct(f"={len(OUTPUTS)}d")
_SETTINGS = slice(_STATE.size + _OUTPUTS.size, None)
_SETTING_NAMES = tuple(name for name, *_ in (*TUNABLE, *FIXED))


class ControllerServer:
    """The controller of one instance; all values come and go as one array in the order of the variables."""

    def __init__(self, description: dict[str, Any]):
        """Prepare what `description`, made by `describe_controller`, holds."""
        vehicle = dict(description["vehicle"])
        vehicle["tyre"] = TyreParameters(**vehicle["tyre"])
        if vehicle["suspension"]:
            vehicle["suspension"] = SuspensionParameters(**vehicle["suspension"])
        self._vehicle = VehicleParameters(**vehicle)
        road = description["road"]
        edges = Widths(np.array(road["widths"]), road["spacing"])
        self._path = ReferencePath(np.array(road["table"]), road["closed"], edges)
        self._obstacles = [Obstacle.from_plain(obstacle) for obstacle in description["obstacles"]]
        self._moving = [index for index, obstacle in enumerate(self._obstacles) if obstacle.moves]
        self._boxes = np.array([self._box(obstacle, 0.0) for obstacle in self._obstacles]).reshape(-1, 5)
        self._config = ControllerConfig(**description["controller"])
        car = self._vehicle
        self._shape = 0.5 * (car.front_extent - car.rear_extent), 0.5 * car.length, 0.5 * car.width
        if tuple(description["variables"]) != NAMES:
            raise InputError("controller.json", "its variables are not this version's", "export the controller again")
        self._held = b""  # the settings that the controller has
        self._controller: SteeringController | None = None

    def start(self, data: bytes) -> bytes:
        """A fresh controller's answer."""
        config = self._set_up(data[_SETTINGS])
        self._controller = SteeringController(self._vehicle, self._path, self._obstacles, config)
        return self._answer(data, self._controller)

    def step(self, data: bytes) -> bytes:
        """The controller's next answer; settings that have changed hold from now on."""
        controller = self._running()
        if data[_SETTINGS] != self._held:
            memory, config = controller.save(), self._set_up(data[_SETTINGS])
            controller = self._controller = SteeringController(self._vehicle, self._path, self._obstacles, config)
            controller.restore(memory)
        return self._answer(data, controller)

    def save(self, _: bytes) -> bytes:
        """The controller's memory and the settings that it has."""
        return self._held + self._running().save()

    def restore(self, data: bytes) -> bytes:
        """Go on from such a memory."""
        size = 8 * len(_SETTING_NAMES)
        config = self._set_up(data[:size])
        self._controller = SteeringController(self._vehicle, self._path, self._obstacles, config)
        self._controller.restore(data[size:])
        return b""

    def _running(self) -> SteeringController:
        if self._controller is None:
            raise InputError("controller", "not started")
        return self._controller

    def _set_up(self, settings: bytes) -> ControllerConfig:
        named = dict(zip(_SETTING_NAMES, np.frombuffer(settings).tolist(), strict=True))
        config = replace(self._config, **named | {"input_delay_steps": round(named["input_delay_steps"])})
        self._held = settings
        return config

    def _answer(self, data: bytes, controller: SteeringController) -> bytes:
        state = VehicleState(*_STATE.unpack_from(data))
        began = time.perf_counter()
        command = controller.step(state)
        took, plan = time.perf_counter() - began, controller.plan
        assert plan is not None
        solved = {"INPUT": 2.0, "SOLVED": 0.0, "UNCONSTRAINED": 0.0}.get(plan.solver_status, 1.0)
        outputs = _OUTPUTS.pack(
            command.steer_angle, command.target_speed, command.acceleration, command.status, self._clearance(state),
            solved, plan.iterations, plan.slack_corridor, plan.slack_slip, 1e-6 * plan.solve_us, took, state.time,
        )  # fmt: skip
        return data[: _STATE.size] + outputs + data[_SETTINGS]

    def _clearance(self, state: VehicleState) -> float:
        for index in self._moving:
            self._boxes[index] = self._box(self._obstacles[index], state.time)
        return clearance(state.x, state.y, state.yaw, *self._shape, self._boxes)

    def _box(self, obstacle: Obstacle, now: float) -> tuple[float, float, float, float, float]:
        x, y, yaw = obstacle.pose(self._path, now)
        if not obstacle.is_there(now):
            x = y = _ELSEWHERE
        return x, y, yaw, 0.5 * obstacle.length, 0.5 * obstacle.width


@kernel
def clearance(x: float, y: float, yaw: float, ahead: float, a: float, b: float, boxes: NDArray[np.float64]) -> float:
    """Distance in [m] from the car to the nearest box, 0 if they overlap, at most `NOTHING_NEAR`.

    Args:
        x, y, yaw: Pose of the car's reference point, in [m] and [rad].
        ahead: From there to the middle of the car, in [m].
        a, b: Half its length and width, in [m].
        boxes: Centre, direction, half length and half width of the others, shape (N, 5).
    """
    x, y, nearest = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw), NOTHING_NEAR
    for i in range(len(boxes)):
        x_2, y_2, heading_2, a_2, b_2 = boxes[i]
        nearest = min(nearest, box_distance(x, y, yaw, a, b, x_2, y_2, heading_2, a_2, b_2))
    return nearest


@kernel
def box_distance(
    x: float, y: float, heading: float, a: float, b: float,
    x_2: float, y_2: float, heading_2: float, a_2: float, b_2: float,
) -> float:  # fmt: skip
    """Distance in [m] between two boxes, 0 if they overlap.

    Args:
        x, y, heading: Centre and direction of the first, in [m] and [rad].
        a, b: Half its length and width, in [m].
        x_2, y_2, heading_2, a_2, b_2: The same of the second.
    """
    first, apart = _corner_distance(x, y, heading, a, b, x_2, y_2, heading_2, a_2, b_2)
    second, too = _corner_distance(x_2, y_2, heading_2, a_2, b_2, x, y, heading, a, b)
    return min(first, second) if apart or too else 0.0


@kernel
def _corner_distance(x, y, heading, a, b, x_2, y_2, heading_2, a_2, b_2):
    """From the corners of the second box to the first one; whether an axis of the first one separates them."""
    c, s, turn = math.cos(heading), math.sin(heading), heading_2 - heading
    along, across = c * (x_2 - x) + s * (y_2 - y), c * (y_2 - y) - s * (x_2 - x)
    cos, sin = math.cos(turn), math.sin(turn)
    nearest = math.inf
    for i in (-1.0, 1.0):
        for j in (-1.0, 1.0):
            u, w = along + i * a_2 * cos - j * b_2 * sin, across + i * a_2 * sin + j * b_2 * cos
            nearest = min(nearest, math.hypot(max(abs(u) - a, 0.0), max(abs(w) - b, 0.0)))
    reach_u, reach_w = a_2 * abs(cos) + b_2 * abs(sin), a_2 * abs(sin) + b_2 * abs(cos)
    return nearest, abs(along) > a + reach_u or abs(across) > b + reach_w


def main(folder: Path) -> None:
    """Serve until the other side closes the socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    server = ControllerServer(json.loads((folder / "controller.json").read_text(encoding="utf-8")))
    with socket.socket(fileno=SOCKET) as channel:
        serve(server, channel)
    os._exit(0)  # at once: nothing is left to be saved


def serve(server: ControllerServer, channel: socket.socket) -> None:
    """Answer requests until the other side closes its end."""
    answers: dict[int, Callable[[bytes], bytes]] = {
        _START: server.start, _STEP: server.step, _SAVE: server.save, _RESTORE: server.restore,
    }  # fmt: skip
    while head := channel.recv(_HEAD.size, socket.MSG_WAITALL):
        code, size = _HEAD.unpack(head)
        data = channel.recv(size, socket.MSG_WAITALL) if size else b""
        try:
            status, answer = OK, answers[code](data)
        except InputError as error:
            status, answer = ERROR, str(error).encode()
        channel.sendall(_HEAD.pack(status, len(answer)) + answer)
