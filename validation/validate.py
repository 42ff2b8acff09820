"""`sidestep validate`: the checks of a plant as a table, and its figures."""

from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from sidestep.plant_models.errors import InputError
from sidestep.validation.files import written_to
from sidestep.validation.mujoco_drive import long_drive
from sidestep.validation.mujoco_validation import Check, validate_mujoco


def validate(plant: str, out: Path | None = None) -> int:
    """Run and print the checks of a plant; write its figures to `out`, if given.

    Returns:
        The exit status: 0 if all checks pass.

    Raises:
        InputError: There are no checks for this plant, or the folder cannot be written.
    """
    if plant != "mujoco":
        raise InputError("--plant", f"no checks for {plant!r}", "mujoco")
    checks = [*validate_mujoco(), *long_drive()]
    print_checks(checks)
    if out:
        from sidestep.validation.mujoco_figures import axle_forces, manoeuvres

        with written_to(out):
            out.mkdir(parents=True, exist_ok=True)
            for name, figure in (("mujoco-axle-force", axle_forces()), ("mujoco-manoeuvres", manoeuvres())):
                figure.savefig(out / f"{name}.png", dpi=110)
                print(f"figure: {out / f'{name}.png'}")
    return 0 if all(check.passed for check in checks) else 1


def print_checks(checks: Sequence[Check]) -> None:
    """Print one row a check."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for head in ("check", "value", "limit", "unit", "verdict"):
        table.add_column(head, justify="right" if head in ("value", "limit") else "left")
    for check in checks:
        verdict = "[green]PASS[/]" if check.passed else "[red]FAIL[/]"
        table.add_row(check.name, f"{check.value:.3g}", f"{check.limit:g}", check.unit, verdict)
    console = Console()
    (console if console.is_terminal else Console(width=110)).print(table)
