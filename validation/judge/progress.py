"""How far and how fast a drive went against what its scene asks, from the plant's own state.

What is asked is driven on paper first: from the start with the speed control that all plants have, at the asked speed,
until time or road end. What that drive comes to is due; what it never comes to, the scene is too short for.
"""

from dataclasses import dataclass

import numpy as np

from sidestep.plant_models.obstacle import Obstacle
from sidestep.plant_models.speed_control import limited_acceleration
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.geometry import Array
from sidestep.validation.loop.recording import Recording
from sidestep.validation.scenarios.scenario import Scenario

STANDING = 0.1
"""Speed below which a car stands, in [m/s]."""
DUE_SPEED = 0.9
"""What a drive at this share of the asked speed comes to is due: avoidance takes a little."""
HEADWAY = 3.0
"""A car that ends within this time [s], at the asked speed, of a slower one ahead follows it."""
SETTLED = 2.0
"""How long the commanded speed has been within reach before the plant's is compared with it, in [s]."""
_PERIOD = 0.01


@dataclass(frozen=True)
class Progress:
    """Of one drive; obstacles by their index.

    Attributes:
        distance, asked_distance: Along the road, driven, and at the asked speed until time or road end, in [m].
        mean_speed: In [m/s].
        held_speed, commanded_speed: Means of the plant's speed and of what it was told, where that was settled, in
            [m/s]; None if it never was.
        ahead: Obstacles on the road that the car comes up to, or that come up to it.
        reached: Those of them whose near end the front bumper came to.
        passed: Those that the car left behind.
        unpassed: Those that it did not leave behind, or not even reach, although that was due.
        out_of_reach: Those not reached that were not due, either: the scene is too short for them.
        followed: The slower one close behind which the drive ended, if any.
        standing: Whether the car stands in the end.
    """

    distance: float
    asked_distance: float
    mean_speed: float
    held_speed: float | None
    commanded_speed: float | None
    ahead: tuple[int, ...]
    reached: tuple[int, ...]
    passed: tuple[int, ...]
    unpassed: tuple[int, ...]
    out_of_reach: tuple[int, ...]
    followed: int | None
    standing: bool


def progress(recording: Recording, scenario: Scenario) -> Progress:
    """What a drive came to."""
    time, s = recording["time"] - recording["time"][0], recording["s"]
    ahead = obstacles_ahead(scenario, float(s[0]))
    reached, passed = _met(scenario, ahead, time, s)
    due_reached, due_passed = _met(scenario, ahead, *asked_drive(scenario, float(s[0]), DUE_SPEED))
    unpassed = (due_passed - passed) | (due_reached - reached)
    held, commanded = _held_speed(recording, scenario.vehicle)
    _, asked_s = asked_drive(scenario, float(s[0]))
    return Progress(
        distance=float(s[-1] - s[0]),
        asked_distance=float(asked_s[-1] - asked_s[0]),
        mean_speed=float((s[-1] - s[0]) / time[-1]) if time[-1] > 0.0 else float(recording["v_x"][0]),
        held_speed=held,
        commanded_speed=commanded,
        ahead=tuple(ahead),
        reached=tuple(sorted(reached)),
        passed=tuple(sorted(passed)),
        unpassed=tuple(sorted(unpassed)),
        out_of_reach=tuple(sorted(set(ahead) - due_reached - reached)),
        followed=_followed(scenario, ahead, passed, float(time[-1]), float(s[-1])),
        standing=bool(abs(recording["v_x"][-1]) < STANDING),
    )


def half_length(obstacle: Obstacle) -> float:
    """From an obstacle's centre to its ends along the road, in [m]."""
    along = abs(obstacle.length * np.cos(obstacle.heading)) + abs(obstacle.width * np.sin(obstacle.heading))
    return float(along / 2.0)


def obstacles_ahead(scenario: Scenario, s: float) -> dict[int, float]:
    """Obstacles on the road that a car at station `s` and the asked speed comes up to, and their stations, in [m].

    What is as fast as asked, or stands beside the road, is none; a closed road brings up again what lies behind.
    """
    config, path, found = scenario.controller, scenario.path, {}
    for index, o in enumerate(scenario.obstacles):
        across = (abs(o.length * np.sin(o.heading)) + abs(o.width * np.cos(o.heading))) / 2.0
        beside = o.l - across >= config.width_left or o.l + across <= -config.width_right
        station, behind = o.s, s - scenario.vehicle.rear_extent - half_length(o)
        if path.closed and station <= behind:
            station += path.length * np.ceil((behind - station) / path.length)
        if not beside and o.speed < scenario.speed and station > behind:
            found[index] = float(station)
    return found


def asked_drive(scenario: Scenario, s: float, share: float = 1.0) -> tuple[Array, Array]:
    """Times and stations of the drive that is asked for, at a share of its speed, until time or road end; [s], [m]."""
    vehicle, speed, target = scenario.vehicle, scenario.start.v_x * share, scenario.speed * share
    times = np.arange(0.0, scenario.duration + _PERIOD / 2.0, _PERIOD)
    speeds = _under_speed_control(speed, np.full(len(times), target), np.full(len(times), _PERIOD), vehicle)
    stations = s + np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2.0 * _PERIOD)])
    if scenario.path.closed:
        return times, stations
    on_road = np.concatenate([[True], stations[:-1] < scenario.path.length])
    return times[on_road], stations[on_road]


def _under_speed_control(speed: float, targets: Array, steps: Array, vehicle: VehicleParameters) -> Array:
    """Speed at every sample of a car that follows the targets, shape (n,), in [m/s]."""
    speeds = np.empty(len(targets))
    for k, (target, step) in enumerate(zip(targets.tolist(), steps.tolist(), strict=True)):
        speeds[k] = speed
        speed += step * limited_acceleration(speed, target, vehicle.max_braking, vehicle.max_acceleration)
    return speeds


def _met(scenario: Scenario, ahead: dict[int, float], time: Array, s: Array) -> tuple[set[int], set[int]]:
    """Which obstacles ahead a car at these stations reaches, and which it leaves behind."""
    reached, passed = set(), set()
    for index, station in ahead.items():
        obstacle = scenario.obstacles[index]
        gap = station + obstacle.speed * time - s
        reached |= {index} if np.any(gap - half_length(obstacle) <= scenario.vehicle.front_extent) else set()
        passed |= {index} if np.any(gap + half_length(obstacle) <= -scenario.vehicle.rear_extent) else set()
    return reached, passed


def _followed(scenario: Scenario, ahead: dict[int, float], passed: set[int], time: float, s: float) -> int | None:
    """The nearest obstacle ahead that moves on and is not left behind, if that is near."""
    gaps = {
        index: station + o.speed * time - half_length(o) - s - scenario.vehicle.front_extent
        for index, station in ahead.items()
        if index not in passed and (o := scenario.obstacles[index]).speed > 0.0
    }
    nearest = min(gaps, key=lambda index: gaps[index], default=None)
    return nearest if nearest is not None and gaps[nearest] <= HEADWAY * scenario.speed else None


def _held_speed(recording: Recording, vehicle: VehicleParameters) -> tuple[float | None, float | None]:
    """Mean speed and mean commanded speed where a car like this would have reached what is commanded, in [m/s]."""
    time, targets = recording["time"], np.maximum(recording["target_speed"], 0.0)
    steps = np.diff(time, append=time[-1])
    ideal = _under_speed_control(float(recording["v_x"][0]), targets, steps, vehicle)
    off = np.abs(ideal - targets) > 0.02 * targets + 0.02
    last_off = np.maximum.accumulate(np.where(off, time, -np.inf))
    settled = ~off & (time - np.maximum(last_off, time[0]) >= SETTLED)
    if not settled.any():
        return None, None
    return float(recording["v_x"][settled].mean()), float(targets[settled].mean())
