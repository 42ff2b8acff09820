"""`sidestep can replay`: a log as plant on a bus, or what the controller would have sent."""

import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np
from matplotlib.figure import Figure

from sidestep.controller import SteeringController
from sidestep.controller.can_port.bus.bus import Bus, key_of
from sidestep.controller.can_port.bus.log import LogReport, read_log
from sidestep.controller.can_port.codec.catalogue import BusDescription, own_bus
from sidestep.controller.can_port.codec.messages import (
    ANSWERS,
    STEER_CMD,
    SteerFrame,
    decode_steer_command,
    encode_steer_command,
)
from sidestep.controller.can_port.codec.samples import EXACT_ID, LOG_CHANNEL, exact_state, sample_number
from sidestep.controller.can_port.listener import Assembler, Sample
from sidestep.controller.can_port.nodes import Steering
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.can_bus.limits import within
from sidestep.validation.files import made, written_to
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.recording import Array, write_columns
from sidestep.validation.report.style import BLUE, ORANGE, RED, legend, panel, styled, write_figure
from sidestep.validation.scenarios.scenario import Scenario

_UNITS = {"time": "s", "logged": "rad", "asked_now": "rad", "difference": "rad"}

LONGEST_PAUSE = 3600.0
"""Longer ones in a log are faults of its clock: they are cut to this, in [s], where nothing else is asked for."""


@dataclass(frozen=True)
class Pace:
    """How a log is sent.

    Attributes:
        speed: Times as fast as it was recorded.
        loops: How often.
        gap: Longest pause, in [s] of the log.
    """

    speed: float = 1.0
    loops: int = 1
    gap: float = LONGEST_PAUSE


def replay_as_plant(
    log: Path, bus: Bus, described: BusDescription | None = None, channel: str | None = None, pace: Pace | None = None
) -> int:
    """Send what the vehicle sent, in the log's own time or in that of `pace`; how many frames the bus took.

    Raises:
        InputError: The log cannot be read, or holds none of our messages.
    """
    ours = {m.frame_id: m.name for m in (described or own_bus()).messages.values() if m.sender != "CTRL"}
    pace, sent, found = pace or Pace(), 0, False
    for _ in range(pace.loops):
        report, due, last = LogReport(), time.monotonic(), None
        for message in _told(log, read_log(log, channel, report), report):
            if key_of(message) not in ours or message.channel == LOG_CHANNEL:
                continue
            found = True
            passed = max(0.0, message.timestamp - last) if last is not None else 0.0
            last = message.timestamp
            due += min(passed, pace.gap) / pace.speed
            time.sleep(max(0.0, due - time.monotonic()))
            sent += bus.send(message)
    if not found:
        raise InputError(str(log), "holds no frame of a vehicle", f"a log with {', '.join(ours.values())}")
    return sent


def what_if(
    log: Path, scenario: Scenario, out: Path, described: BusDescription | None = None, channel: str | None = None
) -> int:
    """Feed a log to a scenario's controller, compare its steering with the log's; print, write and plot it.

    Raises:
        InputError: Log, scenario or folder cannot be used.
    """
    bus = described or own_bus()
    report = LogReport()
    frames = _told(log, read_log(log, channel, report), report)
    columns, missing = compare(frames, bare_controller(within(scenario, bus)), bus)
    if not len(columns["time"]):
        allowed = "a log of both nodes, as `sidestep can drive` writes one, with the same protection and mapping"
        raise InputError(str(log), "never has both a state to steer by and a command that answers it", allowed)
    with made(out), written_to(out):
        write_columns(out / "what_if.csv", columns, _UNITS)
        write_figure(out / "what_if.svg", figure(columns))
    difference = np.abs(columns["difference"])
    print(
        f"{len(difference)} commands compared: difference RMS {np.sqrt(np.mean(difference**2)):.5f} rad, "
        f"largest {difference.max():.5f} rad\nplot: {out / 'what_if.svg'}"
    )
    if missing:
        print(f"{missing} commands are missing in the log: what the controller made of them is not in it")
    return 0


def _told(log: Path, frames: Iterable[can.Message], report: LogReport) -> Iterator[can.Message]:
    """The frames, and on stderr what was odd about them."""
    yield from frames
    for sentence in report.sentences():
        print(f"sidestep: {log}: {sentence}", file=sys.stderr)


def compare(
    log: Iterable[can.Message], controller: SteeringController, bus: BusDescription | None = None
) -> tuple[dict[str, Array], int]:
    """Ask a controller again: one step for every logged command, at the state that the command says it answers.

    Returns:
        Columns time, logged angle, the controller's angle, and their difference, wherever the logged command is
        enabled; and how many commands the log lacks by its alive counters.
    """
    asked = _Asked(controller, bus or own_bus())
    rows = [row for message in log if (row := asked.about(message))]
    time_, logged_angle, mine = np.array(rows, dtype=float).reshape(-1, 3).T
    return {"time": time_, "logged": logged_angle, "asked_now": mine, "difference": mine - logged_angle}, asked.missing


class _Asked:
    """A controller at the end of a log."""

    def __init__(self, controller: SteeringController, bus: BusDescription):
        self.missing = 0
        self._command = bus.messages[STEER_CMD.name]
        self._steering = Steering(controller, self._command.cycle, bus.interface)
        self._assembler = Assembler(bus.messages)
        self._samples: deque[Sample] = deque(maxlen=ANSWERS)
        self._exact: dict[int, SteeringCommand] = {}
        self._controller = controller
        self._counter: int | None = None

    def about(self, message: can.Message) -> tuple[float, float, float] | None:
        """Take in a frame of the log; time and both angles if it is an enabled command with a state to answer."""
        if message.channel == LOG_CHANNEL and message.arbitration_id == EXACT_ID:
            self._take_exact(exact_state(message.data))
        elif key_of(message) == self._command.frame_id:
            return self._take_command(message)
        elif part := self._assembler.messages.get(key_of(message)):
            counter = part.profile.counter_of(message.data) if len(message.data) == part.length else None
            if counter is not None and (sample := self._assembler.add(part.frame_id, counter, message.data)):
                self._samples.append(sample)
        return None

    def _take_exact(self, state: VehicleState) -> None:
        """The state of a run's own log: the controller was stepped there and then."""
        if not self._exact:
            self._controller.reset()
        number = sample_number(state.time) % ANSWERS
        self._exact.pop(number, None)
        self._exact[number] = self._controller.step(state)

    def _take_command(self, message: can.Message) -> tuple[float, float, float] | None:
        data, time = bytes(message.data), message.timestamp
        counter = self._command.profile.counter_of(data) if len(data) == self._command.length else None
        if counter is None or (counter == self._counter and self._command.profile.counters > 1):
            return None
        if self._counter is not None:
            self.missing += (counter - self._counter - 1) % self._command.profile.counters
        self._counter = counter
        theirs = decode_steer_command(data, time, self._command)
        mine = self._answer(theirs) if theirs.enable else self._steering.pause()
        if mine is None:
            return None
        again = decode_steer_command(encode_steer_command(mine, counter, message=self._command), time, self._command)
        return time, theirs.command.steer_angle, again.command.steer_angle

    def _answer(self, theirs: SteerFrame) -> SteeringCommand | None:
        if self._exact:
            return self._exact.get(theirs.answers) if theirs.answers is not None else None
        answered = (s for s in reversed(self._samples) if theirs.answers is None or s.answers == theirs.answers)
        sample = next(answered, None)
        return self._steering.answer(sample) if sample else None


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
