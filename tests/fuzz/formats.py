"""Every format that is read from outside: small files to damage, what knows its structure, and its reader."""

import json
import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import msgspec
import numpy as np
from fmus import archives, description, read_description, read_fmu  # pyright: ignore[reportMissingImports]
from mutation import Blow, json_blow, mutated, toml_blow, xml_blow  # pyright: ignore[reportMissingImports]

from sidestep.controller.can_port.bus.faults import FaultSpec
from sidestep.controller.can_port.bus.log import LogReport, read_log
from sidestep.controller.can_port.codec.catalogue import mapped_bus
from sidestep.controller.can_port.codec.foreign import load_database
from sidestep.controller.can_port.codec.proposal import proposed
from sidestep.controller.memory import empty, restored, saved
from sidestep.controller.validity import Validity
from sidestep.fmu.importing.mapping import Mapping as FmuMapping
from sidestep.plant_models.mujoco.surface import HeightField
from sidestep.plant_models.tyres.property_file import read_tyre_file
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.campaigns.campaign import cases, load_campaign
from sidestep.validation.campaigns.campaign_run import load_rows
from sidestep.validation.loop.recording import SAMPLE_UNITS, read_columns
from sidestep.validation.model_error.identification.car_kernel import Chassis, Values
from sidestep.validation.model_error.identification.identified_file import read_identified
from sidestep.validation.model_error.logs.mapping import read_map
from sidestep.validation.model_error.logs.measured import load_log
from sidestep.validation.report.compare.compare import read_runs
from sidestep.validation.report.compare.golden import check, read_golden
from sidestep.validation.scenarios.library import built_in_scenarios, read_scenario
from sidestep.validation.scenarios.readers.openscenario.opendrive import read_opendrive
from sidestep.validation.scenarios.scenario import load_scenario, parse_scenario
from sidestep.validation.scenarios.tables import override

CORPUS = Path(__file__).parent / "corpus"
PACKAGE = Path(load_scenario.__code__.co_filename).parents[2]
_ROAD = "speed = 5.0\nduration = 0.1\n[road]\nwidth_left = 4.0\nwidth_right = 4.0\n"
_LINE = _ROAD + 'segments = [{ type = "line", length = 200.0 }]\n[plant]\nkind = "linear"\n'


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: Of it.
        seeds: Whole files, made when they are asked for first.
        ending: Of the file's name.
        read: Its reader.
        blows: What knows its structure.
        beside: Files that have to be there, too.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    ending: str
    read: Callable[[Path], object]
    blows: tuple[Blow, ...] = ()
    beside: tuple[str, ...] = ()

    def make(self, random_: random.Random) -> bytes:
        """A damaged file."""
        return mutated(random_, self.seeds(), self.blows)

    def prepare(self, folder: Path) -> Path:
        """Where its cases go, with the files beside them."""
        for name in self.beside:
            (folder / name).write_bytes((CORPUS / name).read_bytes())
        return folder / f"case{self.ending}"


@cache
def _corpus(*names: str) -> list[bytes]:
    return [(CORPUS / name).read_bytes() for name in names]


def _package(*patterns: str) -> list[bytes]:
    files = [file for pattern in patterns for file in sorted(PACKAGE.glob(pattern))]
    assert files
    return [file.read_bytes() for file in files]


@cache
def _scenarios() -> list[bytes]:
    return [*_corpus("scenario.toml"), *(read_scenario(name)[1].encode() for name in built_in_scenarios())]


def _read_override(file: Path) -> None:
    """The words of `--set`."""
    for line in file.read_text(errors="replace").splitlines()[:20]:
        tables = {"a": {"b": [1.0, {"c": 2}]}, "speed": 1.0}
        override(tables, line)


def _read_waypoints(file: Path) -> None:
    parse_scenario(_ROAD + f'waypoints = "{file.name}"\n', "scene", (), file.parent / "scene.toml")


def _read_motion(file: Path) -> None:
    text = (
        _LINE + f'[[obstacles]]\nlength = 1.0\nwidth = 1.0\ntrajectory = {{ frame = "world", file = "{file.name}" }}\n'
    )
    parse_scenario(text, "scene", (), file.parent / "scene.toml")


def _read_opendrive(file: Path) -> None:
    for road in read_opendrive(file).values():
        road.point(1.0, 0.0) if hasattr(road, "point") else None


@cache
def _journals() -> list[bytes]:
    campaign = load_campaign(CORPUS / "campaign.toml")
    head = {"campaign": {**msgspec.to_builtins(campaign), "file": ""}, "about": {"file": campaign.file, "versions": {}}}
    rows = [
        {"row": c.row, "seed": c.seed, "values": dict(c.values), "verdict": "pass", "label": "ok", "end": "completed",
         "margin_m": 0.5, "error": None}
        for c in cases(campaign)
    ]  # fmt: skip
    return [b"".join(json.dumps(line).encode() + b"\n" for line in [head, *rows])]


@cache
def _recordings() -> list[bytes]:
    rows = [",".join(f"{name} [{unit}]" for name, unit in SAMPLE_UNITS.items())]
    rows += [",".join(f"{0.01 * k * (i + 1):.3f}" for i in range(len(SAMPLE_UNITS))) for k in range(30)]
    return ["".join(row + "\n" for row in rows).encode()]


@cache
def _summaries() -> list[bytes]:
    summary = {
        "scenario": "single-obstacle", "plant": "linear", "preset": "default", "verdict": "pass", "label": "ok",
        "folder": ".", "tables": parse_scenario(read_scenario("single-obstacle")[1], "a").tables, "detail": "",
        "min_clearance_m": 0.4, "max_lateral_acceleration": 3.0, "max_steer_rate": 0.2, "rms_lateral_error_m": 0.3,
        "infeasible_steps": 0, "max_slack_m": 0.0, "duration": 8.0, "error": None, "findings": [],
        "step_time_us": {"median": 1.0, "p99": 2.0, "max": 3.0}, "can": {"sent": 0, "interface": "off"},
    }  # fmt: skip
    return [json.dumps(summary, indent=1).encode()]


def _read_summary(file: Path) -> None:
    (file.parent / "recording.csv").write_bytes(_recordings()[0])
    file.replace(file.parent / "summary.json")
    read_runs([file.parent, file.parent])


@cache
def _identified() -> list[bytes]:
    values, chassis = dict.fromkeys(Values._fields, 1.0), dict.fromkeys(Chassis._fields, 1.0)
    parameters = {"C_f": {"value": 9e4, "low": 8e4, "high": 1e5, "unit": "N/rad", "refused": ""}}
    table = {"log": "a", "values": values, "linear": values, "chassis": chassis, "parameters": parameters,
             "explained": {"yaw_rate": 0.9}, "left_out": {}}  # fmt: skip
    return [json.dumps(table).encode()]


def _read_golden(file: Path) -> None:
    golden = read_golden(file, "single-obstacle")
    time = 0.01 * np.arange(50)
    check({name: time if name == "time" else 0.0 * time for name in golden}, golden)


def _read_frames(file: Path) -> None:
    report = LogReport()
    for count, _ in enumerate(read_log(file, None, report)):
        assert count < 1_000_000, "a log without end"
    report.sentences()


def _read_measured(file: Path) -> None:
    load_log(file, read_map(CORPUS / "log_map.toml"))


def _read_database(file: Path) -> None:
    database, _ = load_database(file)
    proposed(database, file)


@cache
def _databases(ending: str) -> list[bytes]:
    database, _ = load_database(CORPUS / "bus.dbc")
    return [{"kcd": database.as_kcd_string, "sym": database.as_sym_string}[ending]().encode()]


def _memory() -> list[bytes]:
    return [saved(empty(10.0))]


def _resealed(random_: random.Random, data: bytes) -> bytes:
    """The head says again what the body is: only what is in it is wrong."""
    head = struct.Struct("<8sIIQ")
    if len(data) < head.size:
        return data
    name, version, _, _ = head.unpack_from(data)
    body = data[head.size :]
    return head.pack(name, version, zlib.crc32(body), len(body)) + body


def _logs(*names: str) -> Callable[[], list[bytes]]:
    return partial(_corpus, *names)


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("scenario", _scenarios, ".toml", load_scenario, (toml_blow,), ("waypoints.csv",)),
        Format("set", lambda: [b"speed=3\na.b[0]=[1]\na.b.1.c=1e3\na.d={x=1}\n"], ".txt", _read_override),
        Format("vehicle", partial(_package, "plant_models/vehicle/presets/*.toml"), ".toml",
               VehicleParameters.from_file, (toml_blow,)),
        Format("mapping", _logs("mapping.toml"), ".toml", FmuMapping.from_file, (toml_blow,)),
        Format("bus-map", _logs("bus.toml"), ".toml", lambda file: mapped_bus(str(file)), (toml_blow,), ("bus.dbc",)),
        Format("log-map", _logs("log_map.toml"), ".toml", read_map, (toml_blow,)),
        Format("campaign", _logs("campaign.toml", "campaign_grid.toml"), ".toml", load_campaign, (toml_blow,)),
        Format("faults", _logs("faults.toml"), ".toml", FaultSpec.from_file, (toml_blow,)),
        Format("waypoints", _logs("waypoints.csv", "waypoints_closed.csv"), ".csv", _read_waypoints),
        Format("motion", _logs("motion.csv"), ".csv", _read_motion),
        Format("heights", _logs("heights.csv"), ".csv", lambda file: HeightField.from_csv(file, 0.1)),
        Format("commonroad", _logs("commonroad.xml", "commonroad_older.xml"), ".xml", load_scenario, (xml_blow,)),
        Format("openscenario", _logs("openscenario.xosc"), ".xosc", load_scenario, (xml_blow,),
               ("road.xodr", "cars.xosc")),
        Format("opendrive", _logs("opendrive.xodr", "opendrive_cubic.xodr", "road.xodr"), ".xodr", _read_opendrive,
               (xml_blow,)),
        Format("tir", _logs("tyre.tir", "tyre_5.tir"), ".tir", read_tyre_file),
        Format("validity", _logs("validity.json"), ".json", lambda file: Validity.from_file(file, "affine"),
               (json_blow,)),
        Format("journal", _journals, ".jsonl", load_rows, (json_blow,)),
        Format("golden", _logs("golden.csv"), ".csv", _read_golden),
        Format("recording", _recordings, ".csv", read_columns),
        Format("summary", _summaries, ".json", _read_summary, (json_blow,)),
        Format("identified", _identified, ".json", read_identified, (json_blow,)),
        Format("log-blf", _logs("log.blf"), ".blf", _read_frames),
        Format("log-asc", _logs("log.asc"), ".asc", _read_frames),
        Format("log-candump", _logs("log.log", "log_plain.log"), ".log", _read_frames),
        Format("log-csv", _logs("log.csv", "log_savvy.csv"), ".csv", _read_frames),
        Format("log-trc", _logs("log.trc"), ".trc", _read_frames),
        Format("log-db", _logs("log.db"), ".db", _read_frames),
        Format("log-gz", _logs("log.log.gz"), ".log.gz", _read_frames),
        Format("log-measured", _logs("measured.csv"), ".csv", _read_measured),
        Format("dbc", _logs("bus.dbc"), ".dbc", _read_database),
        Format("kcd", partial(_databases, "kcd"), ".kcd", _read_database, (xml_blow,)),
        Format("sym", partial(_databases, "sym"), ".sym", _read_database),
        Format("fmu", archives, ".fmu", read_fmu),
        Format("model-description", lambda: [description(2), description(3)], ".xml", read_description,
               (xml_blow,)),
        Format("memory", _memory, ".bin", lambda file: restored(file.read_bytes()), (_resealed,)),
    )
}  # fmt: skip
"""By name. There is no reader of systems (.ssp): they are only written."""
