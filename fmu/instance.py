"""One loaded co-simulation FMU, FMI 2.0 and FMI 3.0 alike, with as few Python operations a step as can be.

Life cycle: construct (unpack, load) -> start -> any number of set, step, get -> start again ... -> close.
"""

import ctypes
import os
import shutil
import weakref
from collections import deque
from contextlib import ExitStack, suppress
from pathlib import Path

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave

from sidestep.fmu.archive import UnpackedFmu, unpack
from sidestep.plant_models.errors import InputError, PlantError

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_WARNING, _FATAL = 1, 4


class Port:
    """Variables that are always set or read together, with the buffer of their values.

    Attributes:
        names: The variables.
        values: Their values, in the FMU's units; a ctypes array of doubles.
    """

    def __init__(self, names: list[str], references: list[int], is_fmi2: bool):
        self.names = names
        self.values = (ctypes.c_double * len(names))()
        size = ctypes.c_size_t(len(names))
        arguments = ((ctypes.c_uint32 * len(names))(*references), size, self.values)
        self.arguments = arguments if is_fmi2 else (*arguments, size)


class FmuInstance:
    """An FMU that can be started, stepped and started again.

    Attributes:
        path: The .fmu file.
        variables: fmpy's description of its variables, by name.
    """

    def __init__(self, path: str | Path):
        """Unpack and load the FMU.

        Raises:
            InputError: It cannot be used on this machine.
        """
        self.path = Path(path)
        with ExitStack() as resources:
            unpacked = unpack(self.path)
            resources.callback(shutil.rmtree, unpacked.folder, ignore_errors=True)
            self.variables, self._is_fmi2 = unpacked.variables, unpacked.is_fmi2
            self._slave = _load(self.path, unpacked)
            resources.callback(self._slave.freeLibrary)
            resources.callback(_end, self._slave)
            self._release = weakref.finalize(self, resources.pop_all().close)
        self._bind()
        self._messages: deque[str] = deque(maxlen=3)
        self._handle: ctypes.c_void_p | None = None
        self._time = 0.0

    def port(self, names: list[str]) -> Port:
        """Value references and a buffer for these variables.

        Raises:
            InputError: No such variable, or one that is not a double.
        """
        for name in names:
            if name not in self.variables:
                raise InputError(str(self.path), f"no variable {name!r} in it", ", ".join(list(self.variables)[:40]))
            if self.variables[name].type not in ("Real", "Float64"):
                raise InputError(str(self.path), f"{name!r} is of type {self.variables[name].type}", "Real, Float64")
        return Port(names, [self.variables[name].valueReference for name in names], self._is_fmi2)

    def start(self, time: float, values: dict[str, float]) -> None:
        """A new instance at `time` [s] with these start values; a former one is freed.

        Raises:
            InputError: A name is not one of its variables.
            PlantError: The FMU refuses.
        """
        port = self.port(list(values))
        port.values[:] = list(values.values())
        self._handle = None
        _end(self._slave)
        self._time = time
        self._instantiate()
        slave = self._slave
        try:
            if isinstance(slave, FMU2Slave):
                slave.setupExperiment(startTime=time)
                self.set(port)
                slave.enterInitializationMode()
            else:
                self.set(port)
                slave.enterInitializationMode(startTime=time)
            slave.exitInitializationMode()
        except FMICallException as error:
            raise self._failure(error.function, error.status) from error

    def set(self, port: Port) -> None:
        """Hand the port's buffer to the FMU.

        Raises:
            PlantError: The FMU refuses.
        """
        status = self._set(self._handle, *port.arguments)
        if status > _WARNING:
            raise self._failure(self._names[0], status)

    def get(self, port: Port) -> None:
        """Fill the port's buffer.

        Raises:
            PlantError: The FMU refuses.
        """
        status = self._get(self._handle, *port.arguments)
        if status > _WARNING:
            raise self._failure(self._names[1], status)

    def step(self, time: float, duration: float) -> None:
        """From `time` on for `duration`, in [s].

        Raises:
            PlantError: The FMU cannot.
        """
        self._time = time
        status = self._do_step(self._handle, ctypes.c_double(time), ctypes.c_double(duration), *self._step_arguments)
        if status > _WARNING:
            raise self._failure(self._names[2], status)
        if self._ended.value:
            raise PlantError(f"{self.path.name}: the FMU ended the simulation in the step from t = {time:.6g} s")

    @property
    def is_running(self) -> bool:
        """Whether it has been started and not failed since."""
        return self._handle is not None

    def close(self) -> None:
        """Free the instance, unload the library, remove what was unpacked; a second time does nothing."""
        self._handle = None
        self._release()

    def _bind(self) -> None:
        """Fresh function objects without argument conversion: all arguments are ctypes values already."""
        library = self._slave.dll
        if self._is_fmi2:
            self._names = ("fmi2SetReal", "fmi2GetReal", "fmi2DoStep")
        else:
            self._names = ("fmi3SetFloat64", "fmi3GetFloat64", "fmi3DoStep")
        self._set, self._get, self._do_step = (library[name] for name in self._names)
        self._ended = ctypes.c_bool(False)
        answers = (ctypes.c_bool(), self._ended, ctypes.c_bool(), ctypes.c_double())
        self._step_arguments = (
            (ctypes.c_int(1),) if self._is_fmi2 else (ctypes.c_bool(True), *map(ctypes.pointer, answers))
        )

    def _instantiate(self) -> None:
        messages = self._messages
        messages.clear()

        def log(*arguments: object) -> None:
            """Both standards' callback: the message comes last."""
            message = arguments[-1]
            messages.append(message.decode(errors="replace") if isinstance(message, bytes) else str(message))

        try:
            if isinstance(self._slave, FMU2Slave):
                callbacks = fmi2CallbackFunctions()
                callbacks.logger = fmi2CallbackLoggerTYPE(log)
                callbacks.allocateMemory = defaultCallbacks.allocateMemory
                callbacks.freeMemory = defaultCallbacks.freeMemory
                self._slave.instantiate(callbacks=callbacks)
            else:
                self._slave.instantiate(logMessage=log)
        except Exception as error:  # fmpy raises bare Exception when the FMU returns a null pointer
            raise PlantError(f"{self.path.name}: {error}{self._said()}") from error
        self._handle = ctypes.c_void_p(self._slave.component)  # pyright: ignore[reportArgumentType] (an int, in truth)

    def _failure(self, function: str, status: int) -> PlantError:
        """The error for a failed call; the instance is freed, unless the FMU forbids every further call."""
        label = _STATUS[status] if 0 <= status < len(_STATUS) else "unknown"
        where = f"at t = {self._time:.6g} s"
        error = PlantError(f"{self.path.name}: {function} failed {where}: status {status} ({label}){self._said()}")
        self._handle = None
        _free(self._slave, may_call=status != _FATAL)
        return error

    def _said(self) -> str:
        return "".join(f"; {message}" for message in self._messages)


def _load(path: Path, fmu: UnpackedFmu) -> FMU2Slave | FMU3Slave:
    directory = os.getcwd()
    try:
        return (FMU2Slave if fmu.is_fmi2 else FMU3Slave)(
            guid=fmu.token, unzipDirectory=str(fmu.folder), modelIdentifier=fmu.identifier, instanceName=fmu.name
        )
    except Exception as error:  # fmpy raises bare Exception; a missing function is an AttributeError
        raise InputError(str(path), f"its binary cannot be loaded: {error}") from error
    finally:
        os.chdir(directory)  # a load that fails leaves fmpy in the binary's folder


def _end(slave: FMU2Slave | FMU3Slave) -> None:
    """Terminate and free the instance, if there is one."""
    if slave.component:
        with suppress(FMICallException):
            slave.terminate()
    _free(slave)


def _free(slave: FMU2Slave | FMU3Slave, may_call: bool = True) -> None:
    """Forget the instance, if there is one, and free it; the library stays."""
    component = slave.component
    slave.component = None  # pyright: ignore[reportAttributeAccessIssue] (as fmpy itself begins)
    if not (component and may_call):
        return
    if isinstance(slave, FMU2Slave):
        slave.fmi2FreeInstance(component)
    else:
        slave.fmi3FreeInstance(component)
