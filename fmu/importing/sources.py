"""The binary of an FMU that brings its C sources, and none for this machine: compiled on first use and cached."""

import hashlib
from pathlib import Path

import fmpy
from fmpy.model_description import BuildConfiguration, ModelDescription

from sidestep.fmu.compiling.cache import cached
from sidestep.fmu.compiling.platforms import HOST, compile_library
from sidestep.fmu.scratch import discard, scratch_folder

_HEADERS = Path(fmpy.__file__).parent / "c-code"
_OWN_NAMES = ("FMI2_OVERRIDE_FUNCTION_PREFIX", "FMI3_OVERRIDE_FUNCTION_PREFIX")
"""Without prefix, as a shared library has its functions."""


def source_configuration(description: ModelDescription, identifier: str) -> BuildConfiguration | None:
    """How the co-simulation FMU is compiled, if it says so."""
    found = [c for c in description.buildConfigurations or [] if c.modelIdentifier == identifier]
    return found[0] if found and any(s.sourceFiles for s in found[0].sourceFileSets) else None


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
