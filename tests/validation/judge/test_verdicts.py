"""The rows of docs/verdicts.md that are about drives that never happened: what was called a pass, and is none."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from support.fmus.fmu_files import FOREIGN_MAP
from support.stand_in import KinematicCar

from sidestep.controller import Plan
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.cli.main import main
from sidestep.validation.judge.findings import Verdict
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.judge.verdict import Judgement, judge
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import Scenario, load_scenario, parse_scenario

ROOT = Path(__file__).parents[3]
TABLE = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")


def test_every_row_of_the_table_names_a_test():
    rows = re.findall(r"^\|.*\| `(\w+)` \|$", TABLE, re.MULTILINE)
    files = (ROOT / "tests").rglob("test_*.py")
    there = {name for file in files for name in re.findall(r"def (test_\w+)", file.read_text(encoding="utf-8"))}
    assert len(rows) >= 12
    assert sorted(set(rows) - there) == []


@dataclass
class Halting:
    """A controller that merely stops, or creeps."""

    target: float = 0.0
    status: Status = Status.BLOCKED
    plan: Plan | None = None

    def __post_init__(self) -> None:
        from support.stand_in import straight_plan

        self.plan = straight_plan(VehicleState())

    def reset(self) -> None: ...

    def step(self, state: VehicleState) -> SteeringCommand:
        return SteeringCommand(state.time, 0.0, self.target, self.status)


def driven(scenario: Scenario, controller: object = None, plant: Plant | None = None) -> Judgement:
    return judge(closed_loop(scenario, plant, controller), scenario)  # pyright: ignore[reportArgumentType]


@pytest.mark.closed_loop
@pytest.mark.parametrize("scene", ["single-obstacle", "double-obstacle", "s-curve", "moose"])
@pytest.mark.parametrize("status", [Status.BLOCKED, Status.FAULT, Status.TRACKING])
def test_a_controller_that_merely_stops_fails(scene, status):
    judged = driven(load_scenario(scene, ["plant.kind=linear"]), Halting(status=status))
    assert (judged.verdict, judged.label, judged.touched) == (Verdict.FAIL, "stopped though passable", False)
    assert re.search(r"1\d\.\d m of \d+\.\d m driven, 0 of \d obstacles left behind; a way past at", judged.detail)


@pytest.mark.closed_loop
def test_a_controller_that_creeps_fails():
    judged = driven(load_scenario("single-obstacle", ["plant.kind=linear"]), Halting(1.0, Status.TRACKING))
    assert (judged.verdict, judged.label) == (Verdict.FAIL, "slow though passable")


@pytest.mark.closed_loop
def test_a_stop_on_an_empty_road_fails():
    judged = driven(load_scenario("single-obstacle", ["plant.kind=linear", "obstacles=[]"]), Halting())
    assert (judged.verdict, judged.label) == (Verdict.FAIL, "stopped though passable")


@pytest.mark.closed_loop
def test_a_stop_at_a_blocked_road_stays_a_pass():
    _, judged = simulate(load_scenario("blocked", ["plant.kind=linear"]))
    assert (judged.verdict, judged.label) == (Verdict.PASS, "stopped, no way past")


@pytest.mark.closed_loop
def test_a_gap_narrower_than_the_buffer_is_no_way_past():
    """The controller is held to its own buffer: with less of it, the same gap is a way past."""
    gap = "obstacles=[{s=60, l=-2.55, length=1, width=2.9}, {s=60, l=2.55, length=1, width=2.9}]"  # 2.2 m
    scene = ["plant.kind=linear", gap]
    assert driven(load_scenario("blocked", [*scene, "controller.buffer=0.35"]), Halting()).passed
    assert not driven(load_scenario("blocked", [*scene, "controller.buffer=0.05"]), Halting()).passed


@pytest.mark.closed_loop
def test_a_scene_too_short_for_its_obstacle_is_inconclusive(tmp_path, capsys):
    out = ["--plant", "linear", "--can", "off", "--out", str(tmp_path / "a"), "--junit", str(tmp_path / "j.xml")]
    assert main(["run", "single-obstacle", "--set", "duration=2", *out]) == 1
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert (summary["verdict"], summary["label"]) == ("inconclusive", "scene too short")
    assert summary["obstacles_ahead"] == [0]
    assert summary["obstacles_reached"] == []
    assert "inconclusive: scene too short" in capsys.readouterr().out
    assert "INCONCLUSIVE (scene too short)" in (tmp_path / "a" / "report.html").read_text()
    assert 'errors="1"' in (tmp_path / "j.xml").read_text()


class Standing(KinematicCar):
    """A plant that drives at a share of what it is told, whatever it is told."""

    share = 0.0

    def step(self, command, dt):
        return super().step(replace(command, target_speed=self.share * command.target_speed), dt)


@pytest.mark.closed_loop
@pytest.mark.parametrize("speed", [15.0, 3.0])
def test_a_plant_that_stands_still_fails(speed):
    judged = driven(load_scenario("single-obstacle", ["plant.kind=linear", f"speed={speed}"]), None, Standing())
    assert judged.verdict is Verdict.FAIL
    assert judged.label in ("speed not held", "stopped though passable")


@pytest.mark.closed_loop
def test_a_plant_at_another_speed_than_told_fails():
    """u_r misread as m/s: 0.87 instead of 3."""
    plant = Standing()
    plant.share = 0.29
    judged = driven(load_scenario("single-obstacle", ["plant.kind=linear", "speed=3", "duration=8"]), None, plant)
    assert (judged.verdict, judged.label) == (Verdict.FAIL, "speed not held")
    assert judged.detail.startswith("0.87 m/s where the plant was told 3.00 m/s")


def deaf(foreign, tmp_path, *starts: str) -> list[str]:
    """`--plant` and `--map` of the foreign car, with only these lines of its [start]."""
    file, _ = foreign
    head, _, tail = FOREIGN_MAP.partition("[start]\n")
    table = tmp_path / "deaf.toml"
    table.write_text(head + "[start]\n" + "\n".join(starts) + "\n[parameters]" + tail.partition("[parameters]")[2])
    return ["--plant", str(file), "--map", str(table)]


YAW, SPEED = 'yaw = { variable = "Psi0", unit = "deg" }', 'v_x = { variable = "v0", unit = "km/h" }'


@pytest.mark.parametrize(
    ("starts", "changes", "signal", "asked"),
    [
        ((YAW,), ["speed=12"], "v_x", "12"),
        ((SPEED,), ["start.heading=0.2"], "yaw", "0.2"),
        ((YAW, SPEED), ["start.l=1.5"], "y", "1.5"),
    ],
)
def test_an_fmu_that_does_not_take_the_start_is_refused(starts, changes, signal, asked, foreign, tmp_path, capsys):
    plant = deaf(foreign, tmp_path, *starts)
    sets = [part for change in changes for part in ("--set", change)]
    assert main(["run", "single-obstacle", *plant, *sets, "--can", "off", "--out", str(tmp_path / "a")]) == 2
    error = capsys.readouterr().err
    assert re.search(rf"start: the plant foreign starts with {signal} \S+ instead of {asked} ", error)
    assert f"the variable that sets it as start.{signal} in {tmp_path / 'deaf.toml'}" in error
    assert "--accept-start" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "a").exists()


@pytest.mark.closed_loop
def test_an_accepted_start_is_told_as_it_was(foreign, tmp_path):
    plant = deaf(foreign, tmp_path, YAW, SPEED)
    arguments = ["run", "single-obstacle", *plant, "--set", "start.l=1.5", "--can", "off", "--out", str(tmp_path / "a")]
    assert main([*arguments, "--accept-start"]) == 0
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["label"].endswith(", start not as asked")
    assert (summary["start"]["asked"]["y"], summary["start"]["got"]["y"]) == (1.5, 0.0)
    assert summary["start"]["not_taken"] == ["y"]
    assert "y 0, asked 1.5" in (tmp_path / "a" / "report.html").read_text()


class Elsewhere(KinematicCar):
    """A plant that stands where it stands."""

    def reset(self, state):
        return super().reset(replace(state, v_x=0.0))


def test_no_study_drives_a_plant_from_another_start():
    scenario = load_scenario("single-obstacle", ["plant.kind=linear"])
    with pytest.raises(InputError, match="starts with v_x 0 instead of 15 m/s"):
        closed_loop(scenario, Elsewhere())
    accepted = replace(scenario, plant=replace(scenario.plant, accept_start=True), duration=0.1)
    assert [str(off) for off in closed_loop(accepted, Elsewhere()).departures] == ["v_x 0 instead of 15 m/s"]


CASES = {
    "USA_US101-14": """
name = "traffic"
speed = 14.8499
duration = 14.0
road = { width_left = 11.7587, width_right = 5.2037, segments = [{ type = "line", length = 250.0 }] }
start = { s = 10.0, l = 0.2096 }
obstacles = [
    { s = 64.31, l = -0.531, length = 5.639, width = 1.798, heading = -0.051 },
    { s = 67.32, l = 9.349, length = 5.486, width = 1.951, heading = -0.001 },
    { s = 54.39, l = -2.318, length = 4.724, width = 2.103, heading = 0.071 },
    { s = 70.83, l = 6.354, length = 5.029, width = 1.798, heading = 0.014 },
    { s = 68.52, l = 2.457, length = 6.096, width = 1.951, heading = -0.014 },
]
""",
    "USA_US101-8": """
name = "traffic"
speed = 12.19
duration = 14.0
road = { width_left = 8.3424, width_right = 8.5362, segments = [{ type = "line", length = 250.0 }] }
start = { s = 10.0, l = 0.6141 }
obstacles = [
    { s = 34.86, l = -2.969, length = 6.096, width = 1.951, heading = -0.066 },
    { s = 38.53, l = 0.291, length = 5.944, width = 2.408, heading = -0.062 },
    { s = 30.51, l = 3.455, length = 4.42, width = 1.951, heading = 0.042 },
]
""",
}


@pytest.mark.closed_loop
@pytest.mark.parametrize("case", CASES)
def test_a_stop_in_recorded_traffic_with_a_way_past_fails(case):
    """Stopping there passed; the stop is made here by force, so that the row outlives a better controller."""
    judged = driven(parse_scenario(CASES[case], case, ["plant.kind=linear"]), Halting())
    assert (judged.verdict, judged.label) == (Verdict.FAIL, "stopped though passable")


@pytest.mark.closed_loop
@pytest.mark.parametrize("setting", ["plant.noise=5", "plant.measured_offset=0.3"])
def test_sensors_act_wherever_a_scenario_is_driven(setting):
    """In limits scenes, delay, moose, optimum, endurance and over CAN they made no difference."""
    from sidestep.validation.can_bus.drive import drive_virtual
    from sidestep.validation.studies import delay, endurance, moose, optimum, scenes

    def on_can(sets):
        scenario = load_scenario("single-obstacle", ["plant.kind=linear", "duration=1", *sets])
        with open_plant(scenario) as plant:
            return drive_virtual(scenario, plant).recording["l"][-1]

    def on_the_ring(sets):
        scenario = parse_scenario(endurance._SCENE, "endurance", ["plant.kind=linear", "duration=2", *sets])
        with open_plant(scenario) as plant:
            return endurance._drive(scenario, plant, scenario.start, 3, 0)[1]

    case = moose.CASES[0]
    studies = {
        "scenes": lambda sets: scenes.run_scene(4, "linear", sets),
        "delay": lambda sets: delay.drive(delay.scene(0.05, 1, True, "linear", ["duration=2", *sets]), 1)["l"][-1],
        "moose": lambda sets: moose.drive(moose.scene(case, "linear", 40.0, sets)),
        "optimum": lambda sets: optimum._drive("single-obstacle", "linear", sets),
        "endurance": on_the_ring,
        "can": on_can,
    }
    unmoved = [name for name, study in studies.items() if study([]) == study([setting])]
    assert unmoved == []


def test_one_file_makes_the_controller_of_a_scenario():
    made = [
        str(file.relative_to(ROOT))
        for folder in ("validation", "examples", "benchmarks")
        for file in (ROOT / folder).rglob("*.py")
        if re.search(r"\b(SteeringController|kind)\(\s*(scenario|scene|SCENE|now)\.", file.read_text())
    ]
    assert made == ["validation/loop/closed_loop.py"]
