"""The wandering of a gyro's bias: flicker noise of a given bias instability.

Flicker noise of instability B has the one-sided density B^2 / (pi f), so each octave of frequency carries the variance
B^2 ln 2 / pi, and the Allan deviation's floor is 0.664 B (IEEE 952, C.1).  One Gauss-Markov process an octave adds up to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.common.units import DEG_PER_HOUR

#: correlation times of the octaves, s: from a still to a working hour
TIMES_S = 2.0 ** np.arange(-1, 12)


@dataclass(frozen=True)
class BiasInstability:
    """A sensor's bias instability.

    rps: rad/s; sigma_rps of it where it was estimated, else None; most_rps: 95 % upper limit of an estimate; source: where it is from;
    of_unit: whether it is this unit's own, and not a data sheet's.
    """

    rps: float
    source: str
    sigma_rps: float | None = None
    most_rps: float | None = None
    of_unit: bool = False

    @property
    def words(self) -> str:
        """The figure, ° an hour, with its sigma, and where it is from."""
        value = self.rps / DEG_PER_HOUR
        if self.sigma_rps is None or self.most_rps is None:
            return f"{value:g} °/h, {self.source}" if self.source != UNKNOWN else self.source
        sigma, most = self.sigma_rps / DEG_PER_HOUR, self.most_rps / DEG_PER_HOUR
        digits = max(0, 1 - int(np.floor(np.log10(max(sigma, 1e-6) * 1.05))))
        said = f"{value:.{digits}f} ± {sigma:.{digits}f} °/h, {self.source}"
        return said if value > SEEN_SIGMAS * sigma else f"{said}, which does not show it: less than {most:.2g} °/h (95 %)"

    def to_json(self) -> dict:
        """Three keys for a ``noise`` object; null where it is not known, or has no sigma."""
        known = self.source != UNKNOWN
        return {
            "gyro_bias_instability_dph": self.rps / DEG_PER_HOUR if known else None,
            "gyro_bias_instability_sigma_dph": None if self.sigma_rps is None else self.sigma_rps / DEG_PER_HOUR,
            "gyro_bias_instability_source": self.source,
        }


#: source of what nobody has given and nothing at rest shows: the bias is then taken to stand still
UNKNOWN = "not known: nothing at rest shows it"
#: an estimate this many of its sigmas from zero is seen; a flat prior's half of a normal curve at zero is at 1.3
SEEN_SIGMAS = 2.0


@dataclass(frozen=True, eq=False)
class BiasWander:
    """When each segment was recorded, middle_s (S,) s of the session, and the bias instability, rad/s, that it is known with."""

    middle_s: np.ndarray
    instability_rps: float

    def covariance(self, *more_s: np.ndarray) -> np.ndarray:
        """(N, N) (rad/s)^2 of one axis' bias at the segments' moments, and at further ones (Q,) s after them."""
        return self._of_segments if not more_s else self._at(*more_s)

    @cached_property
    def _of_segments(self) -> np.ndarray:
        return self._at()

    def _at(self, *more_s: np.ndarray) -> np.ndarray:
        return wander_covariance(np.concatenate([self.middle_s, *more_s]), instability_rps=self.instability_rps)


def wander_covariance(t_s: np.ndarray, span_s: np.ndarray | float = 0.0, *, instability_rps: float) -> np.ndarray:
    """(N, N) (rad/s)^2 of one axis' bias at moments t_s (N,), each the mean over a span_s (N,) around it."""
    apart = np.abs(t_s[:, None] - t_s[None])
    octave = instability_rps**2 * np.log(2) / np.pi
    span = np.broadcast_to(span_s, t_s.shape)
    total = np.zeros(apart.shape)
    for time in TIMES_S:
        left = np.sqrt(_left_by_mean(span / time))
        total += np.exp(-apart / time) * np.outer(left, left)
    return octave * total


def _left_by_mean(x: np.ndarray) -> np.ndarray:
    """Share of a Gauss-Markov process's variance that its mean over x correlation times keeps: 2 (x - 1 + e^-x) / x^2."""
    safe = np.maximum(x, 1e-3)
    return np.where(x > 1e-3, 2 * (safe - 1 + np.exp(-safe)) / safe**2, 1.0)
