"""The controller on an FMU of your own: look into it, propose a mapping, drive it, and see what was estimated.

Run it: python examples/drive_your_own_fmu.py [FILE.fmu [MAP.toml]]; without a file it builds one of ours.
"""

import sys
from pathlib import Path

from sidestep.fmu.importing.archive import describe_fmu
from sidestep.fmu.importing.mapping import Mapping
from sidestep.fmu.importing.plant import FmuPlant
from sidestep.fmu.importing.proposal import describe, propose_mapping
from sidestep.fmu.native.build import build_fmu
from sidestep.validation.judge.verdict import judge
from sidestep.validation.loop.closed_loop import closed_loop
from sidestep.validation.scenarios.scenario import load_scenario


def main(file: Path, table: Path | None) -> None:
    fmu = describe_fmu(file)
    proposal = propose_mapping(fmu, file)
    print(describe(fmu).splitlines()[0])

    mapping = Mapping.from_file(table) if table else Mapping.from_text(proposal)
    scene = load_scenario("single-obstacle")
    with FmuPlant.from_file(file, mapping, scene.vehicle) as plant:
        recording = closed_loop(scene, plant)
    judged = judge(recording, scene)
    words = f"{judged.verdict.value}: {judged.label}, clearance {judged.min_clearance:.2f} m"
    print(f"{recording.end.value} at {recording['time'][-1]:.2f} s, {words}")
    print("estimated:", ", ".join(recording.estimated) or "nothing")


if __name__ == "__main__":
    files = [Path(argument) for argument in sys.argv[1:]]
    main(files[0] if files else build_fmu(), files[1] if len(files) > 1 else None)
