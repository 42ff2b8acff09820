"""Tiny FMUs with one oddity each, see odd_fmu.c: compiled and described by the tests."""

import tempfile
import zipfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import fmpy

from sidestep.fmu.compiling.platforms import compile_library

HEADERS = Path(fmpy.__file__).parent / "c-code"
SOURCE = Path(__file__).with_name("odd_fmu.c")
PLATFORM = {2: fmpy.platform, 3: fmpy.platform_tuple}

_OUTPUTS = (
    ("x", "m"), ("y", "m"), ("yaw", "rad"), ("v_x", "m/s"), ("v_y", "m/s"), ("yaw_rate", "rad/s"),
    ("steer_angle", "rad"),
)  # fmt: skip
ROWS = (
    ("steer_angle_command", 0, "input", "rad"), ("target_speed", 1, "input", "m/s"),
    *((name, 2 + k, "output", unit) for k, (name, unit) in enumerate(_OUTPUTS)),
    *((f"{name}_0", 10 + k, "parameter", unit) for k, (name, unit) in enumerate(_OUTPUTS)),
)  # fmt: skip
"""Name, value reference, causality and unit: those of our own FMUs."""


@dataclass(frozen=True)
class Odd:
    """One kind of FMU.

    Attributes:
        fmi: 2 or 3.
        macros: Of odd_fmu.c.
        rows: As of ROWS.
        more: Further variables, as XML.
        units: Contents of UnitDefinitions; the plain names if empty.
        attributes: Of the element CoSimulation.
        experiment: Attributes of DefaultExperiment.
        changes: Of the text of modelDescription.xml, pairs of old and new.
        files: Further files in the archive.
        folder: Put before every name in the archive.
        has_binary: Whether the binary is in it.
    """

    fmi: int = 2
    macros: tuple[str, ...] = ()
    rows: tuple[tuple[str, int, str, str], ...] = ROWS
    more: str = ""
    units: str = ""
    attributes: str = 'canHandleVariableCommunicationStepSize="true"'
    experiment: str = 'stepSize="0.01"'
    changes: tuple[tuple[str, str], ...] = ()
    files: dict[str, bytes] = field(default_factory=dict, hash=False)
    folder: str = ""
    has_binary: bool = True

    def write(self, file: Path, encoding: str = "utf-8") -> Path:
        """Make the .fmu file."""
        text = self._description()
        for old, new in self.changes:
            assert old in text
            text = text.replace(old, new)
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr(f"{self.folder}modelDescription.xml", text.encode(encoding))
            if self.has_binary:
                name = f"{self.folder}binaries/{PLATFORM[self.fmi]}/odd{fmpy.sharedLibraryExtension}"
                archive.writestr(name, compiled(self.fmi, self.macros))
            for name, data in self.files.items():
                archive.writestr(self.folder + name, data)
        return file

    def _description(self) -> str:
        units = self.units or "".join(f'<Unit name="{unit}"/>' for unit in sorted({row[3] for row in self.rows} - {""}))
        return (self._fmi2 if self.fmi == 2 else self._fmi3)(f"<UnitDefinitions>{units}</UnitDefinitions>")

    def _fmi2(self, units: str) -> str:
        variability = {"input": "continuous", "output": "continuous", "parameter": "fixed"}
        rows = "".join(
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{kind}" '
            f'variability="{variability[kind]}"><Real{_unit(unit)}{_start(kind, name)}/></ScalarVariable>'
            for name, reference, kind, unit in self.rows
        )
        outputs = [k + 1 for k, row in enumerate(self.rows) if row[2] == "output"]
        unknowns = "".join(f'<Unknown index="{k}"/>' for k in outputs)
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            '<fmiModelDescription fmiVersion="2.0" modelName="odd" guid="{right}">'
            f'<CoSimulation modelIdentifier="odd" {self.attributes}/>{units}<DefaultExperiment {self.experiment}/>'
            f"<ModelVariables>{rows}{self.more}</ModelVariables><ModelStructure><Outputs>{unknowns}</Outputs>"
            f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>"
        )

    def _fmi3(self, units: str) -> str:
        variability = {"input": "continuous", "output": "continuous", "parameter": "fixed"}
        rows = "".join(
            f'<Float64 name="{name}" valueReference="{reference}" causality="{kind}" '
            f'variability="{variability[kind]}"{_unit(unit)}{_start(kind, name)}/>'
            for name, reference, kind, unit in self.rows
        )
        rows += '<Float64 name="time" valueReference="99" causality="independent" variability="continuous"/>'
        outputs = [row[1] for row in self.rows if row[2] == "output"]
        structure = "".join(f'<Output valueReference="{k}"/>' for k in outputs)
        structure += "".join(f'<InitialUnknown valueReference="{k}"/>' for k in outputs)
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            '<fmiModelDescription fmiVersion="3.0" modelName="odd" instantiationToken="{right}">'
            f'<CoSimulation modelIdentifier="odd" {self.attributes}/>{units}<DefaultExperiment {self.experiment}/>'
            f"<ModelVariables>{rows}{self.more}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
            "</fmiModelDescription>"
        )


def _unit(unit: str) -> str:
    return f' unit="{unit}"' if unit else ""


def _start(kind: str, name: str) -> str:
    return "" if kind == "output" else ' start="15"' if name in ("v_x_0", "target_speed") else ' start="0"'


@cache
def compiled(fmi: int, macros: tuple[str, ...]) -> bytes:
    """The binary of these macros, compiled once."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "odd.c")
        source.write_bytes(SOURCE.read_bytes())
        flags = ("-O0", "-fvisibility=default", f"-I{HEADERS}", f"-DFMI={fmi}", *(f"-D{macro}" for macro in macros))
        compile_library(Path(folder), Path(folder, "odd.so"), flags)
        return Path(folder, "odd.so").read_bytes()
