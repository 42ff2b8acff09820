"""A log whose car is known: the MuJoCo car driven on a banked road, measured by sensors with noise, offset and delay.

To see whether identification finds what is there; the car's tyres, springs and dampers are MuJoCo's own, not the
fitted model's.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.manoeuvres.catalogue import RandomSteer
from sidestep.validation.model_error.logs.measured import PERIOD

Array = NDArray[np.float64]

COLUMNS = (
    "time [s]",
    "steering_wheel [deg]",
    "v_x [km/h]",
    "yaw_rate [deg/s]",
    "a_y [m/s^2]",
    "a_x [m/s^2]",
    "v_y [m/s]",
)
FASTEST = 2.0
"""Of the steering, in [Hz]."""
LEAST_SPEED, MOST_SPEED = 12.0, 26.0
_SPRINGS = ("spring_front", "spring_rear", "anti_roll_front", "anti_roll_rear")
_AHEAD = 20  # samples driven before and after, for the delays


@dataclass(frozen=True)
class Sensors:
    """What the sensors do to the truth.

    Attributes:
        ratio: Steering wheel over road wheel.
        steer_offset: Road-wheel angle at a measured 0, in [rad].
        steer_delay: By how much the car is later than the measured steering, in [s].
        yaw_rate_offset, a_y_offset, sideslip_offset: In [rad/s], [m/s^2], [rad].
        a_y_delay, v_y_delay: In [s].
        noise: Standard deviations by signal, SI.
    """

    ratio: float = 14.5
    steer_offset: float = 0.004
    steer_delay: float = 0.04
    yaw_rate_offset: float = -0.006
    a_y_offset: float = 0.12
    sideslip_offset: float = 0.004
    a_y_delay: float = 0.02
    v_y_delay: float = 0.03
    noise: Mapping[str, float] = field(
        default_factory=lambda: {"steer": 2e-4, "v_x": 0.05, "yaw_rate": 1.75e-3, "a_y": 0.05, "a_x": 0.1, "v_y": 0.03}
    )


def known_car() -> VehicleParameters:
    """The BMW 320i preset, lower, on stiffer springs and lighter wheels: a car that rolls by 4 degrees per g."""
    vehicle = VehicleParameters.preset("bmw-320i")
    data = vehicle.suspension
    assert data is not None
    doubled = {name: 2.0 * getattr(data, name) for name in _SPRINGS} | {
        name: math.sqrt(2.0) * getattr(data, name) for name in ("damper_front", "damper_rear")
    }
    return vehicle.with_(cg_height=0.4, suspension=replace(data, wheel_spin_inertia=0.9, **doubled))


def write_log(path: Path, table: Array) -> None:
    """As a CSV file that `sidestep identify --log` reads."""
    with path.open("w", encoding="utf-8") as stream:
        np.savetxt(stream, table, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.8g")


def made_log(
    vehicle: VehicleParameters, sensors: Sensors, seed: int, duration: float = 90.0, acceleration: float = 3.0,
    bank: float = 0.03,
) -> tuple[Array, dict[str, float]]:  # fmt: skip
    """Drive and measure.

    Args:
        vehicle: The car, with suspension.
        sensors: What is measured of it.
        seed: Of steering, speed, bank and noise.
        duration: In [s].
        acceleration: Lateral acceleration that the steering asks for, in [m/s^2]; peaks are about twice that.
        bank: Amplitude of the road's bank, in [rad].

    Returns:
        A table with COLUMNS, and the true parameters by the names of `Values`, without tyre shape.
    """
    random = np.random.default_rng(seed)
    true = _drive(vehicle, random, duration, acceleration, bank)
    n = len(true["yaw_rate"])

    def seen(name: str, values: Array, late: float, offset: float | Array = 0.0) -> Array:
        moved = np.interp(np.arange(n) - late / PERIOD, np.arange(n), values)
        return (moved + offset + sensors.noise[name] * random.standard_normal(n))[_AHEAD:-_AHEAD]

    angle = seen("steer", (true["steer"] - sensors.steer_offset), -sensors.steer_delay) * sensors.ratio
    columns = [
        PERIOD * np.arange(n - 2 * _AHEAD),
        np.degrees(angle),
        3.6 * seen("v_x", true["v_x"], 0.0),
        np.degrees(seen("yaw_rate", true["yaw_rate"], 0.0, sensors.yaw_rate_offset)),
        seen("a_y", true["a_y"], sensors.a_y_delay, sensors.a_y_offset),
        seen("a_x", true["a_x"], 0.0),
        seen("v_y", true["v_y"], sensors.v_y_delay, sensors.sideslip_offset * true["v_x"]),
    ]
    slope = float(true["roll"] @ true["force"] / (true["force"] @ true["force"]))
    values = {
        "C_f": vehicle.cornering_stiffness_front,
        "C_r": vehicle.cornering_stiffness_rear, "I_z": vehicle.yaw_inertia,
        "steer_gain": 1.0 / sensors.ratio, "steer_offset": sensors.steer_offset, "steer_delay": sensors.steer_delay,
        "yaw_rate_offset": sensors.yaw_rate_offset, "a_y_offset": sensors.a_y_offset, "roll_gain": slope,
        "sideslip_offset": sensors.sideslip_offset, "a_y_delay": sensors.a_y_delay, "v_y_delay": sensors.v_y_delay,
        "relaxation": vehicle.tyre.relaxation_y, "cg_height": vehicle.cg_height, "cg_offset": 0.0,
    }  # fmt: skip
    return np.column_stack(columns), values


def _drive(
    vehicle: VehicleParameters, random: np.random.Generator, duration: float, acceleration: float, bank: float
) -> dict[str, Array]:
    """True signals every PERIOD; `force` is the lateral force over the mass, `a_y` that as the rolled body feels it."""
    n = round(duration / PERIOD) + 2 * _AHEAD
    time: Array = PERIOD * np.arange(n, dtype=np.float64)
    shares = RandomSteer(0.05, FASTEST, int(random.integers(1 << 30)))(time)
    waves = [np.sin(2.0 * math.pi * time / t + random.uniform(0.0, 6.3)) for t in (9.0, 17.0)]
    lean = 0.5 * bank * (waves[0] + waves[1])
    middle, half = 0.5 * (LEAST_SPEED + MOST_SPEED), 0.5 * (MOST_SPEED - LEAST_SPEED)
    speed = middle + half * np.sin(2.0 * math.pi * time / 40.0 + random.uniform(0.0, 6.3))
    rows = []
    with MujocoPlant(vehicle) as plant:
        state = plant.reset(VehicleState(v_x=float(speed[0])))
        for k in range(n):
            weight = GRAVITY * math.sin(lean[k])
            plant.model.opt.gravity[:] = (
                weight * math.sin(state.yaw), -weight * math.cos(state.yaw), -GRAVITY * math.cos(lean[k])
            )  # fmt: skip
            gain = vehicle.wheelbase / max(state.v_x, 1.0) ** 2 + 0.0015
            state = plant.step(SteeringCommand(time[k], acceleration * gain * shares[k], float(speed[k])), PERIOD)
            signals = plant.signals()
            force = signals["a_y"]
            a_y = force * math.cos(signals["roll"]) + GRAVITY * math.sin(signals["roll"])
            rows.append(
                (state.steer_angle, state.v_x, state.yaw_rate, a_y, signals["a_x"], state.v_y, signals["roll"], force)
            )
    names = ("steer", "v_x", "yaw_rate", "a_y", "a_x", "v_y", "roll", "force")
    return dict(zip(names, np.array(rows).T, strict=True))
