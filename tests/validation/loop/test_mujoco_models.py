"""Other people's MuJoCo models as plants of scenarios."""

from pathlib import Path

import foreign_cars
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.loop.foreign import plant_doubts
from sidestep.validation.scenarios.scenario import load_scenario

STRANGERS = Path(foreign_cars.__file__).parent / "strangers"


def of(name, *more):
    return [f"plant.kind={str(STRANGERS / f'{name}.xml')!r}", *more]


@pytest.mark.parametrize(("scene", "car"), [("single-obstacle", "sedan"), ("double-obstacle", "backwards")])
def test_scenes_of_the_paper_pass(scene, car):
    scenario = load_scenario(scene, of(car))
    recording = closed_loop(scenario)
    assert judge(recording, scenario).passed
    assert not recording.contact


def test_controller_believes_the_model_and_the_mapping_file(tmp_path):
    told = tmp_path / "car.toml"
    told.write_text('forward = "x"\n[vehicle]\nsteer_rate_limit = 0.7\n')
    scenario = load_scenario("single-obstacle", of("sedan", f"plant.map={str(told)!r}", "vehicle.width=1.9"))
    vehicle = scenario.vehicle
    assert (vehicle.name, vehicle.mass, vehicle.steer_rate_limit, vehicle.width) == ("sedan", 1490.0, 0.7, 1.9)
    preset = load_scenario("single-obstacle", of("sedan", 'vehicle.preset="bmw-320i"'))
    assert preset.vehicle.name == "bmw-320i"


def test_speed_out_of_reach_is_an_error_of_input():
    with pytest.raises(InputError, match="speed: 15 m/s: told to hold that straight on"):
        load_scenario("single-obstacle", of("racer"))


def test_quick_check_tells_what_was_changed():
    scenario = load_scenario("single-obstacle", of("kart", "speed=8"))
    assert any("got motors" in doubt for doubt in plant_doubts(scenario))


def test_what_the_model_does_not_know_is_refused():
    scenario = load_scenario("single-obstacle", of("sedan", "plant.mass=1.1"))
    with pytest.raises(InputError, match=r"plant\.mass"):
        closed_loop(scenario)
