"""What goes wrong in one unit of an array: its readings (T, 3) rad/s from a sample on, and for how long."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.io.units import DEG


def stuck(raw: np.ndarray) -> np.ndarray:
    """One and the same reading."""
    return np.broadcast_to(raw[0], raw.shape).copy()


def dead(raw: np.ndarray) -> np.ndarray:
    """No samples."""
    return np.full_like(raw, np.nan)


def step(raw: np.ndarray, dps: float = 3.0) -> np.ndarray:
    """An offset."""
    return raw + dps * DEG * np.array([1.0, 0.0, 0.0])


def scale(raw: np.ndarray, share: float = 0.05) -> np.ndarray:
    """Scale 5 % too great."""
    return raw * (1 + share)


def sign(raw: np.ndarray) -> np.ndarray:
    """One axis with the other sign."""
    return raw * [1, -1, 1]


def spikes(raw: np.ndarray, every: int = 3, dps: float = 200.0) -> np.ndarray:
    """Every third reading is far off."""
    out = raw.copy()
    out[::every] += dps * DEG
    return out


def drift(raw: np.ndarray, dps_per_s: float = 0.5, rate_hz: float = 100.0) -> np.ndarray:
    """An offset that grows."""
    return raw + (np.arange(len(raw)) / rate_hz * dps_per_s * DEG)[:, None]


def saturation(raw: np.ndarray, dps: float = 50.0) -> np.ndarray:
    """Clipped at a rate far below the range that its session.toml states."""
    return np.clip(raw, -dps * DEG, dps * DEG)


def late(raw: np.ndarray, samples: int = 2) -> np.ndarray:
    """Two samples behind the others."""
    return np.concatenate([raw[:1].repeat(samples, axis=0), raw[:-samples]])


FAULTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    each.__name__: each for each in (stuck, dead, step, scale, sign, spikes, drift, saturation, late)
}


def with_fault(raw: np.ndarray, unit: int, name: str, begin: int, end: int) -> np.ndarray:
    """Rates (T, N, 3) in which a unit is wrong from one sample to another."""
    out = raw.copy()
    out[begin:end, unit] = FAULTS[name](raw[begin:end, unit])
    return out
