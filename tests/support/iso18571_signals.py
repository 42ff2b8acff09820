"""Signals on which our ISO/TS 18571 rating is held against another's, see iso18571.json."""

import numpy as np

SAMPLES = 600


def pairs() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Reference and the other signal by name, 6 s at 100 Hz."""
    t = np.arange(SAMPLES) / 100.0
    noise = np.random.default_rng(18571).standard_normal(SAMPLES)
    step = _step(t, 1.0, 6.0, 0.6)
    lane_change = np.sin(np.pi * t) * (t < 4.0)
    return {
        "damping": (step, _step(t, 1.0, 6.0, 0.4)),
        "late": (step, _step(t, 1.25, 6.0, 0.6)),
        "early": (lane_change, np.sin(np.pi * (t + 0.18)) * (t < 3.82)),
        "gain": (lane_change, 0.8 * lane_change),
        "offset": (step, step + 0.15),
        "noise": (lane_change, lane_change + 0.05 * noise),
        "sweep": (np.sin(t**2), 0.9 * np.sin((t - 0.06) ** 2)),
        "opposite": (lane_change, -0.5 * lane_change),
        "far too late": (_step(t, 0.5, 6.0, 0.6), _step(t, 3.0, 6.0, 0.6)),
    }


def _step(t: np.ndarray, start: float, omega: float, damping: float) -> np.ndarray:
    """Step response of an oscillator."""
    t = np.maximum(t - start, 0.0)
    omega_d = omega * np.sqrt(1.0 - damping**2)
    swing = np.cos(omega_d * t) + damping * omega / omega_d * np.sin(omega_d * t)
    return 1.0 - np.exp(-damping * omega * t) * swing
