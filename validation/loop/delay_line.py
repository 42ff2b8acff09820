"""A bus that takes its time: every command arrives a fixed time after it was sent."""

from collections import deque

from sidestep.plant_models.signals import SteeringCommand


class DelayLine:
    """A `Port` of the co-simulation loop; until the first command arrives nothing does.

    Commands carry the time at which they were sent, which grows; one delay line per run.
    """

    def __init__(self, delay: float):
        """Set the delay, in [s]; 0 hands everything over at once."""
        self.delay = delay
        self._on_the_way: deque[SteeringCommand] = deque()

    def transmit(self, command: SteeringCommand) -> SteeringCommand | None:
        """Send a command; the newest one that has arrived by now, None if none has."""
        self._on_the_way.append(command)
        arrived = None
        while self._on_the_way and self._on_the_way[0].time <= command.time - self.delay + 1e-9:
            arrived = self._on_the_way.popleft()
        return arrived
