"""Instances of the controller's FMU: from a damaged file, from an odd folder, and many of them."""

import contextlib
import os
import subprocess
import sys
import zipfile

import pytest
from support.component import drive as drive_here
from support.component import scene_of
from support.fmus.controller_fmu import Driver, export, numbers, running
from support.fmus.fmu_files import changed

from sidestep.plant_models.errors import PlantError


def test_a_setup_that_is_missing_or_damaged_is_told_at_instantiation(tmp_path):
    file = export(3)
    with zipfile.ZipFile(file) as archive:
        setup = archive.read("resources/controller.setup")
    for data, problem in ((None, "cannot be read"), (setup[:-3], "length is wrong"), (b"", "too short")):
        broken = changed(file, tmp_path / "broken.fmu", {"resources/controller.setup": data})
        with pytest.raises(PlantError, match=rf"controller\.setup.*{problem}"), running(3, broken):
            pass


@pytest.mark.parametrize("fmi", [2, 3])
def test_many_instances_one_after_the_other_and_at_once(fmi):
    code = f"""
import resource, fmpy
from fmpy.simulation import instantiate_fmu
file, fmi = {str(export(fmi))!r}, {fmi}
folder, description = fmpy.extract(file), fmpy.read_model_description(file)
def made(): return instantiate_fmu(folder, description, "CoSimulation", logger=None)
def used(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
first = made()
library = first.dll
many = [made() for _ in range(200)]
print((used()))
for one in many: one.freeInstance()
before = used()
for _ in range(1000):
    one = made(); one.freeInstance()
print(used() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[1]) < 16 * 1024  # [KiB]: not one of the thousand is left


def test_it_runs_from_a_folder_with_blanks_and_umlauts_that_cannot_be_written(tmp_path, monkeypatch):
    [(state, command)], _ = drive_here(scene_of("double-obstacle"), 1)
    folder = tmp_path / "für alle Fälle"
    folder.mkdir()
    file = folder / "ein Regler.fmu"
    file.write_bytes(export(2).read_bytes())
    monkeypatch.setenv("TMPDIR", str(folder))
    with contextlib.suppress(KeyError):
        monkeypatch.delenv("HOME")
    os.chmod(file, 0o444)
    with running(2, file) as fmu:
        assert Driver(fmu).step(state) == numbers(command)
