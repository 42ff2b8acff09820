"""Build native plant FMUs on first use into a cache keyed by content, so that nothing is built twice."""

import hashlib
import io
import string
import uuid
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import fmpy

from sidestep.fmu.compiling.cache import cache_folder, cached, write_whole
from sidestep.fmu.compiling.platforms import (
    HOST,
    Platform,
    all_platforms,
    compile_library,
    compiler_call,
    compiler_version,
    find_compiler,
)
from sidestep.fmu.description.icon import draw_icon
from sidestep.fmu.description.model_description import build_description, model_description, variable_rows
from sidestep.fmu.description.plants import find_model
from sidestep.fmu.description.variables import Model, c_header
from sidestep.fmu.native.expected_output import expected_output
from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.errors import InputError

_FOLDER = Path(__file__).parent
_FMI_HEADERS = Path(fmpy.__file__).parent / "c-code"
_COMMON_SOURCES = ("instance.c", "instance.h", "fmi2.c", "fmi3.c")
_ICON_PLACE = (
    b'<?xml version="1.0" encoding="UTF-8"?>\n<fmiTerminalsAndIcons fmiVersion="3.0"><GraphicalRepresentation>'
    b'<CoordinateSystem x1="-100" y1="-100" x2="100" y2="100"/><Icon x1="-100" y1="-100" x2="100" y2="100"/>'
    b"</GraphicalRepresentation></fmiTerminalsAndIcons>\n"
)


def build_fmu(
    model: str = "single-track", fmi: int = 3, out: str | Path | None = None, everywhere: bool = False
) -> Path:
    """A native plant as an FMU.

    Args:
        model: One of `plants.MODELS`.
        fmi: 2 or 3.
        out: Where to put it; the cache's own file if None.
        everywhere: For all of `PLATFORMS`, which takes the package ziglang, not for this machine alone.

    Returns:
        Path of the .fmu file.

    Raises:
        InputError: Unknown model or FMI version, or `out` or the cache cannot be written.
        CompilerError: The FMU is not in the cache and cannot be compiled.
    """
    file = build_model(find_model(model), fmi, platforms=all_platforms() if everywhere else (HOST,))
    return write_to(Path(out), file.read_bytes()) if out else file


def build_model(
    model: Model, fmi: int, resources: dict[str, bytes] | None = None, platforms: Sequence[Platform] = (HOST,),
    further: Callable[[Platform], dict[str, bytes]] | None = None,
) -> Path:  # fmt: skip
    """The FMU of a variable table and its C files, from the cache if it is there.

    Args:
        model: What to build.
        fmi: 2 or 3.
        resources: Files in resources/, by name.
        platforms: What to compile for, this machine among it.
        further: Files by name that are compiled and linked with the model's own for a platform, object code among
            them; the FMU then comes without sources, which would not be all.

    Raises:
        InputError: Unknown FMI version, or the cache cannot be written.
        CompilerError: The FMU is not in the cache and cannot be compiled.
    """
    if fmi not in (2, 3):
        raise InputError("fmi", f"{fmi}", "2, 3")
    recipes = [_recipe(platform) for platform in platforms]
    contents = _contents(model, fmi, with_sources=further is None) | {
        f"resources/{name}": data for name, data in (resources or {}).items()
    }
    key = _digest(contents | source_files(model) | {"recipes": repr(recipes).encode()})

    def pack() -> bytes:
        for platform, recipe in zip(platforms, recipes, strict=True):
            library = _library(model, platform, recipe, further(platform) if further else {})
            folder = platform.fmi2 if fmi == 2 else platform.fmi3
            contents[f"binaries/{folder}/{model.identifier}{platform.suffix}"] = library.read_bytes()
        if model.of_kind("state"):
            contents["documentation/expected_output.csv"] = _expected_output(model, contents)
        return _archive(contents)

    return cached(f"{model.identifier}-fmi{fmi}-{key}", ".fmu", pack)


def _recipe(platform: Platform) -> str:
    call = compiler_call(platform)
    return repr((call, compiler_version(tuple(find_compiler(platform)))))


def _expected_output(model: Model, contents: dict[str, bytes]) -> bytes:
    folder = scratch_folder("build")
    try:
        draft = folder / f"{model.identifier}.fmu"
        draft.write_bytes(_archive(contents))
        return expected_output(draft, model)
    finally:
        discard(folder)


def write_to(out: Path, data: bytes) -> Path:
    """Write a file that was asked for, complete or not at all; a device or a pipe is written to.

    Raises:
        InputError: `out` cannot be written.
    """
    try:
        if out.exists() and not out.is_file():
            out.write_bytes(data)
        else:
            write_whole(out, data)
    except OSError as error:
        raise InputError(str(out), f"cannot be written: {error.strerror}") from error
    return out


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


def _contents(model: Model, fmi: int, with_sources: bool) -> dict[str, bytes]:
    """All files of the FMU but binaries and what they answer, by path in the archive."""
    sources = source_files(model) if with_sources else {}
    files = {"modelDescription.xml": model_description(model, fmi, _token(model), _c_files(sources))}
    files |= {f"sources/{name}": data for name, data in sources.items()}
    files["documentation/index.html"] = _documentation(model).encode()
    icon = draw_icon(model.identifier)
    if fmi == 2:
        return files | {"model.png": icon}
    return files | {"terminalsAndIcons/icon.png": icon, "terminalsAndIcons/terminalsAndIcons.xml": _ICON_PLACE}


def _documentation(model: Model) -> str:
    """The page about the model: its own text, what all cars share, and the table of variables."""

    def text(name: str, **parts: str) -> str:
        template = (_FOLDER.parent / "description" / "resources" / f"{name}.html").read_text(encoding="utf-8")
        return string.Template(template).substitute(parts)

    body = text(model.identifier, actuator=text("actuator"), numbers=text("numbers"))
    return text("page", title=model.name, body=body, variables=variable_rows(model))


def _archive(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)  # fixed date: same bytes again
    return buffer.getvalue()


def _library(model: Model, platform: Platform, recipe: str, further: dict[str, bytes]) -> Path:
    """The compiled binary, one for both standards."""
    files = source_files(model) | further

    def build() -> bytes:
        folder = scratch_folder("build", cache_folder())
        try:
            for name, data in files.items():
                (folder / name).write_bytes(data)
            output = folder / "output" / f"{model.identifier}{platform.suffix}"
            output.parent.mkdir()
            compile_library(folder, output, platform=platform)
            return output.read_bytes()
        finally:
            discard(folder)

    key = _digest(files | {"recipe": recipe.encode()})
    return cached(f"{model.identifier}-{key}", platform.suffix, build)


def _digest(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, data in sorted(files.items()):
        digest.update(f"{name}:{len(data)}:".encode() + data)
    return digest.hexdigest()[:16]
