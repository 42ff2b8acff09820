"""How the body rolls, and what the tyres feel of it.

The springs let the body lean out of a turn, about the axis through the roll centres of both axles: the wheels then
move sideways under the centre of gravity, which changes every slip angle, and load goes to the outer wheels, which
costs force. What goes through the roll centres needs no lean. Roll is no state of the prediction: it follows, as a
linear oscillator, from the lateral acceleration of the last plan.
"""

import math
from typing import NamedTuple

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import Array, Record, kernel
from sidestep.plant_models.vehicle.parameters import AXLES, GRAVITY, VehicleParameters

ROLL_STEP = 0.01
"""Step of the oscillator, in [s]."""


class Body(NamedTuple):
    """Oscillator der(rate) = gain a_y - stiffness angle - damping rate, and load moved per angle and rate of an axle.

    Attributes:
        height: Of the centre of gravity over the roll axis below it, in [m]; 0 if nothing rolls.
        gain, stiffness, damping: In [rad/m], [1/s^2], [1/s].
        front, rear: Load that goes from the inner to the outer wheel, in [N/rad] and [N s/rad]. What the roll
            centre takes is in it, for the lateral acceleration that goes with this roll.
    """

    height: float = 0.0
    gain: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    front: tuple[float, float] = (0.0, 0.0)
    rear: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, vehicle: VehicleParameters) -> "Body":
        """The body of a vehicle with suspension data; springs and tyres act in series.

        Raises:
            InputError: No suspension data, or springs too soft to hold the car upright.
        """
        data = vehicle.suspension
        if data is None:
            raise InputError("controller.body_roll", f"{vehicle.name} has no suspension data", "[suspension]")
        springy, centres, stiffness, damping, inertia = [], [], 0.0, 0.0, data.roll_inertia
        height = vehicle.cg_height
        for axle in AXLES:
            track, (springs, dampers) = getattr(data, f"track_{axle}"), data.roll_of_axle(axle)
            tyres = 0.5 * data.tyre_stiffness * track**2
            part = tyres / (springs + tyres)  # of roll that the suspension takes
            held, damped = springs * part, dampers * part**2
            springy.append((held / track, damped / track))
            carried = vehicle.axle_load(axle) / GRAVITY - getattr(data, f"unsprung_mass_{axle}")
            moment = carried * getattr(data, f"roll_centre_{axle}")  # per lateral acceleration
            height -= moment / vehicle.mass
            centres.append(moment / track)
            stiffness, damping = stiffness + held, damping + damped
            inertia += 0.25 * getattr(data, f"unsprung_mass_{axle}") * track**2
        upright = stiffness - vehicle.mass * GRAVITY * height
        if upright <= 0.0:
            raise InputError("vehicle.suspension", f"roll stiffness {stiffness:.0f} N m/rad of springs and tyres",
                             f"> {stiffness - upright:.0f}, the moment of the car's weight")  # fmt: skip
        gain = vehicle.mass * height / inertia
        axles = [
            (by_angle + centre * upright / inertia / gain, by_rate + centre * damping / inertia / gain)
            for (by_angle, by_rate), centre in zip(springy, centres, strict=True)
        ]
        return cls(height, gain, upright / inertia, damping / inertia, *axles)


@kernel
def advance_roll(angle: float, rate: float, lateral: float, dt: float, body: Record) -> tuple[float, float]:
    """Roll angle [rad, to the right] and rate [rad/s] after `dt` [s] of lateral acceleration `lateral` [m/s^2]."""
    steps = math.ceil(dt / ROLL_STEP)
    for _ in range(steps):
        h = dt / steps
        rate += h * (body.gain * lateral - body.stiffness * angle)
        rate /= 1.0 + h * body.damping
        angle += h * rate
    return angle, rate


@kernel
def roll_effects(angle: float, rate: float, body: Record) -> tuple[float, float, float]:
    """What the tyres feel.

    Returns:
        Lateral velocity of the road's point under the centre of gravity against it [m/s], load moved between the
        front and between the rear wheels [N].
    """
    front = body.front[0] * angle + body.front[1] * rate
    return body.height * rate, front, body.rear[0] * angle + body.rear[1] * rate


@kernel
def roll_ahead(now: Array, grid: Record, states: Array, speed: float, body: Record, roll: Array) -> None:
    """Roll along a prediction.

    Args:
        now: Roll angle and rate, shape (2,), in [rad] and [rad/s].
        grid: Record of `GRID`.
        states: Shape (N + 1, 6), see `prediction`.
        speed: v > 0, in [m/s].
        body: Body.
        roll: Angle and rate, shape (N + 1, 2); filled.
    """
    roll[0, 0], roll[0, 1] = now[0], now[1]
    for k in range(grid.nodes):
        lateral = lateral_acceleration(states[k], states[k + 1], speed, grid.steps[k])
        roll[k + 1, 0], roll[k + 1, 1] = advance_roll(roll[k, 0], roll[k, 1], lateral, grid.steps[k], body)


@kernel
def lateral_acceleration(before: Array, now: Array, speed: float, dt: float) -> float:
    """Mean lateral acceleration [m/s^2] between two states of `prediction`, shape (6,), `dt` [s] apart."""
    return speed * ((now[2] - before[2]) / dt + 0.5 * (now[3] + before[3]))
