"""What the tests of campaigns let other processes do: light to import there."""

import os
import time
from pathlib import Path

from sidestep.validation.campaigns.campaign import Case, load_campaign


def fake(case: Case) -> dict[str, object]:
    """A row without a drive: fails where the noise is high, and is slow enough to be killed half way."""
    time.sleep(0.005)
    margin = 0.5 - 0.4 * case.values["plant.noise"]
    return {
        "row": case.row, "seed": case.seed, "values": dict(case.values), "verdict": "pass" if margin > 0.0 else "fail",
        "label": "ok" if margin > 0.0 else "collision", "margin_m": margin, "error": None,
    }  # fmt: skip


def deadly(case: Case) -> dict[str, object]:
    """The same, but one case takes its process with it."""
    if case.row == 7:
        os._exit(1)
    return fake(case)


def go_on(folder: str, file: str) -> None:
    """Run the campaign of FOLDER/spec.toml into FILE."""
    from sidestep.validation.campaigns.campaign_run import run_campaign

    run_campaign(load_campaign(Path(folder) / "spec.toml"), Path(file), 1, work=fake)
