"""What a node has seen of the other end in the long run, and what that says about a drive.

The actuator decides from cycle to cycle. Whether the drive is worth a verdict shows only afterwards: a controller that
fell silent, a second one on the same bus, commands out of sequence, time spent in fail-safe.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, Literal, NamedTuple

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.codec.database import CYCLE
from sidestep.controller.can_port.codec.messages import ActuatorState
from sidestep.controller.can_port.protection.e2e import CheckStatus

Verdict = Literal["pass", "fail", "inconclusive"]
"""What a drive may be at best with a finding; "pass" is a pass that says so in its label."""

FAIL_SAFE = (ActuatorState.STANDBY, ActuatorState.RAMP_TO_ZERO, ActuatorState.FAULT)
"""States in which the actuator does not do what the controller asks for, but what is safe."""

TOO_LATE = 0.05
"""Lateness of a command that no actuator bridges, in [s]."""

_BURST = 20.0  # frames that may come at once after as many cycles without one, or be too many


class Finding(NamedTuple):
    """Something on the bus that a verdict has to name.

    Attributes:
        label: In one or two words.
        verdict: The best that the drive can still be.
        text: With the figures.
    """

    label: str
    verdict: Verdict
    text: str


@dataclass(frozen=True)
class CommandRecord:
    """What the actuator's end saw of the commands, from the moment on that the car was let go.

    Attributes:
        cycles: Cycles of the node.
        seconds_in: Time in every state of the actuator, in [s].
        checks: Outcomes of the frame checks.
        implausible: Commands that passed them and cannot have been meant.
        lost: Commands that the alive counter says were lost.
        longest_silence: Longest time without an accepted command, in [s].
        silent_at_end: Time since the last one, in [s].
        unheard_at_end: Time since the last intact command, accepted or not, in [s].
        hold_age: What the actuator bridges, in [s].
        senders: 2 if there must have been more than one, else 1.
        strangers: Frames that came from elsewhere under an identifier of this node.
        blocked: Commands that the interface did not let pass.
    """

    cycles: int
    seconds_in: Mapping[ActuatorState, float]
    checks: Mapping[CheckStatus, int]
    implausible: int
    lost: int
    longest_silence: float
    silent_at_end: float
    unheard_at_end: float
    hold_age: float
    senders: int
    strangers: int = 0
    blocked: int = 0

    @property
    def fail_safe(self) -> float:
        """Time in fail-safe, in [s]."""
        return sum(self.seconds_in.get(state, 0.0) for state in FAIL_SAFE)

    def as_dict(self) -> dict[str, Any]:
        """For summary.json."""
        return {
            "cycles": self.cycles,
            "seconds_in": {state.name: seconds for state, seconds in self.seconds_in.items()},
            "checks": {status.value: count for status, count in self.checks.items()},
            "implausible": self.implausible, "lost": self.lost, "longest_silence_s": self.longest_silence,
            "silent_at_end_s": self.silent_at_end,
            "unheard_at_end_s": self.unheard_at_end, "senders": self.senders, "strangers": self.strangers,
            "blocked": self.blocked,
        }  # fmt: skip


@dataclass
class CommandWatch:
    """Watches an actuator and its commands, cycle by cycle.

    Attributes:
        actuator: Whose.
        several_senders: Whether one sender cannot have sent all that came.
    """

    actuator: Actuator
    several_senders: bool = False
    _states: Counter[ActuatorState] = field(default_factory=Counter)
    _checks: Counter[CheckStatus] = field(default_factory=Counter)
    _before: tuple[int, int, int] = (0, 0, 0)  # implausible, lost and blocked, when it began
    _began: float = -inf
    _time: float = -inf
    _heard: float = -inf
    _intact: float = -inf
    _silence: float = 0.0
    _surplus: float = 0.0  # frames beyond one a cycle

    def begin(self, time: float) -> None:
        """From `time`, in [s], on it counts."""
        self._states.clear()
        self._checks = Counter(self.actuator.channel.receiver.counts)
        self._before = self.actuator.implausible, self.actuator.channel.receiver.lost, self.actuator.blocked
        self._began = self._heard = self._intact = time
        self._silence, self.several_senders = 0.0, False

    def see(self, time: float, commands: Sequence[bytes | bytearray]) -> None:
        """Take in a cycle at `time`, in [s], after the actuator's step."""
        passed = (time - self._time) / CYCLE if self._time > -inf else 1.0
        self._time = time
        message = self.actuator.channel.message
        whole = (data for data in commands if len(data) == message.length)
        counters = [(message.profile.counter_of(data), bytes(data)) for data in whole]
        intact = [(counter, data) for counter, data in counters if counter is not None]
        self._surplus = max(self._surplus - passed * CYCLE / message.cycle + len(intact), -_BURST)
        twofold = len(intact) < message.profile.counters and len(set(intact)) > len({counter for counter, _ in intact})
        if self._surplus > _BURST or twofold:
            self.several_senders = True
        self._intact = time if intact else self._intact
        self._states[self.actuator.state] += 1
        if (asked := self.actuator.asked) and asked.time > self._heard:
            self._silence, self._heard = max(self._silence, asked.time - self._heard), asked.time

    def record(self, strangers: int = 0) -> CommandRecord:
        """What there is to say.

        Args:
            strangers: Frames from elsewhere under an identifier of this node.
        """
        receiver, silent = self.actuator.channel.receiver, max(0.0, self._time - self._heard)
        return CommandRecord(
            cycles=self._states.total(),
            seconds_in={state: count * CYCLE for state, count in sorted(self._states.items())},
            checks=Counter(receiver.counts) - self._checks,
            implausible=self.actuator.implausible - self._before[0],
            lost=receiver.lost - self._before[1],
            longest_silence=max(self._silence, silent),
            silent_at_end=silent,
            unheard_at_end=max(0.0, self._time - self._intact),
            hold_age=self.actuator.hold_age,
            senders=1 + self.several_senders,
            strangers=strangers,
            blocked=self.actuator.blocked - self._before[2],
        )


def findings(record: CommandRecord) -> tuple[Finding, ...]:
    """What a verdict has to name, causes before what follows from them."""
    wrong, corrupt = record.checks.get(CheckStatus.WRONGSEQUENCE, 0), record.checks.get(CheckStatus.ERROR, 0)
    held = record.seconds_in.get(ActuatorState.HOLD, 0.0)
    found: tuple[tuple[bool, str, Verdict, str], ...] = (
        (record.senders > 1, "second sender", "inconclusive", "more commands than one controller can have sent"),
        (record.strangers > 0, "second sender", "inconclusive",
         f"{record.strangers} frames from elsewhere under identifiers of the vehicle"),
        (record.unheard_at_end > record.hold_age, "controller silent", "fail",
         f"no command for the last {record.silent_at_end:.2f} s"),
        (record.unheard_at_end <= record.hold_age < record.silent_at_end, "commands not accepted", "fail",
         f"none in the last {record.silent_at_end:.2f} s: the channel is not VALID again"),
        (record.implausible > 0, "implausible commands", "inconclusive",
         f"{record.implausible} intact commands that cannot have been meant"),
        (record.blocked > 0, "blocked by the interface", "fail",
         f"{record.blocked} commands beyond what the interface lets pass"),
        (record.fail_safe > 0.0, "fail-safe", "fail", f"actuator in fail-safe for {record.fail_safe:.2f} s"),
        (wrong > 0, "wrong sequence", "inconclusive", f"{wrong} commands out of sequence"),
        (corrupt > 0, "corrupt commands", "inconclusive", f"{corrupt} commands with a wrong CRC or length"),
        (held > 0.0, "commands bridged", "pass", f"last command held for {held:.2f} s"),
    )  # fmt: skip
    return tuple(Finding(label, verdict, text) for there, label, verdict, text in found if there)


@dataclass(frozen=True)
class StateRecord:
    """What the controller's end saw of the vehicle, while it steered.

    Attributes:
        left: Whether the vehicle said that it leaves before it fell silent.
        stale: Time with nothing to steer by between states, in [s].
        checks: Outcomes of the frame checks of all its messages.
        strangers: Frames that came from elsewhere under an identifier of this node.
        late: By how much after it was due the latest of its own cycles had ended, in [s].
    """

    left: bool
    stale: float
    checks: Mapping[CheckStatus, int]
    strangers: int = 0
    late: float = 0.0


def state_findings(record: StateRecord) -> tuple[Finding, ...]:
    """What the controller's end has to name, causes before what follows from them."""
    wrong, corrupt = record.checks.get(CheckStatus.WRONGSEQUENCE, 0), record.checks.get(CheckStatus.ERROR, 0)
    found: tuple[tuple[bool, str, Verdict, str], ...] = (
        (record.strangers > 0, "second sender", "inconclusive",
         f"{record.strangers} frames from elsewhere under identifiers of the controller"),
        (not record.left, "vehicle silent", "fail", "the vehicle fell silent and had not said that it leaves"),
        (record.late > TOO_LATE, "controller late", "fail", f"a cycle ended {record.late:.2f} s after it was due"),
        (record.stale > 0.0, "nothing to steer by", "fail", f"no usable state for {record.stale:.2f} s on the way"),
        (wrong > 0, "wrong sequence", "inconclusive", f"{wrong} frames out of sequence"),
        (corrupt > 0, "corrupt frames", "inconclusive", f"{corrupt} frames with a wrong CRC or length"),
    )  # fmt: skip
    return tuple(Finding(label, verdict, text) for there, label, verdict, text in found if there)
