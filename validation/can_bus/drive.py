"""Scenarios driven over a bus: plant and steering actuator at one end, the controller at the other.

The two ends are two processes in real time, or one in virtual time. The car is held at the start until the
controller answers, or several do; then the co-simulation loop runs with the bus in the controller's place, one cycle
at a time.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sidestep.controller import SteeringController
from sidestep.controller.answer import FEASIBLE_SLACK
from sidestep.controller.can_port.actuator import ActuatorConfig
from sidestep.controller.can_port.bus.bus import resolve_spec
from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.controller.can_port.codec.catalogue import BusDescription, own_bus
from sidestep.controller.can_port.codec.database import CYCLE
from sidestep.controller.can_port.codec.messages import ActuatorState, QpStatus
from sidestep.controller.can_port.findings import Finding, findings, state_findings
from sidestep.controller.can_port.link import Link, RealTimeLink, VirtualTimeLink
from sidestep.controller.can_port.nodes import ControllerNode, VehicleNode
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.validation.can_bus.limits import within
from sidestep.validation.files import made
from sidestep.validation.interrupt import interrupts_between_steps
from sidestep.validation.judge.findings import Verdict, for_the_judge
from sidestep.validation.judge.run import Run
from sidestep.validation.judge.summary import summarise
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.foreign import is_foreign
from sidestep.validation.loop.measurement import sensed
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.loop.recording import STEP_UNITS, Recording
from sidestep.validation.loop.start import reset_to
from sidestep.validation.scenarios.scenario import Scenario
from sidestep.validation.undisturbed import undisturbed

PATIENCE = 120.0
"""How long a node waits for the other end, in [s]."""

_GONE = 2.0  # the controller's node ends when the vehicle has been silent for so long, in [s]
_CONTROLLER, _VEHICLE = ("CTRL",), ("EPS", "VEH")


class FarController:
    """The controller at the other end of a bus, as the co-simulation loop sees it; its port as well.

    Args:
        link: The way to it.
        node: The vehicle's end.
        waiting: Called in every cycle that the car is held.
    """

    def __init__(self, link: Link, node: VehicleNode, waiting: Callable[[], None] = lambda: None):
        self.link, self.node, self._waiting = link, node, waiting
        self.plan = _Unknown()
        self._began: float | None = None
        self._applied: SteeringCommand | None = None

    def reset(self) -> None:
        """Hold the car at the start again."""
        self._began = None

    def step(self, state: VehicleState) -> SteeringCommand:
        """One cycle on the bus; what the controller has asked for.

        Raises:
            InputError: No controller answers.
        """
        if self._began is None:
            self._began = self._await(state)
        else:
            self._cycle(state)
        return self.node.actuator.asked or SteeringCommand(state.time, state.steer_angle, state.v_x)

    def transmit(self, command: SteeringCommand) -> SteeringCommand | None:
        """What the steering actuator makes of it."""
        return replace(self._applied, time=command.time) if self._applied else None

    def _await(self, state: VehicleState) -> float:
        actuator, now = self.node.actuator, -math.inf
        for _ in range(round(PATIENCE / CYCLE)):
            self._waiting()
            now = self._cycle(state, valid=actuator.state is ActuatorState.STANDBY)
            if actuator.state is ActuatorState.ACTIVE or self.node.watch.several_senders:  # these may never be followed
                self.link.begin()
                self.node.watch.begin(now)
                return now
        if actuator.blocked:
            what = f"{actuator.blocked} commands blocked by the interface's limits, none let pass in {PATIENCE:g} s"
            raise InputError("can", what, "sidestep can drive with the same --map")
        raise InputError("can", f"no controller answers within {PATIENCE:g} s", "sidestep can drive on the same bus")

    def _cycle(self, state: VehicleState, valid: bool = True) -> float:
        now = self.link.wait()
        self._applied, frames = self.node.step(replace(state, time=now), self.link.receive(), valid)
        self.link.send(frames)
        return now

    def steps(self) -> dict[str, Any]:
        """What the controller reported, as the columns of `STEP_UNITS`; nan is what it does not report."""
        columns: dict[str, Any] = {name: np.full(len(self.node.reports), np.nan) for name in STEP_UNITS}
        for k, (now, report) in enumerate(self.node.reports):
            feasible = report.qp_status is QpStatus.SOLVED and report.slack <= FEASIBLE_SLACK
            columns["time"][k], columns["status"][k] = now - (self._began or 0.0), report.status
            columns["feasible"][k], columns["iterations"][k] = feasible, report.iterations
            columns["slack_corridor"][k], columns["step_time"][k] = report.slack, 1e6 * report.solve_time
        driven = columns["time"] >= 0.0
        return {name: column[driven] for name, column in columns.items()}


class _Unknown:
    """The plan stays with the controller: every figure of it reads as not known."""

    def __getattr__(self, name: str) -> float:
        return math.nan


def drive_over(
    link: Link, node: VehicleNode, plant: Plant, scenario: Scenario, progress: Callable[[float], None] | None = None
) -> Recording:
    """Drive a scenario with the controller at the other end of `link`.

    Raises:
        InputError: No controller answers.
    """
    far = FarController(link, node, lambda: progress(0.0) if progress else None)
    cycle_by_cycle = replace(scenario, controller=replace(scenario.controller, period=CYCLE))
    recording = cosimulate(sensed(far, scenario), plant, cycle_by_cycle, far, progress=progress)
    if isinstance(recording.error, InputError):
        raise recording.error
    return replace(recording, steps=far.steps(), plans=())


@dataclass(frozen=True)
class VirtualRun:
    """A drive in virtual time.

    Attributes:
        recording: What happened.
        vehicle, controller: The two nodes afterwards.
        findings: What a verdict has to name.
    """

    recording: Recording
    vehicle: VehicleNode
    controller: ControllerNode
    findings: tuple[Finding, ...]


def drive_virtual(
    scenario: Scenario,
    plant: Plant,
    faults: FaultSpec | None = None,
    bus: BusDescription | None = None,
    controller: SteeringController | None = None,
) -> VirtualRun:
    """Drive a scenario over a faulty bus in virtual time, both nodes in this process.

    Args:
        scenario: What to drive.
        plant: Open.
        faults: What goes wrong, in both directions.
        bus: What travels; None for our own messages.
        controller: One to use again; None makes it.
    """
    bus = bus or own_bus()
    catalogue = bus.messages
    far = ControllerNode(controller or bare_controller(within(scenario, bus)), catalogue, bus.interface)
    vehicle = VehicleNode(catalogue, _actuator(scenario), bus.interface)
    recording = drive_over(VirtualTimeLink(far, faults, catalogue), vehicle, plant, scenario)
    return VirtualRun(recording, vehicle, far, findings(vehicle.watch.record()))


def run_plant(
    scenario: Scenario,
    folder: Path,
    can: str = "auto",
    bus: BusDescription | None = None,
    log: str = "can.blf",
    allow_real_bus: bool = False,
    progress: Callable[[float], None] | None = None,
    command_line: str = "",
) -> Run:
    """The vehicle's end as a process: plant, steering actuator and sensors, in real time.

    Raises:
        InputError: Plant, bus or folder cannot be used, or no controller answers.
        PlantError: The plant cannot be built or cannot start.
    """
    bus = bus or own_bus()
    catalogue = bus.messages
    node = VehicleNode(catalogue, _actuator(scenario), bus.interface)
    with open_plant(scenario) as plant:
        start, _ = reset_to(plant, scenario.start, scenario.plant)  # refused here, before anything is written
        if not is_foreign(scenario.plant):  # load the kernels; an FMU has none, and some start only once
            plant.step(SteeringCommand(start.time, start.steer_angle, scenario.speed), CYCLE)
        with made(folder):
            link = RealTimeLink(resolve_spec(can, True), _VEHICLE, catalogue, folder / log, allow_real_bus)
        with link, undisturbed():
            recording = drive_over(link, node, plant, scenario, progress)
            link.send(node.leave())
    record = node.watch.record(link.strangers)
    judgement = judge(recording, scenario, for_the_judge(findings(record)))
    frames = {**link.statistics(), **record.as_dict()}
    summary = summarise(scenario, recording, judgement, can=frames, coupling="over the bus", command_line=command_line)
    return Run(scenario, recording, judgement, summary, folder)


def run_controller(
    scenario: Scenario,
    folder: Path,
    can: str = "auto",
    bus: BusDescription | None = None,
    log: str = "can.blf",
    allow_real_bus: bool = False,
) -> dict[str, Any]:
    """The controller's end as a process; ends when the vehicle has fallen silent, or on an interrupt.

    Returns:
        Figures of the bus, the deadlines and the processor.

    Raises:
        InputError: Bus or folder cannot be used, or no vehicle answers.
    """
    bus = bus or own_bus()
    catalogue = bus.messages
    controller = bare_controller(within(scenario, bus))
    for _ in range(3):
        controller.step(scenario.start)  # load the kernels before the clock runs
    node = ControllerNode(controller, catalogue, bus.interface)
    with made(folder):
        link = RealTimeLink(resolve_spec(can, True), _CONTROLLER, catalogue, folder / log, allow_real_bus, True)
    with link, undisturbed():
        interrupted, share = _serve(link, node)
    if node.heard is None and not interrupted:
        raise InputError("can", f"no vehicle answers within {PATIENCE:g} s", "sidestep can plant on the same bus")
    lost = sum(channel.receiver.lost for channel in node.listener.channels.values())
    bus_figures = link.statistics(node.heard or 0.0)
    record = node.record(link.strangers, 1e-3 * bus_figures["latest_end_ms"])
    found = () if interrupted else for_the_judge(state_findings(record))
    worst = next((each for each in found if each.verdict is not Verdict.PASS), None)
    figures = {"lost": lost, "stale_cycles": node.stale_cycles, "processor_share": share, "interrupted": interrupted}
    return {
        **bus_figures, **figures,
        "verdict": worst.verdict.value if worst else "inconclusive" if interrupted else "pass",
        "label": worst.label if worst else "interrupted" if interrupted else "ok",
        "findings": [{"label": f.label, "verdict": f.verdict.value, "text": f.text} for f in found],
    }  # fmt: skip


def _serve(link: RealTimeLink, node: ControllerNode) -> tuple[bool, float]:
    """Steer until the vehicle is gone; whether that was interrupted, and the share of a processor that it took."""
    now, used, interrupted = 0.0, 0.0, False
    began: tuple[float, float] | None = None  # of steering: time and processor time, in [s]
    with interrupts_between_steps() as interruption:
        try:
            while now < (PATIENCE if node.heard is None else node.heard + _GONE):
                interruption()
                now = link.wait()
                link.send(node.step(now, link.receive()))
                if node.heard == now:
                    if began is None:
                        link.begin()
                        began = now, time.process_time()
                    used = time.process_time() - began[1]
        except KeyboardInterrupt:
            interrupted = True
        finally:
            link.send(node.leave())
    return interrupted, used / max(CYCLE, (node.heard or 0.0) - began[0]) if began else 0.0


def _actuator(scenario: Scenario) -> ActuatorConfig:
    return ActuatorConfig(angle_limit=scenario.vehicle.steer_limit)
