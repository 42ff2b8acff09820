"""An accurate solution of a car's equations, to hold FMUs against."""

from dataclasses import astuple

import numpy as np
from scipy.integrate import solve_ivp


def integrate(rates, start, hidden, command, duration, dt=0.02):
    """solve_ivp over `rates(state, steer_angle, target_speed)`, started anew at every command; one row per `dt`.

    A state is position, heading, velocities and yaw rate of `start`, `hidden` zeros, the steering angle.
    """
    state = np.array([*astuple(start)[1:7], *np.zeros(hidden), start.steer_angle])
    rows = [state]
    for k in range(round(duration / dt)):
        now = command(k * dt)
        solution = solve_ivp(
            lambda _, x, now=now: rates(x, *now), (0.0, dt), state, method="DOP853", rtol=1e-10, atol=1e-12,
            max_step=dt / 4,
        )  # fmt: skip
        state = solution.y[:, -1]
        rows.append(state)
    return np.array(rows)
