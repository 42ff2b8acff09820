"""The binary of an FMU that brings its C sources, and none for this machine: compiled on first use and cached."""

import hashlib
from pathlib import Path, PurePosixPath

import fmpy
from fmpy.model_description import BuildConfiguration, ModelDescription

from sidestep.fmu.compiling.cache import cached
from sidestep.fmu.compiling.platforms import HOST, compile_library
from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.errors import InputError

_HEADERS = Path(fmpy.__file__).parent / "c-code"
_OWN_NAMES = ("FMI2_OVERRIDE_FUNCTION_PREFIX", "FMI3_OVERRIDE_FUNCTION_PREFIX")
"""Without prefix, as a shared library has its functions."""


def source_configuration(description: ModelDescription, identifier: str) -> BuildConfiguration | None:
    """How the co-simulation FMU is compiled, if it says so.

    Raises:
        InputError: It names files of others.
    """
    found = [c for c in description.buildConfigurations or [] if c.modelIdentifier == identifier]
    if not found or not any(s.sourceFiles for s in found[0].sourceFileSets):
        return None
    for part in found[0].sourceFileSets:
        for name in (*part.sourceFiles, *part.includeDirectories):
            if not (path := PurePosixPath(name)).parts or path.is_absolute() or ".." in path.parts:
                raise InputError("buildDescription.xml", f"{name!r} lies outside of sources/", "a file in it")
    return found[0]


def compile_sources(folder: Path, configuration: BuildConfiguration) -> Path:
    """The shared library of an unpacked FMU's sources.

    Args:
        folder: With sources/ in it.
        configuration: What to compile, and how.

    Raises:
        CompilerError: There is no C compiler, or it failed.
        InputError: The cache cannot be written.
    """
    sources = folder / "sources"
    digest = hashlib.sha256(repr(configuration).encode())
    for file in sorted(file for file in sources.rglob("*") if file.is_file()):
        digest.update(f"{file.relative_to(sources)}".encode() + file.read_bytes())
    key = f"source-{configuration.modelIdentifier}-{digest.hexdigest()[:16]}"
    return cached(key, HOST.suffix, lambda: _compiled(sources, configuration))


def _compiled(sources: Path, configuration: BuildConfiguration) -> bytes:
    flags, files = [f"-D{name}" for name in _OWN_NAMES], []
    for part in configuration.sourceFileSets:
        files += [sources / name for name in part.sourceFiles]
        flags += [f"-I{sources / name}" for name in part.includeDirectories]
        flags += [f"-D{d.name}" + (f"={d.value}" if d.value else "") for d in part.preprocessorDefinitions]
    out = scratch_folder("build")
    try:
        visible = ("-fvisibility=default", f"-I{_HEADERS}", "-w")
        compile_library(sources, out / "library", (*visible, *flags), files=files)
        return (out / "library").read_bytes()
    finally:
        discard(out)
