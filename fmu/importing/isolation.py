"""A plant in a process of its own: what crashes or hangs there is an error here."""

import multiprocessing
import signal
import tempfile
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Self

from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState

Report = Callable[[str, str], None]
"""Hears "finding" with a sentence, or "call" with the name of what is called next."""

START_LIMIT = 60.0
"""Time for the process to start and build the plant, in [s]."""


def reported(function: Callable[[Report], None], time_limit: float) -> list[str]:
    """What a picklable function found, called in a process of its own.

    Args:
        function: Is handed a `Report`; what it said before its process ends or hangs is kept.
        time_limit: Between two reports, in [s]; the first one may take START_LIMIT.

    Returns:
        The findings; the last one says how it ended, if it did not return, and in which call.
    """
    process, found, doing, limit = _Process(_report, function), [], "the call", max(time_limit, START_LIMIT)
    try:
        while (answer := process.answer(doing, limit)) is not None:
            (kind, text), limit = answer, time_limit
            if kind == "finding":
                found.append(text)
            else:
                doing = text
    except (InputError, PlantError) as error:
        found.append(str(error))
    finally:
        process.end()
    return found


class IsolatedPlant:
    """A `Plant` whose steps are made by another process, each within a time limit.

    Attributes:
        time_limit: For one reset or step, in [s].
        estimated: As the plant behind says.
    """

    def __init__(self, build: Callable[[], Plant], time_limit: float = 5.0):
        """Start the process and build the plant in it.

        Args:
            build: Makes the plant; must be picklable.
            time_limit: For one reset or step, in [s].

        Raises:
            InputError, PlantError: What `build` raises, or the process ends or hangs.
        """
        if not time_limit > 0.0:
            raise InputError("isolate", f"{time_limit} s", "> 0")
        self.time_limit, self._build = time_limit, build
        self._begin()

    def _begin(self) -> None:
        self._process, self._is_used = _Process(_serve, self._build), False
        try:
            self.estimated: tuple[str, ...] = self._process.answer("the start", START_LIMIT)
        except (InputError, PlantError):
            self._process.end()
            raise

    def reset(self, state: VehicleState) -> VehicleState:
        """Reset the plant behind; where a second reset fails, in a fresh process: some FMUs start once in each.

        Raises:
            PlantError: It does, or ends or hangs.
        """
        if self._is_used:
            try:
                return self._process.ask("reset", (state,), self.time_limit)
            except PlantError:
                self._process.end()
                self._begin()
        began = self._process.ask("reset", (state,), self.time_limit)
        self._is_used = True
        return began

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Step the plant behind.

        Raises:
            PlantError: It does, or ends or hangs.
        """
        return self._process.ask("step", (command, dt), self.time_limit)

    def close(self) -> None:
        """End the process; what it holds, it closes before."""
        self._is_used = False
        self._process.finish(self.time_limit)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class _Process:
    """The other process, the connection to it, and a folder for what it unpacks: dead, it cleans up nothing."""

    def __init__(self, serve: Callable[..., None], work: Callable[..., Any]):
        self._folder = scratch_folder("process")
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_begin, args=(str(self._folder), serve, theirs, work), daemon=True)
        self.process.start()
        theirs.close()

    def ask(self, method: str, arguments: tuple[object, ...], limit: float) -> Any:
        if self.connection.closed:
            raise PlantError(f"{method}: the plant's process has ended")
        with suppress(OSError):  # the answer says why
            self.connection.send((method, arguments))
        return self.answer(method, limit)

    def answer(self, what: str, limit: float) -> Any:
        try:
            if not self.connection.poll(limit):
                self.end()
                raise PlantError(f"the plant's process hangs: no answer to {what} within {limit:g} s")
            value, error = self.connection.recv()
        except EOFError as broken:
            self.process.join(limit)
            code = self.process.exitcode or 0
            self.end()
            how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
            raise PlantError(f"the plant's process ended in {what}: {how}") from broken
        if error is not None:
            raise InputError(*error) if isinstance(error, tuple) else PlantError(error)
        return value

    def finish(self, limit: float) -> None:
        if self.connection.closed:
            return
        with suppress(OSError):
            self.connection.send(None)
        self.process.join(limit)
        self.end()

    def end(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.join()
        discard(self._folder)


def _begin(folder: str, serve: Callable[..., None], connection: Connection, work: Callable[..., Any]) -> None:
    tempfile.tempdir = folder
    serve(connection, work)


def _report(connection: Connection, function: Callable[[Report], None]) -> None:
    try:
        function(lambda kind, text: connection.send(((kind, text), None)))
        connection.send((None, None))
    except Exception as error:  # whatever it is, the parent tells it
        connection.send((None, _message(error)))


def _serve(connection: Connection, build: Callable[[], Plant]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    try:
        plant = build()
    except Exception as error:  # whatever it is, the parent raises it
        connection.send((None, _message(error)))
        return
    connection.send((tuple(getattr(plant, "estimated", ())), None))
    with plant, suppress(EOFError):
        while request := connection.recv():
            method, arguments = request
            try:
                connection.send((getattr(plant, method)(*arguments), None))
            except Exception as error:  # as above
                connection.send((None, _message(error)))


def _message(error: Exception) -> tuple[str, str, str] | str:
    if isinstance(error, InputError):
        return error.where, error.problem, error.allowed
    return str(error) if isinstance(error, PlantError) else f"{type(error).__name__}: {error}"
