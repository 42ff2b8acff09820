"""A few damaged files for every reader; `fuzz.py` makes as many as one has time for."""

import sys
from pathlib import Path

import pytest

from sidestep.plant_models.errors import InputError

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from formats import FORMATS  # noqa: E402
from fuzz import case, fuzz  # noqa: E402

COUNT, SEED = 60, 2026


@pytest.mark.parametrize("name", FORMATS)
def test_only_errors_of_ours_leave(name, tmp_path):
    tally = fuzz(FORMATS[name], COUNT, SEED, tmp_path)
    assert tally.failures == {}
    assert tally.read + tally.refused == COUNT
    assert tally.refused > 0  # the files are damaged


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_damaged_is_whole_before(name, tmp_path):
    kind, whole = FORMATS[name], 0
    for data in kind.seeds():
        file = kind.prepare(tmp_path)
        file.write_bytes(data)
        kind.read(file)  # raises where it is not
        whole += 1
    assert whole > 0


def test_a_case_follows_from_its_seed_and_number():
    for kind in FORMATS.values():
        assert case(kind, 3, 1) == case(kind, 3, 1)
    assert len({case(FORMATS["scenario"], number, 1) for number in range(50)}) > 40


def test_what_is_wrong_is_found(tmp_path):
    def read(file):
        if file.read_bytes()[:1] != FORMATS["tir"].seeds()[0][:1]:
            raise InputError("a", "b") if len(file.read_bytes()) % 2 else KeyError("no")

    broken = type(FORMATS["tir"])("tir", FORMATS["tir"].seeds, ".tir", read)
    tally = fuzz(broken, 200, SEED, tmp_path)
    assert [kind.partition(" at ")[0] for kind in tally.failures] == ["KeyError"]
    assert tally.refused > 0
