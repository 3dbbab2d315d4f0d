"""Noise terms of an Allan curve that somebody already has."""

from __future__ import annotations

import numpy as np

from tinygc.noise.figures import AxisNoise


def fit_curve(tau_s: np.ndarray, deviation: np.ndarray, duration_s: float, rate_hz: float | None) -> list[AxisNoise]:
    """Fit the terms of each axis to Allan deviations (K, A), SI, at averaging times (K,) s of a recording of this duration and rate."""
    raise NotImplementedError
