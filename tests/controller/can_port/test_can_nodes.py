"""The two nodes, cycle by cycle and in closed loop."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import pytest

from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.catalogue import own_bus
from sidestep.controller.can_port.codec.database import CYCLE, messages
from sidestep.controller.can_port.codec.messages import ActuatorState
from sidestep.controller.can_port.findings import findings
from sidestep.controller.can_port.link import VirtualTimeLink
from sidestep.controller.can_port.listener import STALE, StateListener
from sidestep.controller.can_port.nodes import ControllerNode, VehicleNode
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState
from sidestep.validation.can_bus import drive as can_run
from sidestep.validation.can_bus.drive import drive_virtual
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.recording import End
from sidestep.validation.scenarios.scenario import load_scenario

SCENE = load_scenario("single-obstacle", ["plant.kind=linear", "duration=2.5"])


class Echo:
    """A controller that answers every state with a thousandth of its station, and remembers what it was given."""

    def __init__(self, period=CYCLE):
        self.config = SimpleNamespace(period=period, formulation="corridor")
        self.vehicle = SimpleNamespace(steer_rate_limit=0.4)
        self.plan, self.given, self.resets = None, [], 0

    def reset(self):
        self.resets += 1

    def step(self, state):
        self.given.append(state)
        return SteeringCommand(state.time, 1e-3 * state.x, 15.0)


class Loop:
    """Both nodes with nothing between them, the car moving at 15 m/s, cycle by cycle."""

    def __init__(self, period=CYCLE, protection="P02"):
        self.echo = Echo(period)
        self.message = messages(protection)["STEER_CMD"]
        self.controller = ControllerNode(self.echo, messages(protection))
        self.vehicle = VehicleNode(messages(protection))
        self.cycle, self.command, self.sent = 0, None, []

    def step(self, to_controller=lambda frames: frames, valid=True):
        time = self.cycle * CYCLE
        state = VehicleState(time, x=15.0 * time, yaw=0.1, v_x=15.0, steer_angle=0.02)
        answer, frames = self.vehicle.step(state, self.sent, valid)
        self.sent = self.controller.step(time + 0.5 * CYCLE, to_controller(frames))
        self.cycle += 1
        self.command = m.decode_steer_command(dict(self.sent)[0x101], time, self.message)
        return answer

    def run(self, cycles, **more):
        return [self.step(**more) for _ in range(cycles)]


# --- cycle by cycle


@pytest.mark.parametrize("protection", ["P02", "P05", "none"])
def test_state_goes_out_and_steering_comes_back(protection):
    loop = Loop(protection=protection)
    loop.run(60)
    assert loop.vehicle.actuator.state is ActuatorState.ACTIVE
    state = loop.echo.given[-1]
    assert (state.x, state.yaw, state.v_x) == pytest.approx((15.0 * 0.59, 0.1, 15.0), abs=1e-3)
    assert state.steer_angle == pytest.approx(0.02)
    assert loop.command.command.steer_angle == pytest.approx(1e-3 * state.x, abs=2.6e-5)
    assert loop.command.rate_limit == pytest.approx(0.4)
    assert loop.controller.stale_cycles == 0


def test_time_starts_with_the_first_state_and_the_controller_is_reset_then():
    loop = Loop()
    loop.run(30, valid=False)
    assert (loop.echo.given, loop.echo.resets) == ([], 0)
    assert not loop.command.enable
    assert loop.vehicle.actuator.state is ActuatorState.STANDBY
    loop.run(5)
    assert loop.echo.resets == 1
    assert [state.time for state in loop.echo.given] == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04])


def test_a_longer_period_of_the_controller_repeats_the_command():
    loop = Loop(period=0.02)
    loop.run(60)
    assert [b.time - a.time for a, b in itertools.pairwise(loop.echo.given)] == pytest.approx([0.02] * (
        len(loop.echo.given) - 1
    ))  # fmt: skip


def test_controller_status_every_100_ms():
    loop = Loop()
    sent = [loop.step() and loop.sent for _ in range(100)]
    assert [0x301 in dict(frames) for frames in sent] == [k % 10 == 0 for k in range(100)]
    times = [time for time, _ in loop.vehicle.reports]
    assert times == pytest.approx([0.01 + 0.1 * k for k in range(10)])
    assert [report.mode for _, report in loop.vehicle.reports][:2] == [m.SteerMode.STANDBY, m.SteerMode.ANGLE]


@pytest.mark.parametrize("silent", ["VEH_DYN", "VEH_POS", "VEH_HEADING", "STEER_STATUS"])
def test_any_input_older_than_50_ms_disables_the_steering_and_asks_to_stop(silent):
    loop = Loop()
    loop.run(50)
    frame_id = messages()[silent].frame_id
    enabled = []
    for _ in range(10):
        loop.step(lambda frames: [frame for frame in frames if frame[0] != frame_id])
        enabled.append(loop.command.enable)
    assert enabled == [True] * round(STALE / CYCLE) + [False] * (10 - round(STALE / CYCLE))
    assert loop.command.command == SteeringCommand(loop.cycle * CYCLE - CYCLE, 0.0, 0.0, Status.FAULT)
    assert loop.controller.stale_cycles == 5
    answers = loop.run(100, to_controller=lambda frames: [])
    assert (answers[-1].steer_angle, answers[-1].target_speed) == (0.0, 0.0)
    assert loop.vehicle.actuator.state is ActuatorState.STANDBY  # the controller keeps sending


@pytest.mark.parametrize(("age", "fresh"), [(0.0, True), (0.0499, True), (0.05, True), (0.0501, False), (1.0, False)])
def test_the_age_of_the_sample_decides(age, fresh):
    listener, node = StateListener(messages()), VehicleNode()
    for k in range(21):
        listener.take(k * CYCLE, node.step(VehicleState(k * CYCLE, v_x=15.0), [])[1])
    assert listener.fresh(0.2 + age) is fresh


@pytest.mark.parametrize(("behind", "whole"), [(1, True), (2, True), (3, False)])
def test_a_sample_waits_for_its_last_part_while_so_many_others_begin(behind, whole):
    listener, node = StateListener(messages()), VehicleNode()
    for k in range(20):
        listener.take(k * CYCLE, node.step(VehicleState(k * CYCLE, x=float(k), v_x=1.0), [])[1])
    samples = [node.step(VehicleState(0.2 + k * CYCLE, x=float(20 + k), v_x=1.0), [])[1] for k in range(behind + 1)]
    for sample in samples:
        listener.take(0.2, sample[:2])
    listener.take(0.2, samples[0][2:])
    assert listener.sample.state.x == pytest.approx(20.0 if whole else 19.0)


def test_steering_resumes_when_the_input_is_back():
    loop = Loop()
    loop.run(50)
    loop.run(100, to_controller=lambda frames: [])
    assert not loop.command.enable
    loop.run(20)
    assert loop.command.enable
    assert loop.echo.resets == 1


def test_a_state_declared_invalid_is_no_input():
    loop = Loop()
    loop.run(50)
    loop.run(6, valid=False)
    assert not loop.command.enable


def test_a_vehicle_that_leaves_says_so():
    listener, node = StateListener(messages()), VehicleNode()
    for k in range(30):
        listener.take(k * CYCLE, node.step(VehicleState(k * CYCLE, x=float(k), v_x=1.0), [])[1])
    assert listener.said_valid
    listener.take(0.3, node.leave())
    assert not listener.said_valid
    assert listener.sample.state.x == pytest.approx(29.0)


def test_parts_of_different_samples_are_never_mixed():
    listener, node = StateListener(messages()), VehicleNode()
    for k in range(200):
        state = VehicleState(k * CYCLE, x=float(k), y=float(k), yaw=0.01 * k, v_x=0.1 * k, v_y=0.05 * k)
        _, frames = node.step(state, [])
        lost = messages()[("VEH_DYN", "VEH_POS", "VEH_HEADING")[k % 3]].frame_id
        listener.take(k * CYCLE, [frame for frame in frames if k % 2 or frame[0] != lost])
        if listener.sample:
            got = listener.sample.state
            assert (got.y, got.yaw, got.v_x, got.v_y) == pytest.approx(
                (got.x, 0.01 * got.x, 0.1 * got.x, 0.05 * got.x), abs=3e-3
            )
    assert listener.sample.state.x == pytest.approx(199.0)


def test_a_sample_whose_parts_come_in_different_cycles_counts_when_it_is_whole():
    listener, node = StateListener(messages()), VehicleNode()
    for k in range(20):
        listener.take(k * CYCLE, node.step(VehicleState(k * CYCLE, x=float(k), v_x=1.0), [])[1])
    _, frames = node.step(VehicleState(0.2, x=20.0, v_x=1.0), [])
    listener.take(0.20, frames[:2])
    assert listener.sample.state.x == pytest.approx(19.0)
    listener.take(0.21, frames[2:])
    assert (listener.sample.state.x, listener.arrived) == (pytest.approx(20.0), 0.21)


# --- closed loop in virtual time


def drive(faults=None, scenario=SCENE, protection="P02"):
    with LinearPlant(scenario.vehicle) as plant:
        return drive_virtual(scenario, plant, faults, own_bus(protection))


@pytest.fixture(scope="module")
def clean():
    return drive()


def test_the_scene_is_driven_over_the_bus(clean):
    assert clean.recording.end is End.COMPLETED
    assert judge(clean.recording, SCENE).label == "ok"
    assert clean.recording["steer_command"] == pytest.approx(clean.recording["steer_received"], abs=0.01)
    assert clean.vehicle.actuator.implausible == clean.controller.stale_cycles == 0
    assert clean.vehicle.actuator.channel.receiver.lost == 0
    assert len(clean.recording.steps["time"]) == 25
    assert set(clean.recording.steps["feasible"]) == {1.0}


def test_the_same_faults_give_the_same_recording():
    spec = FaultSpec(seed=3, loss=0.1, jitter=0.02, corruption=0.05)
    scenario = replace(SCENE, duration=0.6)
    one, two = (drive(spec, scenario).recording["x"] for _ in range(2))
    assert one.tolist() == two.tolist()
    assert one.tolist() != drive(replace(spec, seed=4), scenario).recording["x"].tolist()


@pytest.mark.parametrize("spec", [FaultSpec(loss=0.05), FaultSpec(delay=0.05), FaultSpec(loss=0.05, delay=0.05)])
def test_five_percent_loss_and_50_ms_delay_are_harmless(spec):
    assert judge(drive(spec).recording, SCENE).passed


def test_half_of_the_frames_lost_ends_in_zero_steering_and_a_stop():
    run = drive(FaultSpec(loss=0.5, start=0.5), replace(SCENE, duration=6.0))
    assert run.recording.end is End.STOPPED
    assert run.vehicle.actuator.state is ActuatorState.RAMP_TO_ZERO
    assert run.recording["steer_received"][-1] == run.recording["target_speed"][-1] == 0.0


def test_recovery_after_a_blackout_of_a_second():
    run = drive(FaultSpec(loss=1.0, start=0.3, end=1.3))
    received, time = run.recording["target_speed"], run.recording["time"]
    assert set(received[(time > 0.4) & (time < 1.3)]) == {0.0}
    assert set(run.recording["status"][time > 1.7]) == {float(Status.TRACKING)}


def test_no_controller_answers(monkeypatch):
    monkeypatch.setattr(can_run, "PATIENCE", 0.3)
    monkeypatch.setattr(ControllerNode, "step", lambda self, time, frames: [])
    with pytest.raises(InputError, match="no controller answers within"):
        drive()


class TwoControllers(VirtualTimeLink):
    """A bus with a second controller on it, whose counters are elsewhere."""

    def __init__(self, apart):
        catalogue = messages()
        self.second = ControllerNode(Echo(), catalogue)
        for _ in range(apart):
            self.second.leave()
        super().__init__(ControllerNode(Echo(), catalogue), catalogue=catalogue)
        self.state = []

    def receive(self):
        return [*super().receive(), *self.second.step(self.time, self.state)]

    def send(self, frames):
        super().send(frames)
        self.state = frames


@pytest.mark.parametrize("apart", range(1, 16))
def test_two_controllers_that_nobody_could_follow_let_the_car_go_and_are_named(apart):
    node = VehicleNode(messages())
    with LinearPlant(SCENE.vehicle) as plant:
        recording = can_run.drive_over(TwoControllers(apart), node, plant, SCENE)
    assert len(recording["time"]) > 10
    assert findings(node.watch.record())[0].label == "second sender"
