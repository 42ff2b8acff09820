"""One run: a scenario driven, judged and summarised."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from sidestep.controller import SteeringController
from sidestep.controller.can_port.codec.database import BusMessage
from sidestep.controller.can_port.port import SteeringPort
from sidestep.validation.files import made
from sidestep.validation.judge.findings import Finding, Verdict, for_the_judge
from sidestep.validation.judge.run import Run
from sidestep.validation.judge.summary import summarise
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.announced import Announced
from sidestep.validation.loop.closed_loop import driving_controller
from sidestep.validation.loop.cosimulation import PLANT_STEP, Coupling, cosimulate
from sidestep.validation.loop.foreign import is_foreign
from sidestep.validation.loop.measurement import sensed
from sidestep.validation.loop.own_controller import OwnController
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.start import reset_to
from sidestep.validation.report.film import film
from sidestep.validation.report.film_of import film_of
from sidestep.validation.report.report import write_run
from sidestep.validation.report.style import svg
from sidestep.validation.report.topview import top_view
from sidestep.validation.report.viewer import viewer
from sidestep.validation.scenarios.scenario import Scenario


class DrivenRun(Run):
    """A run just driven: its files and its film."""

    def report(self, folder: Path | str | None = None) -> Path:
        """Write report.html, summary.json, recording.csv and steps.csv.

        Args:
            folder: Made if need be; None for the run's own.

        Returns:
            The report.

        Raises:
            InputError: The folder cannot be written to.
        """
        run = replace(self, folder=Path(folder or self.folder))
        with made(run.folder):
            write_run(run)
        return run.folder / "report.html"

    def film(self, file: Path | str) -> Path:
        """Film the run as MuJoCo shows it, also one of another plant: the car stands where the recording has it.

        Args:
            file: .gif, or .mp4 with ffmpeg.

        Returns:
            The film.

        Raises:
            InputError: No OpenGL, or a file type that cannot be written.
        """
        return film_of(self.scenario, self.recording, Path(file))

    def _repr_html_(self) -> str:
        return self.judgement._repr_html_() + svg(top_view(self.scenario, self.recording, self.judgement))


def drive(
    scenario: Scenario,
    folder: Path | None = None,
    can: str | None = None,
    coupling: Coupling = "zero-delay",
    allow_real_bus: bool = False,
    view: bool = False,
    progress: Callable[[float], None] | None = None,
    command_line: str = "",
    render: Path | None = None,
    message: BusMessage | None = None,
) -> DrivenRun:
    """Drive a scenario once; with a folder, which is made if need be, the CAN log is written there, and nothing else.

    Args:
        scenario: With the plant to drive.
        folder: For the run's files; None for runs/<scenario>, which `report` makes.
        can: Bus that carries the steering commands, see `sidestep.controller.can_port.bus.bus.SPECS`; None for auto,
            or off without a folder.
        coupling: See `cosimulate`.
        allow_real_bus: Whether that bus may reach hardware.
        view: Show MuJoCo's viewer, in real time.
        progress: Called with the simulated time, in [s].
        command_line: For the summary.
        render: Film of MuJoCo's car to write, .gif or .mp4.
        message: The message that steers; None for STEER_CMD.

    Raises:
        InputError: Plant, bus or folder cannot be used, or the plant does not start where it is put; nothing is left
            behind then.
        PlantError: The plant cannot be built or cannot start.
    """
    writes, can = folder is not None, ("auto" if folder else "off") if can is None else can
    folder = folder or Path("runs") / scenario.name
    driver = driving_controller(scenario)
    told = Announced(driver)
    controller = sensed(told, scenario)
    with (
        open_plant(scenario) as plant,
        viewer(plant, scenario, controller) if view else nullcontext() as show,
        film(plant, render, scenario, controller) if render else nullcontext() as shoot,
    ):
        start, _ = reset_to(plant, scenario.start, scenario.plant)  # refused here, before anything is written
        command = controller.step(start)  # load the kernels before the clock runs
        if not is_foreign(scenario.plant):  # an FMU has none, and some start only once
            plant.step(command, PLANT_STEP)
        with made(folder) if writes else nullcontext():
            log = _gone(folder / "can.blf") if writes else None
            behind = int(coupling == "one-step-delay")
            port = SteeringPort(can, log, scenario.vehicle.steer_rate_limit, allow_real_bus, message, behind)
        with port:
            told.announce = port.announce
            recording = cosimulate(controller, plant, scenario, port, coupling, _all(show, shoot, progress))
    found = (*for_the_judge(port.findings()), *_own_failure(driver))
    judgement = judge(recording, scenario, found)
    frames = {
        "sent": port.sent, "lost": port.lost, "strangers": port.strangers, "interface": port.interface,
    }  # fmt: skip
    summary = summarise(scenario, recording, judgement, can=frames, coupling=coupling, command_line=command_line)
    return DrivenRun(scenario, recording, judgement, summary, folder)


def _own_failure(driver: SteeringController | OwnController) -> tuple[Finding, ...]:
    """Somebody else's controller that ours had to take over from has failed, however the drive ended."""
    failure = getattr(driver, "failure", "")
    return (Finding("own controller failed", Verdict.FAIL, failure),) if failure else ()


def _gone(file: Path) -> Path:
    """A file that is not there any more."""
    file.unlink(missing_ok=True)
    return file


def _all(*calls: Callable[[float], None] | None) -> Callable[[float], None]:
    def call(time: float) -> None:
        for each in calls:
            if each is not None:
                each(time)

    return call
