"""Chassis data of multibody plants: springs, dampers, tracks and what hangs on them."""

from dataclasses import dataclass
from typing import Annotated

from sidestep.plant_models.ranges import Range, check


@dataclass(frozen=True)
class SuspensionParameters:
    """Chassis data that only multibody plants need (CommonRoad vehicle models, appendix tables).

    Attributes:
        unsprung_mass_front, unsprung_mass_rear: Unsprung mass PER AXLE, in [kg]; the rest of the car is sprung.
        roll_inertia, pitch_inertia: Inertia of the sprung mass, in [kg m^2].
        spring_front, spring_rear: Wheel rate per wheel, in [N/m].
        damper_front, damper_rear: Damping per wheel, in [N s/m].
        anti_roll_front, anti_roll_rear: Auxiliary roll stiffness per axle, in [N m/rad].
        track_front, track_rear: Track width, in [m].
        tyre_stiffness: Vertical tyre stiffness per wheel, in [N/m].
        wheel_radius: Unloaded radius, in [m].
        wheel_spin_inertia: Spin inertia per wheel, in [kg m^2].
        steer_delay: Time until the steering actuator hears a command, in [s].
        roll_centre_front, roll_centre_rear: Height of the roll centre of the axle above the road, in [m]: where the
            suspension passes the tyres' lateral forces to the body. 0 leaves all of them to springs and dampers.
    """

    unsprung_mass_front: Annotated[float, Range(0.01, 1e5, "kg")]
    unsprung_mass_rear: Annotated[float, Range(0.01, 1e5, "kg")]
    roll_inertia: Annotated[float, Range(1e-4, 1e8, "kg m²")]
    pitch_inertia: Annotated[float, Range(1e-4, 1e8, "kg m²")]
    spring_front: Annotated[float, Range(1.0, 1e9, "N/m")]
    spring_rear: Annotated[float, Range(1.0, 1e9, "N/m")]
    damper_front: Annotated[float, Range(0.01, 1e8, "N s/m")]
    damper_rear: Annotated[float, Range(0.01, 1e8, "N s/m")]
    anti_roll_front: Annotated[float, Range(0.0, 1e9, "N m/rad")]
    anti_roll_rear: Annotated[float, Range(0.0, 1e9, "N m/rad")]
    track_front: Annotated[float, Range(0.05, 20.0, "m")]
    track_rear: Annotated[float, Range(0.05, 20.0, "m")]
    tyre_stiffness: Annotated[float, Range(1.0, 1e9, "N/m")]
    wheel_radius: Annotated[float, Range(0.01, 5.0, "m")]
    wheel_spin_inertia: Annotated[float, Range(1e-6, 1e4, "kg m²")]
    steer_delay: Annotated[float, Range(0.0, 0.99, "s")] = 0.0
    roll_centre_front: Annotated[float, Range(0.0, 5.0, "m")] = 0.0
    roll_centre_rear: Annotated[float, Range(0.0, 5.0, "m")] = 0.0

    def __post_init__(self) -> None:
        check(self, "vehicle.suspension")

    def roll_of_axle(self, axle: str) -> tuple[float, float]:
        """Roll stiffness [N m/rad] of springs and anti-roll bar, and roll damping [N m s/rad], of "front" or "rear"."""
        lever = 0.5 * getattr(self, f"track_{axle}") ** 2  # half the track squared times two wheels
        stiffness = getattr(self, f"spring_{axle}") * lever + getattr(self, f"anti_roll_{axle}")
        return stiffness, getattr(self, f"damper_{axle}") * lever
