"""Our own messages and signals, and numbers for them."""

import pytest
from hypothesis import strategies as st

from sidestep.controller.can_port.codec.database import messages

MESSAGES = list(messages().values())
SIGNALS = [(message, signal) for message in MESSAGES for signal in message.signals]
by_name = pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
by_signal = pytest.mark.parametrize(("message", "signal"), SIGNALS, ids=lambda x: x.name)
numbers = st.floats(allow_nan=True, allow_infinity=True)


def safe_values(message):
    return {signal.name: signal.safe * signal.scale for signal in message.signals}
