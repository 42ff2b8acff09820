"""Sensitivity indices against those that are known."""

import numpy as np
import pytest
from scipy.stats.qmc import Sobol

from sidestep.validation.model_error.sensitivity import first_order, separation, trend


def test_sensitivity_is_that_of_the_ishigami_function():
    """S_1 = 0.3139, S_2 = 0.4424, S_3 = 0 for a = 7, b = 0.1 (Ishigami and Homma 1990)."""
    x = np.pi * (2.0 * Sobol(3, scramble=False).random_base2(14)[1:].T - 1.0)
    y = np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])
    assert [first_order(row, y) for row in x] == pytest.approx([0.3139, 0.4424, 0.0], abs=0.005)
    assert trend(x[0], y) > 0.3
    assert abs(trend(x[1], y)) < 0.05
    assert first_order(np.sign(x[0]), np.sign(x[0])) == pytest.approx(1.0)
    assert first_order(np.zeros(9), np.arange(9.0)) == first_order(np.arange(9.0), np.zeros(9)) == 0.0
    assert trend(np.zeros(9), np.arange(9.0)) == 0.0
    assert separation(np.arange(100.0), np.arange(100) > 89) == pytest.approx(1.0)
    assert separation(x[0], x[1] > 0.0) < 0.03
