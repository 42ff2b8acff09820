import runpy
from pathlib import Path

import numpy as np
import pytest

import sidestep
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status
from sidestep.validation.console import row_name
from sidestep.validation.loop.closed_loop import bare_controller, driving_controller
from sidestep.validation.loop.own_controller import OwnController
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.runs import drive

ROOT = Path(sidestep.__file__).parent


def scene(name, **values):
    controller = {"kind": f"odd_controllers:{name}"}
    return load_scenario(
        "single-obstacle", obstacles=[], duration=1.0, plant={"kind": "linear"}, controller=controller, **values
    )


def test_it_gets_what_it_asks_for_and_its_angle_is_the_command():
    scenario = scene("Straight", speed=12.0)
    controller = driving_controller(scenario)
    assert isinstance(controller, OwnController)
    assert controller.own.speed == 12.0
    controller.reset()
    command = controller.step(scenario.start)
    assert (command.steer_angle, command.target_speed, command.status) == (0.0, 12.0, Status.TRACKING)
    assert controller.own.resets == 1
    assert len(controller.plan.s) > 2  # what ours thinks stays in sight
    assert controller.plan.solver_status == "NOT ASKED"


def test_its_command_is_taken_as_it_is():
    assert driving_controller(scene("Slows")).step(scene("Slows").start).target_speed == 3.0


@pytest.mark.closed_loop
@pytest.mark.parametrize(("name", "words"), [("Raises", "ArithmeticError at 0.5"), ("SaysNothing", "ValueError at")])
def test_ours_takes_over_and_the_drive_says_so(name, words):
    run = drive(scene(name, start={"l": 0.5}))
    assert (run.judgement.verdict.value, run.judgement.label) == ("fail", "own controller failed")
    assert words in run.judgement.detail
    after = run.recording["time"] > 0.6
    assert np.all(run.recording["steer_command"][run.recording["time"] < 0.5] == 0.0)
    assert np.abs(run.recording["steer_command"][after]).max() > 1e-3  # back to the middle
    assert set(run.recording["status"][after][:-1]) == {float(Status.DEGRADED)}
    assert row_name(run.summary) == f"linear ({name})"
    assert run.recording["time"][-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("odd_controllers:Nothing", "without 'step'"),
        ("odd_controllers:wants", "asks for 'weather'"),
        ("odd_controllers:absent", "has no 'absent'"),
        ("no_such_module:X", "cannot import"),
    ],
)
def test_what_is_no_controller_is_refused(kind, words):
    scenario = load_scenario("single-obstacle", controller={"kind": kind})
    with pytest.raises(InputError, match=words) as refused:
        driving_controller(scenario)
    assert refused.value.where == "controller.kind"


def test_a_name_without_a_factory_is_refused_with_the_file():
    with pytest.raises(InputError, match="module:factory"):
        load_scenario("single-obstacle", controller={"kind": "stanley"})


def test_where_only_ours_can_drive_another_one_is_refused():
    with pytest.raises(InputError, match="does not drive here"):
        bare_controller(scene("Straight"))


@pytest.mark.closed_loop
def test_the_examples_follow_the_road(monkeypatch):
    monkeypatch.chdir(ROOT)
    names = ("Stanley", "PurePursuit", "Lqr")
    assert set(names) <= set(runpy.run_path(str(ROOT / "examples" / "own_controllers.py")))
    for name in names:
        own = {"kind": f"examples.own_controllers:{name}"}
        road = load_scenario("s-curve", obstacles=[], start={"l": 0.5}, plant={"kind": "linear"}, controller=own)
        run = drive(road)
        assert run.judgement.label == "ok", name
        assert run.summary["rms_lateral_error_m"] < 0.2, name
        assert np.abs(run.recording["l"]).max() < 0.51, name
