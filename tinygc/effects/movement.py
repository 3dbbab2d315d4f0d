"""What an effect is given: what happened in one log, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Movement:
    """What happened in one log, at each of its N samples.

    t_s (N,) s since the session began; dt_s sampling period; rate (N, 3) rad/s, the true rate as well as it is known, in the sensor's
    axes; force_g (N, 3) specific force in g; temp_c (N,) degC or NaN; vibration_g2 (N,) mean square specific force above the hand's
    band; duration_s of the session; fs_rps full scale; first_temp_c at the session's beginning.
    """

    t_s: np.ndarray
    dt_s: float
    rate: np.ndarray
    force_g: np.ndarray
    temp_c: np.ndarray
    vibration_g2: np.ndarray
    duration_s: float
    fs_rps: float
    first_temp_c: float

    @property
    def acceleration(self) -> np.ndarray:
        """(N, 3) rad/s^2, by central differences."""
        return np.gradient(self.rate, self.dt_s, axis=0)

    def with_rate(self, rate: np.ndarray) -> Movement:
        """The same log with other rates (N, 3) rad/s."""
        return replace(self, rate=rate)
