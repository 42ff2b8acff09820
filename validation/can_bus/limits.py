"""What the interface of a bus leaves of a car's steering."""

from dataclasses import replace

from sidestep.controller.can_port.codec.catalogue import BusDescription
from sidestep.validation.scenarios.scenario import Scenario


def within(scenario: Scenario, bus: BusDescription) -> Scenario:
    """The scenario with a car that steers no faster and no farther than the interface lets pass at its speed."""
    if bus.interface is None:
        return scenario
    car = scenario.vehicle
    rate = min(car.steer_rate_limit, bus.interface.rate(scenario.speed))
    limit = min(car.steer_limit, bus.interface.highest(scenario.speed))
    return replace(scenario, vehicle=replace(car, steer_rate_limit=rate, steer_limit=limit))
