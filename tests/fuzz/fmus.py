"""FMUs to damage: descriptions of both standards, archives with binaries that hold nothing, and their reader."""

import io
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import fmpy

from sidestep.fmu.importing.archive import describe_fmu, unpack
from sidestep.fmu.importing.mapping import Mapping as FmuMapping
from sidestep.fmu.importing.proposal import describe, propose_mapping
from sidestep.fmu.scratch import discard


def description(fmi: int) -> bytes:
    """A description of FMI 2 or 3."""
    type_, start = ("Real", "ScalarVariable") if fmi == 2 else ("Float64", "")
    rows = ""
    names = ("SteerAngle", "input"), ("Pos.x", "output"), ("Psi", "output"), ("mass", "parameter")
    for k, (name, kind) in enumerate(names):
        first = "" if kind == "output" else 'start="1.5"'
        common, unit = f'name="{name}" valueReference="{k}" causality="{kind}"', "rad" if k == 0 else "m"
        shape = '<Dimension start="3"/>' if k == 3 else ""
        kept = 'variability="fixed"' if kind == "parameter" else ""
        if start:
            rows += f'<ScalarVariable {common} {kept}><Real unit="{unit}" {first}/></ScalarVariable>'
        else:
            rows += f'<{type_} {common} {kept} unit="{unit}" {first}>{shape}</{type_}>'
    version, token = ("2.0", "guid") if fmi == 2 else ("3.0", "instantiationToken")
    step = 'stepSize="0.01"' if fmi == 2 else 'fixedInternalStepSize="0.01"'
    experiment = f"<DefaultExperiment {step}/>" if fmi == 2 else '<DefaultExperiment stopTime="1"/>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{version}" modelName="fuzzed" {token}='
        f'"1"><CoSimulation modelIdentifier="car" {"" if fmi == 2 else step}/><UnitDefinitions><Unit name="m">'
        f'<BaseUnit m="1" factor="1"/></Unit><Unit name="rad"><BaseUnit rad="1"/></Unit></UnitDefinitions>'
        f"{experiment}<ModelVariables>{rows}</ModelVariables>"
        "<ModelStructure/></fmiModelDescription>"
    ).encode()


def archive(files: Mapping[str, bytes], packing: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip of files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", packing) as target:
        for name, data in files.items():
            target.writestr(zipfile.ZipInfo(name), data, packing)
    return buffer.getvalue()


def stub_fmu(description: bytes) -> dict[str, bytes]:
    """Files of an FMU whose binaries hold nothing, for this machine in both standards."""
    places = (f"binaries/{name}/car{fmpy.sharedLibraryExtension}" for name in (fmpy.platform, fmpy.platform_tuple))
    return {"modelDescription.xml": description, **dict.fromkeys(places, b"\x7fELF, no more")}


@cache
def archives() -> list[bytes]:
    """Whole ones, packed and not."""
    files = [stub_fmu(description(fmi)) | {"resources/a.txt": b"text" * 50} for fmi in (2, 3)]
    return [archive(files[0]), archive(files[1]), archive(files[0], zipfile.ZIP_STORED)]


def read_fmu(file: Path) -> None:
    """All that is done with one before it is loaded."""
    about = describe_fmu(file)
    describe(about)
    FmuMapping.from_text(propose_mapping(about, file).replace('"?"', '"a"'))
    discard(unpack(file).folder)


def read_description(file: Path) -> None:
    """Within an archive that has it."""
    packed = file.with_suffix(".fmu")
    packed.write_bytes(archive(stub_fmu(file.read_bytes())))
    read_fmu(packed)
