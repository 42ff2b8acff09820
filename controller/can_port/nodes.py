"""The two ends of the bus, as what they do in one cycle: frames in, frames out. In any time, simulated or real.

    controller   takes the vehicle's state from the bus, answers with DRIVE_CMD and STEER_CMD; CTRL_STATUS every 100 ms
    vehicle      takes both with its actuators and answers with STEER_STATUS and the state's three frames

Neither waits for the other: every cycle has its frames. While its input is older than 50 ms, or a channel is not
VALID, the controller sends enable = 0 and asks to stop.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from sidestep.controller.can_port.actuator import Actuator, ActuatorConfig
from sidestep.controller.can_port.codec.database import CYCLE, BusMessage, Catalogue, Frame, messages
from sidestep.controller.can_port.codec.messages import (
    CTRL_STATUS,
    DRIVE_CMD,
    MAX_RATE_LIMIT,
    STEER_CMD,
    STEER_STATUS,
    ControllerStatus,
    QpStatus,
    SteerMode,
    SteerStatus,
    decode_controller_status,
    encode_controller_status,
    encode_drive_command,
    encode_steer_command,
    steer_status_values,
)
from sidestep.controller.can_port.codec.samples import VEHICLE_STATE, encode_vehicle_state
from sidestep.controller.can_port.findings import CommandWatch, StateRecord
from sidestep.controller.can_port.interface import Interface
from sidestep.controller.can_port.listener import VEHICLE_NODES, Sample, StateListener
from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus, Receiver
from sidestep.controller.plan import Plan
from sidestep.controller.steering import SteeringController
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

_STOP = SteeringCommand(0.0, 0.0, 0.0, Status.FAULT)
_READABLE = ACCEPTED | {CheckStatus.INITIAL}
_QP_STATUS = {
    "UNCONSTRAINED": QpStatus.SOLVED, "SOLVED": QpStatus.SOLVED, "ITERATION_LIMIT": QpStatus.MAX_ITERATIONS,
    "INFEASIBLE": QpStatus.PRIMAL_INFEASIBLE, "INPUT": QpStatus.NOT_RUN,
}  # fmt: skip


class Steering:
    """A controller that is stepped once for every command, at the state that the command answers.

    Args:
        controller: Is reset when the first state comes, and when the vehicle's clock has started again.
        cycle: Time between two commands, in [s].
        interface: What the angle has to pass; None for nothing.
    """

    def __init__(self, controller: SteeringController, cycle: float = CYCLE, interface: Interface | None = None):
        self._controller, self._interface, self._cycle = controller, interface, cycle
        self._angle: float | None = None  # last let pass
        self._cycles_per_step = max(1, round(controller.config.period / cycle))
        self._began: Sample | None = None
        self._cycles = 0  # since there was something to steer by
        self._command = SteeringCommand(0.0, 0.0, 0.0, Status.FAULT)

    @property
    def has_begun(self) -> bool:
        """Whether there has been a state to steer by."""
        return self._began is not None

    def answer(self, sample: Sample) -> SteeringCommand:
        """The command of a cycle that has `sample` to steer by; the first sample is time 0."""
        if self._began is None or sample.drive != self._began.drive:
            self._began = sample
            self._controller.reset()
            self._cycles = 0
        if self._cycles % self._cycles_per_step == 0:
            time = (sample.number - self._began.number) * CYCLE
            self._command = self._controller.step(replace(sample.state, time=time))
        self._cycles += 1
        if self._interface is None:
            return self._command
        last = sample.state.steer_angle if self._angle is None else self._angle
        self._angle = self._interface.limited(self._command.steer_angle, last, sample.state.v_x, self._cycle)
        return replace(self._command, steer_angle=self._angle)

    def pause(self) -> None:
        """A cycle with nothing to steer by."""
        self._cycles, self._angle = 0, None


class ControllerNode:
    """The controller's end of the bus.

    Args:
        controller: Is reset when the first state arrives; that moment is time 0 for it.
        catalogue: The messages in use.
        interface: What the angle has to pass; None for nothing.

    Attributes:
        listener: The vehicle's state as received.
        stale_cycles: Cycles since the first state in which there was nothing to steer by.
        gap_cycles: Those of them after which there was again.
        heard: Time of the last cycle in which there was, in [s]; None before the first.
    """

    def __init__(
        self,
        controller: SteeringController,
        catalogue: Catalogue | None = None,
        interface: Interface | None = None,
    ):
        catalogue = catalogue or messages()
        self._controller, self._messages = controller, catalogue
        self._steering = Steering(controller, catalogue[STEER_CMD.name].cycle, interface)
        literal = controller.config.formulation == "paper"  # its angle is free to jump
        self._rate_limit = MAX_RATE_LIMIT if literal else controller.vehicle.steer_rate_limit
        self.listener = StateListener(catalogue)
        self.stale_cycles = self.gap_cycles = 0
        self.heard: float | None = None
        self._cycle = 0

    def step(self, time: float, frames: Iterable[Frame]) -> list[Frame]:
        """One cycle.

        Args:
            time: Of this cycle, in [s].
            frames: What arrived since the last one, oldest first.

        Returns:
            What is to be sent.
        """
        self.listener.take(time, frames)
        sample = self.listener.sample if self.listener.fresh(time) else None
        if sample:
            self.heard, self.gap_cycles = time, self.stale_cycles
            due = _count(self._messages[STEER_CMD.name], self._cycle) is not None
            return self._answer(self._steering.answer(sample) if due else _STOP, sample)
        if self._steering.has_begun:
            self.stale_cycles += 1
            self._steering.pause()
        return self._answer(_STOP)

    def record(self, strangers: int = 0, late: float = 0.0) -> StateRecord:
        """What there is to say of the vehicle.

        Args:
            strangers: Frames from elsewhere under an identifier of this node.
            late: By how much after it was due the latest of its cycles had ended, in [s].
        """
        checks = sum((Counter(channel.receiver.counts) for channel in self.listener.channels.values()), Counter())
        return StateRecord(not self.listener.said_valid, self.gap_cycles * CYCLE, checks, strangers, late)

    def leave(self) -> list[Frame]:
        """The last frames: enable = 0."""
        return self._answer(_STOP)

    def _answer(self, command: SteeringCommand, sample: Sample | None = None) -> list[Frame]:
        answer, enable = [], sample is not None
        message, status = self._messages[STEER_CMD.name], self._messages[CTRL_STATUS.name]
        if (count := _count(message, self._cycle)) is not None:
            answers = sample.answers if sample else None
            if drive := self._messages.get(DRIVE_CMD.name):
                answer.append((drive.frame_id, encode_drive_command(command, count, enable, drive)))
            data = encode_steer_command(command, count, enable, self._rate_limit, message, answers)
            answer.append((message.frame_id, data))
        if (count := _count(status, self._cycle)) is not None:
            report = _report(self._controller.plan if enable else None, enable)
            answer.append((status.frame_id, encode_controller_status(report, count, status)))
        self._cycle += 1
        return answer


def _count(message: BusMessage, cycle: int) -> int | None:
    """Number of the frame that is due in this cycle; None if none is."""
    number, rest = divmod(cycle, max(1, round(message.cycle / CYCLE)))
    return None if rest else number


def _report(plan: Plan | None, enable: bool) -> ControllerStatus:
    mode = SteerMode.ANGLE if enable else SteerMode.STANDBY
    if plan is None:
        return ControllerStatus(QpStatus.NOT_RUN, Status.FAULT, mode, 0.0, 0.0, 0)
    qp_status = _QP_STATUS.get(plan.solver_status, QpStatus.NUMERICS)
    return ControllerStatus(qp_status, plan.status, mode, 1e-6 * plan.step_us, plan.slack_corridor, plan.iterations)


class VehicleNode:
    """The vehicle's end of the bus: steering actuator and motion sensors.

    Args:
        catalogue: The messages in the protection in use.
        config: Limits of the actuator.
        interface: What lies before it; None for nothing.

    Attributes:
        actuator: The steering actuator.
        watch: What it makes of the commands in the long run.
        reports: Time of arrival, in [s], and content of every CTRL_STATUS.
    """

    def __init__(
        self,
        catalogue: Catalogue | None = None,
        config: ActuatorConfig | None = None,
        interface: Interface | None = None,
    ):
        self._messages = catalogue or messages()
        self._sample = [self._messages[message.name] for message in VEHICLE_STATE]
        self._foreign = [m for m in self._messages.values() if not m.tied and m.sender in VEHICLE_NODES]
        self._command = self._messages[STEER_CMD.name]
        self._drive = self._messages.get(DRIVE_CMD.name)
        self.actuator = Actuator(config, self._command, interface, self._drive)
        self.watch = CommandWatch(self.actuator)
        self.reports: list[tuple[float, ControllerStatus]] = []
        self._report = self._messages[CTRL_STATUS.name]
        self._reports = Receiver(self._report.profile, self._report.length)
        self._cycle = 0
        self._last: VehicleState | None = None

    def step(
        self, state: VehicleState, frames: Iterable[Frame], valid: bool = True
    ) -> tuple[SteeringCommand, list[Frame]]:
        """One cycle.

        Args:
            state: State now; its time is that of this cycle.
            frames: What arrived since the last one, oldest first.
            valid: Whether the state is to be steered by.

        Returns:
            What steering and speed control do until the next cycle, and what is to be sent.
        """
        arrived = list(frames)
        commands = [data for frame_id, data in arrived if frame_id == self._command.frame_id]
        drive = [data for frame_id, data in arrived if self._drive and frame_id == self._drive.frame_id]
        command = self.actuator.step(commands, state, drive)
        self.watch.see(state.time, commands)
        for frame_id, data in arrived:
            if frame_id == self._report.frame_id and self._reports.check(data) in _READABLE:
                self.reports.append((state.time, decode_controller_status(data, self._report)))
        answer = self._frames(state, valid)
        self._last = state
        self._cycle += 1
        return command, answer

    def leave(self) -> list[Frame]:
        """The last frames: a state that is not to be used."""
        return self._frames(self._last, valid=False) if self._last else []

    def _frames(self, state: VehicleState, valid: bool) -> list[Frame]:
        last, report = self._last, self.actuator.report
        slip_rate = (state.v_y - last.v_y) / (state.time - last.time) if last and state.time > last.time else 0.0
        lateral = slip_rate + state.v_x * state.yaw_rate
        frames: list[Frame] = []
        if report and (status := self._messages.get(STEER_STATUS.name)):
            frames.append((status.frame_id, status.encode(steer_status_values(report), self._cycle)))
        if report and self._foreign:
            frames += self._foreign_frames(state, lateral, report)
        data = encode_vehicle_state(state, lateral, self._cycle, valid, self._sample)
        return frames + [(message.frame_id, frame) for message, frame in zip(self._sample, data, strict=True)]

    def _foreign_frames(self, state: VehicleState, lateral: float, report: SteerStatus) -> list[Frame]:
        moves = {"VehDyn_Speed": state.v_x, "VehDyn_YawRate": state.yaw_rate, "VehDyn_AccLat": lateral}
        values = steer_status_values(report) | moves
        counted = [(message, _count(message, self._cycle)) for message in self._foreign]
        return [(message.frame_id, message.encode(values, count)) for message, count in counted if count is not None]
