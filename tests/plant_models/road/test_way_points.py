"""Reference paths through way-points, from arrays and from CSV files."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from support.paths import circle_points, figure_eight, steady

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Arc
from sidestep.plant_models.road.widths import Widths, widths_at


def test_a_circle_sampled_every_metre_is_met_within_a_millimetre():
    path = ReferencePath.from_waypoints(circle_points(20.0, 1.0), closed=True)
    x, y = path.to_cartesian(np.linspace(0.0, path.length, 2000), 0.0)
    assert np.abs(np.hypot(x, y) - 20.0).max() < 1e-5
    assert path.length == pytest.approx(40.0 * math.pi, abs=1e-4)
    np.testing.assert_allclose(path.curvature(np.linspace(0.0, path.length, 2000)), 0.05, atol=1e-4)


def test_half_a_circle_is_met_within_a_millimetre_up_to_its_ends():
    points = circle_points(20.0, 1.0)[:60]
    path = ReferencePath.from_waypoints(points)
    assert not path.closed
    x, y = path.to_cartesian(np.linspace(0.0, path.length, 2000), 0.0)
    assert np.abs(np.hypot(x, y) - 20.0).max() < 1e-3


@steady
@given(st.lists(st.tuples(st.floats(4.0, 15.0), st.floats(-0.35, 0.35)), min_size=3, max_size=12), st.booleans())
def test_the_path_holds_to_its_way_points_and_stays_arc_length_parametrised(legs, far_away):
    length, turn = np.array(legs).T
    angle = np.cumsum(turn)
    points = np.column_stack([np.cumsum(length * np.cos(angle)), np.cumsum(length * np.sin(angle))])
    path = ReferencePath.from_waypoints(points + 5e6 * far_away)
    assert path.origin == ((5e6, 5e6) if far_away else (0.0, 0.0))
    s, l_s, _ = path.project(points[:, 0], points[:, 1], near=path.station_of(path.given.stations))
    np.testing.assert_allclose(l_s, 0.0, atol=0.1)
    assert np.all(np.diff(s) > 0.0)
    assert (s[0], s[-1]) == pytest.approx((0.0, path.length), abs=1e-6)
    assert furthest(path, points) <= 0.1
    stations = np.linspace(0.0, path.length, 401)
    middle, step = 0.5 * (stations[1:] + stations[:-1]), stations[1]
    chord = np.hypot(*np.diff(path.to_cartesian(stations, 0.0)))
    np.testing.assert_allclose(chord, step * (1.0 - (path.curvature(middle) * step) ** 2 / 24.0), rtol=1e-6, atol=1e-8)


def furthest(path, points):
    """Hausdorff distance of the path from a polyline, by shapely."""
    line = shapely.LineString(points)
    driven = shapely.LineString(np.column_stack(path.to_cartesian(np.linspace(0.0, path.length, 4001), 0.0)))
    return shapely.hausdorff_distance(line, driven, densify=0.01)


def test_the_splines_curvature_is_continuous():
    path = figure_eight()
    nodes = path.table[1:-1, 0]
    jump = path.curvature(nodes) - path.curvature(nodes - 1e-9)
    assert np.abs(jump).max() < 2e-4 * np.abs(path.curvature(nodes)).max()


def test_two_way_points_make_a_line():
    path = ReferencePath.from_waypoints([(1.0, 1.0), (4.0, 5.0)])
    assert path.length == pytest.approx(5.0)
    assert path.heading(2.0) == pytest.approx(math.atan2(4.0, 3.0))
    assert path.curvature(2.0) == pytest.approx(0.0, abs=1e-12)


def test_closing_is_found_out_or_asked_for():
    ring = circle_points(20.0, 2.0)
    closed = np.vstack([ring, ring[:1]])
    assert ReferencePath.from_waypoints(closed).closed
    assert ReferencePath.from_waypoints(ring).closed
    assert not ReferencePath.from_waypoints(ring, closed=False).closed
    assert not ReferencePath.from_waypoints(ring[:-4]).closed
    np.testing.assert_array_equal(
        ReferencePath.from_waypoints(ring, closed=True).table, ReferencePath.from_waypoints(closed).table
    )
    assert not ReferencePath.from_waypoints(closed, closed=False).closed
    assert not ReferencePath.from_segments([Arc(40.0 * math.pi, 0.05)], closed=False).closed


def test_a_step_of_five_centimetres_stays_one():
    path = ReferencePath.from_waypoints([(0, 0), (10, 0), (20, 0), (20.1, 0.05), (30, 0.05), (40, 0.05), (60, 0.05)])
    _, y = path.to_cartesian(np.linspace(0.0, path.length, 500), 0.0)
    assert y.min() > -0.03
    assert y.max() < 0.08
    assert np.abs(path.curvature(np.linspace(0.0, path.length, 500))).max() < 0.02
    assert "smoothed along" in path.notes[-1]


@pytest.mark.parametrize("closed", [False, True])
def test_uneven_spacing_does_not_swing_off(closed):
    angle = np.cumsum([0.5, 0.02, 0.02, 0.5, 0.02, 0.3, 0.3, 0.02, 0.5] * 2 + [0.5, 0.5, 0.5, 0.02, 0.5])
    points = 40.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    path = ReferencePath.from_waypoints(points, closed=closed)
    assert furthest(path, np.vstack([points, points[:1]]) if closed else points) <= 0.1


def test_what_cannot_hold_to_the_way_points_is_refused_with_the_place_and_smoothing_is_told():
    corner = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (20.0, 10.0), (20.0, 20.0)]
    with pytest.raises(InputError, match="turn by 90 degrees here") as caught:
        ReferencePath.from_waypoints(corner)
    assert caught.value.where == "road.waypoints[2]"
    path = ReferencePath.from_waypoints(corner, smooth=1.5)
    assert 0.1 < furthest(path, corner) <= 1.5
    assert "strays from the way-points by up to" in path.notes[-1]


def test_repeated_points_merge_and_the_first_is_named(tmp_path):
    (tmp_path / "centre.csv").write_text("x,y\n0,0\n5,1\n5.004,1\n9,2\n14,3\n14,3\n")
    path = ReferencePath.from_csv(tmp_path / "centre.csv")
    assert path.notes == (f"merged 2 way-points closer than 1 cm to the one before, first {tmp_path / 'centre.csv'}:4",)
    assert len(path.given.points) == 4


def test_widths_of_a_file_are_looked_up_by_station(tmp_path):
    rows = "".join(f"{x},0,{3 + x / 100},{2 if x < 50 else 4}\n" for x in range(0, 101, 10))
    (tmp_path / "track.csv").write_text("# x_m,y_m,w_tr_right_m,w_tr_left_m\n" + rows)
    path = ReferencePath.from_csv(tmp_path / "track.csv")
    left, right = path.widths(np.array([-5.0, 0.0, 25.0, 45.0, 100.0, 120.0]))
    np.testing.assert_allclose(right, [3.0, 3.0, 3.25, 3.45, 4.0, 4.0], atol=1e-9)
    np.testing.assert_allclose(left, [2.0, 2.0, 2.0, 3.0, 4.0, 4.0], atol=1e-9)
    for s, both in zip((-5.0, 25.0, 45.0, 120.0), np.column_stack([left, right])[[0, 2, 3, 5]], strict=True):
        assert widths_at(path.edges.table, path.edges.spacing, path.period, s) == pytest.approx(tuple(both))
    with pytest.raises(InputError, match=r"road\.width_left"):
        path.with_edges(Widths.at_stations([0.0, 1.0], [1.0, -1.0], [1.0, 1.0], path.length, False))


# CSV


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n10,1\n20,4\n",
        "x,y\n0,0\n10,1\n20,4\n",
        "\ufeffs;x [m];y [m]\n0;0;0\n\n10.1;10;1\n20.2;20;4\n",
        "# centre line\n# x_m, y_m, w_right, w_left\n0,0,3,3\n10,1,3,3\n20,4,3,3\n",
        '"X"\t"Y"\n0\t0\n10\t1\n20\t4\n',
    ],
)
def test_csv_dialects(tmp_path, text):
    file = tmp_path / "centre.csv"
    file.write_text(text, encoding="utf-8")
    expected = ReferencePath.from_waypoints([(0.0, 0.0), (10.0, 1.0), (20.0, 4.0)])
    np.testing.assert_array_equal(ReferencePath.from_csv(file).table, expected.table)


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("x,y\n0,0\n1,oops\n", ":3", "'oops' is not a number"),
        ("x,y\n0,0\n1\n", ":3", "only 1 column"),
        ("x;y\n0;0\n1,5;2,5\n", ":3", "'1,5' is not a number"),
        ("x,y\n0,0\nnan,1\n", ":3", "not finite"),
        ("easting,northing\n0,0\n", ":1", "no columns x and y"),
        ("x,y\n", "", "0 points"),
        ("0,0\n", "", "1 points"),
    ],
)
def test_csv_errors_name_file_and_line(tmp_path, text, line, problem):
    file = tmp_path / "centre.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=problem) as caught:
        ReferencePath.from_csv(file)
    assert caught.value.where == f"{file}{line}"


def test_csv_that_cannot_be_read(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    for name in ("missing.csv", "binary.csv"):
        with pytest.raises(InputError, match=r"\.csv: cannot be read"):
            ReferencePath.from_csv(tmp_path / name)
