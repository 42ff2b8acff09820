"""The best that could be done in the paper's two scenes: an optimal control problem over the whole drive, offline.

    python benchmarks/studies/offline_optimum.py [--nodes 800]

Linear single track (5) at constant speed in the frame of a straight road, the steering rate as input, exactly
discretised over 8 s. The car's side keeps the buffer of Eq. (13) to every obstacle that it is beside, at both ends
of the stretch beside it, and passes where the default controller does. From the centre line back to it, and on it in
the last second, as is asked of the controller, with the least integral of a_y^2 + (JERK_TIME jerk)^2: a sparse convex
QP, solved by PIQP. Prints the peaks and writes them to
validation/scenarios/offline_optimum.json, which `sidestep limits optimum` compares drives with.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import piqp
from scipy import sparse

from sidestep.plant_models.linear.bicycle import continuous, discretise
from sidestep.validation.loop.closed_loop import open_controller
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import Scenario, load_scenario
from sidestep.validation.studies.optimum import RESULTS, SCENES, Peaks

JERK_TIME = 0.1
"""Jerk weighs as much as a_y in motions of this time constant, in [s]."""
BACK = 1.0
"""How long before its end the drive is back on the centre line, in [s]."""
STATES = 5  # l, e, beta, gamma, delta


def passing_sides(scenario: Scenario) -> list[int]:
    """Side of every obstacle on which the default controller passes it, +1 on its left."""
    controller = open_controller(scenario)
    with open_plant(scenario) as plant:
        recording = cosimulate(controller, plant, scenario)
    beside = np.interp([o.s for o in scenario.obstacles], recording["s"], recording["l"])
    return [1 if offset > o.l else -1 for offset, o in zip(beside, scenario.obstacles, strict=True)]


def solve(scenario: Scenario, sides: list[int], nodes: int) -> dict[str, np.ndarray]:
    """Time, states (nodes + 1, 5), lateral acceleration and steering rate of the optimum."""
    vehicle, v, dt = scenario.vehicle, scenario.speed, scenario.duration / nodes
    a, b, _ = continuous(vehicle, v)
    model = np.zeros((STATES, STATES))
    model[:4, :4], model[:4, 4] = a, b
    step, ramp = discretise(model, np.eye(STATES)[:, 4:], dt)
    every, next_one = sparse.eye(nodes, nodes + 1), sparse.eye(nodes, nodes + 1, 1)
    acceleration = sparse.kron(sparse.eye(nodes + 1), v * (model[2:3] + np.eye(STATES)[3:4])).tocsc()
    jerk = (acceleration[1:] - acceleration[:-1]) / dt
    cost = 2.0 * dt * (acceleration.T @ acceleration + JERK_TIME**2 * jerk.T @ jerk)
    dynamics = sparse.hstack([
        sparse.kron(every, step) - sparse.kron(next_one, np.eye(STATES)), sparse.kron(sparse.eye(nodes), ramp)
    ])  # fmt: skip
    rows, low, high = clearances(scenario, sides, v * dt * np.arange(nodes + 1))
    rows = sparse.hstack([rows, sparse.csr_matrix((len(low), nodes))])
    count = STATES * (nodes + 1)
    largest = np.full(count + nodes, 1e3)
    largest[4:count:STATES], largest[count:] = vehicle.steer_limit, vehicle.steer_rate_limit
    largest[:STATES] = largest[count - STATES * (1 + round(BACK / dt)) : count] = 0.0  # from the centre line back to it
    solver = piqp.SparseSolver()
    solver.settings.eps_abs, solver.settings.eps_rel = 1e-7, 0.0
    solver.setup(
        sparse.csc_matrix(sparse.block_diag([cost, sparse.csc_matrix((nodes, nodes))])), np.zeros(count + nodes),
        sparse.csc_matrix(dynamics), np.zeros(STATES * nodes),
        sparse.csc_matrix(rows), low, high, -largest, largest,
    )  # fmt: skip
    if (status := solver.solve()) != piqp.PIQP_SOLVED:
        raise RuntimeError(f"{scenario.name}: {status}")
    x = solver.result.x.copy()
    return {
        "time": dt * np.arange(nodes + 1),
        "states": x[:count].reshape(-1, STATES),
        "lateral_acceleration": acceleration @ x[:count],
        "steer_rate": x[count:],
    }


def clearances(
    scenario: Scenario, sides: list[int], stations: np.ndarray
) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Rows on the states with their bounds: l + lever e beside obstacles, and at both bumpers between the edges."""
    vehicle, config = scenario.vehicle, scenario.controller
    half = vehicle.width / 2.0 + config.buffer
    entries: list[tuple[int, float, float, float]] = []  # node, lever, low, high
    for k, s in enumerate(stations):
        for lever in (vehicle.front_extent, -vehicle.rear_extent):
            entries.append((k, lever, half - config.width_right, config.width_left - half))
        for o, side in zip(scenario.obstacles, sides, strict=True):
            begin = max(o.s - o.length / 2.0 - s, -vehicle.rear_extent)
            end = min(o.s + o.length / 2.0 - s, vehicle.front_extent)
            bound = o.l + side * (o.width / 2.0 + half)
            if begin <= end:
                entries += [(k, x, *((bound, 1e3) if side > 0 else (-1e3, bound))) for x in (begin, end)]
    node, lever, low, high = (np.array(column) for column in zip(*entries, strict=True))
    index = np.arange(len(node))
    ones = sparse.csr_matrix((np.ones(len(node)), (index, STATES * node)), (len(node), STATES * len(stations)))
    turned = sparse.csr_matrix((lever, (index, STATES * node + 1)), ones.shape)
    return ones + turned, low, high


def peaks_of(optimum: dict[str, np.ndarray]) -> Peaks:
    return Peaks.of(optimum["time"], optimum["lateral_acceleration"], optimum["steer_rate"])


def main() -> None:
    parser = argparse.ArgumentParser(description="Offline optimum of the paper's two scenes.")
    parser.add_argument("--nodes", type=int, default=800, help="default: %(default)s")
    parser.add_argument("--out", type=Path, default=RESULTS, help="default: %(default)s")
    options = parser.parse_args()
    results = {}
    for name in SCENES:
        scenario = load_scenario(name, ["plant.kind=linear"])
        sides = passing_sides(scenario)
        peaks = peaks_of(solve(scenario, sides, options.nodes))
        results[name] = {"sides": sides, "nodes": options.nodes, "jerk_time": JERK_TIME, **vars(peaks)}
        print(name, results[name])
    options.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
