"""Settings of the controller, and its two presets."""

from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.ranges import Range, check


@dataclass(frozen=True)
class ControllerConfig:
    """Everything that can be tuned; the defaults are the `default` preset.

    Attributes:
        formulation: "corridor" (footprint corridor, soft rows, steering rate as input, exact
            discretisation) or "paper" (Eqs. (7), (13)-(16) to the letter).
        period: Control period, in [s].
        input_delay_steps: Periods until a command takes effect (1 for one-step-delay coupling); the
            state is moved forward with the commands already sent.
        cruise_speed: Speed to hold, in [m/s]; None takes that of the first state.
        width_left, width_right: Road edges left and right of the reference, in [m].
        reference_offset: l_ref of Eq. (10), in [m].
        buffer: Clearance l_buffer of Eq. (13) to obstacles and road edges, in [m].
        least_clearance: Where no way keeps the buffer, one with this clearance is driven slowly, in [m].
        tightening: Clearance asked on top of the buffer half a second ahead and later, in [m]; what
            model error and sampling take of it on the way does not end as slack.
        margin_time: Extra distance that the planner keeps from obstacles on top, in [m] per [m/s].
        safe_distance: d_max of Eq. (12), in [m].
        weight_reference, weight_continuity, weight_obstacle: Of the costs (10), (11) (per squared
            lateral speed) and (12).
        side_hysteresis: Cost per layer of changing the passing side of an obstacle.
        max_lateral_speed, max_slope: Bound (8): l' <= min(max_slope, max_lateral_speed / v).
        weight_offset, weight_lateral_speed: Tracking of the planned path, in [1/m^2] and [s^2/m^2].
        weight_acceleration, weight_jerk: Of lateral acceleration [s^4/m^2] and jerk [s^6/m^2].
        weight_rate: Of the steering rate itself, in [s^2/rad^2]; keeps standstill well-posed.
        corridor_penalty, slip_penalty: Linear cost of leaving the corridor [1/m] or the slip bound [1/rad].
        solver: Of the QP where a bound acts: "piqp", or "active-set", which is compiled with the step; where that one
            does not come to an end, PIQP is asked. Both give the optimum.
        tyre_model: "affine" takes tangents to the Magic Formula about the last plan, "linear" the
            cornering stiffness of the paper.
        body_roll: Predict how the body rolls, and what tyres feel of it, from the vehicle's suspension data: for
            real cars and plants with springs; a single-track car does not roll.
        friction: Road friction that the controller believes, as a factor on the tyre's peak.
        slip_share: Bound on front and rear slip angle, as a share of the angle at which the axle peaks.
        validity: File of `sidestep validate` (validity.json): slip angles then also stay where lateral acceleration
            is within its limits for this speed and friction; empty for none.
        reject_disturbance: Learn steering offset and lateral force that the model lacks.
        comfort_braking: Deceleration used where the distance allows it, in [m/s^2].
        bend_acceleration: Lateral acceleration that sets the speed in bends, in [m/s^2]; less where friction or
            `validity` allow less.
        standstill_gap: Distance left to what blocks the road, in [m].
        max_lateral_acceleration: a_y,max of Eq. (14), in [m/s^2]; `paper` only.
        weight_steer: R of Eq. (15), which the paper does not give; below about 20 its closed loop oscillates
            on the steering actuator's lag. `paper` only.
    """

    formulation: str = "corridor"
    period: Annotated[float, Range(0.001, 0.2, "s")] = 0.02
    input_delay_steps: Annotated[int, Range(0, 50)] = 0
    cruise_speed: Annotated[float, Range(0.0, 150.0, "m/s")] | None = None
    width_left: Annotated[float, Range(0.01, 1e3, "m")] = 4.0
    width_right: Annotated[float, Range(0.01, 1e3, "m")] = 4.0
    reference_offset: Annotated[float, Range(-1e3, 1e3, "m")] = 0.0
    buffer: Annotated[float, Range(0.0, 100.0, "m")] = 0.2
    least_clearance: Annotated[float, Range(0.0, 100.0, "m")] = 0.1
    tightening: Annotated[float, Range(0.0, 100.0, "m")] = 0.03
    margin_time: Annotated[float, Range(0.0, 10.0, "s")] = 0.01
    safe_distance: Annotated[float, Range(0.001, 100.0, "m")] = 1.0
    weight_reference: Annotated[float, Range(0.0, 1e6)] = 1.0
    weight_continuity: Annotated[float, Range(0.0, 1e6)] = 0.2
    weight_obstacle: Annotated[float, Range(0.0, 1e6)] = 3.0
    side_hysteresis: Annotated[float, Range(0.0, 1e6)] = 2.0
    max_lateral_speed: Annotated[float, Range(0.01, 100.0, "m/s")] = 6.0
    max_slope: Annotated[float, Range(0.001, 10.0)] = 0.35
    weight_offset: Annotated[float, Range(1e-6, 1e6, "1/m²")] = 3.0
    weight_lateral_speed: Annotated[float, Range(0.0, 1e6, "s²/m²")] = 0.4
    weight_acceleration: Annotated[float, Range(0.0, 1e6, "s⁴/m²")] = 0.07
    weight_jerk: Annotated[float, Range(0.0, 1e6, "s⁶/m²")] = 2e-3
    weight_rate: Annotated[float, Range(1e-6, 1e6, "s²/rad²")] = 0.5
    corridor_penalty: Annotated[float, Range(0.001, 1e6, "1/m")] = 300.0
    slip_penalty: Annotated[float, Range(0.001, 1e6, "1/rad")] = 300.0
    solver: str = "piqp"
    tyre_model: str = "affine"
    body_roll: bool = False
    friction: Annotated[float, Range(0.01, 5.0)] = 1.0
    slip_share: Annotated[float, Range(0.01, 10.0)] = 0.8
    validity: str = ""
    reject_disturbance: bool = True
    comfort_braking: Annotated[float, Range(0.01, 50.0, "m/s²")] = 3.0
    bend_acceleration: Annotated[float, Range(0.01, 100.0, "m/s²")] = 4.0
    standstill_gap: Annotated[float, Range(0.0, 100.0, "m")] = 2.0
    max_lateral_acceleration: Annotated[float, Range(0.01, 100.0, "m/s²")] = 8.0
    weight_steer: Annotated[float, Range(1e-6, 1e6)] = 50.0

    def __post_init__(self) -> None:
        check(self, "controller")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                allowed = ", ".join(str(choice).lower() for choice in choices)
                raise InputError(f"controller.{name}", f"{getattr(self, name)!r}", allowed)
        if not isinstance(self.validity, str):
            raise InputError("controller.validity", f"{self.validity!r}", "the path of a file, or empty")

    @classmethod
    def preset(cls, name: str = "default", **overrides: Any) -> "ControllerConfig":
        """A preset with single values replaced.

        Args:
            name: "default", or "paper" for the literal paper as baseline.
            overrides: Fields of this class by name.

        Raises:
            InputError: No such preset or field, or a value out of range.
        """
        if name not in PRESETS:
            raise InputError("controller.preset", f"unknown preset {name!r}", ", ".join(PRESETS))
        names = [f.name for f in fields(cls)]
        for key in overrides:
            if key not in names:
                raise InputError(f"controller.{key}", "unknown key", ", ".join(names))
        return replace(cls(), **{**PRESETS[name], **overrides})


PRESETS: dict[str, dict[str, Any]] = {"default": {}, "paper": {"formulation": "paper"}}
"""What each preset changes against the defaults."""

_CHOICES: dict[str, tuple[str, ...] | tuple[bool, ...]] = {
    "formulation": ("corridor", "paper"),
    "solver": ("piqp", "active-set"),
    "tyre_model": ("affine", "linear"),
    "body_roll": (True, False),
    "reject_disturbance": (True, False),
}
