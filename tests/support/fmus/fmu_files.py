"""FMUs for tests: our own, changed in one place, and one by somebody else."""

import math
import zipfile
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path

import fmpy
import numpy as np

from sidestep.fmu.compiling.platforms import compile_library
from sidestep.fmu.description.plants import MODELS
from sidestep.fmu.importing.archive import unpack
from sidestep.fmu.native.build import build_fmu, source_files
from sidestep.fmu.scratch import discard
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

CAR = VehicleParameters.preset("bmw-320i")
QUICK = ("-O0",)
"""Compiler flags for what is not going to run long."""
START = VehicleState(time=1.0, x=2.0, y=3.0, yaw=0.4, v_x=15.0, v_y=0.1, yaw_rate=0.05, steer_angle=0.01)


def slalom(plant, steps=100, dt=0.02):
    rows = [plant.step(SteeringCommand(0.0, 0.1 * math.sin(0.1 * k), 12.0), dt) for k in range(steps)]
    return np.array([astuple(row) for row in rows])


@contextmanager
def unpacked(file):
    fmu = unpack(file)
    try:
        yield fmu
    finally:
        discard(fmu.folder)


def changed(source, target, changes):
    """A copy of an FMU with the bytes of some of its files replaced; None removes one."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = changes.get(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
        for name in changes.keys() - set(old.namelist()):
            new.writestr(name, changes[name])
    return target


def description(fmi):
    with zipfile.ZipFile(build_fmu(fmi=fmi)) as archive:
        return archive.read("modelDescription.xml").decode()


def binary(fmi, identifier="single_track"):
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    return f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}"


def patched(folder, fmi, old, new, source=None, identifier="single_track"):
    """An FMU of ours with one line of its C sources replaced and compiled again."""
    sources, source = folder / "sources", source or build_fmu(fmi=fmi)
    with zipfile.ZipFile(source) as archive:
        for name in archive.namelist():
            if name.startswith("sources/"):
                archive.extract(name, folder)
    file = next(file for file in sources.glob("*.c") if old in file.read_text())
    file.write_text(file.read_text().replace(old, new))
    compile_library(sources, folder / "binary", QUICK)
    return changed(source, folder / "patched.fmu", {binary(fmi, identifier): (folder / "binary").read_bytes()})


def reported_here(function, limit):
    """Stands in for `isolation.reported`, without the other process."""
    found = []
    try:
        function(lambda kind, text: found.append(text) if kind == "finding" else None)
    except (InputError, PlantError) as error:
        found.append(str(error))
    return found


FOREIGN_MAP = """
estimate = ["yaw_rate"]
[inputs]
steer_angle = { variable = "HandWheel", unit = "deg", ratio = 16.0, sign = -1 }
target_speed = { variable = "Cruise.vSet", unit = "km/h" }
[outputs]
x = "Pos.x"
y = "Pos.y"
yaw = { variable = "Psi", unit = "deg" }
v_x = { variable = "Car.vx", unit = "km/h" }
v_y = "Car.vy"
steer_angle = { variable = "HandWheelAngle", unit = "deg", ratio = 16.0, sign = -1 }
[start]
yaw = { variable = "Psi0", unit = "deg" }
v_x = { variable = "v0", unit = "km/h" }
[parameters]
driveMode = 2
"""

_FOREIGN = (  # name, causality, unit; in value-reference order
    ("HandWheel", "input", "deg"), ("Cruise.vSet", "input", "km/h"), ("Pos.x", "output", "m"),
    ("Pos.y", "output", "m"), ("Psi", "output", "deg"), ("Car.vx", "output", "km/h"), ("Car.vy", "output", "m/s"),
    ("HandWheelAngle", "output", "deg"), ("Psi0", "parameter", "deg"), ("v0", "parameter", "km/h"),
)  # fmt: skip


def foreign_fmu(folder):
    """Somebody else's car as an FMU, see foreign_car.c, and the mapping file for it."""
    sources, model = folder / "foreign", MODELS["single-track"]
    sources.mkdir()
    for name, data in source_files(model).items():
        if name in ("single_track.c", "tyre.c", "car.c") or name.endswith(".h"):
            (sources / name).write_bytes(data)
    starts = ", ".join(f"{{{row.constant}, {row.start!r}}}" for row in model.variables if row.start is not None)
    code = Path(__file__).with_name("foreign_car.c").read_text().replace("START_VALUES", f"{{{starts}}}")
    (sources / "foreign_car.c").write_text(code)
    compile_library(sources, sources / "binary", ("-fvisibility=default", *QUICK))
    file, table = folder / "foreign.fmu", folder / "foreign.toml"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", _foreign_description())
        archive.write(sources / "binary", f"binaries/{fmpy.platform}/car{fmpy.sharedLibraryExtension}")
    table.write_text(FOREIGN_MAP)
    return file, table


def _foreign_description():
    starts = {"input": ' start="0"', "parameter": ' start="0"', "output": ""}
    variability = {"input": "continuous", "parameter": "fixed", "output": "continuous"}
    rows = "".join(
        f'<ScalarVariable name="{name}" valueReference="{k}" causality="{kind}" variability="{variability[kind]}">'
        f'<Real unit="{unit}"{starts[kind]}/></ScalarVariable>'
        for k, (name, kind, unit) in enumerate(_FOREIGN)
    )
    outputs = "".join(f'<Unknown index="{k + 1}"/>' for k, row in enumerate(_FOREIGN) if row[1] == "output")
    units = "".join(f'<Unit name="{unit}"/>' for unit in sorted({row[2] for row in _FOREIGN}))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="2.0" modelName="Foreign car" guid="1">'
        f'<CoSimulation modelIdentifier="car"/><UnitDefinitions>{units}</UnitDefinitions>'
        f'<DefaultExperiment stepSize="0.01"/><ModelVariables>{rows}'
        '<ScalarVariable name="driveMode" valueReference="10" causality="parameter" variability="fixed">'
        '<Integer start="0"/></ScalarVariable></ModelVariables>'
        f"<ModelStructure><Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>"
    )
