"""What a component is made of: the records that cross its C interface, and the setup that it is created from.

Every layout is a numpy dtype with C's alignment; `layout` writes the C structs from them, so that a new field in one
of the controller's records is there in C, too.
"""

import math
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.config import ControllerConfig
from sidestep.controller.memory import empty
from sidestep.controller.records import COMMAND, MEMORY, PLAN, SETTINGS, STATE, WORK, F, N, filled
from sidestep.controller.settings import settings_of
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.road.reference_path import ReferencePath
from sidestep.plant_models.vehicle.parameters import VehicleParameters

BOX_FIELDS = ("s", "l", "length", "width", "heading", "speed")
"""Columns of the controller's obstacles."""
OBSTACLE = np.dtype([(name, F) for name in (*BOX_FIELDS, "time")], align=True)
"""As Obstacle; s is where it was at `time`."""

TUNABLE = (
    "cruise_speed", "reference_offset", "buffer", "least_clearance", "tightening", "margin_time", "safe_distance",
    "weight_reference", "weight_continuity", "weight_obstacle", "side_hysteresis", "max_lateral_speed", "max_slope",
    "weight_offset", "weight_lateral_speed", "weight_acceleration", "weight_jerk", "weight_rate",
    "corridor_penalty", "slip_penalty", "slip_share", "friction", "comfort_braking", "bend_acceleration",
    "standstill_gap",
)  # fmt: skip
"""Fields of ControllerConfig that can change while it runs."""
PARAMETER_FIELDS = (*TUNABLE, "input_delay_steps")
PARAMETERS = np.dtype([(name, F) for name in PARAMETER_FIELDS], align=True)
"""Settings by name; `cruise_speed` is NaN for that of the first state."""

SETUP = np.dtype(
    [
        ("period", F), ("rows", N), ("half_length", F), ("half_width", F), ("ahead", F), ("max_braking", F),
        ("settings", SETTINGS), ("parameters", PARAMETERS), ("memory", MEMORY),
    ],
    align=True,
)  # fmt: skip
"""Period and rows of the road's table; half the car's size, and how far its middle is ahead of the reference point;
what its brakes can do; settings and memory at the start."""

MAGIC = b"sidesetp"
"""A setup file's first bytes; then a checksum of the layouts, one of the rest, and its length."""
HEADER = np.dtype([("magic", "S8"), ("abi", np.uint32), ("checksum", np.uint32), ("size", np.uint64)])


def abi() -> int:
    """A number that changes with every layout that crosses the interface or stands in a setup."""
    layouts = (STATE, COMMAND, PLAN, OBSTACLE, PARAMETERS, SETUP, WORK)
    return zlib.crc32(repr([layout.descr for layout in layouts]).encode())


def parameters_of(config: ControllerConfig) -> NDArray[np.void]:
    """Record of `PARAMETERS`, shape (1,)."""
    values = {name: getattr(config, name) for name in TUNABLE}
    if config.cruise_speed is None:
        values["cruise_speed"] = math.nan
    return filled(PARAMETERS, values | {"input_delay_steps": config.input_delay_steps})


def setup_of(vehicle: VehicleParameters, path: ReferencePath, config: ControllerConfig) -> bytes:
    """A setup file: all that a component's instance is created from.

    Args:
        vehicle, path, config: As `SteeringController` takes them; the solver is the active set in any case.

    Raises:
        InputError: The settings are of the literal paper, whose solver is not compiled, or cannot be used.
    """
    if config.formulation != "corridor":
        raise InputError("controller.formulation", f"{config.formulation!r}: its solver is not compiled", "corridor")
    settings = settings_of(vehicle, config)
    setup = filled(SETUP, {
        "period": path.period, "rows": len(path.table), "half_length": 0.5 * vehicle.length,
        "half_width": 0.5 * vehicle.width, "ahead": 0.5 * (vehicle.front_extent - vehicle.rear_extent),
        "max_braking": vehicle.max_braking,
    })  # fmt: skip
    setup["settings"], setup["parameters"] = settings, parameters_of(config)
    setup["memory"] = empty(float(settings["cruise"][0]))
    body = setup.tobytes() + np.ascontiguousarray(path.table).tobytes()
    header = np.array([(MAGIC, abi(), zlib.crc32(body), len(body))], HEADER)
    return header.tobytes() + body


def obstacle_rows(obstacles: Sequence[Obstacle]) -> NDArray[np.void]:
    """Records of `OBSTACLE` as obstacles stand at time 0, shape (M,)."""
    rows = np.zeros(len(obstacles), OBSTACLE)
    for row, obstacle in zip(rows, obstacles, strict=True):
        for name in BOX_FIELDS:
            row[name] = getattr(obstacle, name)
    return rows
