"""The long drive of the MuJoCo car, made short, and whether its checks can fail."""

from dataclasses import replace

import numpy as np
import pytest

from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.validation.model_error.mujoco import drive as mujoco_drive
from sidestep.validation.model_error.mujoco.drive import long_drive


def failed(seconds):
    checks = long_drive(seconds)
    assert len(checks) == 8
    return [check.name.partition(": ")[2] for check in checks if not check.passed]


def test_a_short_drive_passes():
    assert failed(6.0) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda s: replace(s, x=s.x + 1e-8), "state against the bodies' centre of gravity"),
        (lambda s: replace(s, yaw=s.yaw + 1e-8), "yaw against the chassis"),
        (lambda s: replace(s, v_x=1.001 * s.v_x), "integrated velocity against the way"),
        (lambda s: replace(s, steer_angle=np.nan), "numbers that are not finite"),
    ],
)
def test_a_state_that_lies_is_found_out(change, expected, monkeypatch):
    real = mujoco_drive._look
    monkeypatch.setattr(mujoco_drive, "_look", lambda log, plant, state: real(log, plant, change(state)))
    assert failed(0.5) == [expected]


def test_a_car_that_moves_while_standing_gains_energy(monkeypatch):
    plants = []
    real = MujocoPlant.step

    def pushed(self, command, dt):
        state = real(self, command, dt)
        plants.append(self)
        if len(plants) == 200:  # in the second half
            self.data.qvel[0] += 0.01
        return state

    monkeypatch.setattr(MujocoPlant, "step", pushed)
    assert failed(0.2) == ["kinetic energy gained"]
