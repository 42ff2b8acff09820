import math
from dataclasses import replace

import numpy as np
import pytest
from support.stand_in import Feedback, KinematicCar, shortened

from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.recording import SAMPLE_UNITS, STEP_UNITS, End, read_columns, write_columns
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("single-obstacle")
SHORT = shortened(SCENE, 0.06)


class Wire:
    """A bus that notes, and loses what it is told to."""

    def __init__(self, log, lost=()):
        self.log, self.lost, self.count = log, lost, 0

    def transmit(self, command):
        self.log.append(f"port.transmit {command.time:.2f}")
        self.count += 1
        return None if self.count in self.lost else command


def drive(coupling="zero-delay", lost=()):
    log = []
    controller, plant = Feedback(aim=1.0, log=log), KinematicCar(log=log)
    recording = cosimulate(controller, plant, SHORT, Wire(log, lost), coupling)
    return log, plant.applied, recording


# The order of calls


def test_the_order_of_calls_is_the_documented_one():
    log, _, _ = drive()
    assert log == [
        "controller.reset", "plant.reset",
        "controller.step 0.00",
        "port.transmit 0.00", "plant.step 0.00", "port.transmit 0.01", "plant.step 0.01",
        "controller.step 0.02",
        "port.transmit 0.02", "plant.step 0.02", "port.transmit 0.03", "plant.step 0.03",
        "controller.step 0.04",
        "port.transmit 0.04", "plant.step 0.04", "port.transmit 0.05", "plant.step 0.05",
    ]  # fmt: skip


def test_the_order_is_the_same_with_delay_but_the_commands_are_one_period_old():
    assert drive("one-step-delay")[0] == drive()[0]
    (_, direct, prompt), (_, delayed, late) = drive(), drive("one-step-delay")
    assert prompt.steps["time"].tolist() == late.steps["time"].tolist()
    # Feedback answers x(0) alike in both: what is applied from 0 on here is applied from T on there
    assert [c.steer_angle for c in delayed[:2]] == [0.0, 0.0]
    assert [c.steer_angle for c in delayed[2:4]] == [c.steer_angle for c in direct[:2]] == [0.01, 0.01]


def test_before_the_first_command_the_steering_is_held():
    turned = replace(SHORT, start=replace(SHORT.start, steer_angle=0.02))
    plant = KinematicCar()
    cosimulate(Feedback(), plant, turned, coupling="one-step-delay")
    assert [(c.steer_angle, c.target_speed) for c in plant.applied[:2]] == [(0.02, 15.0)] * 2


def test_what_is_lost_on_the_bus_leaves_the_last_command_in_force():
    _, applied, recording = drive(lost=(3, 4))
    assert applied[2] == applied[1]
    assert applied[3] == applied[1]
    assert applied[4] != applied[1]
    assert recording["steer_received"][2] == applied[1].steer_angle
    assert recording["steer_command"][2] != recording["steer_received"][2]


def test_commands_on_the_bus_carry_the_time_of_their_frame():
    _, applied, _ = drive()
    assert [round(c.time, 9) for c in applied] == [0.0, 0.01, 0.02, 0.03, 0.04, 0.05]


@pytest.mark.parametrize(("period", "substeps"), [(0.01, 1), (0.02, 2), (0.05, 5), (0.025, 3)])
def test_plant_steps_divide_the_period_and_are_10_ms_at_most(period, substeps):
    scene = replace(SCENE, duration=4 * period, controller=replace(SCENE.controller, period=period))
    recording = cosimulate(Feedback(), KinematicCar(), scene)
    assert len(recording["time"]) == 4 * substeps + 1
    assert np.diff(recording["time"]) == pytest.approx(period / substeps)
    assert recording.steps["time"] == pytest.approx(np.arange(4) * period)
    assert len(recording.plans) == 4


def test_unknown_coupling():
    with pytest.raises(InputError, match="allowed: zero-delay, one-step-delay"):
        cosimulate(Feedback(), KinematicCar(), SHORT, coupling="parallel")  # pyright: ignore[reportArgumentType]


def test_progress_is_told_the_time():
    times = []
    cosimulate(Feedback(), KinematicCar(), SHORT, progress=times.append)
    assert times == pytest.approx([0.0, 0.02, 0.04])


# What is recorded


def test_samples_are_the_plants_states_in_the_roads_frame():
    scene = shortened(load_scenario("s-curve", ["start.s=50", "start.l=0.5", "obstacles=[]"]), 1.0)
    recording = cosimulate(Feedback(speed=13.0), KinematicCar(), scene)
    s, offset, heading = scene.path.project(recording["x"], recording["y"], near=recording["s"])
    assert recording["s"] == pytest.approx(s)
    assert recording["l"] == pytest.approx(offset)
    assert recording["heading_error"] == pytest.approx(recording["yaw"] - heading)
    assert recording["s"][0] == pytest.approx(50.0)


def test_heading_error_is_wrapped():
    turned = replace(SHORT, start=replace(SHORT.start, yaw=math.tau + 0.1))
    recording = cosimulate(Feedback(), KinematicCar(), turned)
    assert recording["heading_error"][0] == pytest.approx(0.1)


def test_lateral_acceleration_of_a_steady_circle_is_v_squared_over_r():
    class Circle(KinematicCar):
        def step(self, command, dt):
            return super().step(SteeringCommand(command.time, math.atan(2.6 / 50.0), 10.0), dt)

    recording = cosimulate(Feedback(), Circle(), shortened(SCENE, 1.0))
    assert recording["lateral_acceleration"][1:] == pytest.approx(2.0)


def test_steer_rate_is_the_slope_of_the_realised_angle():
    class Ramp(KinematicCar):
        def step(self, command, dt):
            state = super().step(command, dt)
            self.state = replace(state, steer_angle=0.3 * state.time)
            return self.state

    recording = cosimulate(Feedback(), Ramp(), SHORT)
    assert recording["steer_rate"] == pytest.approx(0.3)


def test_columns_come_back_exactly_from_their_csv(tmp_path):
    _, _, recording = drive()
    write_columns(tmp_path / "recording.csv", recording.samples, SAMPLE_UNITS)
    write_columns(tmp_path / "steps.csv", recording.steps, STEP_UNITS)
    header = (tmp_path / "recording.csv").read_text().splitlines()[0]
    assert header.startswith("time [s],x [m],y [m],yaw [rad],v_x [m/s]")
    for name, columns in (("recording", recording.samples), ("steps", recording.steps)):
        back = read_columns(tmp_path / f"{name}.csv")
        assert list(back) == list(columns)
        assert all(np.array_equal(back[key], columns[key], equal_nan=True) for key in columns)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording.csv", "steps.csv"]


def test_a_csv_that_cannot_be_completed_is_not_there(tmp_path):
    with pytest.raises(ValueError, match="shorter"):
        write_columns(tmp_path / "a.csv", {"time": np.zeros(3), "x": np.zeros(2)}, SAMPLE_UNITS)
    assert list(tmp_path.iterdir()) == []


# How a run ends


@pytest.mark.parametrize(
    ("raised", "end"),
    [
        (PlantError("it blew up"), End.PLANT_INVALID),
        (ZeroDivisionError("a stranger's plant"), End.PLANT_INVALID),
        (KeyboardInterrupt(), End.INTERRUPTED),
    ],
)
def test_what_the_plant_raises_ends_the_run_with_all_before_it(raised, end):
    recording = cosimulate(Feedback(), KinematicCar(raises=raised, raises_at=0.03), SHORT)
    assert (recording.end, recording.error) == (end, raised)
    assert recording["time"] == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert len(recording.steps["time"]) == len(recording.plans) == 2


def test_a_state_that_is_not_finite_ends_the_run_before_it_is_recorded():
    class Diverging(KinematicCar):
        def step(self, command, dt):
            state = super().step(command, dt)
            return replace(state, v_y=math.nan) if state.time > 0.035 else state

    recording = cosimulate(Feedback(), Diverging(), SHORT)
    assert recording.end is End.PLANT_INVALID
    assert "not finite" in str(recording.error)
    kept = [column for name, column in recording.samples.items() if name != "acceleration"]  # none was commanded
    assert np.isfinite(np.array(kept)).all()
    assert recording["time"][-1] == pytest.approx(0.03)


def test_an_error_of_the_controller_is_told_from_the_plants():
    recording = cosimulate(Feedback(fails_at=0.02), KinematicCar(), SHORT)
    assert recording.end is End.CONTROLLER_ERROR
    assert "fell through" in str(recording.error)
    assert recording["time"] == pytest.approx([0.0, 0.01, 0.02])


def test_an_error_of_the_bus_is_told_from_the_plants():
    class Broken:
        def transmit(self, command):
            raise OSError("bus off")

    recording = cosimulate(Feedback(), KinematicCar(), SHORT, Broken())
    assert recording.end is End.BUS_ERROR
    assert recording["time"].tolist() == [0.0]
    assert len(recording.steps["time"]) == 1


def test_interrupted_before_the_first_step_it_holds_the_start():
    def interrupt(_):
        raise KeyboardInterrupt

    recording = cosimulate(Feedback(), KinematicCar(), SHORT, progress=interrupt)
    assert recording.end is End.INTERRUPTED
    assert recording["time"].tolist() == [0.0]
    assert recording["lateral_acceleration"].tolist() == [0.0]
    assert recording.infeasible_steps == 0


def test_a_plant_that_cannot_start_is_an_error():
    class Broken(KinematicCar):
        def reset(self, state):
            return VehicleState(x=math.nan)

    with pytest.raises(PlantError, match="not finite"):
        cosimulate(Feedback(), Broken(), SHORT)


def test_an_open_road_ends_a_closed_one_goes_on():
    open_road = load_scenario("single-obstacle", ["obstacles=[]", "start.s=149.8"])
    recording = cosimulate(Feedback(), KinematicCar(), open_road)
    assert recording.end is End.END_OF_ROAD
    assert recording["s"][-2] < 150.0 <= recording["s"][-1]
    circle = [
        f"road.segments=[{{type='arc', length={math.tau * 50.0!r}, curvature=0.02}}]",
        "obstacles=[]",
        "start.s=314",
    ]
    ring = load_scenario("single-obstacle", [*circle, "duration=0.2"])
    lap = cosimulate(Feedback(), KinematicCar(), ring)
    assert ring.path.closed
    assert lap.end is End.COMPLETED
    assert lap["s"][-1] > ring.path.length


@pytest.mark.parametrize(("status", "end"), [(Status.BLOCKED, End.STOPPED), (Status.TRACKING, End.COMPLETED)])
def test_standing_is_an_end_only_if_the_controller_wanted_it(status, end):
    recording = cosimulate(Feedback(speed=0.0, status=status), KinematicCar(), SHORT)
    assert recording.end is end


def test_the_plants_own_contact_is_noted():
    class Bumper(KinematicCar):
        collided = True

    assert cosimulate(Feedback(), Bumper(), SHORT).contact
    assert not cosimulate(Feedback(), KinematicCar(), SHORT).contact
