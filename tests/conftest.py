"""What holds for every test."""

import os

import pytest
from support.can_port.frames import multicast_spec  # noqa: F401 (a fixture for all)
from support.fmus.fmu_files import foreign_fmu


@pytest.fixture(autouse=True, scope="session")
def fmu_cache(tmp_path_factory):
    """One cache of FMUs for the session, which the user's own does not see; other programs keep theirs."""
    theirs = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("matplotlib", "zig"):
            if os.path.isdir(f"{theirs}/{name}"):
                (folder / name).symlink_to(f"{theirs}/{name}")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def foreign(tmp_path_factory):
    """An FMU by somebody else, and its mapping file."""
    return foreign_fmu(tmp_path_factory.mktemp("foreign"))
