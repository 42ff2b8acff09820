"""Build native plant FMUs on first use into a cache keyed by content, so that nothing is built twice."""

import hashlib
import importlib.util
import io
import os
import shlex
import shutil
import string
import subprocess
import sys
import tempfile
import uuid
import zipfile
from functools import cache
from pathlib import Path

import fmpy

from sidestep.fmu.model_description import build_description, model_description, variable_rows
from sidestep.fmu.plants import find_model
from sidestep.fmu.variables import Model, c_header
from sidestep.plant_models.errors import InputError, PlantError

_FOLDER = Path(__file__).parent
_FMI_HEADERS = Path(fmpy.__file__).parent / "c-code"
_COMMON_SOURCES = ("instance.c", "instance.h", "fmi2.c", "fmi3.c")
# no fused multiply-add and no -march=native: the same bits on every machine
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno")
_WAYS_OUT = "install gcc or clang (or set CC), `pip install sidestep[cross]`, or take --plant linear or mujoco"


class CompilerError(PlantError):
    """No C compiler, or one that failed; the message says what to do."""


def build_fmu(model: str = "single-track", fmi: int = 3, out: str | Path | None = None) -> Path:
    """A native plant as an FMU for this machine.

    Args:
        model: One of `plants.MODELS`.
        fmi: 2 or 3.
        out: Where to put it; the cache's own file if None.

    Returns:
        Path of the .fmu file.

    Raises:
        InputError: Unknown model or FMI version, or `out` or the cache cannot be written.
        CompilerError: The FMU is not in the cache and cannot be compiled.
    """
    file = build_model(find_model(model), fmi)
    return copy_to(file, Path(out)) if out else file


def build_model(model: Model, fmi: int, resources: dict[str, bytes] | None = None) -> Path:
    """The FMU of a variable table and its C files, from the cache if it is there.

    Args:
        model: What to build.
        fmi: 2 or 3.
        resources: Files in resources/, by name.

    Raises:
        InputError: Unknown FMI version, or the cache cannot be written.
        CompilerError: The FMU is not in the cache and cannot be compiled.
    """
    if fmi not in (2, 3):
        raise InputError("fmi", f"{fmi}", "2, 3")
    compiler = find_compiler()
    recipe = repr((compiler, _version(tuple(compiler)), _FLAGS)).encode()
    contents = _contents(model) | {f"resources/{name}": data for name, data in (resources or {}).items()}
    file = _cache_folder() / f"{model.identifier}-fmi{fmi}-{_digest(contents | {'recipe': recipe})}.fmu"
    if not file.exists():
        library = _library(model, _digest(source_files(model) | {"recipe": recipe}))
        _write(file, _archive(model, fmi, contents, library))
    return file


def copy_to(file: Path, out: Path) -> Path:
    """Copy a file, in one go.

    Raises:
        InputError: `out` cannot be written.
    """
    try:
        _write(out, file.read_bytes())
    except OSError as error:
        raise InputError(str(out), f"cannot be written: {error.strerror}") from error
    return out


def find_compiler() -> list[str]:
    """Command line of the C compiler: $CC, else cc, else the one in the ziglang package.

    Raises:
        CompilerError: There is none.
    """
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]):
        return command
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]
    raise CompilerError(f"no C compiler: {command[0]!r} is not on the PATH; {_WAYS_OUT}")


def compile_library(sources: Path, output: Path, flags: tuple[str, ...] = ()) -> None:
    """Compile every C file of a folder into one shared library, with further compiler flags.

    Raises:
        CompilerError: No compiler, or it failed: the first lines of what it said.
    """
    files = sorted(str(file) for file in sources.glob("*.c"))
    command = [*find_compiler(), *_FLAGS, *flags, f"-I{sources}", *files, "-o", str(output), "-lm"]
    result = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if result.returncode != 0:
        said = "; ".join(result.stderr.strip().splitlines()[:4]) or f"exit status {result.returncode}"
        raise CompilerError(f"{command[0]} failed: {said}; {_WAYS_OUT}")


def source_files(model: Model) -> dict[str, bytes]:
    """Everything in sources/ by name: enough to build the binary again anywhere."""
    names = (*_COMMON_SOURCES, *model.c_files)
    files = {name: (_FOLDER / "sources" / name).read_bytes() for name in names}
    files |= {header.name: header.read_bytes() for header in sorted(_FMI_HEADERS.glob("fmi[23]*.h"))}
    files["variables.h"] = c_header(model, _token(model)).encode()
    return files | {"buildDescription.xml": build_description(model, _c_files(files))}


def _token(model: Model) -> str:
    """GUID and instantiation token: changes with the table alone, which is what XML and binary share."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"sidestep:{model.name}:{c_header(model, '')}"))


def _c_files(files: dict[str, bytes]) -> list[str]:
    return sorted(name for name in files if name.endswith(".c"))


def _contents(model: Model) -> dict[str, bytes]:
    """All files of both FMUs but the binary, by path in the archive; the XML files by standard."""
    sources = source_files(model)
    page = (_FOLDER / "resources" / f"{model.identifier}.html").read_text(encoding="utf-8")
    files = {f"sources/{name}": data for name, data in sources.items()}
    files["documentation/index.html"] = string.Template(page).substitute(variables=variable_rows(model)).encode()
    for fmi in (2, 3):
        files[f"{fmi}/modelDescription.xml"] = model_description(model, fmi, _token(model), _c_files(sources))
    return files


def _archive(model: Model, fmi: int, files: dict[str, bytes], library: Path) -> bytes:
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    description = files[f"{fmi}/modelDescription.xml"]
    files = {"modelDescription.xml": description} | {k: v for k, v in files.items() if not k[0].isdigit()}
    files[f"binaries/{platform}/{model.identifier}{fmpy.sharedLibraryExtension}"] = library.read_bytes()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)  # fixed date: same bytes again
    return buffer.getvalue()


def _library(model: Model, key: str) -> Path:
    """The compiled binary, one for both standards."""
    library = _cache_folder() / f"{model.identifier}-{key}{fmpy.sharedLibraryExtension}"
    if not library.exists():
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            for name, data in source_files(model).items():
                Path(folder, name).write_bytes(data)
            fresh = Path(folder, library.name)
            compile_library(Path(folder), fresh)
            fresh.replace(library)
    return library


def _cache_folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base, "sidestep")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("XDG_CACHE_HOME", f"{folder} cannot be made: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise InputError("XDG_CACHE_HOME", f"{folder} cannot be written")
    return folder


def _write(file: Path, data: bytes) -> None:
    """Write in one go: another process sees no file or the whole file."""
    fresh = file.with_name(f"{file.name}.{os.getpid()}")
    try:
        fresh.write_bytes(data)
        fresh.replace(file)
    finally:
        fresh.unlink(missing_ok=True)


@cache
def _version(compiler: tuple[str, ...]) -> str:
    result = subprocess.run([*compiler, "--version"], capture_output=True, text=True, errors="replace", check=False)
    return result.stdout.partition("\n")[0]


def _digest(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, data in sorted(files.items()):
        digest.update(f"{name}:{len(data)}:".encode() + data)
    return digest.hexdigest()[:16]
