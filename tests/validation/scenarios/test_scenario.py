import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.validation.geometry import car_boxes, obstacle_boxes, signed_clearance
from sidestep.validation.scenarios.library import built_in_scenarios
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.scenarios.tables import override

SMALL = """
name = "small"
speed = 10
duration = 2
[road]
width_left = 3
width_right = 2.5
segments = [{ type = "line", length = 50 }, { type = "arc", length = 20.0, curvature = 0.02 }]
"""


@pytest.fixture
def file(tmp_path):
    def write(text=SMALL, name="small.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def problem(*arguments, **keywords):
    with pytest.raises(InputError) as caught:
        load_scenario(*arguments, **keywords)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_papers_scenes_are_those_of_the_issue():
    single, double = load_scenario("single-obstacle"), load_scenario("double-obstacle")
    for scene in (single, double):
        assert (scene.speed, scene.duration, scene.path.length, scene.vehicle.name) == (15.0, 8.0, 150.0, "bmw-320i")
        assert (scene.start.x, scene.start.y, scene.start.yaw, scene.start.v_x) == (0.0, 0.0, 0.0, 15.0)
        assert (scene.controller.width_left, scene.controller.width_right, scene.controller.buffer) == (4.0, 4.0, 0.2)
        assert scene.controller.cruise_speed == 15.0
    assert single.obstacles == (Obstacle(40.0, 0.0, 4.5, 1.8),)
    assert double.obstacles == (Obstacle(40.0, -0.6, 4.5, 1.8), Obstacle(70.0, 0.8, 4.5, 1.8))


@pytest.mark.parametrize("name", built_in_scenarios())
def test_every_built_in_scene_loads_and_describes_itself(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description


@pytest.mark.parametrize(("name", "widths"), [("moose", (2.021, 2.61, 3.0)), ("lane-change", (2.021, 2.182, 2.343))])
def test_lanes_have_the_standards_widths_for_this_car(name, widths):
    scenario = load_scenario(name)
    walls = scenario.obstacles
    for right, left, width in zip(walls[::2], walls[1::2], widths, strict=True):
        assert left.l - left.width / 2.0 - (right.l + right.width / 2.0) == pytest.approx(width, abs=1e-4)
        # nothing is left open beside the lanes
        assert right.l - right.width / 2.0 == pytest.approx(-scenario.controller.width_right, abs=1e-4)
        assert left.l + left.width / 2.0 == pytest.approx(scenario.controller.width_left, abs=1e-4)


def test_a_file_needs_no_more_than_the_road(file):
    scenario = load_scenario(file())
    assert scenario.path.length == pytest.approx(70.0)
    assert scenario.plant.kind == "mujoco"
    assert scenario.obstacles == ()
    assert scenario.start.v_x == 10.0


def test_the_start_is_given_along_the_road(file):
    scenario = load_scenario(file(), ["start.s=60", "start.l=0.5", "start.heading=0.1", "start.speed=4"])
    s, offset, heading = scenario.path.project(scenario.start.x, scenario.start.y)
    assert (s, offset) == (pytest.approx(60.0), pytest.approx(0.5))
    assert scenario.start.yaw == pytest.approx(heading + 0.1) == pytest.approx(0.02 * 10.0 + 0.1)
    assert scenario.start.v_x == 4.0


def test_waypoints_are_found_beside_the_file(file, tmp_path):
    (tmp_path / "centre.csv").write_text("x,y\n" + "".join(f"{x},0\n" for x in range(0, 101, 10)))
    text = SMALL[: SMALL.index("segments")] + 'waypoints = "centre.csv"\n'
    assert load_scenario(file(text)).path.length == pytest.approx(100.0)


def test_a_vehicle_file_is_found_beside_the_file(file, tmp_path):
    original = load_scenario("single-obstacle").vehicle
    numbers = [n for n in original.__dataclass_fields__ if n not in ("name", "tyre", "suspension", "steering_ratio")]
    (tmp_path / "car.toml").write_text("\n".join(f"{n} = {getattr(original, n)}" for n in numbers))
    vehicle = load_scenario(file(), ["vehicle.file=car.toml", "vehicle.mass=1500"]).vehicle
    assert (vehicle.name, vehicle.mass, vehicle.l_f) == ("car", 1500.0, original.l_f)


@pytest.mark.parametrize(
    ("text", "get", "value"),
    [
        ("speed=18.9", lambda s: s.speed, 18.9),
        ("speed = 18", lambda s: s.controller.cruise_speed, 18.0),
        ("plant.friction=0.6", lambda s: s.plant.friction, 0.6),
        ("plant.kind=linear", lambda s: s.plant.kind, "linear"),
        ('plant.kind="single-track"', lambda s: s.plant.kind, "single-track"),
        ("controller.preset=paper", lambda s: s.controller_preset, "paper"),
        ("controller.buffer=0.3", lambda s: s.controller.buffer, 0.3),
        ("road.width_left=5", lambda s: s.controller.width_left, 5.0),
        ("road.segments.0.length=90.5", lambda s: s.path.length, 90.5),
        ("obstacles.1.l=1", lambda s: s.obstacles[1].l, 1.0),
        ("obstacles[1].speed=2", lambda s: s.obstacles[1].speed, 2.0),
        ("obstacles=[]", lambda s: s.obstacles, ()),
        ('obstacles.0={s=50, l=0, length=1, width=1}', lambda s: s.obstacles[0], Obstacle(50.0, 0.0, 1.0, 1.0)),
        ("vehicle.preset=vw-vanagon", lambda s: s.vehicle.name, "vw-vanagon"),
        ("vehicle.mass=1400", lambda s: s.vehicle.mass, 1400.0),
        ("vehicle.tyre.p_dy1=0.9", lambda s: s.vehicle.tyre.p_dy1, 0.9),
        ("vehicle.suspension.spring_front=3e4", lambda s: s.vehicle.suspension.spring_front, 3e4),
    ],
)  # fmt: skip
def test_set_reaches_every_kind_of_key(text, get, value):
    assert get(load_scenario("double-obstacle", [text])) == value


def test_the_last_set_wins():
    assert load_scenario("double-obstacle", ["speed=1", "speed=12"]).speed == 12.0


def test_an_fmu_is_found_from_the_files_folder_and_named_without_it(file, tmp_path):
    plant = load_scenario(file(), ["plant.kind=car.fmu", "plant.map=car.toml"]).plant
    assert (plant.kind, plant.map) == (str(tmp_path / "car.fmu"), str(tmp_path / "car.toml"))
    assert plant.name == "car"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sped=3", "double-obstacle: sped: unknown key, did you mean speed?"),
        ("road.widht_left=3", "road.widht_left: unknown key, did you mean width_left?"),
        ("controller.width_left=2", "controller.width_left: unknown key"),
        ("vehicle.mas=3", "vehicle.mas: unknown key, did you mean mass?"),
        ("vehicle.tyre.p_dy=3", "vehicle.tyre.p_dy: unknown key"),
        ("plant.frictoin=3", "plant.frictoin: unknown key, did you mean friction?; allowed: kind, friction"),
        ("obstacles.1.wdith=3", "obstacles[1].wdith: unknown key, did you mean width?"),
        ("road.segments.0.radius=3", "road.segments[0].radius: unknown key"),
        ("speed=abc", "speed: 'abc' cannot be used; allowed: a number"),
        ("speed=true", "speed: True cannot be used; allowed: a number"),
        ("speed=-1", "speed: -1.0; allowed: 0.01 to 150 m/s"),
        ("speed=nan", "speed: nan"),
        ("duration=inf", "duration: inf; allowed: 0.001 to 100000 s"),
        ("name=a/b", "name: 'a/b' cannot be used"),
        ("road=3", "road: 3 cannot be used; allowed: a table"),
        ("obstacles=3", "obstacles: 3 cannot be used; allowed: a list"),
        ("obstacles=[3]", "obstacles[0]: 3 is not a table"),
        ("obstacles=[{s=1}]", "obstacles[0].l: missing"),
        ("road.width_left=-4", "road.width_left: -4.0; allowed: 0.01 to 1000 m"),
        ("obstacles.0.width=-1.8", "obstacles[0].width: -1.8; allowed: 0.001 to 10000 m"),
        ("obstacles.0.s=2", "obstacles[0]: stands on the start of the car"),
        ("start.l=3.9", "start.l: the car stands 0.7"),
        ("start.s=-3", "start.s: -3.0 m is not on the road; allowed: 0 to 150"),
        ("start.s=151", "start.s: 151.0 m is not on the road"),
        ("road.segments=[]", "road: needs either segments or waypoints"),
        ("road.waypoints=a.csv", "road: needs either segments or waypoints"),
        ("road.segments.0.type=lin", "road.segments[0].type: 'lin'; allowed: line, arc, clothoid"),
        ("road.segments.0.length=-1", "road.segments[0].length: -1.0 m; allowed: 0 < length"),
        ("road.segments=[3]", "road.segments[0].type: None; allowed: line, arc, clothoid"),
        ("vehicle.preset=bmw", "vehicle.preset: unknown preset 'bmw'; allowed: bmw-320i"),
        ("vehicle.mass=-3", "vehicle.mass: -3.0; allowed: 0.1 to 1e+06 kg"),
        ("vehicle.file=none.toml", "none.toml"),
        ("controller.preset=papr", "controller.preset: unknown preset 'papr'; allowed: default, paper"),
        ("controller.period=0", "controller.period: 0.0; allowed: 0.001 to 0.2 s"),
        ("plant.friction=0", "plant.friction: 0.0; allowed: 0.001 to 10"),
        ("speed", "--set: 'speed' is not key=value"),
        ("speed.x=1", "--set speed.x: 'speed' holds a value, not a table"),
        ("obstacles.7.s=2", "--set obstacles.7.s: no entry '7' in a list of 2"),
        ("obstacles.one=2", "--set obstacles.one: no entry 'one' in a list of 2"),
    ],
)
def test_every_error_names_the_key_and_what_is_allowed(text, words):
    assert words in problem("double-obstacle", [text])


def test_errors_of_files_name_the_file(file, tmp_path):
    assert "did you mean moose?" in problem("mose")
    assert "allowed: blocked, double-obstacle" in problem("mose")
    assert str(tmp_path / "small.toml") in problem(file("speed = "))
    assert f"{tmp_path / 'small.toml'}: road: missing" in problem(file('name = "x"\nspeed = 1\nduration = 1\n'))
    bytes_file = tmp_path / "bytes.toml"
    bytes_file.write_bytes(b"\xff\xfe")
    assert str(bytes_file) in problem(bytes_file)


def test_an_obstacle_beside_the_road_is_allowed(file):
    assert load_scenario(file(), ["obstacles=[{s=5, l=9, length=4, width=2}]"]).obstacles[0].l == 9.0


@settings(deadline=None)
@given(s=st.floats(3.0, 12.0), offset=st.floats(-2.0, 2.0), heading=st.floats(-math.pi, math.pi))
def test_a_start_is_refused_exactly_when_the_boxes_touch(s, offset, heading):
    scene = load_scenario("single-obstacle")
    box = Obstacle(s, offset, 4.5, 1.8, heading)
    gap = signed_clearance(car_boxes(scene.vehicle, 0.0, 0.0, 0.0), obstacle_boxes(scene.path, box, np.zeros(1)))[0]
    overrides = [f"obstacles.0.{key}={getattr(box, key)!r}" for key in ("s", "l", "heading")]
    if gap > 0.0:
        assert load_scenario("single-obstacle", overrides).obstacles == (box,)
    else:
        assert "stands on the start" in problem("single-obstacle", overrides)


@settings(deadline=None)
@given(st.text("ab.c[]019 x", max_size=10), st.text(max_size=8))
def test_overrides_never_fail_but_by_input_errors(key, value):
    tables = {"a": {"b": [1, {"c": 2}]}}
    try:
        override(tables, f"{key}={value}")
    except InputError:
        assert tables == {"a": {"b": [1, {"c": 2}]}}
