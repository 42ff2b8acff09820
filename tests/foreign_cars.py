"""Cars in MuJoCo's format as strangers write them: each with its own names, axes, joints, actuators and scale."""

from pathlib import Path

_TEXTS = {file.stem: file.read_text() for file in sorted((Path(__file__).parent / "strangers").glob("*.xml"))}
TWO_WHEELED = _TEXTS.pop("two_wheeled")
"""No car."""
CARS = _TEXTS
"""By file name; the first line of each says what is odd about it."""
SEDAN, NORTHBOUND, BARE = CARS["sedan"], CARS["northbound"], CARS["kart"]
