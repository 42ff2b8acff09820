"""MF4 export of a recording, as measurement tools read it; needs the extra `mdf`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError
from sidestep.validation.files import complete_path, written_to
from sidestep.validation.loop.recording import STEP_UNITS, Array, Recording


def require_mdf() -> Any:
    """The library.

    Raises:
        InputError: It is not installed.
    """
    try:
        import asammdf
    except ImportError as error:
        raise InputError("--mf4", "needs the package asammdf", "pip install 'sidestep[mdf]'") from error
    return asammdf


def write_mdf(file: Path, recording: Recording, comment: str) -> None:
    """Write an MDF 4.10 file with two groups: what is recorded every plant step, and every controller step.

    Raises:
        InputError: The library is not installed, or the file cannot be written.
    """
    asammdf = require_mdf()
    with written_to(file.parent), asammdf.MDF(version="4.10") as mdf:
        mdf.append(_signals(asammdf, recording.samples, recording.units), comment=f"{comment}: plant steps")
        mdf.append(_signals(asammdf, recording.steps, STEP_UNITS), comment=f"{comment}: controller steps")
        with complete_path(file) as path:
            mdf.save(path, overwrite=True)


def _signals(asammdf: Any, columns: Mapping[str, Array], units: Mapping[str, str]) -> list[Any]:
    time = columns["time"]
    return [asammdf.Signal(v, time, unit=units[name], name=name) for name, v in columns.items() if name != "time"]
