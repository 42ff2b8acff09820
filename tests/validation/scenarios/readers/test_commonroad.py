import math

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.validation.geometry import obstacle_poses
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.scenarios.readers.formats import read_foreign, to_toml
from sidestep.validation.scenarios.scenario import load_scenario, parse_scenario


def bound(tag, points):
    return f"<{tag}>" + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in points) + f"</{tag}>"


def lanelet(key, x0, x1, low, high, links=""):
    xs = np.linspace(x0, x1, 5)
    left, right = bound("leftBound", [(x, high) for x in xs]), bound("rightBound", [(x, low) for x in xs])
    return f'<lanelet id="{key}">{left}{right}{links}</lanelet>'


def exact(tag, value):
    return f"<{tag}><exact>{value}</exact></{tag}>"


def state(tag, time, x, y, yaw=0.0, speed=None):
    position = f"<position><point><x>{x}</x><y>{y}</y></point></position>"
    velocity = "" if speed is None else exact("velocity", speed)
    return f"<{tag}>{exact('time', time)}{position}{exact('orientation', yaw)}{velocity}</{tag}>"


CAR = "<shape><rectangle><length>4.0</length><width>2.0</width></rectangle></shape>"
# Two lanes ahead in two pieces, and one that comes towards them.
MAP = (
    lanelet(1, 0, 100, 0, 3.5, '<successor ref="3"/><adjacentLeft ref="2" drivingDir="same"/>')
    + lanelet(
        2,
        0,
        100,
        3.5,
        7,
        '<successor ref="4"/><adjacentRight ref="1" drivingDir="same"/><adjacentLeft ref="5" drivingDir="opposite"/>',
    )
    + lanelet(3, 100, 200, 0, 3.5, '<predecessor ref="1"/><adjacentLeft ref="4" drivingDir="same"/>')
    + lanelet(4, 100, 200, 3.5, 7, '<predecessor ref="2"/><adjacentRight ref="3" drivingDir="same"/>')
    + lanelet(5, 100, 0, 10.5, 7, '<adjacentLeft ref="2" drivingDir="opposite"/>')
)
MOVING = (
    f'<dynamicObstacle id="20"><type>car</type>{CAR}{state("initialState", 0, 50, 1.75, 0.0, 5.0)}<trajectory>'
    + "".join(state("state", k, 50 + 0.5 * k, 1.75 + 0.01 * k) for k in range(1, 21))
    + "</trajectory></dynamicObstacle>"
)
STANDING = (
    f'<staticObstacle id="21"><type>parkedVehicle</type>{CAR}{state("initialState", 0, 150, 5.0, 0.3)}</staticObstacle>'
)
FAR_OFF = (
    f'<staticObstacle id="22"><type>parkedVehicle</type>{CAR}{state("initialState", 0, 150, 90.0)}</staticObstacle>'
)
GOAL = (
    "<goalState><time><intervalStart>10</intervalStart><intervalEnd>30</intervalEnd></time>"
    '<position><lanelet ref="3"/></position></goalState>'
)


def problem(goal=GOAL, x=10.0, y=1.75, yaw=0.0, speed=10.0):
    return f'<planningProblem id="9">{state("initialState", 0, x, y, yaw, speed)}{goal}</planningProblem>'


def document(body, version="2020a"):
    head = f'timeStepSize="0.1" commonRoadVersion="{version}" benchmarkID="TST_One-1_1_T-1"'
    return f"<commonRoad {head}>{body}</commonRoad>"


@pytest.fixture
def file(tmp_path):
    def write(body, version="2020a"):
        (tmp_path / "scene.xml").write_text(document(body, version))
        return tmp_path / "scene.xml"

    return write


def test_start_road_and_goal(file):
    scenario = load_scenario(file(MAP + MOVING + STANDING + problem()))
    assert (scenario.name, scenario.speed, scenario.duration) == ("TST_One-1_1_T-1", 10.0, 3.0)
    assert (scenario.start.x, scenario.start.y, scenario.start.v_x) == pytest.approx((10.0, 1.75, 10.0))
    assert scenario.path.length == pytest.approx(200.0)
    s, _, _ = scenario.path.project(50.0, 1.75)
    left, right = scenario.path.widths(s)
    assert (left, right) == pytest.approx((8.75, 1.75))  # the lane beside and the one that comes
    assert scenario.path.widths(180.0)[0] == pytest.approx(5.25)
    assert scenario.goal.time == [1.0, 3.0]
    assert scenario.goal.s == pytest.approx([100.0, 200.0])


def test_obstacles_are_where_the_file_says(file):
    scenario = load_scenario(file(MAP + MOVING + STANDING + FAR_OFF + problem()))
    moving, standing = scenario.obstacles
    poses = obstacle_poses(scenario.path, moving, np.array([0.0, 0.55, 2.0]))
    np.testing.assert_allclose(poses[:2].T, [[50.0, 1.75], [52.75, 1.805], [60.0, 1.95]], atol=1e-9)
    assert moving.vanishes == pytest.approx(2.05)
    assert obstacle_poses(scenario.path, standing, np.zeros(1))[:, 0] == pytest.approx((150.0, 5.0, 0.3))
    assert any("1 obstacles never come within" in note for note in scenario.notes)


def test_a_change_of_lane_leads_the_reference_over(file):
    scenario = load_scenario(file(MAP + problem(GOAL.replace('ref="3"', 'ref="4"'))))
    y = scenario.path.to_cartesian(np.array([0.0, 10.0, 99.0, 150.0]), 0.0)[1]
    np.testing.assert_allclose(y, [1.75, 1.75, 5.25, 5.25], atol=0.1)
    assert any("changes of lane" in note for note in scenario.notes)


@pytest.mark.parametrize(
    ("shape", "size", "note"),
    [
        ("<circle><radius>0.5</radius></circle>", (1.0, 1.0), "circle"),
        (bound("polygon", [(-1, -1), (3, 0), (-1, 1)]), (4.0, 2.0), "polygon"),
    ],
)
def test_other_shapes_are_bounded_by_boxes_that_say_so(file, shape, size, note):
    body = STANDING.replace(CAR, f"<shape>{shape}</shape>")
    scenario = load_scenario(file(MAP + body + problem()))
    (box,) = scenario.obstacles
    assert (box.length, box.width) == size
    assert any(note in text for text in scenario.notes)
    x, y, _ = obstacle_poses(scenario.path, box, np.zeros(1))[:, 0]
    shift = 1.0 if note == "polygon" else 0.0
    assert (x, y) == pytest.approx((150.0 + shift * math.cos(0.3), 5.0 + shift * math.sin(0.3)))


def test_the_older_format(file):
    body = MOVING.replace("dynamicObstacle", "obstacle").replace(
        "<type>car</type>", "<role>dynamic</role><type>car</type>"
    )
    scenario = load_scenario(file(MAP + body + problem(), "2018b"))
    assert len(scenario.obstacles) == 1


def test_what_is_assumed_is_listed(file):
    text = MAP + "<trafficSign/>" + problem("", speed=0.0) + problem()
    scenario = load_scenario(file(text, "2031x"))
    words = " ".join(scenario.notes)
    for word in ("2031x", "trafficSign", "no place is asked", "3 m/s are asked", "planning problem 9 is driven"):
        assert word in words


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("", "has no lanelet"),
        (MAP, "has no planning problem"),
        (MAP + problem(x=10.0, y=-50.0), "starts beside every lanelet"),
        (MAP + problem(yaw=1.6), "starts across or against its lane"),
        (MAP + problem(GOAL.replace('ref="3"', 'ref="5"')), "no way over the lanelets"),
        (MAP + '<phantomObstacle id="3"/>' + problem(), "hides what is behind it"),
        (MAP + MOVING.replace("<trajectory>", "<occupancySet/><trajectory>") + problem(), "is a set of places"),
        (MAP + STANDING.replace("rectangle", "ellipse") + problem(), "'ellipse' cannot be used"),
        (MAP + STANDING.replace("<width>2.0", "<width>-2.0") + problem(), "width: -2.0 m"),
        (MAP + STANDING.replace("<x>150", "<x>1e400") + problem(), "a finite number"),
        (MAP.replace("<x>25.0", "<x>oops", 1) + problem(), "'oops' is not a number"),
    ],
)
def test_what_changes_the_outcome_is_refused(file, body, words):
    with pytest.raises(InputError) as caught:
        load_scenario(file(body or problem()))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_written_is_what_was_read(file):
    path = file(MAP + MOVING + STANDING + problem())
    imported = read_foreign(path)
    again = parse_scenario(to_toml(imported.tables, imported.notes), "again")
    direct = load_scenario(path)
    assert again.tables == direct.tables
    np.testing.assert_array_equal(again.path.table, direct.path.table)


@pytest.mark.closed_loop
def test_a_read_scene_drives(file):
    recording, judgement = simulate(load_scenario(file(MAP + MOVING + problem()), ["plant.kind=linear"]))
    assert judgement.min_clearance > 0.0
    assert recording["time"][-1] > 2.9
