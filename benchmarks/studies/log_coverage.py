"""Does identification from a log find a known car? MuJoCo drives, sensors measure, `identify_log` fits; seed by seed.

    python benchmarks/studies/log_coverage.py [SEEDS] [FIRST]

Prints, for every parameter that the log identifies, how often its 95 % interval holds the truth, and the errors.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from sidestep.validation.model_error.identification.log_identification import identify_log
from sidestep.validation.model_error.logs.made import Sensors, known_car, made_log, write_log
from sidestep.validation.model_error.logs.mapping import LogMap
from sidestep.validation.model_error.logs.measured import load_log


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    car, rows = known_car(), []
    for seed in range(first, first + seeds):
        rows.append(one(seed, car))
        errors = {n: f"{v - t:+.3g} ± {0.5 * (high - low):.2g}" for n, (t, v, low, high) in rows[-1].items()}
        print(seed, errors, flush=True)
    names = sorted({name for row in rows for name in row})
    print(f"\n{seeds} seeds: parameter, identified, truth inside, RMS and largest error, mean half interval")
    for name in names:
        true, value, low, high = np.array([row[name] for row in rows if name in row]).T
        inside, error = int(((low <= true) & (true <= high)).sum()), value - true
        print(
            f"{name:18}{len(true):5}{inside:5}  {np.sqrt(np.mean(error**2)):10.4g} {np.abs(error).max():10.4g} "
            f"{np.mean(high - low) / 2.0:10.4g}"
        )


def one(seed, car):
    """Truth, value, low and high of every identified parameter of one seed."""
    table, true = made_log(car, Sensors(), seed)
    with tempfile.TemporaryDirectory() as folder:
        write_log(Path(folder) / "made.csv", table)
        log = load_log(Path(folder) / "made.csv", LogMap({}, car, ()))
    found = identify_log(log, car)
    return {
        v.parameter.name: (true[v.parameter.name], v.value, v.low, v.high)
        for v in found.verdicts
        if not v.refused and v.parameter.name in true
    }


if __name__ == "__main__":
    main()
