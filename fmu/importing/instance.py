"""One loaded co-simulation FMU, FMI 2.0 and FMI 3.0 alike, with as few Python operations a step as can be.

Life cycle: construct (unpack, load) -> start -> any number of set, step, get -> start again ... -> close.
"""

import ctypes
import math
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from sidestep.fmu.importing.archive import unpack
from sidestep.fmu.importing.loading import end_instance, fmi2_callbacks, free_instance, load_binary
from sidestep.fmu.importing.ports import FLOATS, Port, elements, find_element
from sidestep.fmu.importing.start_values import set_others
from sidestep.fmu.scratch import discard
from sidestep.plant_models.errors import InputError, PlantError

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_WARNING, _DISCARD, _FATAL = 1, 2, 4
_LAST_SUCCESSFUL_TIME = 2
SMALLEST_PART = 2**-10
"""Part of a communication step below which a step that is discarded again and again is given up."""


class FmuInstance:
    """An FMU that can be started, stepped and started again.

    Attributes:
        path: The .fmu file.
        variables: fmpy's description of its variables, by name.
        fixed_step: Step that every communication step must be a multiple of, in [s]; 0 if any will do.
        interface: fmpy's description of its co-simulation interface.
        is_fmi2: FMI 2.0, else FMI 3.0.
    """

    def __init__(self, path: str | Path, on_call: Callable[[str], None] = lambda name: None):
        """Unpack and load the FMU.

        Args:
            path: The .fmu file.
            on_call: Hears the name of each function of the life cycle before it is called.

        Raises:
            InputError: It cannot be used on this machine.
        """
        self.path, self._on_call = Path(path), on_call
        with ExitStack() as resources:
            unpacked = unpack(self.path)
            resources.callback(discard, unpacked.folder)
            self.variables, self.is_fmi2 = (about := unpacked.about).variables, about.is_fmi2
            self.fixed_step, self.interface = about.fixed_step, about.interface
            self._slave = load_binary(self.path, unpacked)
            resources.callback(self._slave.freeLibrary)
            resources.callback(end_instance, self._slave, on_call)
            self._release = weakref.finalize(self, resources.pop_all().close)
        self._bind()
        self._messages: deque[str] = deque(maxlen=3)
        self._handle: ctypes.c_void_p | None = None
        self._count, self._time = 0, 0.0  # instances made, time of the last call in [s]

    def port(self, names: list[str]) -> Port:
        """Value references and a buffer for these variables.

        Raises:
            InputError: No such variable or element, or one that is no floating-point number.
        """
        for name in names:
            if self._type(name) not in FLOATS:
                raise InputError(str(self.path), f"{name!r} is of type {self._type(name)}", ", ".join(FLOATS))
        rows = [row for name in names if (row := find_element(self.variables, name))]
        try:
            return Port(self._slave.dll.library, names, rows, self.is_fmi2)
        except (AttributeError, ValueError, TypeError, OverflowError) as error:
            what = "lacks what it takes" if isinstance(error, AttributeError) else "has a start value that is no number"
            raise InputError(str(self.path), f"it {what} for {', '.join(names)}: {error}") from error

    def check_known(self, names: Iterable[str]) -> None:
        """Whether these are names of its variables, of any type.

        Raises:
            InputError: One is not.
        """
        for name in names:
            self._type(name)

    def start(self, time: float, values: Mapping[str, float | str]) -> None:
        """A new instance at `time` [s] with these start values; a former one is freed.

        Of an FMU that says that it can be instantiated only once per process, the former one is reset instead.

        Raises:
            InputError: A name is not one of its variables, or a value does not fit its type.
            PlantError: The FMU refuses.
        """
        others = {name: value for name, value in values.items() if self._type(name) not in FLOATS}
        floats = {name: value for name, value in values.items() if name not in others}
        port = self.port(list(floats))
        for name, value in floats.items():
            if isinstance(value, str):
                raise InputError(str(self.path), f"{name!r} of type {self._type(name)} cannot be {value!r}", "a number")
        port.values[:] = list(floats.values())
        self._time = time
        if not self._is_reset():
            self._handle = None
            end_instance(self._slave, self._on_call)
            self._instantiate()
        slave = self._slave
        try:
            if isinstance(slave, FMU2Slave):
                self._on_call("fmi2SetupExperiment")
                slave.setupExperiment(startTime=time)
            self._on_call("the setting of start values")
            self.set(port)
            set_others(slave, str(self.path), self.variables, others, self.is_fmi2)
            self._on_call(f"{self._prefix}EnterInitializationMode")
            if isinstance(slave, FMU2Slave):
                slave.enterInitializationMode()
            else:
                slave.enterInitializationMode(startTime=time)
            self._on_call(f"{self._prefix}ExitInitializationMode")
            slave.exitInitializationMode()
        except FMICallException as error:
            raise self._failure(error.function, error.status) from error

    def _type(self, name: str) -> str:
        if row := find_element(self.variables, name):
            return str(row[0].type)
        if variable := self.variables.get(name):
            problem, allowed = (
                f"{name!r} is an array of {variable.shape}",
                f"an element, such as {elements(variable)[0]}",
            )
            raise InputError(str(self.path), problem, allowed)
        raise InputError(str(self.path), f"no variable {name!r} in it", ", ".join(list(self.variables)[:40]))

    def set(self, port: Port) -> None:
        """Hand the port's buffer to the FMU.

        Raises:
            PlantError: The FMU refuses.
        """
        status = port.set_plain(self._handle, *port.arguments) if port.is_plain else self._set_parts(port)
        if status > _WARNING:
            raise self._failure(port.parts[0].set_name, status)

    def get(self, port: Port) -> None:
        """Fill the port's buffer.

        Raises:
            PlantError: The FMU refuses.
        """
        status = port.get_plain(self._handle, *port.arguments) if port.is_plain else self._get_parts(port)
        if status > _WARNING:
            raise self._failure(port.parts[0].get_name, status)

    def _set_parts(self, port: Port) -> int:
        worst = 0
        for part in port.parts:
            for place, target in part.places:
                part.buffer[target] = port.values[place]
            worst = max(worst, part.set(self._handle, *part.arguments))
        return worst

    def _get_parts(self, port: Port) -> int:
        worst = 0
        for part in port.parts:
            worst = max(worst, part.get(self._handle, *part.arguments))
            for place, source in part.places:
                port.values[place] = part.buffer[source]
        return worst

    def step(self, time: float, duration: float) -> None:
        """From `time` on for `duration`, in [s]; what the FMU discards is tried again in halves.

        Raises:
            PlantError: The FMU cannot.
            InputError: It only makes steps of another size.
        """
        if self.fixed_step:
            self._step_in_parts(time, duration, self._parts(duration))
        else:
            self._step(time, duration)

    def _parts(self, duration: float) -> int:
        parts = round(duration / self.fixed_step)
        if parts < 1 or not math.isclose(parts * self.fixed_step, duration, rel_tol=1e-6):
            problem = f"a step of {duration:g} s: this FMU only steps by {self.fixed_step:g} s"
            raise InputError(str(self.path), problem, f"multiples of {self.fixed_step:g} s (see controller.period)")
        return parts

    def _step_in_parts(self, time: float, duration: float, parts: int) -> None:
        for part in range(parts):
            self._step(time + part * duration / parts, duration / parts)

    def _step(self, time: float, duration: float) -> None:
        done, size = 0.0, duration
        while True:
            can_retry = not self.fixed_step and size > duration * SMALLEST_PART
            done += (reached := self._advance(time + done, size, can_retry))
            if done >= duration * (1.0 - 1e-9):
                return
            size = min(0.5 * size if reached < size else size, duration - done)

    def _advance(self, start: float, size: float, can_retry: bool) -> float:
        """One call of doStep; how far it came, in [s]."""
        self._time = self._start.value = start
        self._size.value = size
        status = self._do_step(self._handle, *self._step_arguments)
        if status > _WARNING and not (status == _DISCARD and can_retry):
            raise self._failure(self._step_name, status)
        if self._ended:
            raise PlantError(f"{self.path.name}: the FMU ended the simulation in the step from t = {start:.6g} s")
        reached = self._reached(start, size) if status == _DISCARD or self._early else size
        if reached == 0.0 and not can_retry:
            raise PlantError(f"{self.path.name}: the step from t = {start:.6g} s comes nowhere")
        return reached

    def _reached(self, start: float, size: float) -> float:
        """How far the step from `start` came that was discarded or that the FMU returned from early, in [s]."""
        if self.is_fmi2:
            query = getattr(self._slave.dll.library, "fmi2GetRealStatus", None)
            if query is None or query(self._handle, _LAST_SUCCESSFUL_TIME, ctypes.byref(self._last_time)) > _WARNING:
                return 0.0
        time = self._last_time.value
        return min(max(time - start, 0.0), size) if math.isfinite(time) else 0.0

    @property
    def is_running(self) -> bool:
        """Whether it has been started and not failed since."""
        return self._handle is not None

    def has_function(self, name: str) -> bool:
        """Whether its binary exports this function of the standard."""
        return hasattr(self._slave.dll.library, name)

    def close(self) -> None:
        """Free the instance, unload the library, remove what was unpacked; a second time does nothing."""
        self._handle = None
        self._release()

    def _bind(self) -> None:
        """A fresh function object without argument conversion: all arguments are ctypes values already."""
        self._prefix = "fmi2" if self.is_fmi2 else "fmi3"
        self._step_name = f"{self._prefix}DoStep"
        self._do_step = self._slave.dll.library[self._step_name]
        self._start, self._size, self._last_time = ctypes.c_double(), ctypes.c_double(), ctypes.c_double()
        self._ended, self._early = ctypes.c_bool(), ctypes.c_bool()
        answers = (ctypes.c_bool(), self._ended, self._early, self._last_time)
        how = (ctypes.c_int(1),) if self.is_fmi2 else (ctypes.c_bool(True), *map(ctypes.pointer, answers))
        self._step_arguments = (self._start, self._size, *how)

    def _is_reset(self) -> bool:
        """Whether a living instance of an FMU that allows but one is as new."""
        if not (self.is_running and self.interface.canBeInstantiatedOnlyOncePerProcess):
            return False
        try:
            self._slave.reset()
        except (FMICallException, PlantError):
            return False
        return True

    def _instantiate(self) -> None:
        messages = self._messages
        messages.clear()

        def log(environment: object, status: int, category: bytes, message: bytes) -> None:
            messages.append((message or b"").decode(errors="replace"))

        function = "fmi2Instantiate" if self.is_fmi2 else "fmi3InstantiateCoSimulation"
        self._on_call(function)
        try:
            if isinstance(self._slave, FMU2Slave):
                self._slave.instantiate(callbacks=fmi2_callbacks(messages), loggingOn=True)
            else:
                self._slave.instantiate(logMessage=log, earlyReturnAllowed=True, loggingOn=True)
        except PlantError:
            raise
        except Exception as error:  # fmpy raises bare Exception when the FMU returns a null pointer
            why = "; it may start once per process: --isolate gives it one for each" if self._count else ""
            raise PlantError(f"{self.path.name}: {function} returned no instance{why}{self._said()}") from error
        self._count += 1
        self._handle = ctypes.c_void_p(self._slave.component)  # pyright: ignore[reportArgumentType] (an int, in truth)

    def _failure(self, function: str, status: int) -> PlantError:
        """The error for a failed call; the instance is freed, unless the FMU forbids every further call."""
        label = _STATUS[status] if 0 <= status < len(_STATUS) else "unknown"
        where = f"at t = {self._time:.6g} s"
        error = PlantError(f"{self.path.name}: {function} failed {where}: status {status} ({label}){self._said()}")
        self._handle = None
        free_instance(self._slave, may_call=status != _FATAL)
        return error

    def _said(self) -> str:
        return "".join(f"; {message}" for message in self._messages)
