"""One run: a scenario driven, judged and summarised."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sidestep.controller.can_port.port import SteeringPort
from sidestep.validation.files import made
from sidestep.validation.judge.summary import summarise
from sidestep.validation.judge.verdict import Judgement, judge
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.cosimulation import PLANT_STEP, Coupling, cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.loop.start import reset_to
from sidestep.validation.report.film import film
from sidestep.validation.report.viewer import viewer
from sidestep.validation.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        scenario: What was driven.
        recording: What happened.
        judgement: What it is worth.
        summary: Its numbers, as in summary.json.
        folder: Where its files are.
    """

    scenario: Scenario
    recording: Recording
    judgement: Judgement
    summary: dict[str, Any]
    folder: Path

    @property
    def interrupted(self) -> bool:
        """Whether it was ended from the keyboard."""
        return self.recording.end is End.INTERRUPTED


def drive(
    scenario: Scenario,
    folder: Path,
    can: str = "auto",
    coupling: Coupling = "zero-delay",
    allow_real_bus: bool = False,
    view: bool = False,
    progress: Callable[[float], None] | None = None,
    command_line: str = "",
    render: Path | None = None,
) -> Run:
    """Drive a scenario once; only the CAN log is written, to `folder`, which is made if need be.

    Args:
        scenario: With the plant to drive.
        folder: For the run's files.
        can: Bus that carries the steering commands, see `sidestep.controller.can_port.bus.bus.SPECS`.
        coupling: See `cosimulate`.
        allow_real_bus: Whether that bus may reach hardware.
        view: Show MuJoCo's viewer, in real time.
        progress: Called with the simulated time, in [s].
        command_line: For the summary.
        render: Film of MuJoCo's car to write, .gif or .mp4.

    Raises:
        InputError: Plant, bus or folder cannot be used, or the plant does not start where it is put; nothing is left
            behind then.
        PlantError: The plant cannot be built or cannot start.
    """
    controller = open_controller(scenario)
    with (
        open_plant(scenario) as plant,
        viewer(plant, scenario, controller) if view else nullcontext() as show,
        film(plant, render, scenario, controller) if render else nullcontext() as shoot,
    ):
        start, _ = reset_to(plant, scenario.start, scenario.plant)  # refused here, before anything is written
        plant.step(controller.step(start), PLANT_STEP)  # load the kernels before the clock runs
        with made(folder):
            log = folder / "can.blf"
            log.unlink(missing_ok=True)
            port = SteeringPort(can, log, scenario.vehicle.steer_rate_limit, allow_real_bus)
        with port:
            recording = cosimulate(controller, plant, scenario, port, coupling, _all(show, shoot, progress))
    judgement = judge(recording, scenario)
    frames = {"sent": port.sent, "lost": port.lost, "interface": port.interface}
    summary = summarise(scenario, recording, judgement, can=frames, coupling=coupling, command_line=command_line)
    return Run(scenario, recording, judgement, summary, folder)


def _all(*calls: Callable[[float], None] | None) -> Callable[[float], None]:
    def call(time: float) -> None:
        for each in calls:
            if each is not None:
                each(time)

    return call
