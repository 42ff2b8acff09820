"""Chassis data of multibody plants: springs, dampers, tracks and what hangs on them."""

from dataclasses import dataclass

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.checks import require_positive

_OR_ZERO = ("anti_roll_front", "anti_roll_rear", "steer_delay", "roll_centre_front", "roll_centre_rear")


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

    unsprung_mass_front: float
    unsprung_mass_rear: float
    roll_inertia: float
    pitch_inertia: float
    spring_front: float
    spring_rear: float
    damper_front: float
    damper_rear: float
    anti_roll_front: float
    anti_roll_rear: float
    track_front: float
    track_rear: float
    tyre_stiffness: float
    wheel_radius: float
    wheel_spin_inertia: float
    steer_delay: float = 0.0
    roll_centre_front: float = 0.0
    roll_centre_rear: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "vehicle.suspension", _OR_ZERO)
        if self.steer_delay >= 1.0:
            raise InputError("vehicle.suspension.steer_delay", f"{self.steer_delay} s", "0 <= value < 1")

    def roll_of_axle(self, axle: str) -> tuple[float, float]:
        """Roll stiffness [N m/rad] of springs and anti-roll bar, and roll damping [N m s/rad], of "front" or "rear"."""
        lever = 0.5 * getattr(self, f"track_{axle}") ** 2  # half the track squared times two wheels
        stiffness = getattr(self, f"spring_{axle}") * lever + getattr(self, f"anti_roll_{axle}")
        return stiffness, getattr(self, f"damper_{axle}") * lever
