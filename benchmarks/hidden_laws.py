"""The laws of the examination of discovery (``discovery_laws.py``), written down before any of them was searched for.

Plain NumPy on the true signals; nothing here knows the grammar of ``tinygc.features.discovery``.  Each law is a function of a ``Scene`` and
gives the rate that it adds, up to a common factor that the examination sets: at 3 and at 10 times the floor of a turn's closure.  Every
other law belongs to the development half, on which the search may be tuned; the rest is the examination half.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

DEG = np.pi / 180


@dataclass(frozen=True, eq=False)
class Scene:
    """True signals at even times t (N,) s: w (N, 3) rad/s, f (N, 3) g, T (N,) degC; fs: full scale, rad/s; k: three factors of about one,
    of either sign, and K: nine, drawn for this law."""

    t: np.ndarray
    w: np.ndarray
    f: np.ndarray
    T: np.ndarray
    fs: float
    k: np.ndarray
    K: np.ndarray


def lag(s: Scene, x: np.ndarray, tau_s: float) -> np.ndarray:
    """First-order lag of x (N, …), from its first value on."""
    from scipy.signal import lfilter

    keep = np.exp(-(s.t[1] - s.t[0]) / tau_s)
    return x[0] + lfilter([1 - keep], [1, -keep], x - x[0], axis=0)


def slope(s: Scene, x: np.ndarray) -> np.ndarray:
    return np.gradient(x, s.t[1] - s.t[0], axis=0)


def norm(x: np.ndarray) -> np.ndarray:
    return np.linalg.norm(x, axis=1, keepdims=True)


def ahead(x: np.ndarray, by: int = 1) -> np.ndarray:
    """Axes y, z, x."""
    return np.roll(x, -by, axis=1)


def last_sign(x: np.ndarray, threshold: float) -> np.ndarray:
    """Sign that each column had when it was last beyond the threshold; zero before."""
    found = np.where(np.abs(x) > threshold, np.sign(x), 0.0)
    for column in found.T:
        at = np.maximum.accumulate(np.where(column != 0, np.arange(len(column)), 0))
        column[:] = column[at]
    return found


def since_turning(s: Scene) -> np.ndarray:
    """(N, 1) s since the body last turned faster than 10 dps."""
    last = np.maximum.accumulate(np.where(norm(s.w)[:, 0] > 10 * DEG, s.t, s.t[0]))
    return (s.t - last)[:, None]


#: degC of warm-up for laws of the temperature
WARM_C = 10.0

LAWS: dict[str, Callable[[Scene], np.ndarray]] = {
    # the element and its loops
    "rate_product": lambda s: s.k * ahead(s.w) * ahead(s.w, 2),
    "drive_droop": lambda s: s.k * s.w * norm(s.w),
    "wide_dead_zone": lambda s: -s.k * np.clip(s.w, -25 * DEG, 25 * DEG),
    "last_rotation": lambda s: s.k * last_sign(s.w, 40 * DEG),
    "speed_slope": lambda s: s.k * slope(s, norm(s.w)),
    "rectified_acceleration": lambda s: s.k * np.abs(slope(s, s.w)),
    "quadratic_drive": lambda s: s.k * norm(s.w) ** 2,
    "soft_limit": lambda s: s.k * (s.w - 200 * DEG * np.tanh(s.w / (200 * DEG))),
    "overload": lambda s: s.k * np.sign(s.w) * np.maximum(np.abs(s.w) - 120 * DEG, 0.0),
    "gain_switch": lambda s: s.k * s.w * (np.abs(s.w) > 90 * DEG),
    "rate_step": lambda s: s.k * np.sign(s.w) * (np.abs(s.w) > 60 * DEG),
    "signed_root": lambda s: s.k * np.sign(s.w) * np.sqrt(np.abs(s.w)),
    "cross_speed": lambda s: np.abs(s.w) @ s.K.T - np.abs(s.w) * np.diag(s.K),
    "rate_times_acceleration": lambda s: s.k * s.w * slope(s, s.w),
    "angular_jerk": lambda s: s.k * slope(s, lag(s, slope(s, s.w), 0.005)),
    "fifth_power": lambda s: s.k * s.w**5,
    # the package: force
    "force_scale": lambda s: s.k * s.w * s.f,
    "force_cross_rate": lambda s: s.k * ahead(s.f) * ahead(s.w, 2),
    "square_rate_force": lambda s: s.k * ahead(s.w, 2) ** 2 * s.f,
    "speed_upright": lambda s: s.k * norm(s.w) * s.f[:, 2:],
    "force_product": lambda s: s.k * ahead(s.f) * ahead(s.f, 2),
    "upside_down": lambda s: s.k * (s.f[:, 2:] < 0),
    "gravity_creep": lambda s: lag(s, s.f, 12.0) @ s.K.T,
    # what a motion leaves behind
    "heated_by_turning": lambda s: s.k * lag(s, norm(s.w), 8.0),
    "heated_by_squares": lambda s: s.k * lag(s, s.w**2, 3.0),
    "after_effect": lambda s: s.k * last_sign(s.w, 10 * DEG) * np.exp(-since_turning(s) / 1.5),
    "drive_recovery": lambda s: s.k * s.w * lag(s, norm(s.w), 2.0),
    # temperature, supply and time
    "cold_speed": lambda s: s.k * (s.T - 30.0)[:, None] * norm(s.w),
    "late_warming": lambda s: s.k * lag(s, slope(s, s.T), 20.0)[:, None],
    "warm_gravity": lambda s: s.k * (s.T - s.T[0])[:, None] * s.f,
    "warm_square_rate": lambda s: s.k * (s.T - s.T[0])[:, None] * s.w**2,
    "supply_settles": lambda s: s.k * s.w * np.exp(-np.maximum(s.t, 0.0) / 50.0)[:, None],
    "root_of_time": lambda s: s.k * np.sqrt(np.maximum(s.t, 0.0))[:, None],
    "slow_wave": lambda s: s.k * np.sin(2 * np.pi * s.t / 37.0)[:, None],
}
WARM = ("cold_speed", "late_warming", "warm_gravity", "warm_square_rate")

#: on which the search may be tuned, and which are opened once
DEVELOPMENT, EXAMINATION = tuple(LAWS)[::2], tuple(LAWS)[1::2]
