"""The mean rate in each still as data: a body at rest turns with the Earth, so E m + B = R_bt w_earth.

Optional (``--still-rates``): the endpoint loss alone is what the method is about, but no datum is sharper for the bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.closure.residual import RateMap
from tinygc.models.linear import BIAS, PARAMETERS


@dataclass(frozen=True, eq=False)
class StillRates:
    """Q stills: rate (Q, 3) measured, earth (Q, 3) the Earth's rate in body axes, sigma (Q, 3) of the mean; all rad/s; attitudes q_tb
    (Q, 4) and moments middle_s (Q,) s are what uncertainties need of them."""

    rate: np.ndarray
    earth: np.ndarray
    sigma: np.ndarray
    q_tb: np.ndarray | None = None
    middle_s: np.ndarray | None = None

    def residuals(self, model: RateMap) -> np.ndarray:
        """(3 Q,) in sigmas."""
        return ((model(self.rate) - self.earth) / self.sigma).ravel()

    def columns(self) -> np.ndarray:
        """(3 Q, 12) of the linear model."""
        count = len(self.rate)
        design = np.zeros((count, 3, PARAMETERS))
        for axis in range(3):
            design[:, axis, 3 * axis : 3 * axis + 3] = self.rate
            design[:, axis, BIAS.start + axis] = 1.0
        return (design / self.sigma[..., None]).reshape(3 * count, PARAMETERS)
