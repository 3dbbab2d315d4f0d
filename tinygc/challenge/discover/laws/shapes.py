"""What many laws are made of: adding to the rate, a first-order lag, the other axes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from session.common.units import G
from tinygc.challenge.concealment import Concealment
from tinygc.challenge.rate_effects import Shaking

#: s: what a mean square of vibration is taken over
ENERGY_S = 0.25
#: added(t (N,), rate (N, 3), force (N, 3), temp (N,)) -> (N, 3) rad/s, SI
Added = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def adding(name: str, truth: dict, added: Added) -> Concealment:
    """What adds to the rate; truth: its parameters, SI."""
    return Concealment(name, truth, distort=lambda t, rate, force, temp: rate + added(t, rate, force, temp))


def lagged(t: np.ndarray, values: np.ndarray, tau_s: float) -> np.ndarray:
    """y' = (x - y) / tau from y = x at the first time on; values (N, …) at even times t (N,) s."""
    keeps = np.exp(-(t[1] - t[0]) / tau_s)
    return values[0] + lfilter([1 - keeps], [1, -keeps], values - values[0], axis=0)


def slope(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Time derivative of values (N, …) at even times t (N,) s."""
    return np.gradient(values, t[1] - t[0], axis=0)


def next_axis(values: np.ndarray) -> np.ndarray:
    """(N, 3): y, z, x."""
    return np.roll(values, -1, axis=1)


def previous_axis(values: np.ndarray) -> np.ndarray:
    """(N, 3): z, x, y."""
    return np.roll(values, 1, axis=1)


def size_of(vectors: np.ndarray) -> np.ndarray:
    """(N, 1) norms of vectors (N, 3)."""
    return np.linalg.norm(vectors, axis=1, keepdims=True)


def energy(t: np.ndarray, shaken: Shaking) -> np.ndarray:
    """(N,) g²: running mean square of the vibration itself, mean of the axes."""
    squares = np.mean((shaken.disturb(t, np.zeros((len(t), 3))) / G) ** 2, axis=1)
    return uniform_filter1d(squares, max(1, round(ENERGY_S / (t[1] - t[0]))), mode="nearest")
