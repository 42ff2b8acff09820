"""How the car wanders on a straight road when its state is measured with noise, with and without the state estimator.

    python benchmarks/perception/wander.py [seeds] [plant ...]

15 m/s; every 20 ms position to 2 cm, yaw to 0.2 deg, yaw rate to 0.02 rad/s and v_y to 0.1 m/s (standard deviations,
white); time, v_x and steering angle as they are. What counts is the true lateral offset and the true road-wheel angle
after the first 5 s: RMS of the offset, RMS of the angle's rate and how often that changes sign.
"""

import math
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidestep.controller import SteeringController
from sidestep.controller.perception.estimator import EstimatorConfig, Measurement, StateEstimator
from sidestep.plant_models.signals import VehicleState
from sidestep.validation.loop.closed_loop import bare_controller
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import Scenario, load_scenario

SECONDS, SETTLED, SEEDS = 20.0, 5.0, 10
NOISE = VehicleState(x=0.02, y=0.02, yaw=math.radians(0.2), v_y=0.1, yaw_rate=0.02)
FILTER = EstimatorConfig(
    position_noise=NOISE.x, yaw_noise=NOISE.yaw, v_y_noise=NOISE.v_y, yaw_rate_noise=NOISE.yaw_rate,
    v_x_noise=0.02, steer_noise=2e-4,  # exact here
)  # fmt: skip


def noisy(state: VehicleState, random: np.random.Generator) -> VehicleState:
    names = ("x", "y", "yaw", "v_y", "yaw_rate")
    return replace(state, **{n: getattr(state, n) + getattr(NOISE, n) * random.standard_normal() for n in names})


def teach(controller: SteeringController, filtered: StateEstimator) -> None:
    """Give the controller, in place of its own observer, what the filter knows; its steering angle is the tyres'."""
    found, own = filtered.disturbances, controller._memory["disturbance"]
    own["actuator"], own["share"] = found["actuator"] + found["sensor"], found["share"]


def drive(scene: Scenario, seed: int, filtered: StateEstimator | None, observes: bool) -> Iterator[VehicleState]:
    """True states; the controller sees noise, through the filter if there is one, with or without its own observer."""
    config = replace(scene.controller, reject_disturbance=observes)
    controller = bare_controller(replace(scene, controller=config, obstacles=()))
    random, period = np.random.default_rng(seed), scene.controller.period
    with open_plant(scene) as plant:
        state = plant.reset(VehicleState(v_x=15.0))
        for _ in range(round(SECONDS / period)):
            seen = noisy(state, random)
            if filtered:
                told = {name: getattr(seen, name) for name in VehicleState.__dataclass_fields__}
                seen = filtered.step(Measurement(**told))
            if filtered and not observes:
                teach(controller, filtered)
            command = controller.step(seen)
            if filtered:
                filtered.tell(command.steer_angle)
            for _ in range(2):
                state = plant.step(command, 0.5 * period)
            yield state


def figures(states: list[VehicleState], period: float) -> NDArray[np.float64]:
    """Wander [cm], steering rate [deg/s], reversals [1/s]."""
    kept = states[round(SETTLED / period) :]
    rate = np.diff([state.steer_angle for state in kept]) / period
    reversals = np.count_nonzero(np.diff(np.sign(rate)) != 0) / (len(rate) * period)
    wander = np.sqrt(np.mean(np.square([state.y for state in kept])))
    return np.array([100.0 * wander, math.degrees(np.sqrt(np.mean(rate**2))), reversals])


def main(seeds: int, plants: list[str]) -> None:
    road = ["obstacles=[]", "speed=15", f"duration={SECONDS}"]
    print("plant, who learns: wander RMS [cm], steering rate RMS [deg/s], reversals [1/s]; mean over the seeds")
    for kind in plants:
        scene = load_scenario("double-obstacle", [*road, f"plant.kind={kind}"])
        period = scene.controller.period
        made = StateEstimator(scene.vehicle, FILTER)
        cases = (("observer", None, True), ("neither", None, False), ("both", made, True), ("filter", made, False))
        for name, made, observes in cases:
            rows = []
            for seed in range(seeds):
                if made:
                    made.reset()
                rows.append(figures(list(drive(scene, seed, made, observes)), period))
            mean = np.mean(rows, axis=0)
            print(f"{kind:12s} {name:9s} {mean[0]:6.2f} {mean[1]:6.2f} {mean[2]:6.1f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS, sys.argv[2:] or ["linear", "single-track"])
