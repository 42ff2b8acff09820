"""The steering actuator's decision: follow, hold, or steer back to zero. Pure and in any time, simulated or real.

    INIT          nothing accepted yet           wheels and speed stay as they are
    ACTIVE        accepted within 25 ms          follow the command within the rate limits
    STANDBY       accepted, but not enabled      steer back to zero, speed as commanded
    HOLD          accepted within 50 ms          hold angle and speed
    RAMP_TO_ZERO  longer ago                     steer back to zero at 0.3 rad/s and stop
    FAULT         steering angle not measurable  hold the angle and stop, for good

A command is accepted if its channel lets it through (see `channel`) and it is plausible: mode, enable and angle
agree, the angle is not farther from the last one than the rate limit allows, and the state that it answers, if it
says which, was sent lately and goes on from the last one.

The acceleration comes with a message of its own, which goes through a channel likewise. While no steering command is
followed, or no acceleration was accepted for as long as a command is held, it is not given: the speed counts.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, nan

from sidestep.controller.can_port.bus.channel import Channel
from sidestep.controller.can_port.codec.database import CYCLE, BusMessage
from sidestep.controller.can_port.codec.messages import (
    ANSWERS,
    MAX_ANGLE,
    MAX_RATE_LIMIT,
    STEER_CMD,
    ActuatorState,
    SteerFrame,
    SteerStatus,
    decode_drive_command,
    decode_steer_command,
)
from sidestep.controller.can_port.codec.samples import sample_number
from sidestep.controller.can_port.interface import Interface
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.signals import Status, SteeringCommand, VehicleState

OLDEST_ANSWER = 0.3
"""Age from which on a state is too old for a command that answers it to be followed, in [s]."""

_STEP = 1e-3  # coarsest step of the angle in a mapped message, in [rad]
_INSTANT = 1e-9  # two times closer than this are the same, in [s]


@dataclass(frozen=True)
class ActuatorConfig:
    """Limits of the steering actuator.

    Attributes:
        active_age: Oldest command that is followed, in [s].
        hold_age: Oldest command that is held, in [s].
        ramp_rate: Rate of the way back to zero, in [rad/s].
        angle_limit: Largest road-wheel angle, in [rad].
        rate_limit: Largest road-wheel rate, in [rad/s]; the command may ask for less.
    """

    active_age: float = 0.025
    hold_age: float = 0.050
    ramp_rate: float = 0.3
    angle_limit: float = MAX_ANGLE
    rate_limit: float = MAX_RATE_LIMIT

    def __post_init__(self) -> None:
        limits = (self.active_age, self.hold_age, self.ramp_rate, self.angle_limit, self.rate_limit)
        if not (all(0.0 < limit < inf for limit in limits) and self.active_age <= self.hold_age):
            raise InputError("actuator", f"{self}", "finite numbers > 0, active_age <= hold_age")


class Actuator:
    """Steering actuator on the bus; `step` is called once every cycle.

    Args:
        config: Limits.
        message: The message that steers.
        interface: What lies before it and blocks what passes its limits; None for nothing.
        drive: The message that carries the acceleration; None for none.

    Attributes:
        state: Present state.
        report: What the last `step` has to say on STEER_STATUS; None before it.
        channel: Receiving end of the command.
        implausible: Commands that came through the channel but cannot have been meant.
        blocked: Commands that the interface did not let pass.
    """

    def __init__(
        self,
        config: ActuatorConfig | None = None,
        message: BusMessage = STEER_CMD,
        interface: Interface | None = None,
        drive: BusMessage | None = None,
    ):
        self.config = config or ActuatorConfig()
        self.state = ActuatorState.INIT
        self.report: SteerStatus | None = None
        self.channel = Channel(message)
        self._drive = Channel(drive) if drive else None
        self._acceleration, self._accelerated = nan, -inf  # as accepted last, and when
        self.implausible = self.blocked = 0
        self._interface = interface
        self._slowness = max(1.0, message.cycle / CYCLE)
        self._frame: SteerFrame | None = None  # the last accepted one
        self._target = self._speed = 0.0
        self._last: VehicleState | None = None

    def step(
        self, frames: Iterable[bytes | bytearray], vehicle: VehicleState, drive: Iterable[bytes | bytearray] = ()
    ) -> SteeringCommand:
        """What steering and speed control do until the next cycle.

        Args:
            frames: STEER_CMD frames that arrived since the last call, oldest first.
            vehicle: State now; its time must not go backwards.
            drive: DRIVE_CMD frames likewise.
        """
        self._speed = vehicle.v_x if self._frame is None else self._speed
        self._receive(frames, vehicle.time)
        if self._drive:
            for data in self._drive.take(drive):
                self._acceleration = decode_drive_command(data, self._drive.message)
                self._accelerated = vehicle.time
        self.state = self._next_state(vehicle)
        elapsed = max(0.0, vehicle.time - self._last.time) if self._last else 0.0
        if self.state is not ActuatorState.FAULT and (self.state is ActuatorState.INIT or self._last is None):
            self._target = vehicle.steer_angle
        self._target = self._next_target(elapsed)
        self.report = self._report(vehicle, elapsed)
        self._last = vehicle
        return self._command(vehicle)

    @property
    def active_age(self) -> float:
        """Oldest command that is followed, in [s]: that of the limits, longer for a message that comes more seldom."""
        return self.config.active_age * self._slowness

    @property
    def hold_age(self) -> float:
        """Oldest command that is held, in [s]; likewise."""
        return self.config.hold_age * self._slowness

    @property
    def asked(self) -> SteeringCommand | None:
        """The last accepted command, limited by nothing; None before the first."""
        return self._frame.command if self._frame else None

    def _receive(self, frames: Iterable[bytes | bytearray], time: float) -> None:
        for data in self.channel.take(frames):
            frame = self._with_speed(decode_steer_command(data, time, self.channel.message))
            if not (frame.plausible and self._can_be_next(frame)):
                self.implausible += 1
            elif not self._passes(frame):
                self.blocked += 1
            else:
                self._frame = frame

    def _passes(self, frame: SteerFrame) -> bool:
        """Whether the interface lets a command pass; one cycle more, for frames that waited on their way."""
        if self._interface is None or self._last is None or not frame.enable:
            return True
        command, cycle = frame.command, self.channel.message.cycle
        if self._frame and self._frame.enable:
            last, elapsed = self._frame.command.steer_angle, command.time - self._frame.command.time + cycle
        else:
            last, elapsed = self._last.steer_angle, cycle
        return self._interface.passes(command.steer_angle, last, self._last.v_x, elapsed, _STEP)

    def _with_speed(self, frame: SteerFrame) -> SteerFrame:
        """A command that carries no speed asks for the one at which steering began."""
        if not isnan(frame.command.target_speed):
            return frame
        return frame._replace(command=replace(frame.command, target_speed=self._speed))

    def _can_be_next(self, frame: SteerFrame) -> bool:
        """Whether it answers what was sent lately and the angle can have come so far.

        `hold_age` more than the time between them, for frames that waited on their way.
        """
        last = self._frame
        if not _answers_lately(frame, last, self.hold_age):
            return False
        if last is None or not (last.enable and frame.enable):
            return True
        elapsed = frame.command.time - last.command.time + self.hold_age
        return abs(frame.command.steer_angle - last.command.steer_angle) <= elapsed * last.rate_limit

    def _next_state(self, vehicle: VehicleState) -> ActuatorState:
        if self.state is ActuatorState.FAULT or not isfinite(vehicle.steer_angle):
            return ActuatorState.FAULT
        if self._frame is None:
            return ActuatorState.INIT
        age = vehicle.time - self._frame.command.time - _INSTANT
        if age <= self.active_age:
            return ActuatorState.ACTIVE if self._frame.enable else ActuatorState.STANDBY
        return ActuatorState.HOLD if age <= self.hold_age else ActuatorState.RAMP_TO_ZERO

    def _next_target(self, elapsed: float) -> float:
        """Angle to go to, in [rad]."""
        if self.state is ActuatorState.ACTIVE and self._frame:
            limit = self.config.angle_limit
            wanted = min(max(self._frame.command.steer_angle, -limit), limit)
            return _towards(wanted, self._target, elapsed * min(self._frame.rate_limit, self.config.rate_limit))
        if self.state in (ActuatorState.STANDBY, ActuatorState.RAMP_TO_ZERO):
            return _towards(0.0, self._target, elapsed * self.config.ramp_rate)
        return self._target

    def _command(self, vehicle: VehicleState) -> SteeringCommand:
        if self.state is ActuatorState.INIT:
            return SteeringCommand(vehicle.time, self._target, vehicle.v_x, Status.FAULT)
        if self._frame is None or self.state in (ActuatorState.RAMP_TO_ZERO, ActuatorState.FAULT):
            return SteeringCommand(vehicle.time, self._target, 0.0, Status.FAULT)
        asked = self._frame.command
        status = asked.status if self.state is ActuatorState.ACTIVE else max(asked.status, Status.DEGRADED)
        acceleration = asked.acceleration if self._drive is None else self._acceleration
        if self._drive and vehicle.time - self._accelerated - _INSTANT > self.hold_age:
            acceleration = nan
        if self.state is ActuatorState.STANDBY:
            acceleration = nan
        return SteeringCommand(vehicle.time, self._target, asked.target_speed, status, acceleration=acceleration)

    def _report(self, vehicle: VehicleState, elapsed: float) -> SteerStatus:
        rate = (vehicle.steer_angle - self._last.steer_angle) / elapsed if self._last and elapsed > 0.0 else 0.0
        return SteerStatus(self.state, vehicle.steer_angle, rate, self.channel.state, self.channel.receiver.lost)


def _towards(goal: float, start: float, reach: float) -> float:
    """`start` moved towards `goal` by `reach` at most."""
    return start + min(max(goal - start, -reach), reach)


def _answers_lately(frame: SteerFrame, last: SteerFrame | None, hold_age: float) -> bool:
    """Whether the state that a command answers was sent in the last `OLDEST_ANSWER`, and is as new as it can be."""
    if frame.answers is None:
        return True
    now = sample_number(frame.command.time)
    if (now - frame.answers) % ANSWERS > OLDEST_ANSWER / CYCLE:
        return False
    if last is None or last.answers is None:
        return True
    passed = now - sample_number(last.command.time) + 2.0 * hold_age / CYCLE
    return passed >= ANSWERS or (frame.answers - last.answers) % ANSWERS <= passed
