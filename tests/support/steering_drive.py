"""Drives of the steering controller on the linear plant."""

from dataclasses import replace

import shapely
import shapely.affinity

from sidestep.controller import SteeringController
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BMW = VehicleParameters.preset("bmw-320i")
ROAD = ReferencePath.from_segments([Line(200.0)])
SINGLE = (Obstacle(40.0, 0.0, 4.5, 1.8),)
DOUBLE = (Obstacle(40.0, -0.6, 4.5, 1.8), Obstacle(70.0, 0.8, 4.5, 1.8))


def drive(obstacles, config=None, road=ROAD, start=None, duration=8.0, vehicle=BMW, delay=0):
    """States, commands and plans of a closed loop on the linear plant."""
    controller = SteeringController(vehicle, road, obstacles, config)
    states, commands, plans = [], [], []
    with LinearPlant(vehicle) as plant:
        state = plant.reset(start or VehicleState(v_x=15.0))
        for _ in range(round(duration / 0.02)):
            states.append(state)
            commands.append(controller.step(state))
            plans.append(controller.plan)
            late = commands[-1 - delay] if len(commands) > delay else replace(commands[0], steer_angle=0.0)
            state = plant.step(late, 0.02)
    return states, commands, plans


def footprint(state):
    car = shapely.box(-BMW.rear_extent, -0.5 * BMW.width, BMW.front_extent, 0.5 * BMW.width)
    turned = shapely.affinity.rotate(car, state.yaw, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, state.x, state.y)


def good_state(time):
    return VehicleState(time=time, x=15.0 * time, v_x=15.0)
