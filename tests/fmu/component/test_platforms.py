"""The component for other platforms: format, processor and exported functions."""

import pytest
from support.component import FUNCTIONS

from sidestep.fmu.compiling.platforms import PLATFORMS
from sidestep.fmu.component.build import shared_library

MAGIC = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}
MACHINE = {"x86_64-linux": (18, 62), "aarch64-linux": (18, 183), "x86_64-darwin": (4, 7), "aarch64-darwin": (4, 12)}
"""Where the processor stands in an ELF or Mach-O file, and its number."""


@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda platform: platform.fmi3)
def test_it_is_a_library_of_the_platform_with_all_functions(platform):
    pytest.importorskip("ziglang", reason="needs ziglang (the extra cross)")
    data = shared_library(platform)
    assert data.startswith(MAGIC[platform.suffix])
    if platform.fmi3 in MACHINE:
        place, number = MACHINE[platform.fmi3]
        assert data[place] == number
    assert [name for name in FUNCTIONS if f"sidestep_{name}".encode() not in data] == []
    assert len(data) < 800 * 1024  # five of them, compressed, are to stay below 4 MiB
