"""Both scenes driven by the two nodes as processes in real time on MuJoCo, over a real vcan0 where there is one.

    tools/vcanbox.py --memory 1500M --timeout 600 -- .venv/bin/python benchmarks/can_port/realtime.py    on a real vcan0
    .venv/bin/python benchmarks/can_port/realtime.py                       without one: over udp_multicast

Run it on an idle machine, some three minutes. The rows "nothing" are a loop that only waits, just before each drive:
what is late there is the machine's. Inside user-mode Linux both nodes share one processor, a system call takes 10 to
30 us, and processor time is counted in whole ticks: the controller's share of a core is to be read from the second
command; "busy", the share of time between waking and waiting again, holds in both.
"""

import csv
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sidestep.controller.can_port.bus.bus import resolve_spec
from sidestep.controller.can_port.bus.log import read_log
from sidestep.controller.can_port.bus.pacing import Pacer
from sidestep.controller.can_port.codec.database import load_dbc
from sidestep.controller.can_port.nodes import CYCLE

LONG = ["--set", "duration=60", "--set", 'road.segments=[{type="line",length=1000.0}]']
DRIVES = (("single-obstacle", []), ("double-obstacle", []), ("single-obstacle", LONG))
HEADS = (
    "scene", "node", "verdict", "cycles", "skipped", "late p50 [ms]", "p99 [ms]", "max [ms]", "drift [%]", "lost",
    "refused", "busy [%]", "core [%]", "candump",
)  # fmt: skip


NODE = [sys.executable, "-m", "sidestep.validation"]


def compile_kernels(folder: Path) -> None:
    """Once, before any clock runs."""
    scene = ["single-obstacle", "--plant", "mujoco", "--can", "off", "--set", "duration=0.1"]
    subprocess.run([*NODE, "run", *scene, "--out", str(folder / "first")], stdout=subprocess.DEVNULL, check=False)


def drive(scene: str, more: list[str], bus: str, folder: Path) -> dict[str, dict]:
    """Drive a scene; the summaries of both nodes."""
    common = [scene, "--can", bus, *more, "--out"]
    quiet = subprocess.DEVNULL
    with subprocess.Popen([*NODE, "can", "drive", *common, str(folder / "controller")], stdout=quiet):
        plant = [*NODE, "can", "plant", *common, str(folder / "plant"), "--plant", "mujoco"]
        subprocess.run(plant, stdout=quiet, check=False)
    return {end: json.loads((folder / end / "summary.json").read_text()) for end in ("plant", "controller")}


@contextmanager
def candump(file: Path) -> Iterator[None]:
    """can-utils' candump listens to vcan0 and writes to `file`."""
    with file.open("wb") as output, subprocess.Popen(["candump", "-L", "vcan0"], stdout=output) as process:
        time.sleep(0.5)
        yield
        time.sleep(0.5)
        process.terminate()


def compared(file: Path, folder: Path) -> str:
    """What candump saw, decoded by cantools, beside what the controller sent and the plant recorded."""
    seen = [
        bytes.fromhex(frame[4:]) for line in file.read_text().splitlines() if (frame := line.split()[2])[:4] == "101#"
    ]
    log = read_log(folder / "controller" / "can.blf")
    sent = [bytes(message.data) for message in log if message.arbitration_id == 0x101 and not message.is_rx]
    decoded = iter([round(angle(data), 9) for data in seen])
    with (folder / "plant" / "recording.csv").open() as recording:
        recorded = [round(float(row["steer_command [rad]"]), 9) for row in csv.DictReader(recording)]
    changes = [now for before, now in zip([None, *recorded], recorded, strict=False) if now != before]
    missing = sum(command not in decoded for command in changes)  # `in` goes on where it left off
    return (
        f"{len(seen)} of {len(sent)}{'' if seen == sent else ', differ'}, {missing} of {len(changes)} commands missing"
    )


def angle(data: bytes) -> float:
    """What cantools reads in a STEER_CMD frame, in [rad]."""
    values = load_dbc().get_message_by_name("STEER_CMD").decode(data, decode_choices=False)
    assert isinstance(values, dict)
    return float(str(values["SteerCmd_Angle"]))


def idle() -> dict:
    """Figures of a node that does nothing for 5 s: what this machine gives at best."""
    pacer = Pacer(CYCLE)
    for _ in range(500):
        pacer.wait()
    return pacer.statistics()


def row(*names: str, figures: dict, dump: str = "") -> list[str]:
    """A line of the table."""
    late = [f"{figures['lateness_ms'][name]:.2f}" for name in ("p50", "p99", "max")]
    share = f"{100.0 * figures['processor_share']:.1f}" if "processor_share" in figures else ""
    return [
        *names, str(figures["cycles"]), str(figures["skipped"]), *late, f"{100.0 * figures['drift']:+.4f}",
        str(figures.get("lost", "")), str(figures.get("refused", "")), f"{100.0 * figures['busy']:.1f}", share, dump,
    ]  # fmt: skip


def main() -> None:
    bus = resolve_spec("auto", several_processes=True)
    dumping = bus == "socketcan:vcan0" and shutil.which("candump") is not None
    table = Table(title=bus, title_justify="left")
    for head in HEADS:
        table.add_column(head, justify="left" if head in ("scene", "node", "verdict", "candump") else "right")
    with tempfile.TemporaryDirectory() as name:
        compile_kernels(Path(name))
    for scene, more in DRIVES:
        table.add_row(*row(f"{scene}{', 60 s' if more else ''}", "nothing", "", figures=idle()))
        with tempfile.TemporaryDirectory() as name:
            folder, dump = Path(name), ""
            if dumping and not more:  # another listener costs the one processor of the box a tenth
                with candump(folder / "candump"):
                    ends = drive(scene, more, bus, folder)
                dump = compared(folder / "candump", folder)
            else:
                ends = drive(scene, more, bus, folder)
            plant, controller = ends["plant"], ends["controller"]
            table.add_row(*row("", "plant", plant["verdict"], figures=plant["can"]))
            table.add_row(*row("", "controller", "", figures=controller["can"], dump=dump))
    Console(width=200).print(table)


if __name__ == "__main__":
    main()
