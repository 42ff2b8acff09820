"""What a plant's FMU answers to a fixed manoeuvre, as a CSV file in it: for importers to compare with."""

from collections.abc import Iterator
from pathlib import Path

from sidestep.fmu.description.variables import ACCELERATION_START, Model
from sidestep.fmu.importing.instance import FmuInstance

STEP, STEPS = 0.02, 200
"""Communication step, in [s], and number of rows after the first."""


def expected_output(file: Path, model: Model) -> bytes:
    """Time, inputs and outputs, one row every `STEP`; inputs hold from the time of their row on.

    Args:
        file: The FMU of the model.
        model: A plant.

    Raises:
        PlantError: Its start values are such that it cannot be stepped.
    """
    inputs = [row.name for _, row in model.of_kind("input")]
    outputs = [row.name for _, row in model.of_kind("state", "output")]
    rows = [",".join(("time", *inputs, *outputs))]
    rows += [",".join(map(repr, row)) for row in _run(file, inputs, outputs, _target_speed(model))]
    return "\n".join((*rows, "")).encode()


def _target_speed(model: Model) -> float:
    return next(row.start or 0.0 for row in model.variables if row.name == "target_speed")


def _run(file: Path, inputs: list[str], outputs: list[str], speed: float) -> Iterator[list[float]]:
    fmu = FmuInstance(file)
    given, answered = fmu.port(inputs), fmu.port(outputs)
    try:
        fmu.start(0.0, {})
        for k in range(STEPS + 1):
            time = k * STEP
            given.values[:] = _manoeuvre(time, speed)
            fmu.set(given)
            fmu.get(answered)
            yield [time, *given.values, *answered.values]
            fmu.step(time, STEP)
    finally:
        fmu.close()


def _manoeuvre(time: float, speed: float) -> tuple[float, float, float]:
    """Steering angle, target speed and acceleration: left, right, straight on more slowly, and brake."""
    steer = 0.04 if 0.2 <= time < 1.0 else -0.04 if 1.0 <= time < 1.8 else 0.0
    return steer, speed if time < 2.0 else 0.8 * speed, ACCELERATION_START if time < 3.0 else -2.0
