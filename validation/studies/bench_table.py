"""The bench's figures as tables, absolute and as ratios."""

from typing import Any

from rich.markup import escape
from rich.table import Table

from sidestep.validation.console import new_table, show

_FRAME_PERIOD, _MUJOCO_STEP = 0.01, 0.001  # [s]


def print_figures(figures: dict[str, Any]) -> None:
    """Controller, QP solvers, plants and CAN, and the machine that they were measured on."""
    period = figures["scene"]["period_s"]
    step, planner, qps = figures["controller_step_us"], figures["planner_us"], figures["qp_us"]
    table = new_table("", "cost of", "median [µs]", "p99 [µs]", "p99 quiet [µs]", "ratio")
    _add(table, "controller step", step, f"{1e-4 * step['median'] / period:.1f} % of its {1e3 * period:.0f} ms")
    bounded = figures["bounded_step_us"]
    _add(table, "  where a bound acts", bounded, f"{1e-4 * bounded['median'] / period:.1f} %")
    _add(table, "  path search and corridor", planner, f"{100 * planner['median'] / step['median']:.0f} % of the step")
    for name, times in qps.items():
        _add(table, f"  its QP in {name}", times, f"{times['median'] / qps['piqp']['median']:.2f} x piqp")
    for kind, time in figures["plant_us"].items():
        covers = _MUJOCO_STEP if kind == "mujoco" else period
        if time is None:
            table.add_row(f"{kind} plant", "–", "", "", "cannot be built here")
        else:
            faster = f"{1e6 * covers / time:.0f} x real time"
            table.add_row(f"{kind} plant, per {1e3 * covers:.0f} ms", f"{time:.2f}", "", "", faster)
    frame = figures["can_frame_us"]
    table.add_row("CAN frame", f"{frame:.1f}", "", "", f"{1e-4 * frame / _FRAME_PERIOD:.1f} % of its 10 ms")
    machine, versions = figures["machine"], figures["versions"]
    show(table, f"{machine['processor']}, {machine['cores']} cores, load {machine['load_before']:.1f} before the start")
    show(", ".join(f"{name} {version}" for name, version in versions.items() if version))


def print_solvers(figures: dict[str, Any]) -> None:
    """The controller's QPs in every solver that is installed: speed against error."""
    table = new_table(
        "", "QP solver", "median [µs]", "p99 [µs]", "p99 quiet [µs]", "ratio", "largest error of u0 [rad/s]"
    )
    errors, base = figures["solver_errors"], figures["qp_us"]["piqp"]["median"]
    for name, times in sorted(figures["qp_us"].items(), key=lambda entry: entry[1]["median"]):
        error = f"{errors[name]:.1e}" if name in errors else "–"
        _add(
            table,
            name,
            times,
            f"{times['median'] / base:.2f} x piqp",
            "exact by definition" if name == "daqp" else error,
        )
    show(table)
    if not errors:
        show(escape("errors need DAQP: pip install 'sidestep[bench]'"))


def _add(table: Table, name: str, times: dict[str, float], *rest: str) -> None:
    table.add_row(name, *(f"{times[key]:.0f}" for key in ("median", "p99", "p99_quiet")), *rest)
