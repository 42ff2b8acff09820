"""Measure what the README shows, and write it there: python benchmarks/readme.py [picture] [demo] [bench]

The figures are kept beside this file as demo.json and bench.json; a test holds the README's tables against them.
"""

import json
import math
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from sidestep.validation.report.style import styled
from sidestep.validation.report.topview import top_view
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.runs import drive

HERE = Path(__file__).parent
README = HERE.parent / "README.md"
PICTURE = HERE.parent / "docs" / "images" / "double-obstacle.png"
SIDESTEP = (sys.executable, "-m", "sidestep.validation")
DEMO_KEYS = (
    "scenario", "plant", "preset", "verdict", "label", "min_clearance_m", "max_lateral_acceleration", "max_steer_rate",
    "final_rms_lateral_error_m", "infeasible_steps", "max_slack_m",
)  # fmt: skip


def picture() -> None:
    scenario = load_scenario("double-obstacle", ["plant.kind=mujoco"])
    with tempfile.TemporaryDirectory() as folder:
        run = drive(scenario, Path(folder), can="off")
    figure = top_view(run.scenario, run.recording, run.judgement)
    PICTURE.parent.mkdir(exist_ok=True)
    with styled():
        figure.savefig(PICTURE, dpi=140, pil_kwargs={"optimize": True})


def demo() -> None:
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        subprocess.run([*SIDESTEP, "demo", "--out", folder], check=True)
        seconds = time.perf_counter() - began
        runs = json.loads((Path(folder) / "summary.json").read_text(encoding="utf-8"))["runs"]
    kept = {"seconds": seconds, "runs": [{key: run[key] for key in DEMO_KEYS} for run in runs]}
    (HERE / "demo.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def bench() -> None:
    subprocess.run([*SIDESTEP, "bench", "--solvers", "--json", str(HERE / "bench.json")], check=True)


def stored(name: str) -> dict[str, Any] | None:
    file = HERE / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


def table(*rows: tuple[str, ...]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|---" + "|---:" * (len(rows[0]) - 1) + "|", *lines[1:]])


def demo_table() -> str:
    if not (demo := stored("demo")):
        return "Not measured yet."
    head = (
        "Scene, plant", "Verdict", "Clearance [m]", "Max a_y [m/s²]", "Max steering rate [deg/s]",
        "RMS error, last second [cm]", "Infeasible steps",
    )  # fmt: skip
    runs = table(head, *(_demo_row(run) for run in demo["runs"]))
    return f"{runs}\n\nThe whole demo, reports included, took {demo['seconds']:.0f} s."


def _demo_row(run: dict[str, Any]) -> tuple[str, ...]:
    preset = "" if run["preset"] == "default" else f", `{run['preset']}` preset"
    return (
        f"{run['scenario']}, {run['plant']}{preset}",
        f"{run['verdict']}: {run['label']}",
        f"{run['min_clearance_m']:.3f}",
        f"{run['max_lateral_acceleration']:.2f}",
        f"{math.degrees(run['max_steer_rate']):.1f}",
        f"{100 * run['final_rms_lateral_error_m']:.2f}",
        str(run["infeasible_steps"]),
    )


def bench_table() -> str:
    if not (figures := stored("bench")):
        return "Not measured yet."
    plants, qps, machine = figures["plant_us"], figures["qp_us"], figures["machine"]
    rows = [
        ("Cost of", "Median [µs]", "p99 [µs]", "p99, scheduler noise removed [µs]"),
        _times("controller step: search, corridor, QP, solve", figures["controller_step_us"]),
        _times("of which path search and corridor", figures["planner_us"]),
        _times("controller step in a double lane change, where a bound acts", figures["bounded_step_us"]),
        *(_times(f"its QP in {_solver(name, figures)}", times) for name, times in qps.items()),
        *((f"{name} plant, per 20 ms", _one(plants[name]), "", "") for name in ("linear", "single-track")),
        ("mujoco plant, per 1 ms", _one(plants["mujoco"]), "", ""),
        ("CAN frame: encode, protect, send, receive, check, decode", _one(figures["can_frame_us"]), "", ""),
    ]
    return (
        f"{table(*rows)}\n\n{machine['processor']}, {machine['cores']} cores, load {machine['load_before']:.1f} before "
        f"the start, Python {machine['python']}. Command: `sidestep bench --solvers`."
    )


def _times(name: str, times: dict[str, float]) -> tuple[str, ...]:
    return name, *(_one(times[key]) for key in ("median", "p99", "p99_quiet"))


def _one(time: float | None) -> str:
    return "not here" if time is None else f"{time:.3g}" if time < 100 else f"{time:.0f}"


def _solver(name: str, figures: dict[str, Any]) -> str:
    errors = figures["solver_errors"]
    accuracy = "exact" if name == "daqp" else f"error {errors[name]:.0e} rad/s" if name in errors else ""
    return f"{name.upper() if name != 'clarabel' else 'Clarabel'} ({accuracy})"


def with_tables(text: str) -> str:
    """The README with the tables of the stored figures between its marks."""
    for name, content in (("demo", demo_table()), ("bench", bench_table())):
        mark = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- /{name} -->)", re.DOTALL)
        text, count = mark.subn(lambda found, content=content: found[1] + content + found[2], text)
        assert count == 1, f"README.md has no place for {name}"
    return text


if __name__ == "__main__":
    for wanted in sys.argv[1:] or ("picture", "demo", "bench"):
        {"picture": picture, "demo": demo, "bench": bench}[wanted]()
    README.write_text(with_tables(README.read_text(encoding="utf-8")), encoding="utf-8")
