import json

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from sidestep.validation.report.explore.chart_data import MOST_POINTS, chart_data
from sidestep.validation.report.style import BLUE, timeline


def charts(figure):
    return json.loads(chart_data(figure))


def only(figure):
    (chart,) = charts(figure)["charts"]
    return chart


def test_a_line_is_what_was_plotted():
    figure = Figure()
    axes = timeline(figure.subplots())
    axes.plot([0.0, 1.0, 2.0], [5.0, np.nan, 7.0], "--", color=BLUE, label="speed")
    axes.plot([0.0, 2.0], [1.0, 2.0], color="#123456", drawstyle="steps-post")
    axes.set(title="Speed", xlabel="time  [s]", xlim=(0.0, 2.0))
    chart = only(figure)
    first, second = chart["series"]
    assert (first["x"], first["y"]) == ([0.0, 1.0, 2.0], [5.0, None, 7.0])
    assert (first["name"], first["colour"], "dashes" in first) == ("speed", "var(--blue)", True)
    assert (second["colour"], second["steps"], "name" in second) == ("#123456", True, False)
    assert chart["time"]
    assert (chart["title"], chart["x"]["label"], chart["x"]["limits"]) == ("Speed", "time  [s]", [0.0, 2.0])


def test_lines_across_the_axes_stand_where_they_were_put():
    figure = Figure()
    axes = figure.subplots()
    axes.axvline(0.25)
    axes.axhline(-3.0, label="limit")
    upright, level = only(figure)["series"]
    assert (upright["kind"], upright["at"]) == ("upright", 0.25)
    assert (level["kind"], level["at"], level["name"]) == ("level", -3.0, "limit")


def test_areas_and_bars_keep_their_corners():
    figure = Figure()
    axes = figure.subplots()
    axes.fill_between([0.0, 1.0], [1.0, 2.0], [3.0, 4.0], color="red", alpha=0.5)
    axes.bar([2.0], [5.0], width=0.5)
    axes.add_collection(PolyCollection([[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]] * 2, facecolor="none", edgecolor="k"))
    by_size = {len(one["shapes"]): one for one in only(figure)["series"]}
    boxes = by_size[2]
    assert (boxes["shapes"][0]["fill"], boxes["shapes"][1]["edge"]) == (None, ["#000000", 1.0])
    band, bar = (
        next(one for one in only(figure)["series"] if len(one["shapes"]) == 1 and one["shapes"][0]["fill"][1] == alpha)
        for alpha in (0.5, 1.0)
    )
    points = np.array(band["shapes"][0]["rings"][0]).reshape(-1, 2)
    assert {tuple(point) for point in points} == {(0.0, 1.0), (1.0, 2.0), (1.0, 4.0), (0.0, 3.0)}
    corners = np.array(bar["shapes"][0]["rings"][0]).reshape(-1, 2)
    assert (corners.min(axis=0).tolist(), corners.max(axis=0).tolist()) == ([1.75, 0.0], [2.25, 5.0])


def test_points_lead_where_they_are_told():
    figure = Figure()
    cloud = figure.subplots().scatter([1.0, 2.0], [3.0, 4.0], c=[0.0, 1.0])
    cloud.set_urls(["#row-7", "#row-8"])
    (points,) = only(figure)["series"]
    assert (points["x"], points["y"], points["urls"]) == ([1.0, 2.0], [3.0, 4.0], ["#row-7", "#row-8"])
    assert len(set(points["colour"])) == 2


def test_contours_and_their_colours_are_read():
    figure = Figure()
    axes = figure.subplots()
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41))
    filled = axes.contourf(x, y, x**2 + y**2, levels=[0.0, 0.25, 0.5])
    figure.colorbar(filled).set_label("square [m²]")
    data = charts(figure)
    (bands,) = data["charts"][0]["series"]
    assert [len(shape["rings"]) for shape in bands["shapes"]] == [1, 2]  # the outer band has a hole
    hole = min((np.array(ring).reshape(-1, 2) for ring in bands["shapes"][1]["rings"]), key=np.ptp)
    assert np.allclose(np.hypot(*hole.T), 0.5, atol=0.01)
    (shades,) = data["shades"]
    assert (shades["label"], shades["stops"][0][0]) == ("square [m²]", "0")


def test_axes_keep_direction_scale_and_names_of_their_ticks():
    figure = Figure()
    left, right = figure.subplots(1, 2)
    left.plot([1.0, 100.0], [0.0, 1.0])
    left.set_xscale("log")
    left.invert_yaxis()
    right.barh([0, 1], [3.0, 4.0])
    right.set_yticks([0, 1], ["one", "two"])
    data = charts(figure)
    first, second = data["charts"]
    assert data["columns"] == 2
    assert first["x"]["log"]
    assert first["y"]["limits"][0] > first["y"]["limits"][1]
    assert second["y"]["ticks"] == [[0.0, "one"], [1.0, "two"]]


def test_a_long_line_keeps_its_extremes():
    y = np.zeros(100_000)
    y[12_345], y[77_777] = 9.0, -9.0
    figure = Figure()
    figure.subplots().plot(np.arange(100_000.0), y)
    (line,) = only(figure)["series"]
    assert len(line["y"]) <= MOST_POINTS
    assert (max(line["y"]), min(line["y"])) == (9.0, -9.0)
    assert line["x"] == sorted(line["x"])


def test_numbers_are_as_fine_as_a_deep_zoom_needs_and_no_finer():
    figure = Figure()
    figure.subplots().plot([0.0, 1e-4], [1e6 / 3.0, 1e6])
    (line,) = only(figure)["series"]
    assert line["y"][0] == pytest.approx(1e6 / 3.0, abs=1.0)
    assert line["x"][1] == 1e-4
    assert len(str(line["y"][0])) <= 9


def test_a_figure_with_something_else_in_it_stays_a_picture():
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.0, 1.0])
    assert chart_data(figure) is not None
    axes.set_yscale("symlog")
    assert chart_data(figure) is None


def test_what_is_written_cannot_end_the_element_that_holds_it():
    figure = Figure()
    figure.subplots().plot([0.0, 1.0], label="</script>")
    assert "<" not in chart_data(figure)
