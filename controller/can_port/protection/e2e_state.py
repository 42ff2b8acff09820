"""E2E state machine: what a series of frame checks says about the channel.

AUTOSAR FO R19-11, PRS_E2EProtocol, E2E_SMCheck: only OK and ERROR are counted, within a window of the last checks
whose size depends on the state.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum

from sidestep.controller.can_port.protection.e2e import ACCEPTED, CheckStatus
from sidestep.plant_models.errors import InputError

_OK = CheckStatus.OK


class E2EState(IntEnum):
    """State of a protected channel, numbered as in the AUTOSAR specification; an unknown number is invalid."""

    VALID = 0  # communication works, data may be used
    DEINIT = 1  # never entered here: a machine is initialised when it is made
    NODATA = 2  # nothing intact has arrived since the start
    INIT = 3  # something has arrived, not enough yet
    INVALID = 4  # communication does not work, data must not be used

    @classmethod
    def _missing_(cls, value: object) -> "E2EState":
        return cls.INVALID


@dataclass(frozen=True)
class StateConfig:
    """Window and thresholds of one state.

    Attributes:
        window: How many of the last checks count.
        min_ok: Fewest OK among them to be, or become, VALID.
        max_error: Most ERROR among them to be, or become, VALID.
    """

    window: int
    min_ok: int
    max_error: int

    def __post_init__(self) -> None:
        if not (1 <= self.min_ok <= self.window and 0 <= self.max_error <= self.window):
            raise InputError("e2e", f"{self}", "1 <= min_ok <= window, 0 <= max_error <= window")


@dataclass
class E2EStateMachine:
    """State of one protected channel.

    The defaults suit a message every 10 ms: 5 % of lost frames go unnoticed, with 20 % the channel stays VALID nearly
    always (binomial: 0.15 % of the windows fall short), with 50 % it turns INVALID in a blink and stays so.

    Attributes:
        init: Window and thresholds of INIT.
        valid: Those of VALID.
        invalid: Those of INVALID.
        clear_to_invalid: Whether the transition to INVALID forgets the past, so that the way back starts from nothing.
        state: Present state.
    """

    init: StateConfig = StateConfig(window=16, min_ok=8, max_error=6)
    valid: StateConfig = StateConfig(window=16, min_ok=8, max_error=6)
    invalid: StateConfig = StateConfig(window=16, min_ok=14, max_error=2)
    clear_to_invalid: bool = False
    state: E2EState = E2EState.NODATA
    _window: deque[CheckStatus] = field(default_factory=deque, repr=False)

    def __post_init__(self) -> None:
        self._keep(())

    def add(self, status: CheckStatus) -> E2EState:
        """Take in one check and return the new state."""
        if self.state is E2EState.NODATA:
            if status not in (CheckStatus.ERROR, CheckStatus.NONEWDATA):
                self._enter(E2EState.INIT)
            return self.state
        self._window.append(_OK if status in ACCEPTED else status)
        calm = self._window.count(CheckStatus.ERROR) <= self._config.max_error
        good = calm and self._window.count(_OK) >= self._config.min_ok
        if good and self.state is not E2EState.VALID:
            self._enter(E2EState.VALID)
        elif (self.state is E2EState.VALID and not good) or (self.state is E2EState.INIT and not calm):
            self._enter(E2EState.INVALID)
        return self.state

    @property
    def _config(self) -> StateConfig:
        if self.state is E2EState.VALID:
            return self.valid
        return self.invalid if self.state is E2EState.INVALID else self.init

    def _enter(self, state: E2EState) -> None:
        self.state = state
        self._keep(() if state is E2EState.INVALID and self.clear_to_invalid else self._window)

    def _keep(self, checks: Iterable[CheckStatus]) -> None:
        self._window = deque(checks, maxlen=self._config.window)
