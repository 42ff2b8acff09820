"""How the path search grows: with obstacles on the road, and with nodes of the lattice.

    python benchmarks/controller/planner_scaling.py

Whole controller steps on a road with 2 and with 50 boxes along 500 m, in turns on the same states, and the exact search
alone on lattices of up to a million nodes. Every figure is the least of several medians, and a ratio.
"""

from time import perf_counter

import numpy as np

from sidestep.controller import SteeringController
from sidestep.controller.decision.lattice import shortest_path
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.road.segments import Line
from sidestep.plant_models.signals import VehicleState
from sidestep.plant_models.vehicle.parameters import VehicleParameters

FEW, MANY = 2, 50
ROUNDS, SECONDS = 7, 8.0
LATTICES = ((60, 100), (60, 1000), (600, 1000), (1000, 1000))
"""Layers and lateral nodes."""
REACH = 3
"""Largest lateral step between layers, in nodes."""


def boxes(count: int) -> list[Obstacle]:
    """The first two at the paper's places, the others at the edges of the road ahead."""
    rng = np.random.default_rng(1)
    beside = [Obstacle(s, float(rng.choice((-1, 1))) * 3.6, 3.0, 0.8) for s in np.linspace(15.0, 500.0, count - 2)]
    return [Obstacle(40.0, -0.6, 4.5, 1.8), Obstacle(70.0, 0.8, 4.5, 1.8), *beside]


def drive(controller: SteeringController, car: VehicleParameters) -> float:
    """Median time of a step over one drive, in [us]."""
    times, controller_step = [], controller.step
    controller.reset()
    with LinearPlant(car) as plant:
        state = plant.reset(VehicleState(v_x=15.0))
        while state.time < SECONDS:
            began = perf_counter()
            command = controller_step(state)
            times.append(perf_counter() - began)
            state = plant.step(command, 0.02)
    return 1e6 * float(np.median(times))


def search(layers: int, lateral: int) -> float:
    """Least time of the search, in [ns] per node."""
    cost = np.random.default_rng(2).uniform(0.0, 1.0, (layers, lateral))
    middle, times = 0.5 * lateral, []
    for _ in range(ROUNDS):
        began = perf_counter()
        shortest_path(cost, 1.0, 1.0, REACH, middle, float(REACH), middle)
        times.append(perf_counter() - began)
    return 1e9 * min(times) / cost.size


def main() -> None:
    car, road = VehicleParameters.preset("bmw-320i"), ReferencePath.from_segments([Line(600.0)])
    controllers = {count: SteeringController(car, road, boxes(count)) for count in (FEW, MANY)}
    medians = {count: [] for count in controllers}
    for _ in range(ROUNDS):
        for count, controller in controllers.items():
            medians[count].append(drive(controller, car))
    few, many = (min(medians[count]) for count in (FEW, MANY))
    print(f"step with {FEW} obstacles {few:.0f} us, with {MANY} {many:.0f} us: {many / few:.2f} times (asked: 1.3)")
    for layers, lateral in LATTICES:
        print(f"{layers * lateral:9d} nodes: {search(layers, lateral):.2f} ns per node")


if __name__ == "__main__":
    main()
