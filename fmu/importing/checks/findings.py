"""What is wrong with an FMU: our verdict, and those of fmpy and fmutool."""

import importlib.util
import math
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from fmpy.validation import validate_fmu

from sidestep.fmu.importing.archive import FmuDescription, unpack
from sidestep.fmu.importing.instance import FmuInstance
from sidestep.fmu.importing.isolation import Report, reported
from sidestep.fmu.importing.ports import FLOATS, elements
from sidestep.fmu.scratch import discard
from sidestep.plant_models.errors import InputError, PlantError

TIME_LIMIT = 60.0
"""For loading an FMU and one step of it, in [s]."""

_CAPABILITIES = {
    "canGetAndSetFMUstate": (("fmi2GetFMUstate", "fmi2SetFMUstate"), ("fmi3GetFMUState", "fmi3SetFMUState")),
    "canSerializeFMUstate": (("fmi2SerializeFMUstate",), ("fmi3SerializeFMUState",)),
    "providesDirectionalDerivative": (("fmi2GetDirectionalDerivative",), ("fmi3GetDirectionalDerivative",)),
}


def check_fmu(path: Path) -> list[tuple[str, str]]:
    """Inspect an FMU and run it for one step, in a process of its own.

    Returns:
        Who found it (sidestep, fmpy or fmutool) and what; empty if there is nothing.
    """
    try:
        fmu = unpack(path)
    except InputError as error:
        return [("sidestep", f"{error.problem}" + (f"; allowed: {error.allowed}" if error.allowed else ""))]
    except PlantError as error:
        return [("sidestep", str(error))]
    try:
        found = [("sidestep", finding) for finding in (*_described(fmu.about), *_run(path))]
    finally:
        discard(fmu.folder)
    return found + [("fmpy", finding) for finding in _fmpy(path)] + [("fmutool", finding) for finding in _fmutool(path)]


def _described(fmu: FmuDescription) -> Iterator[str]:
    names = {variable.causality for variable in fmu.variables.values()}
    for causality in ("input", "output"):
        if causality not in names:
            yield f"it has no {causality}: nothing can be connected"
    if fmu.remark:
        yield fmu.remark
    if not fmu.interface.canHandleVariableCommunicationStepSize and not fmu.fixed_step:
        yield "it has a fixed step but does not say which"


def _run(path: Path) -> list[str]:
    return reported(partial(_one_step, path), TIME_LIMIT)


def _one_step(path: Path, say: Report) -> None:
    say("call", "the loading of the binary")
    fmu = FmuInstance(path, lambda name: say("call", name))
    try:
        for flag, name in _missing(fmu):
            say("finding", f"it says {flag}, but its binary lacks {name}")
        variables = [v for v in fmu.variables.values() if v.causality == "output" and v.type in FLOATS]
        outputs = fmu.port([name for variable in variables for name in elements(variable)])
        fmu.start(0.0, {})
        say("call", "the reading of outputs")
        fmu.get(outputs)
        say("call", "the first step")
        fmu.step(0.0, fmu.fixed_step or 0.01)
        fmu.get(outputs)
        for name, value in zip(outputs.names, outputs.values, strict=True):
            if not math.isfinite(value):
                say("finding", f"output {name} is {value} after the first step")
    except (PlantError, InputError) as error:
        say("finding", str(error))
    finally:
        fmu.close()


def _missing(fmu: FmuInstance) -> Iterator[tuple[str, str]]:
    for flag, functions in _CAPABILITIES.items():
        if getattr(fmu.interface, flag):
            yield from ((flag, name) for name in functions[0 if fmu.is_fmi2 else 1] if not fmu.has_function(name))


def _fmpy(path: Path) -> list[str]:
    try:
        return [" ".join(str(problem).split()) for problem in validate_fmu(str(path))]
    except Exception as error:  # fmpy raises bare Exception
        return [str(error)]


def _fmutool(path: Path) -> list[str]:
    if importlib.util.find_spec("fmu_manipulation_toolbox") is None:
        return []
    code = "from fmu_manipulation_toolbox.cli.fmutool import fmutool; fmutool()"
    command = [sys.executable, "-c", code, "-input", str(path), "-check"]
    result = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    lines = (result.stdout + result.stderr).splitlines()
    return [line.partition("|")[2].strip() for line in lines if line.startswith(("ERROR", "WARNING", "CRITICAL"))]
