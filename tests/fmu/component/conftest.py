import pytest
from support.component import drive, load, scene_of

from sidestep.fmu.component.build import shared_library


@pytest.fixture(scope="session")
def library_file(tmp_path_factory):
    file = tmp_path_factory.mktemp("component") / "libsidestep.so"
    file.write_bytes(shared_library())
    return file


@pytest.fixture(scope="session")
def library(library_file):
    return load(library_file)


@pytest.fixture(scope="session")
def driven():
    scene = scene_of("double-obstacle")
    rows, memory = drive(scene)
    return scene, rows, memory
