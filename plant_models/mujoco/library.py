"""MuJoCo's library a second time, for the plant's own steps: the first belongs to whoever imports `mujoco`.

MuJoCo keeps callbacks and a clock in variables of the library, one set for the process. With its clock on, which the
Python package turns on, each step reads the time 32 times for the profile in `MjData.timer`: a tenth of its time. A
copy of the library under another name has variables of its own, in which no clock is set and nobody's callbacks are;
models and data are plain memory, with which both work alike.
"""

import ctypes
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

import mujoco

_SHARED = ("mju_user_error", "mju_user_warning", "mju_user_malloc", "mju_user_free")
"""Variables that the copy takes over: who reports errors, who gives memory."""


def load_own_copy() -> ctypes.CDLL:
    """Copy MuJoCo's library, load the copy and remove its file."""
    folder = Path(mujoco.__file__).parent
    original = next(file for pattern in ("libmujoco*", "mujoco.dll") for file in folder.glob(pattern))
    with tempfile.TemporaryDirectory(prefix="sidestep-", ignore_cleanup_errors=True) as place:
        copy = shutil.copyfile(original, Path(place, f"own-{original.name}"))
        library, theirs = ctypes.CDLL(str(copy)), ctypes.CDLL(str(original))
    for name in _SHARED:
        with suppress(ValueError):  # not in this version
            ctypes.c_void_p.in_dll(library, name).value = ctypes.c_void_p.in_dll(theirs, name).value
    return library
