"""Both scenes driven over a real vcan0 by the two nodes as processes in real time: lateness, drift, lost frames.

Run it where vcan0 is, natively or by `tools/vcanbox.py --memory 1500M -- python benchmarks/can_realtime.py`, on an
idle machine: inside user-mode Linux a system call costs twenty times what it costs outside.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

CHANNEL = "socketcan:vcan0"


def measure(scene: str, folder: Path, plant: str = "mujoco") -> dict[str, dict]:
    """Summaries of plant and controller node after driving a scene."""
    node = [sys.executable, "-m", "sidestep.validation", "can"]
    common = [scene, "--can", CHANNEL]
    with subprocess.Popen([*node, "drive", *common, "--out", str(folder / "controller")]):
        subprocess.run([*node, "plant", *common, "--plant", plant, "--out", str(folder / "plant")], check=False)
    return {end: json.loads((folder / end / "summary.json").read_text()) for end in ("plant", "controller")}


def main() -> None:
    for scene in ("single-obstacle", "double-obstacle"):
        with tempfile.TemporaryDirectory() as folder:
            for end, summary in measure(scene, Path(folder)).items():
                bus = summary["can"]
                print(
                    f"{scene} {end}: {summary.get('verdict', '')} lost {bus['lost']}, refused {bus['refused']}, "
                    f"lateness {bus['lateness_ms']} ms, drift {bus['drift']:.2e}"
                )


if __name__ == "__main__":
    main()
