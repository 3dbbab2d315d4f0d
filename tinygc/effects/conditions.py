"""From a log's samples to the movement that effects are given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import G
from session.log.samples import Samples
from tinygc.effects.movement import Movement

#: a temperature has no business moving within this; its register's noise is taken off
TEMPERATURE_S = 1.0
#: vibration is what is faster than the first, its energy is taken over the second
HAND_S, ENERGY_S = 0.05, 0.25


@dataclass(frozen=True)
class Conditions:
    """What effects refer to: duration_s of the session they were fitted to, full scale fs_rps, first_temp_c or NaN."""

    duration_s: float
    fs_rps: float
    first_temp_c: float


def movement_of(samples: Samples, rate: np.ndarray, known: Conditions, began_s: float = 0.0, live: bool = False) -> Movement:
    """The movement of one log that began ``began_s`` into the session; samples with the pre-calibrated force, rate (N, 3) rad/s;
    live: the temperature as it comes, since its mean would need what is yet to come."""
    dt_s, force_g, mean_s = samples.period_s, samples.accel / G, 0.0 if live else TEMPERATURE_S
    return Movement(
        t_s=began_s + samples.t_s,
        dt_s=dt_s,
        rate=rate,
        force_g=force_g,
        temp_c=np.full(len(samples), np.nan) if samples.temp_c is None else _mean(samples.temp_c, mean_s, dt_s),
        vibration_g2=vibration(force_g, dt_s),
        duration_s=known.duration_s,
        fs_rps=known.fs_rps,
        first_temp_c=known.first_temp_c,
    )


def without_vibration(force_g: np.ndarray, dt_s: float) -> np.ndarray:
    """(N, 3) what a hand does to the specific force, and gravity."""
    return _mean(force_g, HAND_S, dt_s)


def vibration(force_g: np.ndarray, dt_s: float) -> np.ndarray:
    """(N,) g^2: mean square of what is faster than a hand, mean of the axes."""
    # Twice the mean: once, between 20 and 40 Hz, it turns what it leaves upside down, and half as much energy again would be seen there.
    fast = force_g - without_vibration(without_vibration(force_g, dt_s), dt_s)
    return _mean(np.mean(fast**2, axis=1), ENERGY_S, dt_s)


def _mean(values: np.ndarray, window_s: float, dt_s: float) -> np.ndarray:
    """Moving mean along the samples."""
    from scipy.ndimage import uniform_filter1d  # a fit that needs none of this need not wait for it

    return uniform_filter1d(values, max(1 if values.ndim == 1 else 3, round(window_s / dt_s)), axis=0, mode="nearest")
