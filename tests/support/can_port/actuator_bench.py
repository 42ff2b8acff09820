"""A steering actuator on a bench: its wheels follow at once, and the clock is the caller's."""

import itertools

import pytest

from sidestep.controller.can_port.actuator import Actuator
from sidestep.controller.can_port.codec import messages as m
from sidestep.controller.can_port.codec.database import messages
from sidestep.controller.can_port.codec.messages import ActuatorState
from sidestep.plant_models.signals import SteeringCommand, VehicleState

INIT, STANDBY, ACTIVE = ActuatorState.INIT, ActuatorState.STANDBY, ActuatorState.ACTIVE
HOLD, RAMP, FAULT = ActuatorState.HOLD, ActuatorState.RAMP_TO_ZERO, ActuatorState.FAULT
CYCLE = 0.01


class Bench:
    """An actuator whose wheels follow at once, a sender, and a clock."""

    def __init__(self, config=None, protection="P02", angle=0.0):
        self.message = messages(protection)["STEER_CMD"]
        self.actuator = Actuator(config, self.message)
        self.time, self.angle, self.counters = 0.0, angle, itertools.count()
        self.answer = None

    def frame(self, angle=0.2, speed=15.0, **more):
        command = SteeringCommand(self.time, angle, speed)
        return m.encode_steer_command(command, next(self.counters), message=self.message, **more)

    def step(self, *frames, dt=CYCLE):
        self.time += dt
        self.answer = self.actuator.step(frames, VehicleState(self.time, v_x=14.0, steer_angle=self.angle))
        self.angle = self.answer.steer_angle
        return self.actuator.state

    def send(self, count, **more):
        return [self.step(self.frame(**more)) for _ in range(count)]


def driving(**more):
    bench = Bench(**more)
    bench.send(50)
    assert bench.actuator.state is ACTIVE
    assert bench.angle == pytest.approx(0.2)
    return bench
