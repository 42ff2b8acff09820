"""ISO/TS 18571 against another implementation's values, and what must hold of any rating; Theil's inequality."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from support.iso18571_signals import pairs

from sidestep.plant_models.errors import InputError
from sidestep.validation.model_error.theil import theil
from sidestep.validation.report.compare.rating import best_shift, rate, warping_path

STORED = json.loads((Path(__file__).parent / "iso18571.json").read_text(encoding="utf-8"))["ratings"]


@pytest.mark.parametrize("name", STORED)
def test_scores_are_those_of_objective_rating_metrics(name):
    rating = rate(*pairs()[name])
    ours = {score: getattr(rating, score) for score in STORED[name]}
    assert ours == pytest.approx(STORED[name], abs=1e-9)


def test_every_stored_rating_has_its_signals():
    assert set(STORED) == set(pairs())


def test_a_signal_rates_itself_excellent_and_its_size_does_not_matter():
    reference, other = pairs()["damping"]
    assert rate(reference, reference).overall == pytest.approx(1.0)
    assert rate(reference, reference).grade == "excellent"
    scaled, plain = rate(40.0 * reference, 40.0 * other), rate(reference, other)
    assert scaled.overall == pytest.approx(plain.overall, abs=1e-12)


def test_grades_change_where_the_standard_says():
    reference = pairs()["gain"][0]
    grades = [rate(reference, gain * reference).grade for gain in (0.97, 0.85, 0.6, 0.1)]
    assert grades == ["excellent", "good", "fair", "poor"]


@pytest.mark.parametrize("samples", [-40, -1, 0, 7, 120])
def test_the_shift_is_found_to_the_sample(samples):
    chirp = np.sin(np.linspace(0.0, 7.0, 900) ** 2)
    reference, other = chirp[150:750], chirp[150 - samples : 750 - samples]
    assert best_shift(reference, other) == samples


def test_no_path_through_the_band_is_cheaper():
    """Against plain dynamic programming over the full matrix."""
    random = np.random.default_rng(3)
    a, b, window = random.standard_normal(60).cumsum(), random.standard_normal(60).cumsum(), 7
    cost = cdist(a[:, None], b[:, None], "sqeuclidean")
    cost[np.abs(np.subtract.outer(np.arange(60), np.arange(60))) > window] = np.inf
    total = np.full((61, 61), np.inf)
    total[0, 0] = 0.0
    for i in range(60):
        for j in range(60):
            total[i + 1, j + 1] = cost[i, j] + min(total[i, j], total[i, j + 1], total[i + 1, j])
    i, j = warping_path(a, b, window)
    assert ((a[i] - b[j]) ** 2).sum() == pytest.approx(total[60, 60])
    steps = np.column_stack([np.diff(i), np.diff(j)])
    assert (i[0], j[0], i[-1], j[-1]) == (0, 0, 59, 59)
    assert {tuple(step) for step in steps} <= {(0, 1), (1, 0), (1, 1)}


@pytest.mark.parametrize(
    ("reference", "other", "problem"),
    [
        (np.arange(30.0), np.arange(31.0), "shapes"),
        (np.arange(5.0), np.arange(5.0), "shapes"),
        (np.ones(30), np.arange(30.0), "never changes"),
        (np.arange(30.0), np.full(30, np.nan), "not finite"),
    ],
)
def test_what_cannot_be_rated_is_refused(reference, other, problem):
    with pytest.raises(InputError, match=problem):
        rate(reference, other)


def test_parts_of_the_error_are_told_apart():
    t = np.linspace(0.0, 20.0 * np.pi, 5000, endpoint=False)
    measured = np.sin(t)
    offset, gain, lag = (
        theil(measured, measured + 0.1),
        theil(measured, 1.2 * measured),
        theil(measured, np.sin(t - 0.3)),
    )
    assert (offset.bias, gain.variance, lag.covariance) == pytest.approx((1.0, 1.0, 1.0), abs=1e-9)
    assert theil(measured, -measured).u == pytest.approx(1.0)
    assert theil(measured, measured).u == 0.0


def test_shares_sum_up_to_one_and_covariance_is_its_formula():
    random = np.random.default_rng(5)
    a, p = random.standard_normal(400) + 0.4, 1.3 * random.standard_normal(400)
    split, r = theil(a, p), np.corrcoef(a, p)[0, 1]
    assert split.bias + split.variance + split.covariance == pytest.approx(1.0)
    assert split.covariance == pytest.approx(2.0 * (1.0 - r) * a.std() * p.std() / np.mean((p - a) ** 2))
