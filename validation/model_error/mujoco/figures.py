"""Figures that show the MuJoCo car's tyres, and its manoeuvres beside the other plants'."""

import math
from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from sidestep.fmu.native.plant import native_plant
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.bodies import corners
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.plant_models.plant import Plant
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.tyres.contact import TYRE_MODES
from sidestep.plant_models.tyres.formula import lateral_force
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.geometry import Array
from sidestep.validation.model_error.mujoco.rig import crab
from sidestep.validation.report.style import BLUE, GREEN, INK, ORANGE, styled

_DEGREES = np.array([0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0, 12.0])
_SPEED = 15.0  # [m/s]


def axle_forces() -> Figure:
    """Front axle force against slip angle at three speeds for the three tyres, the formula on top."""
    car = VehicleParameters.preset("bmw-320i")
    load, p, grid = corners(car)[0].load, car.tyre.as_array(), np.linspace(0.0, 12.0, 200)
    scale = car.tyre_scale("front")
    formula = [2e-3 * lateral_force(math.radians(a), load, 1.0, p, scale) for a in grid]
    with styled():
        figure = Figure(figsize=(11.0, 3.2), layout="constrained")
        panels = figure.subplots(1, 3, sharey=True)
        for axes, mode in zip(panels, TYRE_MODES, strict=True):
            plant = MujocoPlant(car, tyre=mode)
            for speed, colour, mark, size in ((5.0, BLUE, "o", 9.0), (15.0, ORANGE, "s", 5.5), (30.0, GREEN, "x", 3.5)):
                force = [1e-3 * crab(plant, speed, math.radians(a), seconds=0.6) for a in _DEGREES]
                axes.plot(_DEGREES, force, mark, color=colour, ms=size, mfc="none", mew=1.2, label=f"{speed:.0f} m/s")
            axes.plot(grid, formula, color=INK, lw=1.0, label="formula", zorder=1)
            axes.set_title(mode)
            axes.set_xlabel("slip angle [deg]")
            axes.set_xlim(0.0, 12.4)
        panels[0].set_ylabel("lateral force of the front axle [kN]")
        panels[0].legend(loc="lower right")
    return figure


def manoeuvres() -> Figure:
    """Yaw rate and sideslip in step steer, sine sweep and ramp steer of three plants at 15 m/s."""
    car = VehicleParameters.preset("bmw-320i")
    plants: dict[str, Plant] = {
        "linear": LinearPlant(car),
        "single-track FMU": native_plant(car),
        "MuJoCo": MujocoPlant(car),
    }
    drives: dict[str, tuple[float, Callable[[float], float]]] = {
        "step steer, 2°": (2.0, lambda t: math.radians(2.0) if t > 0.2 else 0.0),
        "sine sweep, 1°, 0.2 to 3 Hz": (12.0, _sweep),
        "ramp steer, 1.5°/s": (6.0, lambda t: math.radians(1.5) * t),
    }
    with styled():
        figure = Figure(figsize=(11.0, 5.0), layout="constrained")
        panels = figure.subplots(2, 3, sharex="col")
        for (upper, lower), (title, (seconds, steer)) in zip(panels.T, drives.items(), strict=True):
            for (name, plant), colour in zip(plants.items(), (INK, ORANGE, BLUE), strict=True):
                times, rates, slips = _yaw_rate_and_sideslip(plant, seconds, steer)
                upper.plot(times, rates, color=colour, lw=1.1, label=name)
                lower.plot(times, slips, color=colour, lw=1.1)
            upper.set_title(title)
            lower.set_xlabel("time [s]")
            lower.set_xlim(0.0, seconds)
        panels[0, 0].set_ylabel("yaw rate [deg/s]")
        panels[1, 0].set_ylabel("sideslip [deg]")
        panels[0, 0].legend(loc="lower right")
    for plant in plants.values():
        plant.close()
    return figure


def _sweep(time: float) -> float:
    """Frequency that grows exponentially from 0.2 to 3 Hz in 12 s."""
    growth = math.log(3.0 / 0.2) / 12.0
    return math.radians(1.0) * math.sin(2.0 * math.pi * 0.2 * math.expm1(growth * time) / growth)


def _yaw_rate_and_sideslip(plant: Plant, seconds: float, steer: Callable[[float], float]) -> Array:
    """Rows of time [s], yaw rate [deg/s] and sideslip [deg]."""
    state, rows = plant.reset(VehicleState(v_x=_SPEED)), []
    for _ in range(round(seconds / 0.01)):
        rows.append((state.time, math.degrees(state.yaw_rate), math.degrees(math.atan2(state.v_y, state.v_x))))
        state = plant.step(SteeringCommand(state.time, steer(state.time), _SPEED), 0.01)
    return np.array(rows).T
