"""Load an FMU's binary with what fmpy lacks: missing functions that nobody calls, log messages filled in."""

import ctypes
import os
import weakref
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    printLogMessage,
)
from fmpy.fmi3 import FMU3Slave
from fmpy.logging import addLoggerProxy

from sidestep.fmu.importing.archive import UnpackedFmu
from sidestep.plant_models.errors import InputError, PlantError

_REQUIRED = {
    True: ("Instantiate", "FreeInstance", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode",
           "SetReal", "GetReal", "DoStep"),
    False: ("InstantiateCoSimulation", "FreeInstance", "EnterInitializationMode", "ExitInitializationMode",
            "SetFloat64", "GetFloat64", "DoStep"),
}  # fmt: skip


class _Library:
    """A shared library whose missing functions are an error when they are called, not when they are looked up."""

    def __init__(self, library: ctypes.CDLL):
        self.library, self._handle = library, library._handle

    def __getattr__(self, name: str) -> Any:
        return getattr(self.library, name, None) or _missing(name)


def _missing(name: str) -> Callable[..., NoReturn]:
    def call(*_: object) -> NoReturn:
        raise PlantError(f"the FMU's binary has no function {name}")

    return call


class _Tolerant:
    dll: Any

    def _loadFunctions(self) -> None:  # noqa: N802 (fmpy's name)
        self.dll = _Library(self.dll)
        super()._loadFunctions()  # pyright: ignore[reportAttributeAccessIssue] (of the class mixed with)


class FMU2Tolerant(_Tolerant, FMU2Slave):
    """fmpy tells the standard by the beginning of the class name."""


class FMU3Tolerant(_Tolerant, FMU3Slave):
    """As above."""


def load_binary(path: Path, unpacked: UnpackedFmu) -> FMU2Tolerant | FMU3Tolerant:
    """Load the binary of an unpacked FMU; the working directory stays what it is.

    Raises:
        InputError: It cannot be loaded, or lacks a function that nothing goes without.
    """
    directory, fmu = os.getcwd(), unpacked.about
    try:
        slave = (FMU2Tolerant if fmu.is_fmi2 else FMU3Tolerant)(
            guid=fmu.token, unzipDirectory=str(unpacked.folder), modelIdentifier=fmu.identifier, instanceName=fmu.name
        )
    except Exception as error:  # fmpy raises bare Exception
        raise InputError(str(path), f"its binary cannot be loaded: {error}") from error
    finally:
        os.chdir(directory)  # a load that fails leaves fmpy in the binary's folder
    names = [f"fmi{2 if fmu.is_fmi2 else 3}{name}" for name in _REQUIRED[fmu.is_fmi2]]
    missing = [name for name in names if not hasattr(slave.dll.library, name)]
    if missing:
        slave.freeLibrary()
        raise InputError(str(path), f"its binary lacks {', '.join(missing)}", "a binary of the standard it names")
    return slave


def end_instance(slave: FMU2Slave | FMU3Slave, on_call: Callable[[str], None]) -> None:
    """Terminate and free the instance, if there is one; `on_call` hears the functions' names before."""
    if slave.component:
        on_call("fmi2Terminate" if isinstance(slave, FMU2Slave) else "fmi3Terminate")
        with suppress(FMICallException, PlantError):
            slave.terminate()
        on_call("fmi2FreeInstance" if isinstance(slave, FMU2Slave) else "fmi3FreeInstance")
    free_instance(slave)


def free_instance(slave: FMU2Slave | FMU3Slave, may_call: bool = True) -> None:
    """Forget the instance, if there is one, and free it; the library stays."""
    component = slave.component
    slave.component = None  # pyright: ignore[reportAttributeAccessIssue] (as fmpy itself begins)
    if not (component and may_call):
        return
    if isinstance(slave, FMU2Slave):
        slave.fmi2FreeInstance(component)
    else:
        slave.fmi3FreeInstance(component)


_listeners: weakref.WeakValueDictionary[int, deque[str]] = weakref.WeakValueDictionary()


def fmi2_callbacks(messages: deque[str]) -> fmi2CallbackFunctions:
    """Callbacks that append to `messages`, which must outlive the instance.

    FMI 2.0 loggers are variadic, which only fmpy's native proxy can read. It hands every message of the
    process to one function: ours, which knows whose it is by the environment.
    """
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = _logger
    # anew for every instance: what else runs FMUs here (fmpy.ssp) leaves the proxy with a logger that is gone
    addLoggerProxy(ctypes.byref(callbacks))
    callbacks.allocateMemory, callbacks.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
    callbacks.componentEnvironment = id(messages)
    _listeners[id(messages)] = messages
    return callbacks


def _log(environment: int | None, name: bytes, status: int, category: bytes, message: bytes | None) -> None:
    messages = _listeners.get(environment or 0)
    if messages is None:  # an FMU that somebody else runs in this process
        printLogMessage(ctypes.c_void_p(environment), name, status, category, message or b"")
    else:
        messages.append((message or b"").decode(errors="replace"))


_logger = fmi2CallbackLoggerTYPE(_log)
