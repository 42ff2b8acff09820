"""Reference paths from segments: exactness, projection, and what is refused."""

import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numba import njit
from scipy.special import fresnel
from support.paths import CIRCLE, HAIRPIN, figure_eight, steady

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.clothoid import MAX_LENGTH, curvature_at
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc, Clothoid, Line

bends = st.floats(-0.15, 0.15)
lengths = st.floats(1.0, 40.0)
segments = st.one_of(
    st.builds(Line, lengths), st.builds(Arc, lengths, bends), st.builds(Clothoid, lengths, bends, bends)
)
poses = st.tuples(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(-7.0, 7.0))
paths = st.builds(ReferencePath.from_segments, st.lists(segments, min_size=1, max_size=5), poses)


# Exactness


def test_a_line_is_a_line_before_on_and_beyond():
    path = ReferencePath.from_segments([Line(120.3)], start=(3.0, -2.0, 0.7))
    s, offset = np.linspace(-50.0, 200.0, 101), 1.5
    x, y = path.to_cartesian(s, offset)
    np.testing.assert_allclose(x, 3.0 + s * math.cos(0.7) - offset * math.sin(0.7), atol=1e-11)
    np.testing.assert_allclose(y, -2.0 + s * math.sin(0.7) + offset * math.cos(0.7), atol=1e-11)
    assert path.length == pytest.approx(120.3, abs=1e-12)


@pytest.mark.parametrize("curvature", [0.9, -0.02, 1e-9])
def test_an_arc_is_a_circle(curvature):
    path = ReferencePath.from_segments([Arc(300.0, curvature)], closed=False)
    s = np.linspace(0.0, 300.0, 777)
    x, y = path.to_cartesian(s, 0.0)
    np.testing.assert_allclose(x, np.sin(curvature * s) / curvature, atol=1e-9)
    np.testing.assert_allclose(y, 2.0 * np.sin(curvature * s / 2.0) ** 2 / curvature, atol=1e-9)
    np.testing.assert_allclose(path.heading(s), curvature * s, atol=1e-11)


def test_a_clothoid_is_fresnels():
    path = ReferencePath.from_segments([Clothoid(100.0, 0.0, 0.4)])
    s = np.linspace(0.0, 100.0, 555)
    unit = math.sqrt(math.pi / 0.004)
    sine, cosine = fresnel(s / unit)
    np.testing.assert_allclose(path.to_cartesian(s, 0.0), (unit * cosine, unit * sine), atol=1e-9)


@steady
@given(paths)
def test_heading_integrates_curvature_and_points_integrate_heading(path):
    s = np.linspace(0.0, path.length, 601)
    step, middle = s[1], 0.5 * (s[1:] + s[:-1])
    heading = path.heading(s)
    # The midpoint rule misses half a step's worth of every jump in curvature: 4 joints of 0.3 /m at most.
    np.testing.assert_allclose(heading - heading[0], integral(path.curvature(middle), step), atol=0.6 * step)
    x, y = path.to_cartesian(s, 0.0)
    np.testing.assert_allclose(x - x[0], integral(np.cos(path.heading(middle)), step), atol=0.1 * step)
    np.testing.assert_allclose(y - y[0], integral(np.sin(path.heading(middle)), step), atol=0.1 * step)


def integral(rate, step):
    return np.concatenate([[0.0], np.cumsum(rate) * step])


def test_curvature_jumps_at_a_joint_and_holds_from_it_on():
    path = ReferencePath.from_segments([Line(10.0), Arc(10.0, 0.1), Clothoid(10.0, 0.1, -0.1)])
    np.testing.assert_allclose(
        path.curvature(np.array([-5.0, 0.0, 9.999, 10.0, 19.999, 20.0, 25.0, 29.999, 30.0, 99.0])),
        [0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.0, -0.09998, 0.0, 0.0], atol=1e-12,
    )  # fmt: skip


# Projection


@steady
@given(paths, st.floats(-0.2, 1.2), st.floats(-0.95, 0.95), st.floats(-1.0, 1.0))
def test_projection_inverts_to_cartesian(path, fraction, reach, slip):
    s = fraction * path.length
    offset = 6.0 * reach
    # The perpendicular foot is unique while the point stays on this side of the evolute all around.
    assume(np.abs(path.curvature(np.linspace(s - 3.0, s + 3.0, 61)) * offset).max() < 0.9)
    x, y = path.to_cartesian(s, offset)
    found, l_s, heading = path.project(x, y, near=s + slip)
    assert found == pytest.approx(s, abs=1e-9)
    assert l_s == pytest.approx(offset, abs=1e-9)
    assert heading == pytest.approx(path.heading(s), abs=1e-9)


@steady
@given(paths, st.floats(0.0, 1.0), st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
def test_projection_finds_the_nearest_point_of_all(path, fraction, dx, dy):
    x, y = path.to_cartesian(fraction * path.length, 0.0)
    x, y = x + dx, y + dy
    px, py = path.to_cartesian(np.linspace(0.0, path.length, 1001), 0.0)
    brute = np.hypot(px - x, py - y).min()
    s, l_s, _ = path.project(x, y)
    fx, fy = path.to_cartesian(s, 0.0)
    assert math.hypot(fx - x, fy - y) <= brute + 1e-9
    if not path.closed or 0.0 < s < path.length:
        assert path.to_cartesian(s, l_s) == pytest.approx((x, y), abs=1e-7)


def test_a_hairpin_keeps_its_legs_apart():
    station = HAIRPIN.project(0.0, 0.0)[0]
    for s in np.arange(0.0, 57.0, 0.4):
        x, y = HAIRPIN.to_cartesian(s, 4.5)  # 1.5 m from the other leg
        station, l_s, _ = HAIRPIN.project(x, y, near=station)
        assert (station, l_s) == pytest.approx((s, 4.5), abs=1e-9)
        assert HAIRPIN.project(x, y)[0] == pytest.approx(HAIRPIN.length - s, abs=1e-9)


def test_a_drive_round_the_hairpin_does_not_jump():
    station = 0.0
    for s in np.arange(0.0, HAIRPIN.length + 20.0, 0.4):
        x, y = HAIRPIN.to_cartesian(s, 2.7 * math.sin(s))
        station, _, _ = HAIRPIN.project(x, y, near=station)
        assert station == pytest.approx(s, abs=1e-8)


def test_three_laps_of_a_figure_eight():
    path = figure_eight()
    assert path.closed
    assert path.heading(path.length) == pytest.approx(path.heading(0.0), abs=1e-12)
    station = 0.0
    for s in np.arange(0.0, 3.0 * path.length, 0.6):
        offset = 3.5 * math.sin(0.3 * s)
        station, l_s, _ = path.project(*path.to_cartesian(s, offset), near=station)
        assert (station, l_s) == pytest.approx((s, offset), abs=1e-8)


def test_a_closed_path_counts_laps_both_ways():
    assert CIRCLE.closed
    assert CIRCLE.length == pytest.approx(100.0 * math.pi)
    assert CIRCLE.heading(2.5 * CIRCLE.length) == pytest.approx(5.0 * math.pi)
    assert CIRCLE.curvature(-1e3) == CIRCLE.curvature(1e5) == 0.02
    for lap in (-2, -1, 0, 3):
        for angle in (-1e-9, 0.0, 1e-9, 1.0, -1.0):
            x, y = 48.0 * math.sin(angle), 50.0 - 48.0 * math.cos(angle)
            near = lap * CIRCLE.length + 50.0 * angle + 7.0
            s, l_s, heading = CIRCLE.project(x, y, near=near)
            assert (s - lap * CIRCLE.length, l_s) == pytest.approx((50.0 * angle, 2.0), abs=1e-9)
            assert heading == pytest.approx(lap * math.tau + angle, abs=1e-11)


def test_without_near_a_closed_path_answers_within_its_first_lap():
    angle = np.linspace(-7.0, 7.0, 57)
    s, l_s, _ = CIRCLE.project(51.0 * np.sin(angle), 50.0 - 51.0 * np.cos(angle))
    assert np.all((s >= 0.0) & (s <= CIRCLE.length))
    np.testing.assert_allclose(l_s, -1.0, atol=1e-9)
    np.testing.assert_allclose(np.cos(s / 50.0), np.cos(angle), atol=1e-10)


def test_a_point_that_is_not_finite_has_no_projection():
    for x, y in ((math.nan, 0.0), (0.0, math.inf)):
        assert all(math.isnan(value) for value in CIRCLE.project(x, y, near=1.0))
    assert math.isnan(CIRCLE.curvature(math.nan))


# Numbers and arrays


def test_numbers_and_arrays_agree():
    s = np.linspace(-20.0, HAIRPIN.length + 20.0, 12).reshape(3, 4)
    x, y = HAIRPIN.to_cartesian(s, 1.0)
    found = HAIRPIN.project(x, y, near=s)
    assert x.shape == y.shape == found[0].shape == s.shape
    for i in np.ndindex(s.shape):
        station = float(s[i])
        assert HAIRPIN.curvature(s)[i] == HAIRPIN.curvature(station)
        assert HAIRPIN.heading(s)[i] == HAIRPIN.heading(station)
        assert (x[i], y[i]) == HAIRPIN.to_cartesian(station, 1.0)
        assert tuple(values[i] for values in found) == HAIRPIN.project(float(x[i]), float(y[i]), near=station)


def test_offsets_broadcast_against_one_station():
    x, y = HAIRPIN.to_cartesian(10.0, np.array([-1.0, 0.0, 2.0]))
    np.testing.assert_allclose(x, 10.0, atol=1e-12)
    np.testing.assert_allclose(y, [-1.0, 0.0, 2.0], atol=1e-12)


def test_integers_and_numpy_numbers_are_numbers():
    ten: Any = np.float32(10.0)
    one: Any = np.int64(1)
    assert HAIRPIN.to_cartesian(10, 1) == HAIRPIN.to_cartesian(ten, one) == pytest.approx((10.0, 1.0))
    assert HAIRPIN.project(ten, one, 10) == pytest.approx((10.0, 1.0, 0.0))
    assert isinstance(HAIRPIN.curvature(one), float)


def test_a_path_cannot_be_changed_not_even_after_pickling():
    for path in (CIRCLE, pickle.loads(pickle.dumps(CIRCLE))):
        assert not path.table.flags.writeable
        assert path.closed
        with pytest.raises(AttributeError):
            setattr(path, "closed", False)  # noqa: B010 (checkers refuse the assignment)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(CIRCLE)).table, CIRCLE.table)


def test_kernels_take_the_table():
    @njit
    def total(table, period):
        return curvature_at(table, period, 61.0) + curvature_at(table, period, 1.0)

    assert total(HAIRPIN.table, HAIRPIN.period) == pytest.approx(1 / 3)


# Errors


@pytest.mark.parametrize(
    ("make", "where"),
    [
        (lambda: Line(0.0), "segment.length"),
        (lambda: Line(-1.0), "segment.length"),
        (lambda: Line(math.inf), "segment.length"),
        (lambda: Line(2.0 * MAX_LENGTH), "segment.length"),
        (lambda: Line(True), "segment.length"),
        (lambda: Arc(1.0, "left"), "segment.curvature"),  # pyright: ignore[reportArgumentType] the point of the case
        (lambda: Arc(1.0, math.nan), "segment.curvature"),
        (lambda: Arc(1.0, 1.1), "segment.curvature"),
        (lambda: Clothoid(1.0, 0.0, -1.1), "segment.curvature_end"),
        (lambda: ReferencePath.from_segments([]), "road.segments"),
        (lambda: ReferencePath.from_segments([Line(1.0), 3.0]), "road.segments[1]"),  # pyright: ignore[reportArgumentType]
        (lambda: ReferencePath.from_segments([Line(1.0)], start=(0.0, math.nan, 0.0)), "road.start"),
        (lambda: ReferencePath.from_segments([Line(1.0)], closed=True), "road.segments"),
        (lambda: ReferencePath.from_waypoints([(0.0, 0.0)]), "road.waypoints"),
        (lambda: ReferencePath.from_waypoints(np.zeros((4, 3))), "road.waypoints"),
        (lambda: ReferencePath.from_waypoints([(0, 0), (1e-3, 0), (2e-3, 0)]), "road.waypoints"),
        (lambda: ReferencePath.from_waypoints([(0, 0), (9, 0), (0, 0)]), "road.waypoints"),
        (lambda: ReferencePath.from_waypoints([(0, 0), (9, math.inf)]), "road.waypoints[1]"),
        (lambda: ReferencePath.from_waypoints([(0, 0), (1, 0), (1, 0.3), (0, 0.3)]), "road.waypoints[1]"),
        (lambda: ReferencePath.from_waypoints([(0, 0), (2.0 * MAX_LENGTH, 0)]), "road.waypoints"),
    ],
)
def test_errors_name_the_value(make, where):
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.where == where
