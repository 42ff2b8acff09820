"""The bus that takes its time, and what compensation is worth."""

import json
from pathlib import Path

import numpy as np
import pytest

from sidestep.plant_models.signals import SteeringCommand
from sidestep.validation.cli.main import main
from sidestep.validation.loop.delay_line import DelayLine
from sidestep.validation.studies import delay


@pytest.mark.parametrize("steps", [0, 1, 7])
def test_every_command_arrives_after_the_delay(steps):
    line = DelayLine(steps * 0.01)
    sent = [SteeringCommand(0.01 * k, 0.1 * k, 10.0) for k in range(30)]
    arrived = [line.transmit(command) for command in sent]
    assert arrived == [None] * steps + sent[: 30 - steps]


def test_of_several_that_arrive_together_the_newest_counts():
    line = DelayLine(0.05)
    sent = [SteeringCommand(time, time, 10.0) for time in (0.0, 0.01, 0.2)]
    assert [line.transmit(command) for command in sent] == [None, None, sent[1]]


@pytest.mark.closed_loop
def test_a_longer_delay_is_a_later_command():
    """What the wheels get is what the controller gave, that much earlier."""
    recording = delay.drive(delay.scene(0.02, 5, True, "linear"), 5)
    given, got = recording["steer_command"], recording["steer_received"]
    shift = round(4 * 0.02 / 0.01)  # the first of the five periods is the coupling's
    assert np.array_equal(got[shift:-1], given[: -shift - 1])  # the last sample is a state only
    assert not got[:shift].any()


@pytest.mark.closed_loop
def test_compensation_keeps_what_is_lost_without_it(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(delay, "CASES", ((0.05, 1), (0.05, 4)))
    assert main(["limits", "delay", "--plant", "linear", "--out", str(tmp_path)]) == 0
    rows = {(r["delay"], r["compensated"]): r for r in json.loads((tmp_path / "delay.json").read_text())["rows"]}
    assert rows[0.05, True]["final_offset"] < 1e-3
    assert rows[0.2, True]["final_offset"] < 1e-3
    assert rows[0.2, False]["final_offset"] > 0.1
    assert (tmp_path / "delay.png").stat().st_size > 10_000
    assert "not compensated" in capsys.readouterr().out
