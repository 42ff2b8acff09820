"""Platforms that an FMU can hold binaries for, and the compiler of each."""

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import fmpy

from sidestep.plant_models.errors import PlantError

# no fused multiply-add and no -march=native: the same bits on every machine
_FLAGS = ("-std=c99", "-O2", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno")
_ZIG = (sys.executable, "-m", "ziglang", "cc")
_WAYS_OUT = "install gcc or clang (or set CC), `pip install sidestep[cross]`, or take --plant linear or mujoco"


class CompilerError(PlantError):
    """No C compiler, or one that failed; the message says what to do."""


@dataclass(frozen=True)
class Platform:
    """Where a binary runs.

    Attributes:
        target: As zig calls it; empty for this machine, whose own compiler is taken.
        fmi2, fmi3: Folder of the binary in an FMU of either standard.
        suffix: Of a shared library.
    """

    target: str
    fmi2: str
    fmi3: str
    suffix: str

    @property
    def is_windows(self) -> bool:
        """Whether its libraries are DLLs, whose code needs no -fPIC."""
        return self.suffix == ".dll"


HOST = Platform("", fmpy.platform, fmpy.platform_tuple, fmpy.sharedLibraryExtension)
PLATFORMS = (
    Platform("x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so"),
    Platform("aarch64-linux-gnu.2.17", "aarch64-linux", "aarch64-linux", ".so"),
    Platform("x86_64-windows-gnu", "win64", "x86_64-windows", ".dll"),
    Platform("x86_64-macos", "darwin64", "x86_64-darwin", ".dylib"),
    Platform("aarch64-macos", "aarch64-darwin", "aarch64-darwin", ".dylib"),
)
"""What `--platform all` builds for. FMI 2.0 has no names for ARM; those of FMI 3.0 are taken."""


def all_platforms() -> tuple[Platform, ...]:
    """This machine and all others of `PLATFORMS`.

    Raises:
        CompilerError: ziglang, which compiles for them, is not installed.
    """
    if not importlib.util.find_spec("ziglang"):
        raise CompilerError("--platform all: ziglang is not installed; `pip install sidestep[cross]`")
    return (HOST, *(platform for platform in PLATFORMS if platform.fmi3 != HOST.fmi3))


def find_compiler(platform: Platform = HOST) -> list[str]:
    """Command line of the C compiler: here $CC, else cc, else the one in the ziglang package; that one for elsewhere.

    Raises:
        CompilerError: There is none.
    """
    if platform.target:
        return [*_ZIG, "-target", platform.target]
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]):
        return command
    if importlib.util.find_spec("ziglang"):
        return [*_ZIG, "-mcpu=baseline"]
    raise CompilerError(f"no C compiler: {command[0]!r} is not on the PATH; {_WAYS_OUT}")


def compile_library(
    sources: Path,
    output: Path,
    flags: tuple[str, ...] = (),
    platform: Platform = HOST,
    files: Sequence[Path] = (),
) -> None:
    """Compile every C file of a folder, or those that are named, into one shared library, with further compiler flags.

    Object code in the folder, or among the files, is linked in.

    Raises:
        CompilerError: No compiler, or it failed: the first lines of what it said.
    """
    names = sorted(str(file) for file in files or [*sources.glob("*.c"), *sources.glob("*.o")])
    _run([*compiler_call(platform), "-shared", *flags, f"-I{sources}", *names, "-o", str(output), "-lm"])


def archive_library(
    sources: Path, output: Path, platform: Platform, files: Sequence[Path], objects: Sequence[Path]
) -> None:
    """Compile C files into a static library, together with object code that is there.

    Args:
        sources: Folder of the headers.
        output: The library.
        platform: What to compile for.
        files, objects: C files, and object code for the same platform.

    Raises:
        CompilerError: No compiler or archiver, or one failed.
    """
    compiled = [output.parent / f"{file.stem}.o" for file in files]
    for file, made in zip(files, compiled, strict=True):
        _run([*compiler_call(platform), f"-I{sources}", "-c", str(file), "-o", str(made)])
    own = not platform.target and shutil.which("ar")
    _run([*(["ar"] if own else [*_ZIG[:-1], "ar"]), "rcs", str(output), *map(str, (*compiled, *objects))])
    for made in compiled:
        made.unlink()


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if result.returncode != 0:
        said = "; ".join(result.stderr.strip().splitlines()[:4]) or f"exit status {result.returncode}"
        raise CompilerError(f"{command[0]} failed: {said}; {_WAYS_OUT}")


def compiler_call(platform: Platform) -> list[str]:
    """Command line of the compiler with its flags.

    Raises:
        CompilerError: There is none.
    """
    return [*find_compiler(platform), *_FLAGS, *(() if platform.is_windows else ("-fPIC",))]


@cache
def compiler_version(command: tuple[str, ...]) -> str:
    """The first line of what a compiler says of itself."""
    result = subprocess.run([*command, "--version"], capture_output=True, text=True, errors="replace", check=False)
    return result.stdout.partition("\n")[0]
