"""The checks that a plant comes with: run, shown as a table and as evidence, with their figures."""

from collections.abc import Sequence
from pathlib import Path

from sidestep.validation.console import new_table, show
from sidestep.validation.files import written_to
from sidestep.validation.model_error.mujoco.checks import Check, validate_mujoco
from sidestep.validation.model_error.mujoco.drive import long_drive
from sidestep.validation.report.evidence import Evidence, Table
from sidestep.validation.report.exports.junit import JunitCase
from sidestep.validation.report.style import write_figure


def checks_of(plant: str) -> list[Check]:
    """Run and print the checks of a plant; only MuJoCo's car has any."""
    if plant != "mujoco":
        return []
    checks = [*validate_mujoco(), *long_drive()]
    print_checks(checks)
    return checks


def evidence_of(checks: Sequence[Check]) -> list[Evidence]:
    """The checks as a section of a report."""
    if not checks:
        return []
    rows = tuple(
        (c.name, f"{c.value:.3g}", f"{c.limit:g}", c.unit, "PASS" if c.passed else "FAIL") for c in checks
    )  # fmt: skip
    table = Table(("check", "value", "limit", "unit", "verdict"), rows)
    return [Evidence("Checks of the MuJoCo car", "", None, table, all(c.passed for c in checks), "The plant itself")]


def junit_cases(checks: Sequence[Check]) -> list[JunitCase]:
    """One for each check."""
    return [
        JunitCase(
            "sidestep.validate.checks",
            c.name,
            "" if c.passed else f"{c.value:.3g}, limit {c.limit:g} {c.unit}".rstrip(),
        )
        for c in checks
    ]


def write_figures(out: Path) -> None:
    """Figures of the MuJoCo car's tyres and manoeuvres, into a folder that is there.

    Raises:
        InputError: The folder cannot be written.
    """
    from sidestep.validation.model_error.mujoco.figures import axle_forces, manoeuvres

    with written_to(out):
        for name, figure in (("mujoco-axle-force", axle_forces()), ("mujoco-manoeuvres", manoeuvres())):
            write_figure(out / f"{name}.png", figure)
            print(f"figure: {out / f'{name}.png'}")


def print_checks(checks: Sequence[Check]) -> None:
    """Print one row a check."""
    table = new_table("", "check", "value", "limit", "unit", "verdict")
    for check in checks:
        verdict = "[green]PASS[/]" if check.passed else "[red]FAIL[/]"
        table.add_row(check.name, f"{check.value:.3g}", f"{check.limit:g}", check.unit, verdict)
    show(table)
