"""The fit: Gauss and Newton over all windows, with what differs from window to window eliminated from each.

A window begins at a measured state, which noise has moved, on a road whose bank nobody knows. Those four numbers per
window, (v_y, yaw rate, bank at start and end), are unknowns with a Gaussian prior whose width is fitted, too
(expectation and maximisation); a window's own least squares eliminates them, so that the parameters see only what
they leave. Covariance: H^-1 (sum_w g_w g_w' + P^-1) H^-1 with each window's gradient g_w, which also counts that
residuals within a window hang together (Huber's sandwich).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidestep.validation.model_error.identification.car_kernel import Chassis, Values, simulate
from sidestep.validation.model_error.identification.log_parameters import Parameter, moved
from sidestep.validation.model_error.logs.measured import PERIOD

Array = NDArray[np.float64]

CHANNELS = ("yaw_rate", "a_y", "v_y")
"""In the kernel's order."""
EDGE = 15
"""Samples at both ends of a window that only serve the delays."""
STRIDE = 4
"""Of the samples that are compared."""
TOGETHER = 6.0
"""Compared samples that count as one, as residuals hang together: only for the balance with the priors."""
STEP = 1e-3
"""Of the finite differences, in prior deviations."""
ROUNDS, CONVERGED = 25, 1e-4
"""Most steps, and relative fall of the cost that ends them."""
TYPICAL_SCALE = {"yaw_rate": 0.015, "a_y": 0.5, "v_y": 0.1}
"""Of the residuals, where they are not fitted."""
MOST_SPREAD = np.array([0.05, 0.01, 0.3, 0.3])
LEAST_SPREAD = np.array([1e-3, 1e-4, 1e-2, 1e-2])
FIRST_SPREAD = np.array([0.1, 0.01, 0.3, 0.3])
"""Of what differs from window to window: v_y [m/s], yaw rate [rad/s], bank at start and end [m/s^2]."""
UNSTEADY_START = 0.5
"""The first of them where no v_y is measured."""
_FAR = 4.0  # a window whose misfit is so many times the median is taken for less


@dataclass(frozen=True, eq=False)
class Windows:
    """What a fit compares.

    Attributes:
        signals: Of the kernel, and measured `yaw_rate`, `a_y`, `v_y` as far as there are, shape (n,).
        starts: Shape (w,); windows do not overlap.
        steps: Samples of each.
        channels: Those of CHANNELS that are compared.
    """

    signals: Mapping[str, Array]
    starts: NDArray[np.int64]
    steps: int
    channels: tuple[str, ...]

    def measured(self) -> Array:
        """Compared samples, shape (w, m, channels)."""
        index = self.starts[:, None] + np.arange(EDGE, self.steps - EDGE, STRIDE)
        return np.stack([self.signals[name][index] for name in self.channels], axis=-1)


@dataclass(frozen=True, eq=False)
class Fit:
    """What came out.

    Attributes:
        values: All of them.
        steps: The free ones' prior deviations from where they began, shape (q,).
        free: Those that were moved.
        covariance: In prior deviations, shape (q, q).
        moved: What differs per window, shape (w, 4).
        spread: Its standard deviations, shape (4,).
        scale: Standard deviation of the residuals per channel.
    """

    values: Values
    steps: Array
    free: tuple[Parameter, ...]
    covariance: Array
    moved: Array
    spread: Array
    scale: Array

    @property
    def correlation(self) -> Array:
        """Of the free parameters, shape (q, q)."""
        size = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(size, size)


def delayed(out: Array, values: Values) -> Array:
    """The kernel's signals as late as the sensors have them, shape (w, steps, 3); ends are held."""
    result = out.copy()
    for channel, delay in ((1, values.a_y_delay), (2, values.v_y_delay)):
        late = delay / PERIOD
        place = np.clip(np.arange(out.shape[1]) - late, 0.0, out.shape[1] - 1.001)
        k = place.astype(np.int64)
        share = place - k
        result[:, :, channel] = (1.0 - share) * out[:, k, channel] + share * out[:, k + 1, channel]
    return result


def compared(windows: Windows, values: Values, chassis: Chassis, extra: Array, linear: bool) -> Array:
    """The model at the compared samples, shape (w, m, channels)."""
    out = simulate(values, chassis, windows.signals, windows.starts, windows.steps, extra, linear)
    chosen = [CHANNELS.index(name) for name in windows.channels]
    return delayed(out, values)[:, EDGE : windows.steps - EDGE : STRIDE, chosen]


def fit(
    windows: Windows, begin: Values, free: Sequence[Parameter], chassis: Chassis, scale: Array, linear: bool,
    banked: bool = True, steps: Array | None = None,
) -> Fit:  # fmt: skip
    """Fit the free parameters to all windows.

    Args:
        windows: What is compared.
        begin: Where the parameters begin, which is also the mean of their priors.
        free: Those that move.
        chassis: Mass and geometry.
        scale: Standard deviation of the residuals to begin with, per channel.
        linear: Whether the tyres are.
        banked: Whether the road's bank is an unknown.
        steps: Where the search starts, in prior deviations from `begin`; there if None.
    """
    problem = _Problem(windows, begin, tuple(free), chassis, linear)
    spread = FIRST_SPREAD.copy()
    if "v_y" not in windows.channels:
        spread[0] = UNSTEADY_START
    if not banked:
        spread[2:] = 1e-6
    steps = np.zeros(len(free)) if steps is None else steps
    extra, damping = np.zeros((len(windows.starts), 4)), 1e-2
    state = problem.linearise(steps, extra, scale)
    weight = np.ones(len(windows.starts))
    for _ in range(ROUNDS):
        hessian, gradient, _ = _reduced(state, spread, weight)
        cost, done = _cost(state, extra, spread, weight, steps), False
        for _ in range(8):
            change = -np.linalg.solve(
                hessian + np.eye(len(steps)) * (1.0 + damping) + damping * np.diag(np.diag(hessian)),
                gradient + steps,
            )
            change = np.asarray(np.clip(change, -1.0, 1.0), dtype=np.float64)
            new_steps, new_extra = steps + change, extra + _own_change(state, spread, change)
            residual = problem.residual(new_steps, new_extra, scale)
            new_cost = _cost_of(residual, new_extra, spread, weight, new_steps)
            if new_cost < cost:
                done = cost - new_cost < CONVERGED * cost
                steps, extra, damping = new_steps, new_extra, max(damping / 5.0, 1e-6)
                break
            damping *= 5.0
        else:
            done = True
        scale, state, spread, weight = _updated(problem, steps, extra, scale, spread, banked)
        if done:
            break
    hessian, _, gradients = _reduced(state, spread, weight)
    inverse = np.linalg.inv(hessian + np.eye(len(steps)))
    count = len(windows.starts)
    inner = gradients.T @ gradients * count / max(count - len(steps), 1) + np.eye(len(steps))
    return Fit(problem.values(steps), steps, tuple(free), inverse @ inner @ inverse, extra, spread, scale)


def own_of(windows: Windows, values: Values, chassis: Chassis) -> Array:
    """What differs in each window, given the car: v_y and yaw rate at first, bank at start and end, shape (w, 4)."""
    problem = _Problem(windows, values, (), chassis, False)
    extra, none = np.zeros((len(windows.starts), 4)), np.zeros(0)
    state = problem.linearise(none, extra, np.array([TYPICAL_SCALE[name] for name in windows.channels]))
    return _own_change(state, FIRST_SPREAD, none)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Residuals over their scale, shape (w, k), their derivatives by parameters (w, k, q) and by a window's own."""

    residual: Array
    jacobian: Array
    own: Array
    extra: Array


class _Problem:
    def __init__(self, windows: Windows, begin: Values, free: tuple[Parameter, ...], chassis: Chassis, linear: bool):
        self._windows, self._begin, self._free, self._chassis, self._linear = windows, begin, free, chassis, linear
        self._measured = windows.measured()

    def values(self, steps: Array) -> Values:
        return moved(self._begin, self._free, steps)

    def residual(self, steps: Array, extra: Array, scale: Array) -> Array:
        found = compared(self._windows, self.values(steps), self._chassis, extra, self._linear)
        result = (found - self._measured) / (scale * np.sqrt(TOGETHER))
        return np.nan_to_num(result, nan=1e3, posinf=1e3, neginf=-1e3).clip(-1e3, 1e3).reshape(len(extra), -1)

    def linearise(self, steps: Array, extra: Array, scale: Array) -> _Linear:
        here = self.residual(steps, extra, scale)
        jacobian, own = np.empty((*here.shape, len(steps))), np.empty((*here.shape, 4))
        for i in range(len(steps)):
            jacobian[:, :, i] = (self.residual(_bumped(steps, i, STEP), extra, scale) - here) / STEP
        for i in range(4):
            size = 0.1 * FIRST_SPREAD[i]
            own[:, :, i] = (self.residual(steps, _bumped(extra, i, size), scale) - here) / size
        return _Linear(here, jacobian, own, extra)


def _bumped(array: Array, i: int, size: float) -> Array:
    result = array.copy()
    result[..., i] += size
    return result


def _eliminated(state: _Linear, spread: Array) -> tuple[Array, Array, Array]:
    """Inverse of each window's own Hessian (w, 4, 4), its gradient (w, 4), and the mixed one (w, 4, q)."""
    own = state.own.transpose(0, 2, 1)
    inverse = np.asarray(np.linalg.inv(own @ state.own + np.diag(spread**-2.0)), dtype=np.float64)
    gradient = (own @ state.residual[:, :, None])[:, :, 0] + state.extra / spread**2
    return inverse, gradient, own @ state.jacobian


def _reduced(state: _Linear, spread: Array, weight: Array) -> tuple[Array, Array, Array]:
    """Hessian (q, q), gradient (q,), and the windows' gradients (w, q), without the priors of the parameters."""
    inverse, gradient, mixed = _eliminated(state, spread)
    across = mixed.transpose(0, 2, 1) @ inverse
    jacobian = state.jacobian.transpose(0, 2, 1)
    hessian = (weight[:, None, None] * (jacobian @ state.jacobian - across @ mixed)).sum(axis=0)
    gradients = (jacobian @ state.residual[:, :, None] - across @ gradient[:, :, None])[:, :, 0]
    gradients = gradients * weight[:, None]
    return hessian, gradients.sum(axis=0), gradients


def _own_change(state: _Linear, spread: Array, change: Array) -> Array:
    inverse, gradient, mixed = _eliminated(state, spread)
    return -(inverse @ (gradient + mixed @ change)[:, :, None])[:, :, 0]


def _cost(state: _Linear, extra: Array, spread: Array, weight: Array, steps: Array) -> float:
    return _cost_of(state.residual, extra, spread, weight, steps)


def _cost_of(residual: Array, extra: Array, spread: Array, weight: Array, steps: Array) -> float:
    per_window = (residual**2).sum(axis=1) + (extra**2 / spread**2).sum(axis=1)
    return float(weight @ per_window + steps @ steps)


def _updated(
    problem: _Problem, steps: Array, extra: Array, scale: Array, spread: Array, banked: bool
) -> tuple[Array, _Linear, Array, Array]:
    """Scale of the residuals, linearisation, spread of what differs, and weight of each window, for the next step."""
    residual = problem.residual(steps, extra, scale)
    sizes = (residual**2).mean(axis=1)
    weight = np.minimum(1.0, _FAR * np.median(sizes) / np.maximum(sizes, 1e-12))
    channels = residual.reshape(len(residual), -1, len(scale))
    share = weight[:, None, None] / (weight.mean())
    scale = scale * np.sqrt(TOGETHER * np.mean(share * channels**2, axis=(0, 1)))
    state = problem.linearise(steps, extra, scale)
    reach = (state.own[:, :, :2] ** 2).mean(axis=(1, 2))  # a window that runs away tells nothing, however much it moves
    weight = weight * np.minimum(1.0, _FAR * np.median(reach) / np.maximum(reach, 1e-12))
    inverse, _, _ = _eliminated(state, spread)
    size = np.sqrt(np.mean(extra**2 + np.diagonal(inverse, axis1=1, axis2=2), axis=0))
    size[2:] = np.sqrt(np.mean(size[2:] ** 2))
    size = np.clip(size, LEAST_SPREAD, MOST_SPREAD)
    if not banked:
        size[2:] = spread[2:]
    return scale, state, size, weight
