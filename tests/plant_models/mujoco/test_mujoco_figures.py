"""What the figures of the MuJoCo car show, read back from their lines."""

import numpy as np
import pytest

from sidestep.plant_models.tyres.contact import TYRE_MODES
from sidestep.validation.model_error.mujoco import figures as mujoco_figures
from sidestep.validation.model_error.mujoco.figures import axle_forces, manoeuvres


def data_of(axes, label):
    (line,) = (line for line in axes.lines if line.get_label() == label)
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_axle_forces_lie_on_the_formula_except_those_of_stock_friction(monkeypatch):
    monkeypatch.setattr(mujoco_figures, "_DEGREES", np.array([0.6, 4.0]))
    panels = dict(zip(TYRE_MODES, axle_forces().axes, strict=True))
    for mode, axes in panels.items():
        grid, formula = data_of(axes, "formula")
        for speed in ("5 m/s", "15 m/s", "30 m/s"):
            angles, forces = data_of(axes, speed)
            on_it = forces == pytest.approx(np.interp(angles, grid, formula), rel=0.01)
            assert on_it == (mode != "stock-contact")


def test_manoeuvres_agree_where_the_tyres_are_linear_and_part_at_the_limit():
    (step, sweep, ramp, *sideslips) = manoeuvres().axes
    ends = [[data_of(axes, name)[1][-1] for name in ("linear", "single-track FMU", "MuJoCo")] for axes in (step, ramp)]
    assert ends[0] == pytest.approx([ends[0][0]] * 3, rel=0.08)
    assert ends[1][0] > 1.2 * max(ends[1][1:])
    times, rates = data_of(sweep, "MuJoCo")
    assert np.abs(rates[times < 6.0]).max() > 1.3 * np.abs(rates[times > 11.0]).max()
    assert all(len(axes.lines) == 3 for axes in sideslips)
