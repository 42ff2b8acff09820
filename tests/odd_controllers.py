"""Controllers of other people, as the tests name them."""

import math

from sidestep.plant_models.signals import SteeringCommand


class Straight:
    """Steers nowhere; fails as told."""

    def __init__(self, speed):
        self.speed, self.resets = speed, 0

    def reset(self):
        self.resets += 1

    def step(self, state):
        return 0.0


class Slows(Straight):
    def step(self, state):
        return SteeringCommand(state.time, 0.0, 3.0)


class Raises(Straight):
    def step(self, state):
        if state.time > 0.5:
            raise ArithmeticError("lost the road")
        return 0.0


class SaysNothing(Straight):
    def step(self, state):
        return math.nan if state.time > 0.5 else 0.0


class Nothing:
    pass


def wants(weather):
    return weather
