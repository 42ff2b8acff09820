"""Open an .fmu file: what can be wrong with it is found here, before anything of it runs."""

import math
import re
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import fmpy
from fmpy.model_description import BuildConfiguration, CoSimulation, ModelDescription, ScalarVariable

from sidestep.fmu.importing.contents import require_sound
from sidestep.fmu.importing.sources import compile_sources, source_configuration
from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range

_IDENTIFIER = re.compile(r"[A-Za-z_][\w.-]{0,200}", re.ASCII)  # some tools allow themselves dots and hyphens
_STEPS = Range(1e-6, 1e3, "s")  # of an FMU with a fixed one: smaller ones would not come to the end of a period
_MOST_ELEMENTS = 1_000_000  # of an array, each of which has a name
_MOST_DESCRIPTION = 64_000_000  # bytes


@dataclass(frozen=True)
class FmuDescription:
    """A sound co-simulation FMU, as its archive describes it.

    Attributes:
        is_fmi2: FMI 2.0, else FMI 3.0.
        name: Of the model.
        identifier: Of the co-simulation interface: the binary's name.
        token: GUID or instantiation token.
        variables: fmpy's description of the variables, by name.
        fixed_step: Step that every communication step must be a multiple of, in [s]; 0 if any will do.
        description: fmpy's, of the whole.
        interface: fmpy's, of co-simulation.
        sources: How its sources are compiled, if it says so.
        remark: What it lacks that running it here takes; empty if nothing.
    """

    is_fmi2: bool
    name: str
    identifier: str
    token: str
    variables: dict[str, ScalarVariable]
    fixed_step: float
    description: ModelDescription
    interface: CoSimulation
    sources: BuildConfiguration | None = None
    remark: str = ""


@dataclass(frozen=True)
class UnpackedFmu:
    """An FMU on disk.

    Attributes:
        folder: Where it was unpacked; the owner gives it to `discard`.
        about: What it is.
    """

    folder: Path
    about: FmuDescription


def describe_fmu(path: Path) -> FmuDescription:
    """Check an FMU without unpacking it; it may be one for other machines.

    Raises:
        InputError: Not a sound FMU for co-simulation with FMI 2.0 or 3.0.
    """
    with _opened(path) as archive:
        return _described(path, archive)


def unpack(path: Path) -> UnpackedFmu:
    """Check an FMU and extract it to a new folder; without a binary for this machine, its sources are compiled.

    Raises:
        InputError: Not a sound FMU for co-simulation with FMI 2.0 or 3.0, or none for this machine.
        CompilerError: Its sources cannot be compiled.
    """
    with _opened(path) as archive:
        about = _described(path, archive)
        if about.remark and about.sources is None:
            raise InputError(str(path), about.remark)
        folder = scratch_folder("fmu")
        try:
            archive.extractall(folder)
            if about.remark and about.sources:
                _put_compiled(folder, _binary(about.description, about.interface), about.sources)
        except BaseException:
            discard(folder)
            raise
    return UnpackedFmu(folder, about)


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """The archive, after its list of contents was checked; what is wrong with it is named with the file."""
    if not path.is_file():
        raise InputError(str(path), "no such file", "an .fmu file")
    try:
        with zipfile.ZipFile(path) as archive:
            require_sound(path, archive.infolist())
            yield archive
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"not an FMU, or a truncated one: {error}") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be unpacked: {error.strerror or error}") from error


def _described(path: Path, archive: zipfile.ZipFile) -> FmuDescription:
    names = archive.namelist()
    _require_description(path, names)
    description = _read_description(path, archive)
    interface = _interface(path, description)
    _require_small(path, description)
    sources = source_configuration(description, str(interface.modelIdentifier))
    remark = "" if _binary(description, interface) in names else _no_binary(description, names)
    return FmuDescription(
        is_fmi2=description.fmiVersion == "2.0",
        name=str(description.modelName),
        identifier=str(interface.modelIdentifier),
        token=str(description.guid),
        variables={variable.name: variable for variable in description.modelVariables},
        fixed_step=_fixed_step(path, description, interface),
        description=description,
        interface=interface,
        sources=sources,
        remark=remark + ("; its sources are compiled" if remark and sources else ""),
    )


def _put_compiled(folder: Path, binary: str, sources: BuildConfiguration) -> None:
    library = compile_sources(folder, sources)
    (folder / binary).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(library, folder / binary)


def _fixed_step(path: Path, description: ModelDescription, interface: CoSimulation) -> float:
    experiment = description.defaultExperiment
    if interface.canHandleVariableCommunicationStepSize:
        return 0.0
    step = interface.fixedInternalStepSize or (experiment.stepSize if experiment else None) or 0.0
    try:
        size = float(step)
    except ValueError as error:
        raise InputError(str(path), f"its step size is {step!r}", "a number") from error
    if size:
        _STEPS.check(size, f"{path}: its step size")
    return size


def _require_small(path: Path, description: ModelDescription) -> None:
    for variable in description.modelVariables:
        if (count := math.prod(variable.shape or ())) > _MOST_ELEMENTS:
            problem = f"{variable.name!r} is an array of {count} elements"
            raise InputError(str(path), problem, f"up to {_MOST_ELEMENTS}")


def _require_description(path: Path, names: list[str]) -> None:
    if "modelDescription.xml" not in names:
        inner = next((name for name in names if name.endswith("/modelDescription.xml")), "")
        if inner.count("/") == 1:
            top = inner.partition("/")[0]
            raise InputError(
                str(path), f"not an FMU: all of it lies in a folder {top!r} of the archive",
                f"an archive of what is in {top!r}, made from within it",
            )  # fmt: skip
        raise InputError(str(path), "not an FMU: no modelDescription.xml in it")


def _read_description(path: Path, archive: zipfile.ZipFile) -> ModelDescription:
    try:
        if (size := archive.getinfo("modelDescription.xml").file_size) > _MOST_DESCRIPTION:
            raise InputError(str(path), f"a modelDescription.xml of {size} bytes", f"up to {_MOST_DESCRIPTION}")
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        version = root.get("fmiVersion", "")
        if version.startswith("1."):
            raise InputError(str(path), f"FMI {version}", "FMI 2.0, FMI 3.0")
        with path.open("rb") as file:  # which fmpy itself leaves open when it fails
            description = fmpy.read_model_description(file, validate=False)
        interface = root.find("CoSimulation")
    except InputError:
        raise
    except Exception as error:  # fmpy raises bare Exception, and whatever its parsers raise
        raise InputError(str(path), f"modelDescription.xml cannot be read: {error}") from error
    if description.coSimulation and interface is not None and "providesDirectionalDerivatives" in interface.attrib:
        # FMI 3.0's spelling, which fmpy 0.3.32 does not read
        derivatives = interface.attrib["providesDirectionalDerivatives"] in ("true", "1")
        description.coSimulation.providesDirectionalDerivative = derivatives
    return description


def _interface(path: Path, description: ModelDescription) -> CoSimulation:
    if description.coSimulation is None:
        raise InputError(str(path), "made for model exchange only", "an FMU for co-simulation")
    if not _IDENTIFIER.fullmatch(identifier := str(description.coSimulation.modelIdentifier)):
        raise InputError(str(path), f"its model identifier is {identifier[:100]!r}", "a name of C")
    return description.coSimulation


def _binary(description: ModelDescription, interface: CoSimulation) -> str:
    """Where the binary for this machine has to be in the archive."""
    return f"binaries/{_platform(description)}/{interface.modelIdentifier}{fmpy.sharedLibraryExtension}"


def _platform(description: ModelDescription) -> str:
    return fmpy.platform if description.fmiVersion == "2.0" else fmpy.platform_tuple


def _no_binary(description: ModelDescription, names: list[str]) -> str:
    """That there is none for this machine, and for which there are."""
    parts = [PurePosixPath(name).parts for name in names]
    there = sorted({part[1] for part in parts if part[0] == "binaries" and len(part) > 2})
    return f"no binary for {_platform(description)} in it, but for: {', '.join(there) or 'none'}"
