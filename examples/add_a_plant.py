"""A plant of your own under the same judge as ours: checked, driven through a built-in scene, rated against another.

The plant is the kinematic bicycle of own_plant.py; at 15 m/s it is wrong, and the ratings say where.
Run it: python examples/add_a_plant.py
"""

import numpy as np
from own_plant import KinematicCar

from sidestep.plant_models import check_plant
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.loop.recording import Recording
from sidestep.validation.report.compare.rating import rate
from sidestep.validation.scenarios.scenario import load_scenario


def main() -> None:
    scenario = load_scenario("double-obstacle")
    print("check_plant:", check_plant(KinematicCar(scenario.vehicle), scenario.vehicle) or "no finding")

    driven: list[Recording] = []
    for plant in (LinearPlant(scenario.vehicle), KinematicCar(scenario.vehicle)):
        with plant:
            driven.append(closed_loop(scenario, plant))
        judgement = judge(driven[-1], scenario)
        words = f"{judgement.verdict.value}: {judgement.label}, {judgement.min_clearance:.2f} m clear"
        print(f"{type(plant).__name__}: {words}")

    linear, own = driven
    shared = np.arange(0.0, min(linear["time"][-1], own["time"][-1]), 0.01)
    for signal in ("l", "yaw_rate", "v_y"):
        rating = rate(*(np.interp(shared, run["time"], run[signal]) for run in (linear, own)))
        print(f"{signal}: ISO/TS 18571 rating {rating.overall:.3f}, {rating.grade}")


if __name__ == "__main__":
    main()
