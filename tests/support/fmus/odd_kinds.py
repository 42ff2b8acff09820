"""FMUs as they come, one for each kind of oddity, and what becomes of it."""

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from support.fmus.odd_fmus import ROWS, SOURCE, Odd

OURS = "[start]\n" + "".join(f'{name[:-2]} = "{name}"\n' for name, _, kind, _ in ROWS if kind == "parameter")
PROPOSED = "proposed"
"""Stands for the mapping that `fmu info` proposes."""


@dataclass(frozen=True)
class Kind:
    """What is odd, the mapping (None for none), and what becomes of it.

    Attributes:
        odd: The FMU.
        outcome: As the documentation says it.
        mapping: TOML text.
        error: Part of the error, for those that do not drive.
        tolerance: Of the offset driven, in [m].
        isolated: Whether it runs in a process of its own.
        finish: Last change of the file.
    """

    odd: Odd
    outcome: str = "drives"
    mapping: str | None = None
    error: str = ""
    tolerance: float = 1e-9
    isolated: bool = False
    finish: Callable[[Path], None] | None = None


def named(*pairs):
    """ROWS with other names and units: ours, theirs, unit."""
    new = {ours: (theirs, unit) for ours, theirs, unit in pairs}
    return tuple((new[row[0]][0], *row[1:3], new[row[0]][1]) if row[0] in new else row for row in ROWS)


def scalar(name, reference, inside, variability="fixed"):
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="parameter" variability="{variability}">'
        f"{inside}</ScalarVariable>"
    )


def with_parameter(line):
    return f"{OURS}[parameters]\n{line}\n"


def zipped_again(change):
    """A change of the names in the archive."""

    def finish(file):
        with zipfile.ZipFile(file) as archive:
            contents = {name: archive.read(name) for name in archive.namelist()}
        with zipfile.ZipFile(file, "w") as archive:
            for name, data in contents.items():
                info = zipfile.ZipInfo("name")
                info.filename = change(name)  # as it is, backslashes and all
                archive.writestr(info, data)

    return finish


SOURCES = {"sources/car.c": SOURCE.read_bytes(), "binaries/win64/odd.dll": b"MZ"}
BUILD = (
    '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="odd"><SourceFileSet>'
    '<SourceFile name="car.c"/><PreprocessorDefinition name="FMI" value="3"/></SourceFileSet></BuildConfiguration>'
    "</fmiBuildDescription>"
)
PREFIXED = b"#define FMI 2\n#define FMI2_FUNCTION_PREFIX odd_\n" + SOURCES["sources/car.c"]
POSE = (
    '<Float64 name="command" valueReference="0" causality="input" variability="continuous" start="0 15">'
    '<Dimension start="2"/></Float64><Float64 name="position" valueReference="2" causality="output" '
    'variability="continuous"><Dimension start="3"/></Float64>'
)
NO_POSE = tuple(row for row in ROWS if row[1] > 4)
ARRAYS = (
    f'{OURS}[inputs]\nsteer_angle = "command[0]"\ntarget_speed = "command[1]"\n'
    '[outputs]\nx = "position[0]"\ny = "position[1]"\nyaw = "position[2]"\n'
)
WITHOUT_START = tuple(row for row in ROWS if row[2] != "parameter")
GRADS = (
    '<Unit name="Grad"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit><Unit name="kmph"><BaseUnit '
    'm="1" s="-1" factor="0.2777777777777778"/></Unit><Unit name="Grad/s"><BaseUnit '
    'rad="1" s="-1" factor="0.017453292519943295"/></Unit><Unit name="m"/><Unit name="m/s"/>'
)
IN_GRADS = tuple((*row[:3], {"rad": "Grad", "rad/s": "Grad/s"}.get(row[3], row[3])) for row in ROWS)
IN_GRADS = tuple((*row[:3], "kmph" if row[0] in ("target_speed", "v_x", "v_x_0") else row[3]) for row in IN_GRADS)
DEGREES = ("ANGLE=57.29577951308232", "FAST=3.6")
SUFFIXED = named(
    ("steer_angle_command", "delta_w_deg", ""), ("target_speed", "v_set_kmh", ""), ("yaw", "Psi_deg", ""),
    ("v_x", "vx_kmh", ""), ("yaw_rate", "r_a_dps", ""), ("steer_angle", "delta_f_deg", ""), ("yaw_0", "psi_0_deg", ""),
    ("v_x_0", "v_0_kmh", ""), ("yaw_rate_0", "yaw_rate_0_dps", ""), ("steer_angle_0", "delta_0_deg", ""),
)  # fmt: skip
THETA = named(("yaw", "theta", "rad"), ("steer_angle_command", "delta_w", "rad"), ("yaw_rate", "r_a", "rad/s"))
LOCAL = (
    '<ScalarVariable name="psi" valueReference="19" causality="local" variability="continuous"><Real unit="rad"/>'
    "</ScalarVariable>"
)
KINDS = {
    "FMI 2.0, nothing odd": Kind(Odd()),
    "FMI 3.0, nothing odd": Kind(Odd(fmi=3)),
    "can be instantiated once per process, says so": Kind(
        Odd(macros=("ONCE",), attributes='canBeInstantiatedOnlyOncePerProcess="true" '
            'canHandleVariableCommunicationStepSize="true"')
    ),
    "can be instantiated once per process, does not say so": Kind(Odd(macros=("ONCE",))),
    "wants a text as parameter": Kind(
        Odd(macros=("NEEDS_TEXT",), more=scalar("xosc_path", 90, '<String start=""/>')),
        mapping=with_parameter('xosc_path = "roads/here.xodr"'),
    ),
    "wants a text as parameter, FMI 3.0": Kind(
        Odd(fmi=3, macros=("NEEDS_TEXT",), more='<String name="xosc_path" valueReference="90" causality="parameter" '
            'variability="fixed"><Start value=""/></String>'),
        mapping=with_parameter('xosc_path = "roads/here.xodr"'),
    ),
    "wants a text and gets none": Kind(
        Odd(macros=("NEEDS_TEXT",)), "fails, the function named", error="fmi2ExitInitializationMode failed",
    ),
    "a text given to a number": Kind(
        Odd(more=scalar("mode", 90, '<Integer start="0"/>')), "refused", with_parameter('mode = "two"'),
        "'mode' of type Integer cannot be 'two'; allowed: a number",
    ),
    "a number given to a text": Kind(
        Odd(more=scalar("path", 90, '<String start=""/>')), "refused", with_parameter("path = 2"),
        "'path' of type String cannot be 2.0; allowed: a text",
    ),
    "wants a whole number": Kind(
        Odd(macros=("NEEDS_NUMBER",), more=scalar("mode", 90, '<Integer start="0"/>')),
        mapping=with_parameter("mode = 2"),
    ),
    "wants true": Kind(
        Odd(macros=("NEEDS_NUMBER",), more=scalar("on", 90, '<Boolean start="false"/>')),
        mapping=with_parameter("on = true"),
    ),
    "Float32 parameter": Kind(
        Odd(fmi=3, macros=("NEEDS_GAIN",), more='<Float32 name="gain" valueReference="20" causality="parameter" '
            'variability="fixed" start="1"/>'),
        mapping=with_parameter("gain = 2.5"),
    ),
    "Float32 outputs": Kind(
        Odd(fmi=3, rows=tuple(row for row in ROWS if row[0] not in ("x", "y")),
            more="".join(f'<Float32 name="{name}" valueReference="{k}" causality="output" variability="continuous"/>'
                         for name, k in (("x", 2), ("y", 3)))),
        mapping=OURS, tolerance=1e-6,
    ),
    "arrays": Kind(Odd(fmi=3, macros=("ARRAYS",), rows=NO_POSE, more=POSE), mapping=ARRAYS),
    "an array without an element named": Kind(
        Odd(fmi=3, macros=("ARRAYS",), rows=NO_POSE, more=POSE), "refused", ARRAYS.replace("position[0]", "position"),
        "'position' is an array of (3,); allowed: an element, such as position[0]",
    ),
    "makes steps of 10 ms only": Kind(Odd(macros=("STRICT_STEP",), attributes="")),
    "discards steps above 6 ms": Kind(Odd(macros=("DISCARDS",))),
    "units by the factors of its definitions (Grad, kmph)": Kind(
        Odd(macros=DEGREES, rows=IN_GRADS, units=GRADS), mapping=PROPOSED,
    ),
    "units in its names (Psi_deg, vx_kmh)": Kind(Odd(macros=DEGREES, rows=SUFFIXED), mapping=PROPOSED),
    "names of the literature (theta, delta_w, r_a)": Kind(Odd(rows=THETA), mapping=PROPOSED),
    "a local variable with a better name than the output": Kind(
        Odd(rows=named(("yaw", "heading", "rad")), more=LOCAL), mapping=PROPOSED,
    ),
    "reports no yaw rate, v_y and steering": Kind(
        Odd(rows=tuple(row for row in ROWS if row[1] not in (6, 7, 8, 14, 15, 16))), mapping=PROPOSED,
    ),
    "has no start parameters": Kind(Odd(rows=WITHOUT_START), mapping=PROPOSED),
    "no binary for this platform, sources": Kind(
        Odd(has_binary=False, files={**SOURCES, "sources/car.c": PREFIXED},
            changes=(('modelIdentifier="odd"', 'modelIdentifier="odd" needsExecutionTool="false"'),
                     ('Size="true"/>', 'Size="true"><SourceFiles><File name="car.c"/></SourceFiles></CoSimulation>'))),
        "compiled, drives",
    ),
    "no binary for this platform, sources, FMI 3.0": Kind(
        Odd(fmi=3, has_binary=False, files=SOURCES | {"sources/buildDescription.xml": BUILD.encode()}),
        "compiled, drives",
    ),
    "no binary for this platform, no sources": Kind(
        Odd(has_binary=False, files={"binaries/win64/odd.dll": b"MZ"}), "refused; `info` shows it",
        error="in it, but for: win64",
    ),
    "a top folder in the archive": Kind(
        Odd(folder="car/"), "refused, the folder named", error="lies in a folder 'car'",
    ),
    "backslashes in the archive": Kind(
        Odd(), "refused", error="unsafe path", finish=zipped_again(lambda name: name.replace("/", "\\")),
    ),
    "made for model exchange only": Kind(
        Odd(changes=(("<CoSimulation", "<ModelExchange"), ('canHandleVariableCommunicationStepSize="true"', ""))),
        "refused", error="made for model exchange only",
    ),
    "FMI 1.0": Kind(
        Odd(changes=(('fmiVersion="2.0"', 'fmiVersion="1.0"'),)), "refused", error="FMI 1.0; allowed: FMI 2.0, FMI 3.0",
    ),
    "lacks optional functions": Kind(Odd(macros=("NO_TERMINATE", "NO_RESET", "NO_TYPES"))),
    "binary of another description": Kind(
        Odd(macros=("CHECKS_GUID",), changes=(("{right}", "{wrong}"),)), "fails, the function named",
        error="fmi2Instantiate returned no instance",
    ),
    "logs NULL": Kind(Odd(macros=("NULL_LOG",))),
    "logs its last words, if logging is on": Kind(
        Odd(macros=("ENDS",)), "fails, its words shown",
        error="fmi2DoStep failed at t = 0.5 s: status 3 (error); the tank",
    ),
    "logs its last words, if logging is on, FMI 3.0": Kind(
        Odd(fmi=3, macros=("ENDS",)), "fails, its words shown", error="(error); the tank is empty",
    ),
    "reports NaN": Kind(Odd(macros=("NAN_LATER",)), "fails, the signal named", error="y is not finite at t = 0.5 s"),
    "crashes in a step": Kind(
        Odd(macros=("CRASHES",)), "fails, with --isolate", error="process ended in step: SIGABRT", isolated=True,
    ),
    "crashes in Terminate": Kind(Odd(macros=("TERMINATE_CRASHES",)), "drives, with --isolate", isolated=True),
    "description in UTF-16": Kind(Odd(changes=(("UTF-8", "UTF-16"),))),
    "description with a byte order mark": Kind(Odd()),
}  # fmt: skip
ENCODINGS = {"description in UTF-16": "utf-16", "description with a byte order mark": "utf-8-sig"}
