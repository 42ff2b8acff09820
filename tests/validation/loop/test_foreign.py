"""The quick check before a drive: what is refused, what is a warning, and an FMU that starts but once."""

import pytest
from support.fmus.fmu_files import FOREIGN_MAP
from support.fmus.odd_fmus import Odd

from sidestep.fmu.importing import isolation
from sidestep.plant_models.errors import InputError
from sidestep.validation.cli.main import main
from sidestep.validation.loop.foreign import plant_doubts
from sidestep.validation.manoeuvres.scene import open_loop_scenario


@pytest.fixture
def in_this_process(monkeypatch):
    monkeypatch.setattr(isolation, "IsolatedPlant", lambda build, limit: build())


def doubts(foreign, tmp_path, *changes, text=FOREIGN_MAP):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    table = tmp_path / "map.toml"
    table.write_text(text)
    return plant_doubts(open_loop_scenario([f"plant.kind={str(foreign[0])!r}", f"plant.map={str(table)!r}"]))


def test_a_right_mapping_raises_no_doubt(foreign, tmp_path, in_this_process):
    assert doubts(foreign, tmp_path) == []
    assert doubts(foreign, tmp_path, text=FOREIGN_MAP + "[vehicle]\npreset = 'bmw-320i'\n") == []


def test_our_own_plants_are_not_driven():
    assert plant_doubts(open_loop_scenario(["plant.kind=linear"])) == []


INPUT = 'steer_angle = { variable = "HandWheel", unit = "deg", ratio = 16.0, sign = -1 }'
REFUSED = {
    "sign": ([("sign = -1", "sign = 1")], r"the car turns -1 times as much as .* \(the sign is turned\?\)"),
    "ratio": (
        [(INPUT, INPUT.replace("ratio = 16.0, ", ""))],
        r"the car turns 0\.0625 times as much as .* \(a steering-wheel angle, whose ratio is not told\?\)",
    ),
    "degrees": (
        [('variable = "Psi", unit = "deg"', 'variable = "Psi"')], r"turns 5\d\.\d times .* \(degrees for radians\?\)",
    ),
    "km/h": (
        [('v_x = { variable = "Car.vx", unit = "km/h" }', 'v_x = "Car.vx"')],
        r"moves 0\.27\d* times as far as outputs\.v_x",
    ),
    "mirrored": ([('y = "Pos.y"', 'y = { variable = "Pos.y", sign = -1 }')], r"outputs\.yaw: the car moves -"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_a_drive_worthless_is_refused(name, foreign, tmp_path, in_this_process):
    changes, expected = REFUSED[name]
    with pytest.raises(InputError, match=expected) as caught:
        doubts(foreign, tmp_path, *changes)
    assert caught.value.where.endswith("map.toml")
    assert "fmu check" in caught.value.allowed


def test_what_only_looks_odd_is_a_warning(foreign, tmp_path, in_this_process):
    [first, *_] = doubts(foreign, tmp_path, ("ratio = 16.0, sign = -1 }\ntarget", "ratio = 12.0, sign = -1 }\ntarget"))
    assert first.startswith("outputs.steer_angle: 0.75 times the")
    assert first.endswith("(the default car: [vehicle] in the mapping file tells which)")


def test_a_run_is_refused_before_anything_is_written(foreign, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    table = tmp_path / "map.toml"
    table.write_text(FOREIGN_MAP.replace("sign = -1", "sign = 1"))
    line = ["run", "single-obstacle", "--plant", str(foreign[0]), "--map", str(table), "--can", "off", "--out", "out"]
    assert main(line) == 2
    assert "a first bend contradicts it" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_fmu_that_starts_once_per_process_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = Odd(macros=("ONCE",)).write(tmp_path / "once.fmu")
    line = ["run", "single-obstacle", "--plant", str(file), "--can", "off", "--out", "out", "--set", "duration=0.5"]
    status = main(line)
    assert status in (0, 1), capsys.readouterr().err  # half a second tells no more than that it drives
    rows = (tmp_path / "out" / "recording.csv").read_text().splitlines()
    assert len(rows) > 50
