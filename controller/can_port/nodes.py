"""The two ends of the bus, as what they do in one cycle: frames in, frames out. In any time, simulated or real.

    controller   takes the vehicle's state from the bus and answers with STEER_CMD; CTRL_STATUS every 100 ms
    vehicle      takes STEER_CMD with its steering actuator and answers with STEER_STATUS and the state's three frames

Neither waits for the other: every cycle has its frames. While its input is older than 50 ms, or a channel is not
VALID, the controller sends enable = 0 and asks to stop.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from sidestep.controller.can_port.actuator import Actuator, ActuatorConfig
from sidestep.controller.can_port.bus.channel import Channel
from sidestep.controller.can_port.codec.database import Frame, ProtectedMessage, messages
from sidestep.controller.can_port.codec.messages import (
    CTRL_STATUS,
    MAX_RATE_LIMIT,
    STEER_CMD,
    STEER_STATUS,
    VEHICLE_STATE,
    ControllerStatus,
    QpStatus,
    SteerMode,
    decode_controller_status,
    decode_steer_status,
    decode_vehicle_state,
    encode_controller_status,
    encode_steer_command,
    encode_steer_status,
    encode_vehicle_state,
)
from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus, Receiver
from sidestep.controller.can_port.protection.e2e_state import E2EState
from sidestep.controller.plan import Plan
from sidestep.controller.steering import SteeringController
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

CYCLE = STEER_CMD.cycle
"""Time between two steering commands on the bus, in [s]."""

STALE = 0.05
"""Oldest input that the controller steers by, in [s]."""

_UNDER_WAY = 3  # samples that may be incomplete at the same time
_READABLE = ACCEPTED | {CheckStatus.INITIAL}
_QP_STATUS = {
    "UNCONSTRAINED": QpStatus.SOLVED, "SOLVED": QpStatus.SOLVED, "ITERATION_LIMIT": QpStatus.MAX_ITERATIONS,
    "INFEASIBLE": QpStatus.PRIMAL_INFEASIBLE, "INPUT": QpStatus.NOT_RUN,
}  # fmt: skip


class StateListener:
    """Puts the vehicle's state together from its frames; only what is intact, whole and declared valid counts.

    Args:
        catalogue: The messages in the protection in use.

    Attributes:
        channels: Receiving ends by identifier.
        state: The newest state; None before the first. Its time is that of its arrival.
    """

    def __init__(self, catalogue: Mapping[str, ProtectedMessage]):
        self._sample = [catalogue[message.name] for message in VEHICLE_STATE]
        self._status = catalogue[STEER_STATUS.name]
        self.channels = {message.frame_id: Channel(message) for message in (*self._sample, self._status)}
        self.state: VehicleState | None = None
        self._parts: dict[int, dict[int, bytes | bytearray]] = {}  # counter -> identifier -> data
        self._angle, self._angle_time = 0.0, -STALE - 1.0

    def fresh(self, time: float) -> bool:
        """Whether there is a state at `time`, in [s], that may be steered by."""
        return (
            self.state is not None
            and time - self.state.time <= STALE + 1e-9
            and time - self._angle_time <= STALE + 1e-9
            and all(channel.state is E2EState.VALID for channel in self.channels.values())
        )

    def take(self, time: float, frames: Iterable[Frame]) -> None:
        """Take in what arrived in one cycle that ends at `time`, in [s]."""
        arrived: dict[int, list[bytes]] = {frame_id: [] for frame_id in self.channels}
        for frame_id, data in frames:
            if frame_id in arrived:
                arrived[frame_id].append(data)
        for data in self.channels[self._status.frame_id].take(arrived.pop(self._status.frame_id)):
            self._angle, self._angle_time = decode_steer_status(data, self._status).angle, time
        for frame_id, of_message in arrived.items():
            channel = self.channels[frame_id]
            for data in channel.take(of_message):
                self._add(time, channel.receiver.counter or 0, frame_id, data)

    def _add(self, time: float, counter: int, frame_id: int, data: bytes | bytearray) -> None:
        parts = self._parts.setdefault(counter, {})
        parts[frame_id] = data
        if len(parts) == len(self._sample):
            near = self.state.yaw if self.state else 0.0
            whole = [parts[message.frame_id] for message in self._sample]
            self.state = decode_vehicle_state(whole, time, self._angle, near, self._sample) or self.state
            self._parts.clear()
        elif len(self._parts) > _UNDER_WAY:
            del self._parts[next(iter(self._parts))]


class ControllerNode:
    """The controller's end of the bus.

    Args:
        controller: Is reset when the first state arrives; that moment is time 0 for it.
        catalogue: The messages in the protection in use.

    Attributes:
        listener: The vehicle's state as received.
        stale_cycles: Cycles since the first state in which there was nothing to steer by.
        heard: Time of the last cycle in which there was, in [s]; None before the first.
    """

    def __init__(self, controller: SteeringController, catalogue: Mapping[str, ProtectedMessage] | None = None):
        catalogue = catalogue or messages()
        self._controller, self._messages = controller, catalogue
        literal = controller.config.formulation == "paper"  # its angle is free to jump
        self._rate_limit = MAX_RATE_LIMIT if literal else controller.vehicle.steer_rate_limit
        self._cycles_per_step = max(1, round(controller.config.period / CYCLE))
        self.listener = StateListener(catalogue)
        self.stale_cycles = 0
        self.heard: float | None = None
        self._began: float | None = None
        self._cycle = self._fresh_cycles = 0
        self._command = SteeringCommand(0.0, 0.0, 0.0, Status.FAULT)

    def step(self, time: float, frames: Iterable[Frame]) -> list[Frame]:
        """One cycle.

        Args:
            time: Of this cycle, in [s].
            frames: What arrived since the last one, oldest first.

        Returns:
            What is to be sent.
        """
        self.listener.take(time, frames)
        enable = self.listener.fresh(time)
        if enable:
            self._steer(time)
        elif self._began is not None:
            self.stale_cycles += 1
            self._fresh_cycles = 0
        return self._answer(time, enable)

    def leave(self, time: float) -> list[Frame]:
        """The last frames, sent at `time`, in [s]: enable = 0."""
        return self._answer(time, enable=False)

    def _answer(self, time: float, enable: bool) -> list[Frame]:
        command = self._command if enable else SteeringCommand(time, 0.0, 0.0, Status.FAULT)
        message = self._messages[STEER_CMD.name]
        answer = [(message.frame_id, encode_steer_command(command, self._cycle, enable, self._rate_limit, message))]
        status = self._messages[CTRL_STATUS.name]
        if self._cycle % round(status.cycle / CYCLE) == 0:
            count = self._cycle // round(status.cycle / CYCLE)
            report = _report(self._controller.plan if enable else None, enable)
            answer.append((status.frame_id, encode_controller_status(report, count, status)))
        self._cycle += 1
        return answer

    def _steer(self, time: float) -> None:
        state = self.listener.state
        if state is None:
            return
        if self._began is None:
            self._began = state.time
            self._controller.reset()
        if self._fresh_cycles % self._cycles_per_step == 0:
            self._command = self._controller.step(replace(state, time=state.time - self._began))
        self._fresh_cycles += 1
        self.heard = time


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

    Attributes:
        actuator: The steering actuator.
        reports: Time of arrival, in [s], and content of every CTRL_STATUS.
    """

    def __init__(self, catalogue: Mapping[str, ProtectedMessage] | None = None, config: ActuatorConfig | None = None):
        self._messages = catalogue or messages()
        self._sample: Sequence[ProtectedMessage] = [self._messages[message.name] for message in VEHICLE_STATE]
        self.actuator = Actuator(config, self._messages[STEER_CMD.name])
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
        commands = [data for frame_id, data in arrived if frame_id == STEER_CMD.frame_id]
        command = self.actuator.step(commands, state)
        for frame_id, data in arrived:
            if frame_id == CTRL_STATUS.frame_id and self._reports.check(data) in _READABLE:
                self.reports.append((state.time, decode_controller_status(data, self._report)))
        answer = self._frames(state, valid)
        self._last = state
        self._cycle += 1
        return command, answer

    def _frames(self, state: VehicleState, valid: bool) -> list[Frame]:
        last = self._last
        slip_rate = (state.v_y - last.v_y) / (state.time - last.time) if last and state.time > last.time else 0.0
        data = encode_vehicle_state(state, slip_rate + state.v_x * state.yaw_rate, self._cycle, valid, self._sample)
        frames = [(message.frame_id, of_message) for message, of_message in zip(self._sample, data, strict=True)]
        if self.actuator.report:
            status = self._messages[STEER_STATUS.name]
            frames.append((status.frame_id, encode_steer_status(self.actuator.report, self._cycle, status)))
        return frames
