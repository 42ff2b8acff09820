import math

import numpy as np
import pytest
from scipy.integrate import quad

from sidestep.plant_models.errors import InputError
from sidestep.validation.scenarios.readers.openscenario.opendrive import Geometry, read_opendrive
from sidestep.validation.scenarios.readers.openscenario.road_table import RoadTable

LANES = """<lanes><laneOffset s="0" a="0.5" b="0" c="0" d="0"/><laneSection s="0">
<left><lane id="1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane></left>
<center><lane id="0" type="none"/></center>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0.01" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/>
<width sOffset="40" a="3" b="0.05" c="0" d="0"/></lane>
<lane id="-3" type="shoulder"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane></right></laneSection></lanes>"""


def road(pieces, lanes=LANES, more=""):
    body, s = "", 0.0
    for x, y, heading, length, kind in pieces:
        body += f'<geometry s="{s}" x="{x}" y="{y}" hdg="{heading}" length="{length}">{kind}</geometry>'
        s += length
    head = f'<road id="7" length="{s}" junction="-1">'
    return f"<OpenDRIVE>{head}<planView>{body}</planView>{more}{lanes}</road></OpenDRIVE>"


@pytest.fixture
def read(tmp_path):
    def write(text):
        (tmp_path / "a.xodr").write_text(text)
        return read_opendrive(tmp_path / "a.xodr")

    return write


def test_a_spiral_is_the_integral_of_its_heading():
    piece = Geometry(0.0, 3.0, -1.0, 0.4, 80.0, "spiral", (-0.01, 0.03))
    for u in (0.0, 13.0, 80.0):

        def heading(t):
            return 0.4 - 0.01 * t + 0.5 * 0.04 / 80.0 * t * t

        expected = [
            3.0 + quad(lambda t: math.cos(heading(t)), 0.0, u)[0],
            -1.0 + quad(lambda t: math.sin(heading(t)), 0.0, u)[0],
            heading(u),
        ]
        np.testing.assert_allclose(piece.poses(np.array([u]))[:, 0], expected, atol=1e-9)


def test_an_arc_is_a_circle():
    x, y, heading = Geometry(0.0, 0.0, 0.0, 0.0, 100.0, "arc", (0.02,)).poses(np.array([50.0]))
    assert (x[0], y[0], heading[0]) == pytest.approx((50.0 * math.sin(1.0), 50.0 * (1.0 - math.cos(1.0)), 1.0))


@pytest.mark.parametrize("normalised", [0.0, 1.0])
def test_a_parametric_cubic_goes_through_its_ends(normalised):
    length = 50.0
    scale = length if normalised else 1.0
    values = (0.0, scale, 0.0, 0.0, 0.0, 0.0, 0.004 * scale**2, 0.0, normalised)
    x, y, heading = Geometry(0.0, 0.0, 0.0, 0.0, length, "paramPoly3", values).poses(np.array([length]))
    assert (x[0], y[0], heading[0]) == pytest.approx((length, 0.004 * length**2, math.atan(0.008 * length)))


def test_a_cubic_is_run_along_its_arc():
    piece = Geometry(0.0, 0.0, 0.0, 0.0, 60.0, "poly3", (0.0, 0.0, 0.01, 0.0))
    x, y, heading = piece.poses(np.array([0.0, 20.0, 40.0]))
    np.testing.assert_allclose(y, 0.01 * x**2, atol=1e-9)
    np.testing.assert_allclose(np.tan(heading), 0.02 * x, atol=1e-9)
    arc = [quad(lambda u: math.hypot(1.0, 0.02 * u), 0.0, end)[0] for end in x]
    np.testing.assert_allclose(arc, [0.0, 20.0, 40.0], atol=1e-4)


def test_lanes_lie_side_by_side_from_the_lane_offset_on(read):
    one = read(road([(0, 0, 0, 100, "<line/>")]))["7"]
    inner, outer = one.borders(-2, [0.0, 50.0])
    np.testing.assert_allclose(inner, [0.5 - 3.5, 0.5 - 4.0])
    np.testing.assert_allclose(outer, [0.5 - 6.5, 0.5 - 4.0 - 3.5])
    assert one.centre(1, 10.0)[0] == pytest.approx(2.0)
    assert one.drivable_beside(-1, 10.0) == (-1, -2)
    assert (one.direction(-1), one.direction(1)) == (1, -1)
    assert one.lane_of(0.0, -4.0) == -2
    with pytest.raises(InputError, match="no lane -9"):
        one.borders(-9, 1.0)


def test_world_points_are_found_again(read):
    one = read(road([(0, 0, 0, 50, "<line/>"), (50, 0, 0, 60, '<arc curvature="0.02"/>')]))["7"]
    for s, t in ((20.0, 1.5), (75.0, -4.0), (-5.0, 1.0), (114.0, 0.5)):
        (x,), (y,), _ = one.world(s, t)
        assert one.locate(x, y) == pytest.approx((s, t), abs=1e-6)


def test_the_fast_table_agrees(read):
    one = read(road([(0, 0, 0, 50, "<line/>"), (50, 0, 0, 60, '<arc curvature="0.02"/>')]))["7"]
    table = RoadTable(one)
    for s in (-3.0, 0.0, 33.3, 80.2, 110.0, 120.0):
        (x,), (y,), (heading,) = one.world(s, -2.0)
        assert table.pose(s, -2.0) == pytest.approx((x, y, heading), abs=2e-3)
    assert table.centre(-1, 33.3) == pytest.approx(one.centre(-1, 33.3)[0])


def test_what_is_not_flat_is_noted(read):
    more = '<elevationProfile><elevation s="0" a="0" b="0.05" c="0" d="0"/></elevationProfile>'
    assert read(road([(0, 0, 0, 10, "<line/>")], more=more))["7"].notes == (
        "the road's elevation is left out: it is taken as flat",
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<OpenDRIVE/>", "has no road"),
        ("<other/>", "OpenDRIVE"),
        (road([(0, 0, 0, 10, "<loop/>")]), "unknown kind; allowed: line, arc, spiral, poly3, paramPoly3"),
        (road([], LANES), "has no plan view"),
        (road([(0, 0, 0, 10, "<line/>")], ""), "has no lane section"),
        (road([(0, 0, 0, 10, '<arc curvature="x"/>')]), "'x' is not a number"),
    ],
)
def test_what_cannot_be_used_is_refused(read, text, words):
    with pytest.raises(InputError) as caught:
        read(text)
    assert words in str(caught.value)
