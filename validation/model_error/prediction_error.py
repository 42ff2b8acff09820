"""How far a model's prediction is off: N steps ahead without feedback, from many points of a drive.

From the plant's state at a starting point the model runs on with the steering that the plant saw; its error k steps
later is the prediction less what the plant did. Starting points are SPACING apart; all whose horizon fits are used.
The road, straight or an arc, leaves every starting point along the car's heading: l_s = e_phi = 0 there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidestep.plant_models.vehicle.parameters import VehicleParameters
from sidestep.validation.manoeuvres.open_loop import PERIOD, Response
from sidestep.validation.model_error.prediction_models import STEP, predict

Array = NDArray[np.float64]

HORIZON_TIME = 1.5
"""Length of a prediction, in [s]."""
SPACING = 0.1
"""Time between starting points, in [s]."""
STATE_UNITS = {"l_s": "m", "e_phi": "rad", "beta": "rad", "gamma": "rad/s"}
"""The predicted states."""


@dataclass(frozen=True)
class ErrorStatistics:
    """Of the errors' magnitude over all starting points, per step of the horizon; all of shape (n, 4)."""

    rms: Array
    p50: Array
    p95: Array
    max: Array


def prediction_errors(
    model: str, response: Response, vehicle: VehicleParameters, friction: float = 1.0, curvature: float = 0.0
) -> Array:
    """Errors of one model over one drive.

    Args:
        model: One of `prediction_models.MODELS`.
        response: The drive.
        vehicle, friction, curvature: As of `predict`.

    Returns:
        Prediction less plant, shape (w, n, 4), for w starting points and the steps STEP, 2 STEP, .. HORIZON_TIME.
    """
    length, stride = round(HORIZON_TIME / PERIOD), round(STEP / PERIOD)
    starts = np.arange(0, len(response["time"]) - length, round(SPACING / PERIOD))
    window = starts[:, None] + np.arange(length + 1)
    truth = road_states({name: values[window] for name, values in response.items()}, curvature)
    angles, speed = response["steer_angle"][window], response["v_x"][starts]
    return predict(model, vehicle, friction, truth[:, 0], speed, angles, curvature) - truth[:, stride::stride]


def road_states(windows: Response, curvature: float) -> Array:
    """The plant's states on a road that leaves every window's starting point along the car's heading there.

    Args:
        windows: Signals of shape (w, n).
        curvature: Of the road, held, in [1/m].

    Returns:
        [l_s, e_phi, beta, gamma], shape (w, n, 4).
    """
    x, y, yaw = (windows[name] - windows[name][:, :1] for name in ("x", "y", "yaw"))
    c, s = np.cos(windows["yaw"][:, :1]), np.sin(windows["yaw"][:, :1])
    ahead, left = c * x + s * y, c * y - s * x
    if curvature:
        radius, side = 1.0 / abs(curvature), np.sign(curvature)
        turned = np.unwrap(np.arctan2(ahead, radius - side * left))
        left, yaw = side * (radius - np.hypot(ahead, radius - side * left)), yaw - side * turned
    beta = windows["v_y"] / np.maximum(windows["v_x"], 1.0)
    return np.stack([left, yaw, beta, windows["yaw_rate"]], axis=-1)


def statistics(errors: Sequence[Array]) -> ErrorStatistics:
    """Statistics of errors of shape (w, n, 4), the starting points of all drives together."""
    size = np.abs(np.concatenate(errors))
    p50, p95, largest = np.percentile(size, (50.0, 95.0, 100.0), axis=0)
    return ErrorStatistics(np.sqrt(np.mean(size**2, axis=0)), p50, p95, largest)
