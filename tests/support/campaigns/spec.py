"""A small campaign without long drives."""

from pathlib import Path

from sidestep.validation.campaigns.campaign import Campaign, load_campaign

SPEC = """
scenario = "double-obstacle"
runs = 40
seed = 3
[set]
plant.kind = "linear"
duration = 0.2
[vary]
speed = { low = 10.0, high = 18.0 }
plant.noise = { low = 0.0, high = 2.0 }
"obstacles.1.l" = { low = 0.2, high = 1.4 }
controller.tyre_model = { values = ["linear", "affine"] }
"""


def campaign(folder: Path, text: str = SPEC) -> Campaign:
    (folder / "spec.toml").write_text(text)
    return load_campaign(folder / "spec.toml")
