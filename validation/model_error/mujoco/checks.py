"""Fourteen checks that prove the MuJoCo car: statics, tyre, dynamics, numerics."""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass

import mujoco
import numpy as np

from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.bodies import WHEELS, corners, suspension_of
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.mujoco.surface import HeightField, Surface
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.formula import magic_formula
from sidestep.plant_models.vehicle.parameters import GRAVITY, VehicleParameters
from sidestep.validation.geometry import Array
from sidestep.validation.model_error.mujoco.rig import crab

_SMALL = math.radians(0.05)  # slip angle where the force is still linear, [rad]
_SPEEDS = (5.0, 15.0, 30.0)  # [m/s]


@dataclass(frozen=True)
class Check:
    """One result.

    Attributes:
        name: What was checked.
        value: The figure, 0 at best, in `unit`.
        limit: Largest value that passes.
        unit: Of both.
    """

    name: str
    value: float
    limit: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return bool(self.value <= self.limit)


def _car() -> VehicleParameters:
    """The linear model's car: without load sensitivity, so that its axle stiffness is the tyre's."""
    car = VehicleParameters.preset("bmw-320i")
    return car.on_tyres(car.tyre.without_load_sensitivity())


def _drive(
    plant: Plant, speed: float, steer: float | Callable[[float], float], seconds: float, target: float | None = None
) -> Array:
    """States every 10 ms, one a row."""
    states = [plant.reset(VehicleState(v_x=speed))]
    for k in range(round(seconds / 0.01)):
        angle = steer(0.01 * k) if callable(steer) else steer
        states.append(plant.step(SteeringCommand(states[-1].time, angle, speed if target is None else target), 0.01))
    return np.array([astuple(state) for state in states])


def _by_wheel(plant: MujocoPlant, name: str) -> Array:
    signals = plant.signals()
    return np.array([signals[f"{name}_{wheel}"] for wheel in WHEELS])


def _statics() -> list[Check]:
    plant, static = MujocoPlant(_car()), np.array([corner.load for corner in corners(_car())])
    end = _drive(plant, 0.0, 0.0, 3.0)
    mujoco.mj_forward(plant.model, plant.data)
    force, stiffness = np.zeros(6), []
    for i in range(plant.data.ncon):
        mujoco.mj_contactForce(plant.model, plant.data, i, force)
        stiffness.append(-force[0] / plant.data.contact.dist[i])
    expected = suspension_of(_car()).tyre_stiffness
    drift = np.ptp(end[-100:, 1:3], axis=0).max() * 1e3
    return [
        Check("1 static wheel loads", 100 * np.abs(_by_wheel(plant, "load") / static - 1).max(), 0.1, "%"),
        Check("2 vertical tyre stiffness", 100 * np.abs(np.divide(stiffness, expected) - 1).max(), 0.01, "%"),
        Check("9 drift on the level", drift, 0.01, "mm/s"),
    ]


def _stiffness() -> list[Check]:
    plant, load = MujocoPlant(_car()), corners(_car())[0].load
    formula = 2.0 * magic_formula(0.0, _SMALL, load, 1.0, _car().tyre.as_array())[1]
    belt = np.array([crab(plant, speed, _SMALL, on_belt=True) for speed in _SPEEDS])
    moving = np.array([crab(plant, speed, math.radians(4.0)) for speed in _SPEEDS])
    on_belt = np.array([crab(plant, speed, math.radians(4.0), on_belt=True) for speed in _SPEEDS])
    tuned, stock = MujocoPlant(_car(), tyre="contact"), MujocoPlant(_car(), tyre="stock-contact")
    contact = np.array([crab(tuned, speed, _SMALL) for speed in _SPEEDS])
    damper = [crab(stock, speed, _SMALL) for speed in _SPEEDS[:2]]
    return [
        Check("3 axle stiffness at 5, 15, 30 m/s: spread", 100 * np.ptp(belt) / belt.mean(), 0.5, "%"),
        Check("3 axle stiffness against the formula", 100 * np.abs(belt / formula - 1.0).max(), 0.5, "%"),
        Check("3 contact: axle stiffness against the formula", 100 * np.abs(contact / formula - 1.0).max(), 0.5, "%"),
        Check("3 stock-contact fails: distance of its 3:1 from 3", abs(damper[1] / damper[0] - 3.0), 0.05, ""),
        Check("14 belt against moving wheels", 100 * np.abs(on_belt / moving - 1.0).max(), 0.1, "%"),
    ]


def _balance() -> list[Check]:
    plant, errors, forces = MujocoPlant(_car()), [], []
    state = plant.reset(VehicleState(v_x=15.0))
    for k in range(1000):
        before = _momentum(state)
        state = plant.step(SteeringCommand(state.time, 0.05 * math.sin(0.008 * k), 14.0), 1e-3)
        forces.append(plant.data.qfrc_applied[:2].copy())
        errors.append((_momentum(state) - before) / 1e-3 - forces[-1])
    return [Check("4 momentum against the shear forces", float(np.abs(errors).max() / np.abs(forces).max()), 1e-5, "")]


def _momentum(state: VehicleState) -> Array:
    c, s = math.cos(state.yaw), math.sin(state.yaw)
    return _car().mass * np.array([c * state.v_x - s * state.v_y, s * state.v_x + c * state.v_y])


def _step_steer() -> list[Check]:
    plant, steer = MujocoPlant(_car()), math.radians(1.0)
    own, linear = (_drive(p, 15.0, steer, 4.0) for p in (plant, LinearPlant(_car())))
    rate, reference, top, slip = own[:, 6], linear[:, 6], linear[:, 6].max(), np.abs(linear[:, 5]).max()
    rise = [float(np.argmax(r > 0.9 * r[-1])) * 10.0 for r in (rate, reference)]
    return [
        Check("5 step steer: peak yaw rate", 100 * abs(rate.max() / top - 1.0), 6.0, "%"),
        Check("5 step steer: final yaw rate", 100 * abs(rate[-1] / reference[-1] - 1.0), 0.5, "%"),
        Check("5 step steer: final sideslip", 100 * abs(own[-1, 5] - linear[-1, 5]) / slip, 5.0, "%"),
        Check("5 step steer: rise time", abs(rise[0] - rise[1]), 40.0, "ms"),
        _load_transfer(plant),
    ]


def _load_transfer(plant: MujocoPlant) -> Check:
    """Loads against m a_y h / t and the roll term, each axle's track with its own load."""
    _drive(plant, 15.0, 0.04, 6.0)
    data, signals, loads = suspension_of(_car()), plant.signals(), _by_wheel(plant, "load")
    moment = ((loads[1] - loads[0]) * data.track_front + (loads[3] - loads[2]) * data.track_rear) / 2.0
    sprung = _car().mass - data.unsprung_mass_front - data.unsprung_mass_rear
    roll = sprung * GRAVITY * _car().cg_height * math.sin(signals["roll"])
    expected = _car().mass * signals["a_y"] * _car().cg_height + roll
    return Check("6 lateral load transfer", 100 * abs(moment / expected - 1.0), 5.0, "%")


def _limits() -> list[Check]:
    """Ramp steer to the limit; then braking in the bend, dry and on ice."""
    car, used, lightest = VehicleParameters.preset("bmw-320i"), 0.0, math.inf
    plant = MujocoPlant(car)
    state = plant.reset(VehicleState(v_x=15.0))
    for k in range(600):
        state = plant.step(SteeringCommand(state.time, 0.0004 * k, 15.0), 0.01)
        loads, forces = _by_wheel(plant, "load"), _by_wheel(plant, "force_y")
        used, lightest = max(used, float(np.max(forces / _peak(car, loads)[1]))), min(lightest, float(loads.min()))
    ellipse = max(_largest_use(car, friction) for friction in (1.0, 0.3))
    return [
        Check("7 ramp steer: F_y over the peak", used, 1.001, ""),
        Check("7 ramp steer: a wheel in the air (1 = yes)", float(lightest <= 0.0), 0.0, ""),
        Check("8 friction ellipse, braking in a bend", ellipse, 1.14, ""),
    ]


def _peak(car: VehicleParameters, loads: Array) -> tuple[Array, Array]:
    t, dfz = car.tyre, loads / car.tyre.nominal_load - 1.0
    return (t.p_dx1 + t.p_dx2 * dfz) * loads, (t.p_dy1 + t.p_dy2 * dfz) * loads


def _largest_use(car: VehicleParameters, friction: float) -> float:
    plant, largest = MujocoPlant(car, friction=friction), 0.0
    state = plant.reset(VehicleState(v_x=15.0))
    for k in range(200):
        state = plant.step(SteeringCommand(state.time, 0.08, 15.0 if k < 80 else 0.0), 0.01)
        peak_x, peak_y = _peak(car, np.maximum(_by_wheel(plant, "load"), 1.0))
        use = np.hypot(_by_wheel(plant, "force_x") / peak_x, _by_wheel(plant, "force_y") / peak_y) / friction
        largest = max(largest, float(use.max()))
    return largest


def _slopes() -> list[Check]:
    result = []
    for name, surface in (("grade of 20 %", Surface(grade=0.2)), ("bank of 10 %", Surface(bank=0.1))):
        end = _drive(MujocoPlant(_car(), surface=surface), 0.0, 0.0, 6.0)
        creep = float(np.hypot(*(end[-1, 1:3] - end[-101, 1:3]))) * 1e3
        result.append(Check(f"9 creep on a {name}", creep, 1.0, "mm/s"))
    return result


def _numerics() -> list[Check]:
    ends = []
    for time_step in (2e-3, 1e-3, 5e-4):
        ends.append(_drive(MujocoPlant(_car(), time_step=time_step), 15.0, 0.04, 2.0)[-1, 1:4])
    first, second = np.diff(ends, axis=0)
    plant, again = MujocoPlant(_car()), []
    _drive(plant, 12.0, 0.05, 1.0)
    saved = plant.save()
    for _ in range(2):
        plant.restore(saved)
        again.append([plant.step(SteeringCommand(0.0, 0.1, 9.0), 0.01) for _ in range(100)])
    flat = HeightField(np.zeros((21, 81)), 1.0, -20.0, -10.0)
    paths = [_drive(MujocoPlant(_car(), surface=s), 10.0, 0.05, 2.0) for s in (Surface(), Surface(heights=flat))]
    return [
        Check("10 step halving: distance of the ratio from 2", float(np.abs(first / second - 2.0).max()), 0.05, ""),
        Check("11 replay from a snapshot: other bits (1 = yes)", float(again[0] != again[1]), 0.0, ""),
        Check("13 flat height field against the plane", np.abs(paths[0] - paths[1])[:, 1:3].max() * 1e3, 1.0, "mm"),
    ]


def _dissipation() -> list[Check]:
    """Largest shear power of freely rolling wheels; the tyre may only take."""
    plant, largest = MujocoPlant(_car()), -math.inf
    for degrees in (-8.0, -1.0, 0.5, 3.0, 12.0):
        angle = math.radians(degrees)
        largest = max(largest, -crab(plant, 15.0, angle) * 15.0 * math.sin(angle))
    return [Check("12 shear power of rolling wheels", largest, 0.0, "W")]


def validate_mujoco() -> list[Check]:
    """Run all checks; about a minute."""
    parts = (_statics, _stiffness, _balance, _step_steer, _limits, _slopes, _numerics, _dissipation)
    checks = [check for part in parts for check in part()]
    return sorted(checks, key=lambda check: int(check.name.split()[0]))
