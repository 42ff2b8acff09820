import math

import numpy as np
import pytest

from sidestep.plant_models.errors import InputError
from sidestep.validation.geometry import car_boxes, obstacle_boxes, obstacle_poses, signed_clearance
from sidestep.validation.scenarios.readers.openscenario.reader import variations
from sidestep.validation.scenarios.readers.safe_xml import read_xml
from sidestep.validation.scenarios.scenario import load_scenario

ROAD = """<OpenDRIVE><road id="0" length="1000" junction="-1"><planView>
<geometry s="0" x="0" y="0" hdg="0" length="1000"><line/></geometry></planView><lanes><laneSection s="0"><left>
<lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left><center><lane id="0"/></center>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road>
</OpenDRIVE>"""
CATALOGUE = """<OpenSCENARIO><Catalog name="cars"><Vehicle name="car"><BoundingBox><Center x="1.4" y="0" z="0.9"/>
<Dimensions width="2.0" length="5.0" height="1.8"/></BoundingBox></Vehicle></Catalog></OpenSCENARIO>"""


def private(name, *actions):
    body = "".join(f"<PrivateAction>{action}</PrivateAction>" for action in actions)
    return f'<Private entityRef="{name}">{body}</Private>'


def teleport(position):
    return f"<TeleportAction><Position>{position}</Position></TeleportAction>"


def lane(key, s, offset=0.0):
    return f'<LanePosition roadId="0" laneId="{key}" s="{s}" offset="{offset}"/>'


def speed(target, shape="step", dimension="time", value=0.0):
    dynamics = f'<SpeedActionDynamics dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/>'
    action = f"<SpeedAction>{dynamics}<SpeedActionTarget>{target}</SpeedActionTarget></SpeedAction>"
    return f"<LongitudinalAction>{action}</LongitudinalAction>"


def absolute(value):
    return f'<AbsoluteTargetSpeed value="{value}"/>'


def after(seconds):
    return f'<ByValueCondition><SimulationTimeCondition value="{seconds}" rule="greaterOrEqual"/></ByValueCondition>'


def trigger(tag, condition, delay=0, edge="none"):
    head = f'<Condition name="c" delay="{delay}" conditionEdge="{edge}">'
    return f"<{tag}><ConditionGroup>{head}{condition}</Condition></ConditionGroup></{tag}>"


def event(name, start, *actions, actor="Other"):
    body = "".join(
        f'<Action name="{name}{i}"><PrivateAction>{a}</PrivateAction></Action>' for i, a in enumerate(actions)
    )
    actors = f'<Actors selectTriggeringEntities="false"><EntityRef entityRef="{actor}"/></Actors>'
    inner = f'<Maneuver name="m"><Event name="{name}" priority="overwrite">{body}{start}</Event></Maneuver>'
    group = f'<ManeuverGroup maximumExecutionCount="1" name="g">{actors}{inner}</ManeuverGroup>'
    return f'<Story name="s"><Act name="a{name}">{group}{trigger("StartTrigger", after(0))}</Act></Story>'


EGO = private("Ego", teleport(lane(-2, 10)), speed(absolute("$v")))
OTHER = private("Other", teleport(lane(-1, 60)), speed(absolute(8.0)))


END = trigger("StopTrigger", after(10))


def document(init=EGO + OTHER, stories="", stop=END, name="Other"):
    model = '<CatalogReference catalogName="cars" entryName="car"/>'
    entities = "".join(f'<ScenarioObject name="{n}">{model}</ScenarioObject>' for n in ("Ego", name))
    return f"""<OpenSCENARIO><FileHeader revMajor="1" revMinor="1" description="a test"/><ParameterDeclarations>
<ParameterDeclaration name="v" parameterType="double" value="${{36 / 3.6}}"/></ParameterDeclarations>
<CatalogLocations><VehicleCatalog><Directory path="./cars"/></VehicleCatalog></CatalogLocations>
<RoadNetwork><LogicFile filepath="./road.xodr"/></RoadNetwork><Entities>{entities}</Entities>
<Storyboard><Init><Actions>{init}</Actions></Init>{stories}{stop}</Storyboard></OpenSCENARIO>"""


@pytest.fixture
def load(tmp_path):
    (tmp_path / "cars").mkdir()
    (tmp_path / "cars" / "cars.xosc").write_text(CATALOGUE, encoding="utf-8-sig")
    (tmp_path / "road.xodr").write_text(ROAD)

    def write(text, *overrides):
        (tmp_path / "scene.xosc").write_text(text)
        return load_scenario(tmp_path / "scene.xosc", overrides)

    return write


def way(scenario, times, index=0):
    """x and y of the other's rear axle."""
    x, y, yaw = obstacle_poses(scenario.path, scenario.obstacles[index], np.array(times))
    return np.column_stack([x - 1.4 * np.cos(yaw), y - 1.4 * np.sin(yaw)])


def test_road_start_and_outline(load):
    scenario = load(document())
    assert (scenario.name, scenario.description, scenario.speed, scenario.duration) == ("scene", "a test", 10.0, 10.0)
    car, start = scenario.vehicle, scenario.start
    assert (start.x - car.l_r, start.y, start.yaw, start.v_x) == pytest.approx((10.0, -5.25, 0.0, 10.0), abs=1e-5)
    corners = car_boxes(car, start.x, start.y, start.yaw)[0]
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((10.0 + 1.4 - 2.5, 10.0 + 1.4 + 2.5), abs=1e-5)
    assert np.ptp(corners[:, 1]) == pytest.approx(2.0)
    left, right = scenario.path.widths(50.0)
    assert (left, right) == pytest.approx((5.25, 1.75))
    np.testing.assert_allclose(way(scenario, [0.0, 5.0]), [[60.0, -1.75], [100.0, -1.75]], atol=1e-5)


def test_parameters_are_put_in_and_may_be_set(load):
    assert load(document(), "parameters.v=7").speed == 7.0
    with pytest.raises(InputError, match=r"parameters\.w: is not declared"):
        load(document(), "parameters.w=7")


@pytest.mark.parametrize(
    ("shape", "dimension", "value", "duration", "length"),
    [("linear", "rate", 2.0, 2.0, 12.0), ("linear", "time", 3.0, 3.0, 18.0), ("cubic", "rate", 2.0, 3.0, 18.0),
     ("sinusoidal", "rate", math.pi, 2.0, 12.0), ("linear", "distance", 30.0, 7.5 * math.log(2.0), 30.0)],
)  # fmt: skip
def test_speed_changes_by_time_rate_or_distance(load, shape, dimension, value, duration, length):
    story = event("brake", trigger("StartTrigger", after(2)), speed(absolute(4.0), shape, dimension, value))
    scenario = load(document(stories=story))
    places = way(scenario, [2.05, 2.05 + duration, 9.0, 10.0])[:, 0]
    assert places[3] - places[2] == pytest.approx(4.0, abs=1e-3)
    assert places[1] - places[0] == pytest.approx(length, abs=0.35)


def test_a_lane_change_takes_what_its_largest_lateral_speed_asks(load):
    target = '<LaneChangeTarget><RelativeTargetLane entityRef="Ego" value="0"/></LaneChangeTarget>'
    dynamics = '<LaneChangeActionDynamics dynamicsShape="sinusoidal" value="1.0" dynamicsDimension="rate"/>'
    change = f"<LateralAction><LaneChangeAction>{dynamics}{target}</LaneChangeAction></LateralAction>"
    scenario = load(document(stories=event("cut", trigger("StartTrigger", after(2)), change)))
    times = np.arange(0.0, 10.0, 0.1)
    places = way(scenario, times)
    np.testing.assert_allclose(places[[0, -1], 1], [-1.75, -5.25], atol=1e-4)
    across = np.gradient(places[:, 1], times)
    assert np.abs(across).max() == pytest.approx(1.0, abs=0.02)
    speeds = np.hypot(across, np.gradient(places[:, 0], times))
    np.testing.assert_allclose(speeds[1:-1], 8.0, atol=0.1)


def test_a_lane_offset_keeps_its_largest_acceleration(load):
    target = '<LaneOffsetTarget><AbsoluteTargetLaneOffset value="1.0"/></LaneOffsetTarget>'
    dynamics = '<LaneOffsetActionDynamics maxLateralAcc="0.5" dynamicsShape="sinusoidal"/>'
    shift = f'<LateralAction><LaneOffsetAction continuous="false">{dynamics}{target}</LaneOffsetAction></LateralAction>'
    scenario = load(document(stories=event("swerve", trigger("StartTrigger", after(2)), shift)))
    times = np.arange(0.0, 10.0, 0.1)
    y = way(scenario, times)[:, 1]
    assert y[-1] == pytest.approx(-0.75, abs=1e-4)
    assert np.abs(np.gradient(np.gradient(y, times), times)).max() == pytest.approx(0.5, abs=0.06)


def test_distances_trigger_between_bumpers_at_the_cars_first_speed(load):
    near = (
        '<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="Ego"/>'
        "</TriggeringEntities>"
        '<EntityCondition><RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" value="30" '
        'freespace="true" rule="lessThan" coordinateSystem="entity"/></EntityCondition></ByEntityCondition>'
    )
    story = event("stop", trigger("StartTrigger", near, edge="rising"), speed(absolute(0.0)))
    scenario = load(document(stories=story))
    # 50 m apart, 45 m between the bumpers, closing at 2 m/s: 30 m are left after 7.5 s.
    places = way(scenario, [7.4, 8.0, 10.0])[:, 0]
    assert places[0] == pytest.approx(60.0 + 7.4 * 8.0, abs=1e-3)
    assert places[2] == pytest.approx(60.0 + 7.5 * 8.0, abs=0.5)
    car = car_boxes(scenario.vehicle, scenario.start.x + 75.0, scenario.start.y + 3.5, 0.0)
    assert signed_clearance(car, obstacle_boxes(scenario.path, scenario.obstacles[0], np.array([7.5])))[
        0
    ] == pytest.approx(30.0, abs=0.5)


def test_events_follow_each_other_with_a_delay(load):
    ended = (
        '<ByValueCondition><StoryboardElementStateCondition storyboardElementType="action" '
        'storyboardElementRef="first0" '
        'state="endTransition"/></ByValueCondition>'
    )
    stories = event("first", trigger("StartTrigger", after(1)), speed(absolute(4.0), "linear", "time", 2.0))
    stories += event("second", trigger("StartTrigger", ended, delay=2, edge="rising"), speed(absolute(0.0)))
    places = way(load(document(stories=stories)), [3.0, 5.0, 5.3, 9.0])[:, 0]
    assert places[1] - places[0] == pytest.approx(8.0, abs=0.3)
    assert places[3] == pytest.approx(places[2], abs=1e-6)


def test_the_leader_starts_at_its_time_gap(load):
    gap = (
        '<LongitudinalAction><LongitudinalDistanceAction continuous="false" freespace="true" timeGap="2.0" '
        'entityRef="Ego" coordinateSystem="entity" displacement="leadingReferencedEntity"/></LongitudinalAction>'
    )
    relative = '<RelativeLanePosition entityRef="Ego" dLane="0" ds="25" offset="0"/>'
    same = '<RelativeTargetSpeed entityRef="Ego" value="0" speedTargetValueType="delta" continuous="false"/>'
    scenario = load(document(EGO + private("Other", teleport(relative), speed(same), gap)))
    car = car_boxes(scenario.vehicle, scenario.start.x, scenario.start.y, scenario.start.yaw)
    box = obstacle_boxes(scenario.path, scenario.obstacles[0], np.zeros(1))
    assert signed_clearance(car, box)[0] == pytest.approx(20.0, abs=1e-4)


def test_a_walker_follows_a_timed_polyline(load):
    places = ((0, -5), (4, 5))
    vertices = "".join(f'<Vertex time="{t}"><Position>{lane(-2, 60, o)}</Position></Vertex>' for t, o in places)
    follow = (
        f'<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory name="t" closed="false"><Shape><Polyline>'
        f"{vertices}</Polyline></Shape></Trajectory></TrajectoryRef><TimeReference><Timing "
        'domainAbsoluteRelative="relative" scale="1.0" offset="0"/></TimeReference><TrajectoryFollowingMode '
        'followingMode="follow"/></FollowTrajectoryAction></RoutingAction>'
    )
    init = EGO + private("Other", teleport(lane(-2, 60, -5)))
    scenario = load(document(init, event("walk", trigger("StartTrigger", after(3)), follow)))
    y = way(scenario, [2.0, 5.05, 9.0])[:, 1]
    np.testing.assert_allclose(y, [-10.25, -5.25, -0.25], atol=0.15)


def test_the_end_follows_from_the_stop_trigger(load):
    assert load(document(stop=trigger("StopTrigger", after(4), delay=2.5, edge="rising"))).duration == pytest.approx(
        6.5
    )
    endless = load(document(stop=""))
    assert endless.duration == 600.0
    assert any("does not end by itself" in note for note in endless.notes)


VARIATIONS = """<OpenSCENARIO><ParameterValueDistribution><ScenarioFile filepath="./scene.xosc"/><Deterministic>
<DeterministicSingleParameterDistribution parameterName="v"><DistributionRange stepWidth="5"><Range lowerLimit="5"
upperLimit="20"/></DistributionRange></DeterministicSingleParameterDistribution></Deterministic>
</ParameterValueDistribution></OpenSCENARIO>"""


def test_a_file_of_variations_runs_its_first(load, tmp_path):
    load(document())
    (tmp_path / "many.xosc").write_text(VARIATIONS)
    scenario = load_scenario(tmp_path / "many.xosc")
    assert (scenario.name, scenario.speed) == ("many", 5.0)
    assert "the first of 4 variations: v = 5.0" in scenario.notes
    assert load_scenario(tmp_path / "many.xosc", ["parameters.v=15"]).speed == 15.0
    template, values = variations(read_xml(tmp_path / "many.xosc"), tmp_path / "many.xosc")
    assert template == tmp_path / "scene.xosc"
    assert [value["v"] for value in values] == ["5.0", "10.0", "15.0", "20.0"]


NOW = trigger("StartTrigger", after(1))
NEVER = trigger("StartTrigger", "<ByValueCondition><TimeOfDayCondition/></ByValueCondition>")
ELSEWHERE = EGO + private("Other", teleport('<LanePosition roadId="3" laneId="-1" s="0"/>'))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (document(name="Ego2", init=EGO + private("Other", teleport(lane(-1, 60)))), "'Other' is not declared"),
        (document(EGO + private("Other", teleport("<RoutePosition/>"))), "RoutePosition: is not known here"),
        (document(ELSEWHERE), "only the road of the car"),
        (document(stories=event("e", NOW, speed(absolute(1.0)), actor="Ego")), "moves Ego"),
        (document(stories=event("e", NOW, "<SynchronizeAction/>")), "SynchronizeAction"),
        (document(stories=event("e", NEVER, speed(absolute(1.0)))), "TimeOfDayCondition: is not known here"),
        (document().replace('entryName="car"', 'entryName="cart"'), "no entry 'cart'"),
        (document().replace("./road.xodr", "./none.xodr"), "cannot be read"),
        (document().replace("36 / 3.6", "36 / "), "cannot be worked out"),
        (document(init=private("Other", teleport(lane(-1, 60)))), "is nowhere at the beginning"),
    ],
)
def test_what_changes_the_outcome_is_refused(load, text, words):
    with pytest.raises(InputError) as caught:
        load(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
