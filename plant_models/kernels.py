"""The decorator of every compiled function, and the key under which the compiled code is kept.

Numba keys its cache by the file that a function stands in. A kernel holds the code and the constants of other
files, too, which would go unnoticed when they change: after `git pull`, old and new code would run together.
"""

import functools
import hashlib
import pickle
import platform
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numpy.typing import NDArray

Array = NDArray[np.float64]
Records = NDArray[np.void]
"""Records of one structure; kernels take one as an array of shape (1,)."""
Record = Any
"""One record, or a named tuple with its fields: kernels reach them by name."""

_PACKAGES = Path(__file__).resolve().parents[1]  # the folder whose import name is `sidestep`
_IMPORT = re.compile(r"^\s*from sidestep((?:\.\w+)*) import (\([^)]*\)|.*)", re.MULTILINE)
_DIGEST = hashlib.sha256().digest_size
_VERSIONS = (platform.python_version(), np.__version__, numba.__version__, llvmlite.__version__)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile `function` on its first call for each kind of arguments and keep the code for later processes.

    It runs without the interpreter's lock, and a division by zero is no exception. `kernel(function).py_func` is
    `function` itself, for other compilers; with `NUMBA_DISABLE_JIT=1` nothing is compiled and `function` comes back.
    """
    return _compiled(function)


def bare_kernel(function: Callable[..., Any]) -> Any:
    """A `kernel` that needs no run-time library: it cannot raise, and does not compile if it allocates.

    A division by zero gives what IEEE 754 says. Slices of arrays are fine, new arrays are not.
    """
    return _compiled(function, _nrt=False)


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    compiled: Any = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if compiled is not function:
        compiled._cache = _KernelCache(function)  # what `cache=True` does, with our key
    return compiled


class _KernelCache(FunctionCache):
    """Numba's cache, whose entries hold while no source they may stem from has changed.

    The processor is in numba's own key of each entry.
    """

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        stamp = source_stamp(Path(py_func.__code__.co_filename).resolve())
        self._cache_file = _WholeFiles(self.cache_path, self._impl.filename_base, stamp)


class _WholeFiles(IndexDataCacheFile):
    """Numba's files with a digest at the end of each: what was cut short or changed is compiled again.

    Numba itself would load it: an exception at best, wrong machine code at worst.
    """

    def _dump(self, obj: Any) -> bytes:
        data = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    def _load_index(self) -> dict[Any, str]:
        with suppress(OSError), open(self._index_path, "rb") as file, suppress(*_UNREADABLE):
            pickle.load(file)  # the version, which is no part of what is digested
            if _is_whole(file.read()):
                return super()._load_index()
        return {}

    def _load_data(self, name: str) -> Any:
        if not _is_whole(Path(self._data_path(name)).read_bytes()):
            raise OSError(f"{name} is damaged")  # which counts as not there
        return super()._load_data(name)


_UNREADABLE = (
    pickle.UnpicklingError,
    EOFError,
    AttributeError,
    ImportError,
    IndexError,
    ValueError,
    TypeError,
    KeyError,
)


def _is_whole(data: bytes) -> bool:
    return hashlib.sha256(data[:-_DIGEST]).digest() == data[-_DIGEST:]


@functools.cache
def source_stamp(file: Path) -> str:
    """Hash of the versions, of `file`, and of all files of `sidestep` that it imports, directly or through others.

    Import names are taken from the text, so that a file's constants count as its kernels do; what is imported later
    or for type checkers only counts, too.
    """
    files, new = set(), {file}
    while new:
        files |= new
        new = {imported for one in new for imported in _read(one)[1]} - files
    digest = hashlib.sha256(repr(_VERSIONS).encode())
    for one in sorted(files):
        digest.update(_read(one)[0])
    return digest.hexdigest()


@functools.cache
def _read(file: Path) -> tuple[bytes, frozenset[Path]]:
    """Digest of a source file, and the files of `sidestep` that it names in its imports."""
    source = file.read_bytes()
    found = set()
    for module, names in _IMPORT.findall(source.decode()):
        folder = _PACKAGES.joinpath(*module.split(".")[1:])
        if not folder.is_dir():
            found.add(folder.with_suffix(".py"))
            continue
        found.add(folder / "__init__.py")
        found |= {folder / f"{name}.py" for name in re.findall(r"\w+", names)}
    return hashlib.sha256(source).digest(), frozenset(one for one in found if one.is_file())
