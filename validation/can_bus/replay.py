"""`sidestep can replay`: a log as plant on a bus, or what the controller would have sent."""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import can
import numpy as np
from matplotlib.figure import Figure

from sidestep.controller.can_port.bus.bus import Bus
from sidestep.controller.can_port.bus.log import read_log
from sidestep.controller.can_port.codec.database import Frame, Protection, messages
from sidestep.controller.can_port.codec.messages import STEER_CMD, decode_steer_command
from sidestep.controller.can_port.nodes import CYCLE, ControllerNode
from sidestep.plant_models.errors import InputError
from sidestep.validation.files import made, written_to
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.recording import Array, write_columns
from sidestep.validation.report.style import BLUE, ORANGE, RED, legend, panel, styled, write_figure
from sidestep.validation.scenarios.scenario import load_scenario

_UNITS = {"time": "s", "logged": "rad", "asked_now": "rad", "difference": "rad"}


def replay_as_plant(log: Path, bus: Bus, protection: Protection = "P02") -> int:
    """Send what the vehicle sent, in the log's own time; how many frames the bus took.

    Raises:
        InputError: The log cannot be read, or holds none of our messages.
    """
    ours = {m.frame_id: m.name for m in messages(protection).values() if m.sender != "CTRL"}
    frames = [message for message in _read(log) if message.arbitration_id in ours]
    if not frames:
        raise InputError(str(log), "holds no frame of a vehicle", f"a log with {', '.join(ours.values())}")
    zero, sent = time.monotonic() - frames[0].timestamp, 0
    for message in frames:
        time.sleep(max(0.0, zero + message.timestamp - time.monotonic()))
        sent += bus.send(message)
    return sent


def what_if(log: Path, name: str, out: Path, protection: Protection = "P02") -> int:
    """Feed a log to a scenario's controller, compare its steering with the log's; print, write and plot it.

    Raises:
        InputError: Log, scenario or folder cannot be used.
    """
    scenario = load_scenario(name)
    controller = bare_controller(scenario)
    columns = compare(_read(log), ControllerNode(controller, messages(protection)), protection)
    if not len(columns["time"]):
        allowed = "a log of both nodes, as `sidestep can drive` writes one, with the same protection"
        raise InputError(str(log), "never has both a state to steer by and a command to compare with", allowed)
    with made(out), written_to(out):
        write_columns(out / "what_if.csv", columns, _UNITS)
        write_figure(out / "what_if.svg", figure(columns))
    difference = np.abs(columns["difference"])
    print(
        f"{len(difference)} commands compared: difference RMS {np.sqrt(np.mean(difference**2)):.5f} rad, "
        f"largest {difference.max():.5f} rad\nplot: {out / 'what_if.svg'}"
    )
    return 0


def _read(log: Path) -> list[can.Message]:
    try:
        frames = list(read_log(log))
    except InputError as error:
        cause = error.__cause__
        if cause is None:
            raise
        why = (
            cause.strerror
            if isinstance(cause, OSError)
            else f"no CAN log of the kind {log.suffix}, or cut short: {cause}"
        )
        raise InputError(str(log), f"cannot be read ({why})", _LOGS) from error
    if not frames:
        raise InputError(str(log), "holds no CAN frame", _LOGS)
    return frames


_LOGS = ".blf, .asc, .log (candump) or .csv with CAN frames, as python-can writes them"


def compare(log: Sequence[can.Message], node: ControllerNode, protection: Protection = "P02") -> dict[str, Array]:
    """Columns time, logged angle, the node's angle, and their difference, wherever both are enabled."""
    message = messages(protection)["STEER_CMD"]
    rows: list[tuple[float, float, float]] = []
    for now, frames in _cycles(log):
        logged = [data for frame_id, data in frames if frame_id == STEER_CMD.frame_id]
        heard = [frame for frame in frames if frame[0] != STEER_CMD.frame_id]
        answers = dict(node.step(now, heard))
        mine = decode_steer_command(answers[STEER_CMD.frame_id], now, message)
        for data in logged[-1:]:
            theirs = decode_steer_command(data, now, message)
            if mine.enable and theirs.enable:
                rows.append((now, theirs.command.steer_angle, mine.command.steer_angle))
    time_, logged_angle, asked = np.array(rows, dtype=float).reshape(-1, 3).T
    return {"time": time_, "logged": logged_angle, "asked_now": asked, "difference": asked - logged_angle}


def _cycles(log: Sequence[can.Message]) -> Iterator[tuple[float, list[Frame]]]:
    """The log cycle by cycle: a cycle ends with the controller's command, or when its time is over."""
    frames: list[Frame] = []
    ends = log[0].timestamp + CYCLE if log else 0.0
    for message in log:
        while message.timestamp > ends + 0.5 * CYCLE:
            yield ends, frames
            frames, ends = [], ends + CYCLE
        frames.append((message.arbitration_id, bytes(message.data)))
        if message.arbitration_id == STEER_CMD.frame_id:
            yield message.timestamp, frames
            frames, ends = [], message.timestamp + CYCLE


def figure(columns: dict[str, Array]) -> Figure:
    """Both steering angles over time, and their difference."""
    with styled():
        result = Figure(figsize=(9.0, 5.0), layout="constrained")
        above, below = result.subplots(2, 1, sharex=True)
        panel(above, "Steering angle", "deg")
        for name, colour in (("logged", ORANGE), ("asked_now", BLUE)):
            above.plot(columns["time"], np.degrees(columns[name]), color=colour, label=name.replace("_", " "))
        legend(above)
        panel(below, "Difference", "deg").plot(columns["time"], np.degrees(columns["difference"]), color=RED)
        below.set_xlabel("time  [s]")
    return result
