"""Is there a way through? A label for a scene from a search that shares no code with the controller.

What is asked is always for a clearance: scenes are labelled for MARGIN; whether a car that stopped had a way past is
asked for the buffer that its own controller keeps (`way_past`), and at lower speeds, too.

The search is that of `reachability`: a "yes" always comes with a trajectory that was checked against the exact boxes
and edges all along, a witness; a "no" says that the grid found none. A stop counts if nothing hits the standing car
afterwards, either.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from sidestep.plant_models.vehicle.parameters import GRAVITY
from sidestep.validation.geometry import Array
from sidestep.validation.judge.reachability import LAYER, SUBSTEPS, depth_first
from sidestep.validation.scenarios.scenario import Scenario

MARGIN = 0.10
"""Distance of the witness from every obstacle and edge at least where scenes are labelled, in [m]."""
LATERAL_SHARE, BRAKING_SHARE, ACCELERATION_SHARE, GRIP_SHARE = 0.7, 0.8, 0.8, 0.9
"""Lateral acceleration, braking and driving that the witness may use, as shares of mu g, max_braking and
max_acceleration, and of the friction circle together."""
STEER_SHARE = 0.7
"""Share of the steering rate limit that the witness uses."""
REACTION_TIME = 0.3
"""Before the witness brakes, in [s]."""

HORIZON = 20.0
"""Until which nothing hits the car after its stop, in [s]."""
LONGEST = 60.0
"""Time of a way past at most, in [s]; what takes longer counts as not found."""
SPEED_SHARES = (1.0, 0.5, 0.25)
"""Of the asked speed, at which a way past is looked for, the fastest first."""
BRAKE_LATER = np.arange(0.0, 6.0, 0.6)
"""Tried one after another on top of the reaction time, in [s]."""


@dataclass(frozen=True)
class Feasibility:
    """What physics allows in a scene.

    Attributes:
        passable: At the asked speed there is a way past all obstacles.
        stoppable: There is a way to a standstill.
        witness: Rows of time [s], s, l [m], heading relative to the road [rad], path curvature [1/m], speed [m/s]
            of the way through if there is one, else of the stop; empty if there is neither.
        clearance: For which this holds, to every obstacle and edge, in [m].
    """

    passable: bool
    stoppable: bool
    witness: Array
    clearance: float


def assess(scenario: Scenario, clearance: float = MARGIN) -> Feasibility:
    """Search for a way through, and for a stop, the earliest one first.

    Args:
        scenario: Its plant's friction counts.
        clearance: From every obstacle and edge at least, in [m].
    """
    way = _through(scenario, clearance, 1.0)
    brakes = (REACTION_TIME + BRAKE_LATER).tolist()
    stops = (_search(scenario, _Profile(0.0, start, HORIZON), clearance) for start in brakes)
    stop = next((found for found in stops if len(found)), way[:0])
    return Feasibility(len(way) > 0, len(stop) > 0, way if len(way) else stop, clearance)


@dataclass(frozen=True)
class WayPast:
    """That there is a way past all obstacles.

    Attributes:
        share: Of the asked speed at which it was found.
        clearance: Kept to every obstacle and edge, in [m].
        witness: See Feasibility.
    """

    share: float
    clearance: float
    witness: Array

    @property
    def sentence(self) -> str:
        """For people."""
        return f"a way past at {self.witness[-1, 5]:.3g} m/s keeps {self.clearance:g} m"


def way_past(scenario: Scenario, clearance: float) -> WayPast | None:
    """A way past everything from the start on, at the asked speed or slower, as far as the scene goes; None if none.

    Args:
        scenario: Grip is what both the plant and the controller have it to be.
        clearance: From every obstacle and edge at least, in [m].
    """
    grip = min(scenario.plant.friction, scenario.controller.friction)
    told = replace(scenario, plant=replace(scenario.plant, friction=grip))
    ways = ((share, _through(told, clearance, share, to_the_end=True)) for share in SPEED_SHARES)
    return next((WayPast(share, clearance, way) for share, way in ways if len(way)), None)


@dataclass(frozen=True)
class _Profile:
    """Speed over time: that of the start until `begin` [s], then towards `target` [m/s]; for `horizon` [s]."""

    target: float
    begin: float
    horizon: float


def _through(scenario: Scenario, clearance: float, share: float, to_the_end: bool = False) -> Array:
    """A way past all obstacles at a share of the asked speed; empty if there is none, or it takes too long."""
    target = scenario.speed * share
    begin = math.inf if target == scenario.start.v_x else REACTION_TIME
    horizon = _time_to_pass(scenario, _Profile(target, begin, LONGEST))
    if to_the_end:
        horizon = max(horizon, min(_time_to_end(scenario, _Profile(target, begin, LONGEST)), scenario.duration))
    if not horizon <= LONGEST:
        return np.empty((0, 6))
    return _search(scenario, _Profile(target, begin, horizon), clearance)


def _time_to_pass(scenario: Scenario, profile: _Profile) -> float:
    """Until the car has all slower obstacles behind it, and a second more, in [s]; infinite if it takes too long."""
    s, reach = _project(scenario)[0], scenario.vehicle.length
    times, travelled = _distances(scenario, profile)
    last = 0.0
    for o in scenario.obstacles:
        ahead = o.s + o.length / 2.0 + reach - s
        if o.speed < profile.target:
            behind = travelled >= ahead + o.speed * times
            last = max(last, float(times[np.argmax(behind)]) if behind.any() else math.inf)
    return 1.1 * last + 1.0


def _time_to_end(scenario: Scenario, profile: _Profile) -> float:
    """Until an open road ends, in [s]; infinite on a closed one, or if it takes too long."""
    times, travelled = _distances(scenario, profile)
    at_end = travelled >= scenario.path.length - _project(scenario)[0]
    return math.inf if scenario.path.closed or not at_end.any() else float(times[np.argmax(at_end)])


def _distances(scenario: Scenario, profile: _Profile) -> tuple[Array, Array]:
    """Times and the distance driven until then, in [s] and [m]."""
    times, speeds, _ = _speeds(scenario, profile)
    return times, np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2.0 * np.diff(times))])


def _speeds(scenario: Scenario, profile: _Profile) -> tuple[Array, Array, Array]:
    """Times, the speed at each, and the lateral acceleration that is left there, in [s], [m/s], [m/s^2]."""
    vehicle, speed = scenario.vehicle, scenario.start.v_x
    grip = scenario.plant.friction * GRAVITY
    braking = BRAKING_SHARE * min(vehicle.max_braking, grip)
    lateral = LATERAL_SHARE * grip
    lateral_braking = min(lateral, math.sqrt((GRIP_SHARE * grip) ** 2 - braking**2))
    layers = math.ceil(profile.horizon / LAYER)
    times: Array = LAYER / SUBSTEPS * np.arange(layers * SUBSTEPS + 1.0)
    late = np.maximum(times - profile.begin, 0.0)
    if profile.target > speed:
        speeds = np.minimum(speed + ACCELERATION_SHARE * vehicle.max_acceleration * late, profile.target)
    else:
        speeds = np.maximum(speed - braking * late, profile.target)
    return times, speeds.astype(np.float64), np.where(late > 0.0, lateral_braking, lateral).astype(np.float64)


def _project(scenario: Scenario) -> tuple[float, float, float]:
    return scenario.path.project(scenario.start.x, scenario.start.y)


def _search(scenario: Scenario, profile: _Profile, clearance: float) -> Array:
    vehicle, config, path = scenario.vehicle, scenario.controller, scenario.path
    times, speeds, limits = _speeds(scenario, profile)
    boxes = np.array([(o.s, o.l, o.length, o.width, o.heading, o.speed) for o in scenario.obstacles]).reshape(-1, 6)
    s, l, heading = _project(scenario)  # noqa: E741
    start = np.array([s, l, scenario.start.yaw - heading])
    found, states = depth_first(
        start, speeds, limits, _poses(path, boxes, times), boxes, path.table, path.period,
        (vehicle.front_extent + clearance, vehicle.rear_extent + clearance, 0.5 * vehicle.width + clearance),
        (-config.width_right, config.width_left),
        STEER_SHARE * vehicle.steer_rate_limit / vehicle.wheelbase,
        (len(times) - 1) // SUBSTEPS,
    )  # fmt: skip
    if not found:
        return np.empty((0, 6))
    return np.column_stack([times, states, speeds]).astype(np.float64)


def _poses(path, boxes, times):
    """World pose of every box at every time, shape (M, T, 3), and its station, which is the fourth column."""
    poses = np.empty((len(boxes), len(times), 4))
    for m, (s, l, _, _, heading, speed) in enumerate(boxes):  # noqa: E741
        stations = s + speed * times
        poses[m, :, 0], poses[m, :, 1] = path.to_cartesian(stations, np.full_like(times, l))
        poses[m, :, 2], poses[m, :, 3] = path.heading(stations) + heading, stations
    return poses
