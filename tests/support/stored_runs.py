"""Runs of a kinematic car that follows the path, for the tests of what is written and compared."""

from support.stand_in import Feedback, KinematicCar, shortened

from sidestep.validation.files import write_text
from sidestep.validation.judge.run import Run
from sidestep.validation.judge.summary import strict_json, summarise
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.recording import write_columns
from sidestep.validation.scenarios.scenario import load_scenario


def drive(scene="single-obstacle", overrides=(), aim=0.0, folder=None, duration=8.0, **car):
    scenario = shortened(load_scenario(scene, ["plant.kind=linear", *overrides]), duration)
    recording = cosimulate(Feedback(aim=aim, speed=scenario.speed), KinematicCar(**car), scenario)
    judgement = judge(recording, scenario)
    can = {"sent": 0, "lost": 0, "interface": "off"}
    summary = summarise(scenario, recording, judgement, can=can, coupling="zero-delay", command_line="sidestep run <x>")
    return Run(scenario, recording, judgement, summary, folder)


def stored(run, folder):
    """What `sidestep compare` needs of a run's files."""
    folder.mkdir()
    write_columns(folder / "recording.csv", run.recording.samples, run.recording.units)
    write_text(folder / "summary.json", strict_json(run.summary))
