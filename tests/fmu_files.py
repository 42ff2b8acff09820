"""FMUs for tests: our own, changed in one place."""

import math
import zipfile
from dataclasses import astuple

import fmpy
import numpy as np

from sidestep.fmu.build import build_fmu, compile_library
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle import VehicleParameters

CAR = VehicleParameters.preset("bmw-320i")
START = VehicleState(time=1.0, x=2.0, y=3.0, yaw=0.4, v_x=15.0, v_y=0.1, yaw_rate=0.05, steer_angle=0.01)


def slalom(plant, steps=100, dt=0.02):
    rows = [plant.step(SteeringCommand(0.0, 0.1 * math.sin(0.1 * k), 12.0), dt) for k in range(steps)]
    return np.array([astuple(row) for row in rows])


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


def binary(fmi):
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    return f"binaries/{platform}/single_track{fmpy.sharedLibraryExtension}"


def patched(folder, fmi, old, new):
    """Our FMU with one line of its C sources replaced and compiled again."""
    sources = folder / "sources"
    with zipfile.ZipFile(build_fmu(fmi=fmi)) as archive:
        for name in archive.namelist():
            if name.startswith("sources/"):
                archive.extract(name, folder)
    file = next(file for file in sources.glob("*.c") if old in file.read_text())
    file.write_text(file.read_text().replace(old, new))
    compile_library(sources, folder / "binary")
    return changed(build_fmu(fmi=fmi), folder / "patched.fmu", {binary(fmi): (folder / "binary").read_bytes()})
