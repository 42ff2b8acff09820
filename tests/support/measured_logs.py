"""Logs of a car that is the fitted model itself: what goes in must come out."""

import numpy as np

from sidestep.validation.manoeuvres.catalogue import RandomSteer
from sidestep.validation.model_error.identification.car_kernel import Chassis, Values, simulate
from sidestep.validation.model_error.identification.log_parameters import begin
from sidestep.validation.model_error.identification.window_fit import delayed
from sidestep.validation.model_error.logs.measured import PERIOD

CHASSIS = Chassis(1000.0, 1.2, 1.4, 1.0)
MAP = "[vehicle]\nmass = 1000.0\nl_f = 1.2\nl_r = 1.4\n"


def true_values(**changes: float) -> Values:
    return begin(CHASSIS, 1.0, 0.5)._replace(
        C_f=90e3, C_r=85e3, I_z=1500.0, steer_offset=0.003, yaw_rate_offset=-0.004, a_y_offset=0.1, steer_delay=0.03,
        mu_f=1.0, mu_r=1.05, e_f=-0.3, e_r=-0.5, sideslip_offset=0.002,
    )._replace(**changes)  # fmt: skip


def log_table(
    values: Values, seed: int = 0, duration: float = 60.0, acceleration: float = 6.0, fastest: float = 1.5
) -> dict[str, np.ndarray]:
    """Columns by head; one window, all of it."""
    random, n = np.random.default_rng(seed), round(duration / PERIOD)
    time = PERIOD * np.arange(n)
    speed = 22.0 + 6.0 * np.sin(2.0 * np.pi * time / 30.0)
    steer = (acceleration * (2.6 / speed**2 + 0.001)) * RandomSteer(0.05, fastest, seed)(time)
    zero = np.zeros(n)
    signals = {
        "steer": steer,
        "v_x": speed,
        "a_x": np.gradient(speed, PERIOD),
        "start_yaw_rate": zero,
        "start_v_y": zero,
    }
    out = delayed(simulate(values, CHASSIS, signals, np.array([0]), n, np.zeros((1, 4)), False), values)[0]
    out += random.standard_normal(out.shape) * (2e-3, 0.05, 0.02)
    return {
        "time [s]": time, "road_wheel_angle [rad]": steer, "v_x [m/s]": speed, "yaw_rate [rad/s]": out[:, 0],
        "a_y [m/s^2]": out[:, 1], "v_y [m/s]": out[:, 2],
    }  # fmt: skip


def write_table(file, columns) -> None:
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
