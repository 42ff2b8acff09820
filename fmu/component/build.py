"""The component as shared and static library, from object code and C."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sidestep.fmu.compiling.cache import cache_folder
from sidestep.fmu.compiling.platforms import HOST, Platform, archive_library, compile_library
from sidestep.fmu.component.emit import kernels_stamp, object_code
from sidestep.fmu.component.layout import SOURCES, header, private_header
from sidestep.fmu.scratch import discard, scratch_folder

_TRIPLES = {
    "x86_64-linux": "x86_64-unknown-linux-gnu", "aarch64-linux": "aarch64-unknown-linux-gnu",
    "x86_64-windows": "x86_64-pc-windows-gnu", "x86_64-darwin": "x86_64-apple-macosx11.0.0",
    "aarch64-darwin": "arm64-apple-macosx11.0.0",
}  # fmt: skip
"""As LLVM calls them, by the name that FMI 3.0 has for a platform."""


def revision() -> str:
    """Changes with everything that a component is compiled from."""
    digest = hashlib.sha256(kernels_stamp().encode())
    for data in _texts().values():
        digest.update(data)
    return digest.hexdigest()[:16]


def _texts() -> dict[str, bytes]:
    files = {name: (SOURCES / name).read_bytes() for name in ("arena.c", "arena.h", "controller.c")}
    return files | {"sidestep.h": header().encode(), "layout.h": private_header().encode()}


def component_files(platform: Platform = HOST) -> dict[str, bytes]:
    """Headers, C files and object code by name: what is compiled and linked for a platform.

    Raises:
        InputError: The cache cannot be written.
        PlantError: The step does not compile.
    """
    return _texts() | {"kernels.o": object_code(_TRIPLES[platform.fmi3])}


def shared_library(platform: Platform = HOST) -> bytes:
    """The component as a shared library.

    Raises:
        InputError: The cache cannot be written.
        PlantError: The step does not compile, or there is no C compiler for the platform.
    """
    with _written(platform) as folder:
        output = folder / "output" / f"libsidestep{platform.suffix}"
        compile_library(folder, output, ("-DSIDESTEP_BUILD_SHARED",), platform)
        return output.read_bytes()


def static_library(platform: Platform = HOST) -> bytes:
    """The component as a static library; errors as of `shared_library`."""
    with _written(platform) as folder:
        output = folder / "output" / "libsidestep.a"
        files = [folder / name for name in ("arena.c", "controller.c")]
        archive_library(folder, output, platform, files, [folder / "kernels.o"])
        return output.read_bytes()


@contextmanager
def _written(platform: Platform) -> Iterator[Path]:
    folder = scratch_folder("build", cache_folder())
    try:
        for name, data in component_files(platform).items():
            (folder / name).write_bytes(data)
        (folder / "output").mkdir()
        yield folder
    finally:
        discard(folder)
