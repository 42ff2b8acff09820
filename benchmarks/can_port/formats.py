"""Public steering formats by mapping files alone: every random command read by cantools, and accepted by opendbc.

    pip install --no-deps --target OPENDBC opendbc
    PYTHONPATH=OPENDBC python benchmarks/can_port/formats.py

For every mapping file that comes with sidestep: how far the angle is from what was asked, in steps of the signal, as
cantools reads it from opendbc's own database (a half is the best that rounding can do), and how many frames opendbc's
checksum function accepts, where its parser has one for the message. Frames with a flipped bit have to be refused.
"""

import math
import tempfile
from pathlib import Path
from random import Random

from opendbc import DBC_PATH, get_generated_dbcs  # pyright: ignore[reportMissingImports]
from opendbc.can.dbc import DBC  # pyright: ignore[reportMissingImports]
from rich.console import Console
from rich.table import Table

from sidestep.controller.can_port.codec.catalogue import built_in_maps, map_file, mapped_bus
from sidestep.controller.can_port.codec.mapped import MappedMessage
from sidestep.controller.can_port.codec.mapping import read_bus_file
from sidestep.controller.can_port.codec.messages import decode_steer_command, encode_steer_command
from sidestep.plant_models.signals import SteeringCommand

COUNT = 20_000
THEIRS = {
    "tesla": "tesla_model3_party", "ford": "ford_lincoln_base_pt", "ford-2": "ford_lincoln_base_pt",
    "toyota": "toyota_nodsu_pt_generated", "nissan": "nissan_x_trail_2017_generated",
    "subaru": "subaru_global_2017_generated", "psa": "psa_aee2010_r3", "vw-meb": "vw_meb",
    "hyundai-canfd": "hyundai_canfd_generated",
}  # fmt: skip
"""opendbc's databases; PACMod's is not among them and comes with sidestep."""


def database(name: str, folder: Path) -> Path | None:
    """opendbc's database for a mapping file, as a file."""
    theirs = THEIRS.get(name)
    if theirs is None:
        return None
    if content := get_generated_dbcs().get(theirs):
        (folder / f"{theirs}.dbc").write_text(content)
        return folder / f"{theirs}.dbc"
    return Path(DBC_PATH) / f"{theirs}.dbc"


def row(name: str, folder: Path) -> list[str]:
    """One mapping file."""
    dbc, draw = database(name, folder), Random(1)
    bus = mapped_bus(name, dbc, wheelbase=2.8)
    message, theirs = bus.messages["STEER_CMD"], bus.databases[1]
    assert isinstance(message, MappedMessage)
    command = read_bus_file(map_file(name)).command
    quantity = command.angle or command.curvature
    assert quantity is not None
    reader = theirs.get_message_by_name(message.name)
    signal = reader.get_signal_by_name(quantity.signal)
    checksum = DBC(THEIRS[name]).name_to_msg[message.name].sigs.values() if name in THEIRS else ()
    rule = next((s for s in checksum if s.calc_checksum), None)
    worst, accepted, refused, flags = 0.0, 0, 0, 0
    for k in range(COUNT):
        angle, enable = draw.uniform(-0.05, 0.05), draw.random() < 0.9
        data = encode_steer_command(SteeringCommand(0.0, angle, 15.0), k, enable, 0.5, message)
        values = reader.decode(data, decode_choices=False)
        assert isinstance(values, dict)
        side = 1.0 if quantity.positive == "left" else -1.0
        wanted = side * (math.tan(angle) / 2.8 if command.curvature else math.degrees(angle) * quantity.ratio)
        if "rad" in (signal.unit or "") and not command.curvature:
            wanted = math.radians(wanted)
        got = float(str(values[quantity.signal]))
        if quantity.sign and values[quantity.sign.signal] == quantity.sign.negative:
            got = -got
        worst = max(worst, abs(got - (wanted if enable else 0.0)) / abs(signal.scale))
        flags += decode_steer_command(data, 0.0, message).enable is enable
        if rule:
            assert rule.calc_checksum
            accepted += rule.calc_checksum(message.frame_id, rule, bytearray(data)) == values[rule.name]
        if message.profile.checksum:
            flipped = bytearray(data)
            bit = draw.randrange(8 * len(data))
            flipped[bit // 8] ^= 1 << bit % 8
            refused += message.profile.counter_of(flipped) is None
    share = f"{accepted} of {COUNT}" if rule else "no rule in its parser"
    checksum = f"{refused} of {COUNT}" if message.profile.checksum else "no checksum"
    read = "lenient" if bus.remarks else ""
    return [name, f"0x{message.frame_id:X}", f"{worst:.3f}", f"{flags} of {COUNT}", share, checksum, read]


def main() -> None:
    table = Table(
        "mapping file", "id", "error [steps]", "enable reads back", "opendbc accepts", "flipped bit refused", "read"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in built_in_maps():
            table.add_row(*row(name, Path(folder)))
    Console(width=130).print(table)


if __name__ == "__main__":
    main()
