"""Acceptance from exact oriented boxes in the plant's own state, and from how far the drive went.

Nothing of the controller is used here: the car is its outline at the plant's pose, obstacles are their boxes
carried into the world by the reference path, and shapely measures between them. Whether a car that stopped had a way
past is searched for by `feasibility`, which shares no code with the controller, either.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sidestep.plant_models.notebook import facts_table
from sidestep.validation.geometry import Array, car_boxes, edge_clearance, obstacle_boxes, signed_clearance
from sidestep.validation.judge.feasibility import way_past
from sidestep.validation.judge.findings import Finding, Verdict
from sidestep.validation.judge.progress import Progress, progress
from sidestep.validation.loop.recording import End, Recording
from sidestep.validation.scenarios.scenario import Scenario

SLOW = 0.5
"""A drive that went less than this share of what was asked is slow."""
SPEED_SHARE, SPEED_ERROR = 0.2, 0.5
"""The plant's speed may be off what it is told by this share, or by this much if that is more, in [m/s]."""

OK, HANDLED, STOPPED, FOLLOWED = "ok", "infeasible, handled", "stopped, no way past", "ok, following"
COLLISION, OFF_ROAD, NOT_HELD = "collision", "corridor violation", "speed not held"
LAZY_STOP, LAZY_DRIVE = "stopped though passable", "slow though passable"
TOO_SHORT, TIME_OVER = "scene too short", "not passed in time"
ELSEWHERE = ", start not as asked"
"""What a passing label ends with if the plant did not start where it was put and that was accepted."""


BROKE_OFF = (End.PLANT_INVALID, End.CONTROLLER_ERROR, End.BUS_ERROR)
"""Ends of runs in which a part failed."""


class Decision(NamedTuple):
    """A verdict, the label that names its reason, and one line with figures where there is more to say."""

    verdict: Verdict
    label: str
    detail: str = ""


@dataclass(frozen=True, repr=False)
class Judgement:
    """What became of a run.

    Attributes:
        decision: The first that holds of, failing: "plant invalid", "controller error", "bus error" (the run broke off
            there), "collision" (the outlines overlap in some sample, or the plant's own geometry touched: a body that
            rolls reaches over its outline), "corridor violation" (a corner is over the road's edge); inconclusive:
            "interrupted" (from outside); what a finding says; failing: "speed not held" (the plant is far off the speed
            that it is told), "stopped though passable" and "slow though passable" (there is a way past with the
            controller's own buffer); inconclusive: "not passed in time" (an obstacle, and no way past was found at
            speed), "scene too short" (to come to an obstacle at the asked speed); passing: "stopped, no way past" (none
            was found), "ok, following" (close behind a slower obstacle), "infeasible, handled" (in some steps the
            controller had no feasible problem, fell back and came through), "ok".
        min_clearance: Smallest signed distance of the car to an obstacle, in [m], negative by the depth of
            penetration; None without obstacles.
        obstacle: Index of that obstacle.
        time, s: When and at which station of the car that was, in [s] and [m].
        min_edge_clearance: Smallest signed distance of a corner to the road's edges, in [m].
        progress: How far the drive went against what was asked.
        findings: What else was seen.
        broke_off: Whether plant, controller or bus failed.
        contact: Whether the plant's own geometry touched.
    """

    decision: Decision
    min_clearance: float | None
    obstacle: int | None
    time: float | None
    s: float | None
    min_edge_clearance: float
    progress: Progress
    findings: tuple[Finding, ...] = ()
    broke_off: bool = False
    contact: bool = False

    def __repr__(self) -> str:
        gap = "no obstacle" if self.min_clearance is None else f"clearance {self.min_clearance:.3f} m"
        return f"Judgement({self.verdict.value}: {self.label}, {gap})"

    def _repr_html_(self) -> str:
        gap = "–" if self.min_clearance is None else f"{self.min_clearance:.3f} m at {self.time:.2f} s"
        facts = [("reason", self.detail or self.label), ("smallest clearance", gap),
                 ("clearance to the road's edge", f"{self.min_edge_clearance:.3f} m"),
                 *((finding.label, finding.text) for finding in self.findings)]  # fmt: skip
        return facts_table(f"{self.verdict.value}: {self.label}", facts)

    @property
    def verdict(self) -> Verdict:
        """Pass, fail or inconclusive."""
        return self.decision.verdict

    @property
    def label(self) -> str:
        """The reason, in the same few words for all drives of its kind."""
        return self.decision.label

    @property
    def detail(self) -> str:
        """The reason with its figures; empty if the label says all."""
        return self.decision.detail

    @property
    def passed(self) -> bool:
        """Whether the car drove what was asked, or stopped or followed where nothing else was possible, untouched."""
        return self.verdict is Verdict.PASS

    @property
    def touched(self) -> bool:
        """Whether something was hit, the road left, or the run broke off."""
        gap = np.inf if self.min_clearance is None else self.min_clearance
        return self.broke_off or self.contact or overlaps(gap) or leaves(self.min_edge_clearance)


def overlaps(clearance: float) -> bool:
    """Whether outlines so far apart [m] touch."""
    return clearance <= 0.0


def leaves(edge_clearance: float) -> bool:
    """Whether a corner so far inside the road [m] is over its edge."""
    return edge_clearance < 0.0


def judge(recording: Recording, scenario: Scenario, findings: Sequence[Finding] = ()) -> Judgement:
    """Judge every sample of a run (10 ms apart at most), moving obstacles where they are at that time.

    Args:
        recording: What happened.
        scenario: What was asked.
        findings: What the recording does not show, see `findings`.
    """
    time, s, path = recording["time"], recording["s"], scenario.path
    car = car_boxes(scenario.vehicle, recording["x"], recording["y"], recording["yaw"])
    edge = float(edge_clearance(path, car, s).min())
    gap, where = _closest(car, scenario, time)
    went = progress(recording, scenario)
    decision = _safety(recording, gap, edge) or _finding(findings) or _drive(recording, scenario, went)
    if recording.departures and decision.verdict is Verdict.PASS:
        decision = decision._replace(label=decision.label + ELSEWHERE)
    obstacle, sample = where or (None, None)
    return Judgement(
        decision,
        min_clearance=None if sample is None else gap,
        obstacle=obstacle,
        time=None if sample is None else float(time[sample]),
        s=None if sample is None else float(s[sample]),
        min_edge_clearance=edge,
        progress=went,
        findings=tuple(findings),
        broke_off=recording.end in BROKE_OFF,
        contact=recording.contact,
    )


def _closest(car: Array, scenario: Scenario, time: Array) -> tuple[float, tuple[int, int] | None]:
    """Smallest clearance, and the obstacle and sample where it is."""
    gaps = np.array([_clearances(car, obstacle_boxes(scenario.path, box, time)) for box in scenario.obstacles])
    if not len(gaps):
        return np.inf, None
    obstacle, sample = (int(i) for i in np.unravel_index(np.argmin(gaps), gaps.shape))
    return float(gaps[obstacle, sample]), (obstacle, sample)


def _clearances(car: Array, box: Array) -> Array:
    """Signed clearance where it may be the smallest one; elsewhere that of the circumscribed circles, which is less."""
    apart = np.linalg.norm(car.mean(axis=1) - box.mean(axis=1), axis=1)
    radii = [np.linalg.norm(outline[0] - outline[0].mean(axis=0), axis=1).max() for outline in (car, box)]
    gaps = apart - sum(radii)
    near = gaps <= apart.min()
    gaps[near] = signed_clearance(car[near], box[near])
    return gaps


def _safety(recording: Recording, gap: float, edge: float) -> Decision | None:
    """Decided by what must not happen in any drive."""
    if recording.end in BROKE_OFF:
        return Decision(Verdict.FAIL, recording.end.value)
    if overlaps(gap) or recording.contact:
        return Decision(Verdict.FAIL, COLLISION)
    if leaves(edge):
        return Decision(Verdict.FAIL, OFF_ROAD)
    if recording.end is End.INTERRUPTED:
        return Decision(Verdict.INCONCLUSIVE, recording.end.value)
    return None


def _finding(findings: Sequence[Finding]) -> Decision | None:
    """Decided by the first finding that is none of a pass."""
    return next((Decision(f.verdict, f.label, f.text) for f in findings if f.verdict is not Verdict.PASS), None)


def _drive(recording: Recording, scenario: Scenario, went: Progress) -> Decision:
    """Decided by how far and how fast a drive without an incident went."""
    if (off := _speed_not_held(went)) is not None:
        return Decision(Verdict.FAIL, NOT_HELD, off)
    short = went.standing or bool(went.unpassed) or went.distance < SLOW * went.asked_distance
    follows = went.followed is not None and not went.standing
    if short and not follows:
        way = way_past(scenario, scenario.controller.buffer)
        if way is not None:
            label = LAZY_STOP if went.standing else LAZY_DRIVE
            return Decision(Verdict.FAIL, label, f"{_how_far(went)}; {way.sentence}")
        if went.standing:
            return Decision(Verdict.PASS, STOPPED, _how_far(went))
    if went.unpassed and not follows:
        return Decision(Verdict.INCONCLUSIVE, TIME_OVER, f"{_named(went.unpassed)} not left behind, {_how_far(went)}")
    if went.out_of_reach and _matters(scenario, went):
        words = f"{scenario.speed:g} m/s for {scenario.duration:g} s on {scenario.path.length:.4g} m of road"
        return Decision(Verdict.INCONCLUSIVE, TOO_SHORT, f"{words} never come to {_named(went.out_of_reach)}")
    if follows and short:
        return Decision(Verdict.PASS, FOLLOWED, f"behind {_named((went.followed or 0,))}, {_how_far(went)}")
    return Decision(Verdict.PASS, HANDLED if recording.infeasible_steps else OK)


def _speed_not_held(went: Progress) -> str | None:
    held, told = went.held_speed, went.commanded_speed
    if held is None or told is None or abs(held - told) <= max(SPEED_SHARE * told, SPEED_ERROR):
        return None
    return f"{held:.2f} m/s where the plant was told {told:.2f} m/s, {_how_far(went)}"


def _how_far(went: Progress) -> str:
    met = f", {len(went.passed)} of {len(went.ahead)} obstacles left behind" if went.ahead else ""
    return f"{went.distance:.1f} m of {went.asked_distance:.1f} m driven{met}"


def _matters(scenario: Scenario, went: Progress) -> bool:
    """Whether one that is out of reach stands in the road, or none at all was come to."""
    return not went.reached or any(scenario.obstacles[index].speed == 0.0 for index in went.out_of_reach)


def _named(indices: Sequence[int]) -> str:
    return "obstacles" + "".join(f"[{index}]" for index in indices)
