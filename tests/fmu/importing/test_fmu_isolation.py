"""A plant in a process of its own: what crashes, hangs or dies there is an error here."""

import os
import signal
import tempfile
from functools import partial
from multiprocessing import Pipe
from pathlib import Path

import pytest
from support.fmus.endings import ends
from support.fmus.fmu_files import START, patched

from sidestep.controller import SteeringController
from sidestep.fmu.importing import isolation
from sidestep.fmu.importing.isolation import IsolatedPlant, reported
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import SteeringCommand
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import End
from sidestep.validation.scenarios.scenario import load_scenario

STEP = "    Status status = engine_step(instance, time, duration);"
AHEAD = SteeringCommand(0.0, 0.0, 15.0)


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Where temporary folders are made; what is left there should not be."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def children():
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def test_a_hang_inside_an_fmu_is_an_error_within_the_limit_and_leaves_nothing(tmp_path, temporary):
    bad = patched(tmp_path, 3, STEP, "    if (time > 1.03) for (;;) {}\n" + STEP)
    before = children()
    with IsolatedPlant(partial(FmuPlant.from_file, bad), time_limit=60.0) as plant:
        plant.reset(START)
        states = [plant.step(AHEAD, 0.02) for _ in range(2)]
        assert states[-1].time == 1.04
        plant.time_limit = 0.5
        with pytest.raises(PlantError, match=r"hangs: no answer to step within 0\.5 s"):
            plant.step(AHEAD, 0.02)
        with pytest.raises(PlantError, match="has ended"):
            plant.step(AHEAD, 0.02)
    assert children() - before <= {_resource_tracker()}
    assert list(temporary.iterdir()) == []


def _resource_tracker():
    """The one process that multiprocessing keeps for itself."""
    from multiprocessing import resource_tracker

    return str(resource_tracker._resource_tracker._pid)


def test_a_crash_in_a_run_ends_its_recording_there(tmp_path, temporary):
    bad = patched(tmp_path, 3, STEP, "    if (time > 0.995) abort();\n" + STEP)
    scenario = load_scenario("single-obstacle", [f"plant.kind={str(bad)!r}", "plant.isolate=30.0"])
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    with open_plant(scenario) as plant:
        recording = cosimulate(controller, plant, scenario)
    assert recording.end is End.PLANT_INVALID
    assert "SIGABRT" in str(recording.error)
    assert recording["time"][-1] == pytest.approx(1.0)
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    ("how", "message"),
    [("abort", "ended in the last call: SIGABRT"), ("exit", "ended in the last call: exit status 3"),
     ("sleep", "hangs: no answer to the last call within 4 s"), ("return", "")],
)  # fmt: skip
def test_findings_outlive_the_process_that_made_them(how, message):
    found = reported(partial(ends, how), 60.0 if how != "sleep" else 4.0)
    assert found[0] == "kept"
    assert message in " ".join(found[1:])
    assert len(found) == (2 if message else 1)


def test_limits_must_be_positive():
    with pytest.raises(InputError, match="isolate: 0"):
        IsolatedPlant(partial(FmuPlant.from_file, "none.fmu"), 0.0)


class Fake:
    """A plant whose state is the number of its steps."""

    estimated = ("yaw",)

    def __init__(self):
        self.steps, self.closed = 0, False

    def reset(self, state):
        self.steps = 0
        return self.steps

    def step(self, command, dt):
        self.steps += 1
        if dt < 0.0:
            raise InputError("dt", f"{dt} s", "> 0")
        if dt > 1.0:
            raise PlantError("too far")
        return self.steps

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.closed = True


def served(requests, build):
    """Answers of the other process's side to these requests, in this process."""
    ours, theirs = Pipe()
    for request in requests:
        ours.send(request)
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        isolation._serve(theirs, build)
    finally:
        signal.signal(signal.SIGINT, interrupt)
        theirs.close()
    answers = []
    while ours.poll():
        try:
            answers.append(ours.recv())
        except EOFError:
            break
    return answers


def test_the_other_side_answers_every_request_and_closes_its_plant():
    fake = Fake()
    requests = [("reset", (START,)), ("step", (AHEAD, 0.02)), ("step", (AHEAD, -1.0)), ("step", (AHEAD, 2.0)),
                ("step", (AHEAD, "far")), None]  # fmt: skip
    estimated, *answers = served(requests, lambda: fake)
    assert estimated == (("yaw",), None)
    assert answers[:2] == [(0, None), (1, None)]
    assert answers[2] == (None, ("dt", "-1.0 s", "> 0"))
    assert answers[3] == (None, "too far")
    assert answers[4][1].startswith("TypeError: ")
    assert fake.closed


def test_a_plant_that_cannot_be_built_is_told():
    (answer,) = served([], partial(FmuPlant.from_file, "none.fmu"))
    assert answer == (None, ("none.fmu", "no such file", "an .fmu file"))


def test_the_other_side_of_a_call():
    ours, theirs = Pipe()
    isolation._report(theirs, lambda say: say("finding", "one"))
    isolation._report(theirs, lambda say: say(int("x"), ""))
    assert [ours.recv() for _ in range(2)] == [(("finding", "one"), None), (None, None)]
    assert ours.recv()[1].startswith("ValueError: ")
