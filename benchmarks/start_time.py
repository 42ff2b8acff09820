"""How long the command line takes before it works: python benchmarks/start_time.py

Processor time of whole processes, user and system; the best of ten, since what else runs only adds. Exit status 1 if
one takes longer than the limit.
"""

import os
import subprocess
import sys

LIMIT = 0.15
"""In [s] of processor time."""

REPEATS = 10
COMMANDS = ("--help", "--version", "scenarios", "run", "run --jobs", "limits moose --jobs 0", "run mose", "can map")
PROGRAM = (sys.executable, "-m", "sidestep.validation")


def processor_time(command: tuple[str, ...]) -> float:
    before = os.times()
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False, timeout=60)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main() -> int:
    worst = 0.0
    python = min(processor_time((sys.executable, "-c", "pass")) for _ in range(REPEATS))
    print(f"{python:5.2f} s  python alone")
    for command in COMMANDS:
        best = min(processor_time((*PROGRAM, *command.split())) for _ in range(REPEATS))
        worst = max(worst, best)
        print(f"{best:5.2f} s  sidestep {command}")
    return int(worst > LIMIT)


if __name__ == "__main__":
    sys.exit(main())
