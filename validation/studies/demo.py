"""`sidestep demo`: the paper's two scenes on three plants with steering on CAN, and the paper's own baseline."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.validation.console import print_runs, progress_bar
from sidestep.validation.files import made, write_text, written_to
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.run import Run
from sidestep.validation.judge.summary import strict_json
from sidestep.validation.report.report import demo_report, write_run
from sidestep.validation.scenarios.scenario import Scenario, load_scenario
from sidestep.validation.studies.runs import drive

SCENES = ("single-obstacle", "double-obstacle")
CASES = (("linear", "default"), ("single-track", "default"), ("mujoco", "default"), ("linear", "paper"))
"""Plant and preset of every row; those of preset "default" count for the verdict."""


def demo(out: Path, command_line: str = "") -> int:
    """Run everything into `out`, print the table and write the report.

    Returns:
        0 if all runs that count passed, else 1.

    Raises:
        InputError: `out` cannot be written to.
        KeyboardInterrupt: After what was run has been written.
    """
    with made(out):
        scenarios = [
            load_scenario(scene, [f"plant.kind={plant}", f"controller.preset={preset}"])
            for scene in SCENES
            for plant, preset in CASES
        ]
    runs: list[Run] = []
    summaries: list[dict[str, Any]] = []
    interrupted = False
    with progress_bar("demo", len(scenarios)) as progress, written_to(out):
        for done, scenario in enumerate(scenarios):
            summaries.append(_run(scenario, out, command_line, runs, _part(progress, done, scenario.duration)))
            interrupted = bool(runs) and runs[-1].interrupted
            if interrupted:
                break
        verdict = _verdict([s["verdict"] for s in summaries if s["preset"] == "default"], interrupted)
        write_text(out / "summary.json", strict_json({"runs": summaries}))
        write_text(out / "report.html", demo_report(runs, summaries, verdict))
    print_runs(summaries)
    print(f"report: {out / 'report.html'}")
    if interrupted:
        raise KeyboardInterrupt
    return 0 if verdict is Verdict.PASS else 1


def _verdict(verdicts: Sequence[str], interrupted: bool) -> Verdict:
    """A failure decides; without one, what shows nothing does."""
    if Verdict.FAIL.value in verdicts:
        return Verdict.FAIL
    return Verdict.INCONCLUSIVE if interrupted or Verdict.INCONCLUSIVE.value in verdicts else Verdict.PASS


def _part(progress: Callable[[float], None], done: int, duration: float) -> Callable[[float], None]:
    return lambda time: progress(done + time / duration)


def _run(
    scenario: Scenario, out: Path, command_line: str, runs: list[Run], progress: Callable[[float], None]
) -> dict[str, Any]:
    """Drive and write one run; the summary of one that cannot be started says why."""
    preset = scenario.controller_preset
    name = f"{scenario.name}-{scenario.plant.name}" + (f"-{preset}" if preset != "default" else "")
    try:
        run = drive(scenario, out / name, progress=progress, command_line=command_line)
    except (InputError, PlantError) as error:
        return {
            "scenario": scenario.name, "plant": scenario.plant.name, "preset": preset,
            "verdict": "fail", "label": "plant invalid", "detail": "", "error": str(error),
        }  # fmt: skip
    write_run(run)
    runs.append(run)
    return {**run.summary, "report": f"{name}/report.html"}
