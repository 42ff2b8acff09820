"""Identification of cornering stiffnesses and yaw inertia from drives, with what says whether to believe them.

Output error: the linear single track is simulated with the realised steering; the parameters minimise the squared
residuals of yaw rate and lateral acceleration, each over its standard deviation, which is estimated on the way. Then

    covariance   (J^T J)^-1 of the logarithms of the parameters: relative variances
    correlation  near 1: one parameter makes up for the other, the data cannot tell them apart
    whiteness    Ljung and Box: Q = n (n + 2) sum_k r_k^2 / (n - k) of the residuals' autocorrelation r_k up to LAGS;
                 above its bound the model lacks something, and the confidence intervals are too narrow

From the yaw rate alone the three are hardly identifiable however well the fit looks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.stats import chi2

from sidestep.plant_models.errors import InputError
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.catalogue import Manoeuvre, RandomSteer
from sidestep.validation.manoeuvres.open_loop import PERIOD, Response

Array = NDArray[np.float64]

PARAMETERS = ("cornering_stiffness_front", "cornering_stiffness_rear", "yaw_inertia")
UNITS = ("N/rad", "N/rad", "kg m²")
"""By the names of a vehicle file: stiffnesses PER AXLE, twice the paper's k_f and k_r."""
SIGNALS = ("yaw_rate", "lateral_acceleration")
LARGEST_CORRELATION, LARGEST_DEVIATION = 0.98, 0.1
"""Beyond these, of two parameters and relative of one, the data identify nothing."""
LEAST_EXPLAINED = 0.95
"""Share of a signal's variance below which the car is another than the model: one that rolls much, say."""
LAGS = 50
ROUNDS = 2
"""Fits: the first weighted by the size of the signals, then by that of the residuals."""
DRIVES = tuple(
    Manoeuvre("identification", RandomSteer(0.1, 1.0, seed), speed, 2.0, 20.0)
    for seed, speed in enumerate((10.0, 15.0, 20.0, 25.0))
)
"""Steering that stays where the tyres are linear, below the resonance of roll, and excites yaw and sideslip."""


@dataclass(frozen=True, eq=False)
class Identification:
    """What a fit found.

    Attributes:
        values: Of PARAMETERS, in UNITS.
        covariance: Of their logarithms, shape (3, 3).
        signals: That were fitted.
        explained: Share of each signal's variance (VAF).
        ljung_box: Q of each signal's residuals, summed over the drives.
        whiteness_bound: Largest Q of white residuals, at a level of 95 %.
    """

    values: Array
    covariance: NDArray[np.floating]
    signals: tuple[str, ...]
    explained: Array
    ljung_box: Array
    whiteness_bound: float

    @property
    def deviations(self) -> NDArray[np.floating]:
        """Relative standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def intervals(self) -> NDArray[np.floating]:
        """95 % confidence intervals, shape (3, 2), in UNITS."""
        return self.values[:, None] * np.exp(np.outer(1.96 * self.deviations, [-1.0, 1.0]))

    @property
    def correlation(self) -> NDArray[np.floating]:
        """Shape (3, 3)."""
        return self.covariance / np.outer(self.deviations, self.deviations)

    @property
    def is_white(self) -> bool:
        """Whether no residual shows structure, at a level of 95 %."""
        return bool((self.ljung_box <= self.whiteness_bound).all())

    @property
    def problem(self) -> str:
        """Why the values must not be used; empty if they may."""
        if not np.isfinite(self.covariance).all():
            return "a parameter has no effect on what was measured"
        pairs = np.abs(self.correlation - np.eye(3))
        i, j = np.unravel_index(int(pairs.argmax()), pairs.shape)
        if pairs[i, j] > LARGEST_CORRELATION:
            return f"{PARAMETERS[i]} and {PARAMETERS[j]} cannot be separated: correlation {self.correlation[i, j]:.3f}"
        least = int(self.explained.argmin())
        if self.explained[least] < LEAST_EXPLAINED:
            return f"the model explains only {self.explained[least]:.0%} of {self.signals[least]}"
        worst = int(self.deviations.argmax())
        if self.deviations[worst] > LARGEST_DEVIATION:
            return f"{PARAMETERS[worst]} is known to no better than {self.deviations[worst]:.0%}"
        return ""

    def vehicle(self, vehicle: VehicleParameters) -> VehicleParameters:
        """The vehicle with what was found.

        Raises:
            InputError: The data cannot identify it.
        """
        if self.problem:
            raise InputError("identification", self.problem, "steering that excites yaw and sideslip at several speeds")
        return vehicle.with_(**dict(zip(PARAMETERS, self.values.tolist(), strict=True)))


def identify(
    drives: Sequence[Response], vehicle: VehicleParameters, signals: Sequence[str] = SIGNALS
) -> Identification:
    """Fit the linear single track to drives at about constant speed.

    Args:
        drives: One speed each, sampled every PERIOD.
        vehicle: Mass and geometry, and where to begin.
        signals: To fit, some of SIGNALS.

    Raises:
        InputError: Nothing moves in a signal.
    """
    measured = [np.column_stack([drive[name] for name in signals]) for drive in drives]
    scale = np.std(np.concatenate(measured), axis=0)
    if not scale.all():
        raise InputError("identification", "a signal that never changes", "drives with steering")
    start = np.array([getattr(vehicle, name) for name in PARAMETERS])

    def residuals(logarithms: Array) -> list[Array]:
        car = start * np.exp(logarithms)
        return [
            data - _respond(car, drive, vehicle, signals) for data, drive in zip(measured, drives, strict=True)
        ]  # fmt: skip

    found, jacobian, rest = np.zeros(3), np.zeros((0, 3)), measured
    for _ in range(ROUNDS):
        fit = least_squares(lambda p, s=scale: (np.concatenate(residuals(p)) / s).ravel(), found)
        found, jacobian, rest = fit.x, fit.jac, residuals(fit.x)
        scale = np.maximum(np.std(np.concatenate(rest), axis=0), 1e-12)
    return Identification(
        values=start * np.exp(found),
        covariance=_covariance(jacobian),
        signals=tuple(signals),
        explained=1.0 - np.var(np.concatenate(rest), axis=0) / np.var(np.concatenate(measured), axis=0),
        ljung_box=np.sum([[ljung_box(column) for column in part.T] for part in rest], axis=0),
        whiteness_bound=float(chi2.ppf(0.95, LAGS * len(drives))),
    )


def _covariance(jacobian: Array) -> NDArray[np.floating]:
    """(J^T J)^-1; infinite if a parameter has no effect."""
    information = jacobian.T @ jacobian
    size = np.sqrt(np.diag(information))
    if not size.all() or np.linalg.cond(information / np.outer(size, size)) > 1e12:
        return np.full((3, 3), np.inf)
    return np.linalg.inv(information)


def ljung_box(residuals: Array) -> float:
    """Q of residuals of shape (n,)."""
    n, centred = len(residuals), residuals - residuals.mean()
    power = float(centred @ centred)
    correlation = np.array([float(centred[k:] @ centred[:-k]) for k in range(1, LAGS + 1)]) / power
    return n * (n + 2) * float(np.sum(correlation**2 / (n - np.arange(1, LAGS + 1))))


def _respond(car: Array, drive: Response, vehicle: VehicleParameters, signals: Sequence[str]) -> Array:
    """The linear car's signals with the drive's steering at its mean speed, shape (n, signals)."""
    stiffness_f, stiffness_r, inertia = car.tolist()
    m, l_f, l_r, v = vehicle.mass, vehicle.l_f, vehicle.l_r, float(drive["v_x"].mean())
    moment = l_r * stiffness_r - l_f * stiffness_f
    block = np.zeros((4, 4))  # [v_y, gamma, delta, delta' PERIOD], the angle linear between samples
    block[0, :3] = -(stiffness_f + stiffness_r) / (m * v), moment / (m * v) - v, stiffness_f / m
    block[1, :3] = moment / (inertia * v), -(l_f**2 * stiffness_f + l_r**2 * stiffness_r) / (inertia * v), 0.0
    block[1, 2] = l_f * stiffness_f / inertia
    block[2, 3] = 1.0 / PERIOD
    v_y, yaw_rate = _recursion(expm(block * PERIOD)[:2], drive["steer_angle"], drive["v_y"][0], drive["yaw_rate"][0])
    answers = {"yaw_rate": yaw_rate, "lateral_acceleration": np.gradient(v_y, PERIOD) + v * yaw_rate}
    return np.column_stack([answers[name] for name in signals])


@kernel
def _recursion(transition, steer, v_y, yaw_rate):
    lateral, rate = np.empty(steer.shape[0]), np.empty(steer.shape[0])
    lateral[0], rate[0] = v_y, yaw_rate
    for k in range(steer.shape[0] - 1):
        change = steer[k + 1] - steer[k]
        for row, out in ((transition[0], lateral), (transition[1], rate)):
            out[k + 1] = row[0] * lateral[k] + row[1] * rate[k] + row[2] * steer[k] + row[3] * change
    return lateral, rate
