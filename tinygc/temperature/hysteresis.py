"""What the zero is otherwise at the same temperature, on the way up and on the way down."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tinygc.temperature.knots import Knots

#: bins over the range that both branches have
BINS = 8


@dataclass(frozen=True, eq=False)
class Hysteresis:
    """Up less down, of what a model leaves: at_c (n,) degC, difference and sigma (n,) SI."""

    at_c: np.ndarray
    difference: np.ndarray
    sigma: np.ndarray

    @property
    def largest(self) -> tuple[float, float, float]:
        """The difference of greatest size, its sigma, and its temperature."""
        k = int(np.argmax(np.abs(self.difference)))
        return float(self.difference[k]), float(self.sigma[k]), float(self.at_c[k])

    @property
    def rms(self) -> float:
        """Over the temperatures."""
        return float(np.sqrt(np.mean(self.difference**2)))


def hysteresis_of(knots: Knots, residual: np.ndarray, C: np.ndarray) -> Hysteresis | None:
    """Of residuals (K,) with noise C (K, K); None where the temperature went one way only."""
    up, down = knots.direction > 0, knots.direction < 0
    if not (up.any() and down.any()):
        return None
    low = max(knots.temp_c[up].min(), knots.temp_c[down].min())
    high = min(knots.temp_c[up].max(), knots.temp_c[down].max())
    edges = np.linspace(low, high, BINS + 1)
    rows, at = [], []
    for lower, upper in pairwise(edges):
        here = (knots.temp_c >= lower) & (knots.temp_c < upper)
        if (here & up).any() and (here & down).any():
            rising, falling = ((here & way) * knots.span_s for way in (up, down))
            rows.append(rising / rising.sum() - falling / falling.sum())
            at.append((lower + upper) / 2)
    if not rows:
        return None
    D = np.array(rows)
    return Hysteresis(np.array(at), D @ residual, np.sqrt(np.diag(D @ C @ D.T)))
