"""The floor: closure residuals expected from sensor noise alone, bias instability included."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.detect.stills import Noise, Still
from session.io.units import DEG_PER_HOUR
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch, directions

# The drift of a gyro's bias: flicker noise of a given bias instability.
#
# Flicker noise of instability B has the one-sided density B^2 / (pi f), so each octave of frequency carries the variance
# B^2 ln 2 / pi, and the Allan deviation's floor is 0.664 B (IEEE 952, C.1).  The sum of one Gauss-Markov process per octave models it.

#: correlation times of the octaves, s: from a still to a working hour
TIMES_S = 2.0 ** np.arange(-1, 12)


@dataclass(frozen=True)
class BiasInstability:
    """A sensor's bias instability.

    rps: rad/s; sigma_rps: its sigma if it was estimated, else None; most_rps: 95 % upper limit of an estimate; source: its origin;
    of_unit: whether it belongs to this unit rather than to a data sheet.
    """

    rps: float
    source: str
    sigma_rps: float | None = None
    most_rps: float | None = None
    of_unit: bool = False

    @property
    def words(self) -> str:
        """The value in °/h with its sigma and its source."""
        value = self.rps / DEG_PER_HOUR
        if self.sigma_rps is None or self.most_rps is None:
            return f"{value:g} °/h, {self.source}" if self.source != UNKNOWN else self.source
        sigma, most = self.sigma_rps / DEG_PER_HOUR, self.most_rps / DEG_PER_HOUR
        digits = max(0, 1 - int(np.floor(np.log10(max(sigma, 1e-6) * 1.05))))
        said = f"{value:.{digits}f} ± {sigma:.{digits}f} °/h, {self.source}"
        return said if value > SEEN_SIGMAS * sigma else f"{said}, which does not show it: less than {most:.2g} °/h (95 %)"

    def to_json(self) -> dict:
        """Three keys of a ``noise`` object; null if unknown or without a sigma."""
        known = self.source != UNKNOWN
        return {
            "gyro_bias_instability_dph": self.rps / DEG_PER_HOUR if known else None,
            "gyro_bias_instability_sigma_dph": None if self.sigma_rps is None else self.sigma_rps / DEG_PER_HOUR,
            "gyro_bias_instability_source": self.source,
        }


#: source of a bias instability that is neither given nor estimated: the bias is then constant
UNKNOWN = "not known: nothing at rest shows it"
#: sigmas from zero at which an estimate counts as observed; under a flat prior, no bias instability gives 1.3
SEEN_SIGMAS = 2.0


@dataclass(frozen=True, eq=False)
class BiasWander:
    """Bias drift between segments: their middles middle_s (S,) s of the session, and the bias instability, rad/s."""

    middle_s: np.ndarray
    instability_rps: float

    def covariance(self, *more_s: np.ndarray) -> np.ndarray:
        """(N, N) (rad/s)^2 covariance of one axis' bias at the middles of the segments, then at the further moments (Q,) s."""
        if not more_s:
            return self._of_segments
        return wander_covariance(np.concatenate([self.middle_s, *more_s]), instability_rps=self.instability_rps)

    @cached_property
    def _of_segments(self) -> np.ndarray:
        return wander_covariance(self.middle_s, instability_rps=self.instability_rps)


def wander_covariance(t_s: np.ndarray, span_s: np.ndarray | float = 0.0, *, instability_rps: float) -> np.ndarray:
    """(N, N) (rad/s)^2 covariance of one axis' bias at moments t_s (N,), each averaged over span_s (N,) around it."""
    apart = np.abs(t_s[:, None] - t_s[None])
    octave = instability_rps**2 * np.log(2) / np.pi
    span = np.broadcast_to(span_s, t_s.shape)
    total = np.zeros(apart.shape)
    for time in TIMES_S:
        left = np.sqrt(_left_by_mean(span / time))
        total += np.exp(-apart / time) * np.outer(left, left)
    return octave * total


def _left_by_mean(x: np.ndarray) -> np.ndarray:
    """Variance of the mean of a Gauss-Markov process over x correlation times, relative to its own: 2 (x - 1 + e^-x) / x^2."""
    safe = np.maximum(x, 1e-3)
    return np.where(x > 1e-3, 2 * (safe - 1 + np.exp(-safe)) / safe**2, 1.0)


# The floor: closure residuals expected from noise alone.
#
# It contains the gyro's white noise over the segment (angle random walk) and the accelerometer's noise over the stills at both ends.
# Neighbours share a still, so their accelerometer parts are correlated with opposite signs.

#: rad^2 of an unknown angle: its residual and columns are 0, so any value larger than the measured ones will do
UNKNOWN_RAD2 = 1.0


@dataclass(frozen=True, eq=False)
class Floor:
    """Covariance of the error angles, rad^2: own (S, d, d) of each segment; shared (S-1, d, d) of each with the next.

    tilt_excess: factor on the tilt's sigma, estimated from the residuals.  It changes the weights, not the covariance: otherwise tilts with
    too small a sigma would outweigh turns of known angle.  wider (S, d, d): the part of ``own`` that is not noise but the uncertainty of
    single segments (bridged readings, impacts), or None.
    """

    own: np.ndarray
    shared: np.ndarray
    tilt_excess: float = 1.0
    wider: np.ndarray | None = None

    def widened(self, more: np.ndarray) -> Floor:
        """Add a covariance (S, 3, 3) rad^2 of single segments, about the axes of ``directions``."""
        d = self.own.shape[1]
        more = more[:, :d, :d]
        return replace(self, own=self.own + more, wider=more if self.wider is None else self.wider + more)

    @property
    def white(self) -> np.ndarray:
        """(S, d, d) covariance from noise alone."""
        return self.own if self.wider is None else self.own - self.wider

    @property
    def sigma(self) -> np.ndarray:
        """(S, d) rad, the weight of each angle being 1 / sigma^2; both tilt angles have the same sigma."""
        tilt = self.tilt_excess**2 * np.repeat((self.own[:, 0, 0] + self.own[:, 1, 1])[:, None] / 2, 2, axis=1)
        return np.sqrt(np.concatenate([tilt, np.diagonal(self.own, axis1=1, axis2=2)[:, 2:]], axis=1))

    @property
    def tilt_rms(self) -> float:
        """Expected rms tilt error over the segments from noise alone, rad."""
        return float(np.sqrt(np.mean(self.white[:, 0, 0] + self.white[:, 1, 1])))

    def dense(self) -> np.ndarray:
        """(S d, S d) the full covariance."""
        count, d = self.own.shape[:2]
        full = np.zeros((count, d, count, d))
        index = np.arange(count)
        full[index, :, index, :] = self.own
        full[index[:-1], :, index[1:], :] = self.shared
        full[index[1:], :, index[:-1], :] = self.shared.transpose(0, 2, 1)
        return full.reshape(count * d, count * d)

    def times(self, columns: np.ndarray) -> np.ndarray:
        """Covariance times columns (S, d, P), without the dense matrix."""
        product = self.own @ columns
        product[:-1] += self.shared @ columns[1:]
        product[1:] += self.shared.transpose(0, 2, 1) @ columns[:-1]
        return product


def still_tilt_variance(still: Still, noise: Noise) -> float:
    """Variance of a still's gravity direction, rad^2 per horizontal angle."""
    return float(np.mean(noise.velocity_random_walk**2)) / still.duration_s / still.gravity_mps2**2


def closure_floor(
    batch: Batch, attitudes: np.ndarray, ends: list[tuple[Still, Still]], noises: list[Noise], dial_sigma_rad: float = 0.0
) -> Floor:
    """Floor of S segments with attitudes (S, T, 4), the stills at their ends, and the noise of each segment's log.

    Tilt has the accelerometer's white noise (including quantisation), a known yaw the dial's sigma, a known turn angle the stop's.
    Residual errors of the accelerometer's pre-calibration are not included, since they are not known.
    """
    axes = directions(batch, attitudes[:, -1])
    own = (axes @ gyro_variance(batch, attitudes, noises) @ axes.transpose(0, 2, 1))[:, : batch.angles, : batch.angles]
    shared = np.zeros((max(len(batch) - 1, 0), batch.angles, batch.angles))
    dial = [dial_sigma_rad**2] if batch.yaw_known else [0.0] * (batch.angles - 2)
    if batch.turns is not None:
        own[:, 2, 2] += np.where(batch.turns.known, np.nan_to_num(batch.turns.sigma_rad) ** 2, UNKNOWN_RAD2)
    for i, ((first, last), noise) in enumerate(zip(ends, noises, strict=True)):
        begin, end = (np.diag([still_tilt_variance(still, noise)] * 2 + dial) for still in (first, last))
        own[i] += begin + end
        if i + 1 < len(ends) and ends[i + 1][0] is last:
            shared[i] = -end
    return Floor(own, shared)


def gyro_variance(batch: Batch, attitudes: np.ndarray, noises: list[Noise]) -> np.ndarray:
    """(S, 3, 3) rad^2: the integrated white noise of the gyro, each axis with its own angle random walk."""
    weights = np.concatenate([batch.dt, np.zeros((len(batch), 1))], axis=1)
    turn = rotation.matrix(attitudes)
    walk = np.array([noise.angle_random_walk for noise in noises]) ** 2
    return np.einsum("st,stij,sj,stkj->sik", weights, turn, walk, turn, optimize=True)
