"""Masses and places of the MuJoCo car's bodies, from the vehicle data: four wheel stations and what they carry."""

import math
from dataclasses import dataclass

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.plant_models.vehicle.suspension import SuspensionParameters

WHEELS = ("fl", "fr", "rl", "rr")
"""Front left, front right, rear left, rear right: the order of everything that comes in fours."""

_HUB_INERTIA = 0.3  # ours: the CommonRoad sets lack it, and it hardly shows; [kg m^2]


@dataclass(frozen=True)
class Corner:
    """One wheel station.

    Attributes:
        name: One of `WHEELS`.
        x, y: Wheel centre from the centre of gravity, in [m].
        load: Static wheel load, in [N].
        height: Wheel centre above the road at that load, in [m].
        mass: Unsprung mass, in [kg].
        spring, damper: Wheel rate in [N/m], damping in [N s/m].
        roll_centre: Height of the axle's roll centre above the road, in [m].
    """

    name: str
    x: float
    y: float
    load: float
    height: float
    mass: float
    spring: float
    damper: float
    roll_centre: float

    @property
    def slide_axis(self) -> tuple[float, float]:
        """Direction, y and z, in which the wheel moves up: square to the line from its patch to the roll centre."""
        length = math.hypot(self.roll_centre, self.y)
        return math.copysign(self.roll_centre, self.y) / length, abs(self.y) / length


def suspension_of(vehicle: VehicleParameters) -> SuspensionParameters:
    """The multibody data of `vehicle`.

    Raises:
        InputError: It has none.
    """
    if vehicle.suspension is None:
        raise InputError("vehicle.suspension", f"{vehicle.name!r} has none, the MuJoCo car needs it", "a table")
    return vehicle.suspension


def corners(vehicle: VehicleParameters) -> tuple[Corner, ...]:
    """The four wheel stations in the order of `WHEELS`.

    Raises:
        InputError: The vehicle has no suspension data.
    """
    data, result = suspension_of(vehicle), []
    for name in WHEELS:
        front, side = name[0] == "f", 1.0 if name[1] == "l" else -1.0
        lever = vehicle.l_r if front else vehicle.l_f
        load = vehicle.mass * GRAVITY * lever / vehicle.wheelbase / 2.0
        result.append(
            Corner(
                name=name,
                x=vehicle.l_f if front else -vehicle.l_r,
                y=side * (data.track_front if front else data.track_rear) / 2.0,
                load=load,
                height=data.wheel_radius - load / data.tyre_stiffness,
                mass=(data.unsprung_mass_front if front else data.unsprung_mass_rear) / 2.0,
                spring=data.spring_front if front else data.spring_rear,
                damper=data.damper_front if front else data.damper_rear,
                roll_centre=data.roll_centre_front if front else data.roll_centre_rear,
            )
        )
    return tuple(result)


def sprung_body(vehicle: VehicleParameters) -> tuple[float, list[float], list[float]]:
    """Sprung mass, its centre from the total centre of gravity (3), its principal inertia (3).

    What is left of the car's total mass, moments and yaw inertia when the wheel stations are taken off.

    Raises:
        InputError: Nothing is left, or an inertia that no rigid body can have.
    """
    data, stations = suspension_of(vehicle), corners(vehicle)
    mass = vehicle.mass - sum(c.mass for c in stations)
    if mass <= 0.0:
        raise InputError("vehicle.mass", f"{vehicle.mass} kg", f"> {vehicle.mass - mass} kg, the unsprung mass")
    x = -sum(c.mass * c.x for c in stations) / mass
    z = -sum(c.mass * (c.height - vehicle.cg_height) for c in stations) / mass
    unsprung = sum(c.mass * (c.x**2 + c.y**2) + upright_inertia(data) for c in stations)
    others = unsprung + mass * x**2
    roll, pitch, yaw = data.roll_inertia, data.pitch_inertia, vehicle.yaw_inertia - others
    if not abs(pitch - roll) <= yaw <= pitch + roll:
        allowed = (
            f"{abs(pitch - roll) + others:.0f} ... {pitch + roll + others:.0f}, from the sprung roll and pitch inertia"
        )
        raise InputError("vehicle.yaw_inertia", f"{vehicle.yaw_inertia} kg m^2", allowed)
    return mass, [x, 0.0, z], [roll, pitch, yaw]


def upright_inertia(data: SuspensionParameters) -> float:
    """Inertia of hub and wheel about a diameter, in [kg m^2]: half the spin's for a ring, more for its width."""
    return _HUB_INERTIA + 0.6 * data.wheel_spin_inertia
