"""`can replay --what-if`: the same controller asked again gives the logged commands, on every log of ours, exactly."""

from dataclasses import replace
from random import Random

import can
import numpy as np
import pytest

from sidestep.controller import SteeringController
from sidestep.controller.can_port.actuator import ActuatorConfig
from sidestep.controller.can_port.bus.log import open_log, read_log
from sidestep.controller.can_port.codec.catalogue import own_bus
from sidestep.controller.can_port.codec.database import CYCLE, messages
from sidestep.controller.can_port.nodes import ControllerNode, VehicleNode
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.can_bus.drive import drive_over
from sidestep.validation.can_bus.replay import compare
from sidestep.validation.cli.main import main
from sidestep.validation.scenarios.scenario import load_scenario
from sidestep.validation.studies.runs import drive as run

SCENE = load_scenario("double-obstacle", ["plant.kind=linear", "duration=3.0"])
ENDINGS = (".blf", ".asc", ".log", ".csv")


def controller_of(scenario):
    return SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)


class Stumbling:
    """Two nodes on a bus of which either now and then misses cycles, and three logs: one at each end, one beside.

    Args:
        node: The controller's.
        skips: Probability that a cycle is missed, at either end.
        jitter: How much later than half a cycle after the vehicle the controller may wake, in cycles.
    """

    def __init__(self, node, skips, jitter=0.0, seed=0):
        self.node, self.skips, self.jitter, self.draw = node, skips, jitter, Random(seed)
        self.time, self.missed, self.strangers, self.running = -CYCLE, 0, 0, False
        self.to_controller, self.to_vehicle = [], []
        self.logs = {"drive": [], "plant": [], "monitor": []}

    def wait(self):
        cycles = 1
        while True:
            turn = self.time + (cycles - 0.5 + self.jitter * self.draw.random()) * CYCLE
            if self.misses():
                pass
            else:
                heard, self.to_controller = self.to_controller, []
                answer = self.node.step(turn, heard)
                for name in ("drive",):
                    self.log(name, turn, [*heard, *answer])
                self.log("monitor", turn, answer)
                self.to_vehicle += answer
            if not self.misses():
                break
            cycles += 1
        self.time += cycles * CYCLE
        return self.time

    def misses(self):
        missed = self.running and self.draw.random() < self.skips
        self.missed += missed
        return missed

    def receive(self):
        heard, self.to_vehicle = self.to_vehicle, []
        self.log("plant", self.time, heard)
        return heard

    def send(self, frames):
        frames = list(frames)
        self.log("plant", self.time, frames)
        self.log("monitor", self.time, frames)
        split = self.draw.randrange(len(frames) + 1) if self.jitter else len(frames)
        self.to_controller += frames[:split]  # the rest comes while the controller is looking elsewhere
        self.late = frames[split:]
        self.to_controller += self.late

    def begin(self):
        self.running = True

    def log(self, name, time, frames):
        self.logs[name] += [
            can.Message(time + 1.0, frame_id, False, data=data, is_fd=len(data) > 8, channel=0)
            for frame_id, data in frames
        ]


def stumble(skips, jitter=0.0, protection="P02", scenario=SCENE):
    catalogue = messages(protection)
    link = Stumbling(ControllerNode(controller_of(scenario), catalogue), skips, jitter)
    vehicle = VehicleNode(catalogue, ActuatorConfig(angle_limit=scenario.vehicle.steer_limit))
    with LinearPlant(scenario.vehicle) as plant:
        drive_over(link, vehicle, plant, scenario)
    return link


@pytest.fixture(scope="module", params=[0.0, 0.03, 0.1], ids=["clean", "3 % skipped", "10 % skipped"])
def drive(request):
    link = stumble(request.param, jitter=0.4)
    assert (link.missed > 0) == (request.param > 0.0)
    return link


@pytest.mark.parametrize("node", ["drive", "plant", "monitor"])
@pytest.mark.parametrize("ending", ENDINGS)
def test_the_same_controller_gives_every_logged_command_again(drive, node, ending, tmp_path):
    with open_log(tmp_path / f"a{ending}") as log:
        for message in drive.logs[node]:
            log.on_message_received(message)
    columns, missing = compare(read_log(tmp_path / f"a{ending}"), controller_of(SCENE))
    assert missing == 0
    assert len(columns["time"]) > 200
    assert np.max(np.abs(columns["logged"])) > 0.02
    assert np.all(columns["difference"] == 0.0)


@pytest.mark.parametrize("protection", ["P05", "none"])
def test_with_other_protections(protection):
    link = stumble(0.03, protection=protection)
    columns, _ = compare(link.logs["monitor"], controller_of(SCENE), own_bus(protection))
    assert len(columns["time"]) > 200
    assert np.all(columns["difference"] == 0.0)


def test_a_controller_that_steps_every_other_cycle():
    scenario = replace(SCENE, controller=replace(SCENE.controller, period=0.02))
    columns, _ = compare(stumble(0.05, scenario=scenario).logs["plant"], controller_of(scenario))
    assert np.all(columns["difference"] == 0.0)


def test_another_controller_differs():
    other = replace(SCENE, controller=replace(SCENE.controller, weight_offset=9.0))
    columns, _ = compare(stumble(0.0).logs["plant"], controller_of(other))
    assert np.max(np.abs(columns["difference"])) > 1e-4


def test_commands_that_the_log_lacks_are_told(tmp_path, capsys):
    frames = stumble(0.0).logs["monitor"]
    commands = [k for k, frame in enumerate(frames) if frame.arbitration_id == 0x101]
    gone = set(commands[100:103])
    with open_log(tmp_path / "a.blf") as log:
        for k, frame in enumerate(frames):
            if k not in gone:
                log.on_message_received(frame)
    assert main(["can", "replay", str(tmp_path / "a.blf"), "--what-if", "double-obstacle", "--out", str(tmp_path)]) == 0
    assert "3 commands are missing in the log" in capsys.readouterr().out


@pytest.mark.parametrize("coupling", ["zero-delay", "one-step-delay"])
@pytest.mark.parametrize("changes", [[], ["controller.period=0.03"], ["plant.noise=1.0"]])
def test_a_run_s_own_log_is_what_was_asked(coupling, changes, tmp_path):
    scenario = load_scenario("single-obstacle", ["plant.kind=linear", "duration=2.0", *changes])
    done = run(scenario, tmp_path, coupling=coupling)
    columns, missing = compare(read_log(tmp_path / "can.blf"), controller_of(scenario))
    held = int(coupling == "one-step-delay") * round(scenario.controller.period / CYCLE)
    assert (len(columns["time"]), missing) == (done.summary["can"]["sent"] - held, 0)
    assert np.max(np.abs(columns["logged"])) > 0.01
    assert np.all(columns["difference"] == 0.0)


def test_the_vehicle_started_again_is_a_drive_of_its_own():
    frames, node = [], ControllerNode(controller_of(SCENE))
    time = 0.0
    for _ in range(2):
        vehicle = VehicleNode()
        for k in range(40):
            time += CYCLE
            _, sent = vehicle.step(VehicleState(10.0 + k * CYCLE, x=15.0 * k * CYCLE, v_x=15.0), [])
            answer = node.step(time, sent)
            frames += [can.Message(time, frame_id, False, data=data) for frame_id, data in [*sent, *answer]]
    columns, _ = compare(frames, controller_of(SCENE))
    assert len(columns["time"]) > 50
    assert np.all(columns["difference"] == 0.0)
