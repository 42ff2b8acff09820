"""Standing traffic on several lanes, passable with little room: how many drives get through, stop, or touch something.

    python benchmarks/controller/standing_traffic.py [COUNT] [SEED] [PLANT]

Scenes are drawn at random: lanes of 3.6 m with cars that stand where they were when time stopped. Those count for which
the judge's search finds a way with `least_clearance` to spare, at the asked speed or below.
"""

import sys
from collections import Counter

import numpy as np

from sidestep.validation.judge.feasibility import MARGIN, way_past
from sidestep.validation.judge.simulate import simulate
from sidestep.validation.loop.recording import End
from sidestep.validation.scenarios.scenario import Scenario, parse_scenario

LANE = 3.6


def scene(seed: int, plant: str) -> Scenario:
    """Traffic that stands, from 25 m ahead of the car on, in lanes about as full as a motorway's in a thin jam."""
    rng = np.random.default_rng(seed)
    lanes = int(rng.integers(2, 6))
    own = int(rng.integers(lanes))
    right, left = -(own + 0.5) * LANE, (lanes - own - 0.5) * LANE
    boxes: list[str] = []
    for lane in range(lanes):
        s = 10.0 + rng.uniform(25.0, 60.0) if lane == own else rng.uniform(15.0, 60.0)
        while s < 100.0:
            length, width = rng.uniform(4.2, 6.2), rng.uniform(1.7, 2.1)
            offset = (lane - own) * LANE + rng.normal(0.0, 0.35)
            boxes += ["[[obstacles]]", f"s = {s:.2f}", f"l = {offset:.3f}", f"length = {length:.3f}",
                      f"width = {width:.3f}", f"heading = {rng.normal(0.0, 0.03):.3f}"]  # fmt: skip
            s += length + rng.exponential(14.0) + 4.0
    head = f"""
        name = "standing-{seed}"
        speed = {rng.uniform(8.0, 16.0):.2f}
        duration = 25.0
        start = {{ s = 10.0, l = {rng.normal(0.0, 0.2):.3f} }}
        road.width_left = {left:.2f}
        road.width_right = {-right:.2f}
        road.segments = [{{ type = "line", length = 180.0 }}]
    """
    return parse_scenario("\n".join([head, *boxes]), f"scene {seed}", [f"plant.kind={plant}"])


def outcome(scenario: Scenario) -> tuple[str, str]:
    """In a word, and with figures."""
    recording, judgement = simulate(scenario)
    least = min(judgement.min_clearance or 9.9, judgement.min_edge_clearance)
    touched = judgement.touched or judgement.min_edge_clearance < 0.0
    word = "touched" if touched else "stopped" if recording.end is End.STOPPED else judgement.verdict.value
    figures = "" if word == "pass" else f"{judgement.label}: {judgement.detail}"
    return word, f"{recording['time'][-1]:5.1f} s, nearest {least:.2f} m {figures}"


def main(count: int, seed: int, plant: str) -> None:
    words: Counter[str] = Counter()
    while words.total() < count:
        scenario = scene(seed, plant)
        way = way_past(scenario, MARGIN)
        if way:
            word, figures = outcome(scenario)
            words[word] += 1
            print(f"{seed:6} {word:8} {figures} (way at {way.share:.2f} of {scenario.speed} m/s)", flush=True)
        seed += 1
    print(dict(words))


if __name__ == "__main__":
    count, seed, plant = [*sys.argv[1:], *("24", "1", "single-track")[len(sys.argv) - 1 :]]
    main(int(count), int(seed), plant)
