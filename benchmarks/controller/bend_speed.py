"""A tight bend behind a straight, entered at speeds that the tyres cannot hold in it: does the car slow down in time?

    python benchmarks/controller/bend_speed.py [plant ...]

120 m of straight road, 20 m of clothoid, 40 m at a radius of 20 m, 8 m wide, nothing on it. Asked for: on the road by
at least 0.2 m, braking by at most 4 m/s^2. Exit status 1 if a drive misses that.
"""

import sys

import numpy as np

from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.scenarios.scenario import load_scenario

PLANTS, SPEEDS = ("linear", "single-track", "mujoco"), (13.0, 16.0, 20.0, 25.0, 30.0)
MARGIN, BRAKING = 0.2, 4.0  # in [m], [m/s^2]
ROAD = (
    "road.width_left=4",
    "road.width_right=4",
    "road.segments=[{type='line', length=120}, {type='clothoid', length=20, curvature_start=0, curvature_end=0.05},"
    "{type='arc', length=40, curvature=0.05}, {type='line', length=60}]",
)


def drive(plant: str, speed: float) -> tuple[str, float, float, float]:
    """Verdict, largest offset from the middle and least room to the edge in [m], hardest braking in [m/s^2]."""
    settings = [*ROAD, "obstacles=[]", f"speed={speed}", "duration=14", f"plant.kind={plant}"]
    scene = load_scenario("single-obstacle", settings)
    recording = closed_loop(scene)
    judgement = judge(recording, scene)
    braking = -np.gradient(recording["v_x"], recording["time"])
    offset = float(np.abs(recording["l"]).max())
    return judgement.label, offset, judgement.min_edge_clearance, float(braking.max())


def main(plants: list[str]) -> int:
    print(f"{'plant':<14}{'m/s':>5}  {'verdict':<24}{'offset':>8}{'to edge':>9}{'braking':>9}")
    missed = 0
    for plant in plants or PLANTS:
        for speed in SPEEDS:
            label, offset, edge, braking = drive(plant, speed)
            missed += edge < MARGIN or braking > BRAKING
            print(f"{plant:<14}{speed:>5g}  {label:<24}{offset:>6.2f} m{edge:>7.2f} m{braking:>9.2f}", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
