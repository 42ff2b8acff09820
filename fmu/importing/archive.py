"""Open an .fmu file: what can be wrong with it is found here, before anything of it runs."""

import shutil
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import fmpy
from fmpy.model_description import BuildConfiguration, CoSimulation, ModelDescription, ScalarVariable

from sidestep.fmu.importing.sources import compile_sources, source_configuration
from sidestep.fmu.scratch import discard, scratch_folder
from sidestep.plant_models.errors import InputError


@dataclass(frozen=True)
class UnpackedFmu:
    """A sound co-simulation FMU on disk.

    Attributes:
        folder: Where it was unpacked; the owner gives it to `discard`.
        is_fmi2: FMI 2.0, else FMI 3.0.
        name: Of the model.
        identifier: Of the co-simulation interface: the binary's name.
        token: GUID or instantiation token.
        variables: fmpy's description of the variables, by name.
        fixed_step: Step that every communication step must be a multiple of, in [s]; 0 if any will do.
        description: fmpy's, of the whole.
        interface: fmpy's, of co-simulation.
        remark: What it lacks that running it here takes; empty if nothing.
    """

    folder: Path
    is_fmi2: bool
    name: str
    identifier: str
    token: str
    variables: dict[str, ScalarVariable]
    fixed_step: float
    description: ModelDescription
    interface: CoSimulation
    remark: str = ""


def unpack(path: Path, to_run: bool = True) -> UnpackedFmu:
    """Check an FMU and extract it to a new folder; without a binary for this machine, its sources are compiled.

    Args:
        path: The .fmu file.
        to_run: Whether it must run here; else it may also be one for other machines.

    Raises:
        InputError: Not a sound FMU for co-simulation with FMI 2.0 or 3.0, or none for this machine.
        CompilerError: Its sources cannot be compiled.
    """
    if not path.is_file():
        raise InputError(str(path), "no such file", "an .fmu file")
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            _check_names(path, names)
            damaged = archive.testzip()
            if damaged:
                raise InputError(str(path), f"{damaged} in it is damaged")
            description = _read_description(path, archive)
            interface = _interface(path, description)
            binary, platform = _binary(description, interface), ""
            sources = source_configuration(description, str(interface.modelIdentifier))
            if binary not in names:
                platform = "none" if sources is None else "sources"
                if to_run and sources is None:
                    raise InputError(str(path), _no_binary(description, names))
            folder = _extract(archive)
            if to_run and platform and sources:
                _put_compiled(folder, binary, sources)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        raise InputError(str(path), f"not an FMU, or a truncated one: {error}") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be unpacked: {error.strerror or error}") from error
    return UnpackedFmu(
        folder=folder,
        is_fmi2=description.fmiVersion == "2.0",
        name=str(description.modelName),
        identifier=str(interface.modelIdentifier),
        token=str(description.guid),
        variables={variable.name: variable for variable in description.modelVariables},
        fixed_step=_fixed_step(path, description, interface),
        description=description,
        interface=interface,
        remark=_no_binary(description, names) + ("; its sources are compiled" if sources else "") if platform else "",
    )


def _put_compiled(folder: Path, binary: str, sources: BuildConfiguration) -> None:
    try:
        library = compile_sources(folder, sources)
        (folder / binary).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(library, folder / binary)
    except BaseException:
        discard(folder)
        raise


def _fixed_step(path: Path, description: ModelDescription, interface: CoSimulation) -> float:
    experiment = description.defaultExperiment
    if interface.canHandleVariableCommunicationStepSize:
        return 0.0
    step = interface.fixedInternalStepSize or (experiment.stepSize if experiment else None) or 0.0
    try:
        return float(step)
    except ValueError as error:
        raise InputError(str(path), f"its step size is {step!r}", "a number") from error


def _extract(archive: zipfile.ZipFile) -> Path:
    folder = scratch_folder("fmu")
    try:
        archive.extractall(folder)
    except BaseException:
        discard(folder)
        raise
    return folder


def _check_names(path: Path, names: list[str]) -> None:
    for name in names:
        if name.startswith("/") or "\\" in name or ":" in name or ".." in PurePosixPath(name).parts:
            raise InputError(str(path), f"unsafe path {name!r} in the archive: refused")
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
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        version = root.get("fmiVersion", "")
        if version.startswith("1."):
            raise InputError(str(path), f"FMI {version}", "FMI 2.0, FMI 3.0")
        description = fmpy.read_model_description(path, validate=False)
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
