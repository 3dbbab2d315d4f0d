"""Noise floors: the closure that sensor noise alone leaves, Allan deviation (IEEE 952, annex C), bias instability.

The bias instability of stills is the mean over a grid, and no component of ``inference.noise``: a still that was disturbed is an outlier.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from session.base import rotation
from session.base.texts import significant
from session.base.units import DEG_PER_HOUR
from session.detect.stamp_errors import StampErrors, moved_by_stamps
from session.detect.stills import Noise, Still
from session.log.config import Sensor
from tinygc.closure.earth import EarthRate, earths_in_body
from tinygc.closure.residual import Batch, directions, parts
from tinygc.closure.stills import StillSet
from tinygc.inference.noise import wander_covariance
from tinygc.inference.solve import solve_lower

# The floor: closure residuals expected from sensor noise alone, bias instability included.

# The drift of a gyro's bias: flicker noise of a given bias instability.
#
# Flicker noise of instability B has the one-sided density B^2 / (pi f), so each octave of frequency carries the variance
# B^2 ln 2 / pi, and the Allan deviation's floor is 0.664 B (IEEE 952, C.1).  The sum of one Gauss-Markov process per octave models it.


@dataclass(frozen=True)
class BiasInstability:
    """A sensor's bias instability.

    rps: rad/s; sigma_rps: its sigma if it was estimated, else None; most_rps: 95 % upper limit of an estimate; source: its origin;
    of_unit: whether the recording itself gives it: it is then no prior of what is estimated from the same recording.
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
        text = f"{value:.{digits}f} ± {sigma:.{digits}f} °/h, {self.source}"
        return text if value > SEEN_SIGMAS * sigma else f"{text}, whose stills do not show it: less than {significant(most, 2)} °/h (95 %)"

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

    @cached_property
    def covariance(self) -> np.ndarray:
        """(S, S) (rad/s)^2 covariance of one axis' bias at the middles of the segments."""
        return wander_covariance(self.middle_s, instability_rps=self.instability_rps)


# The floor: closure residuals expected from noise alone.
#
# It contains the gyro's white noise over the segment (angle random walk) and the accelerometer's noise over the stills at both ends.
# Neighbours share a still, so their accelerometer parts are correlated with opposite signs.

#: causes of parts of a floor
GYRO_NOISE, ACCEL_NOISE = "white noise of the gyroscope", "white noise of the accelerometer"
DIALS, STOPS, STAMPS = "dials", "known angles of turns", "rounding and jitter of the stamps"
SINGLE_SEGMENTS = "bridged readings and impacts"
#: of the gyroscope's variance: errors of the stamps that add less are left out
COUNTS = 1e-3
#: rad^2 of an unknown angle: its residual and columns are 0, so any value larger than the measured ones will do
UNKNOWN_RAD2 = 1.0


@dataclass(frozen=True, eq=False)
class Floor:
    """Covariance of the error angles, rad^2: own (S, d, d) of each segment; shared (S-1, d, d) of each with the next.

    tilt_excess: factor on the tilt's sigma, estimated from the residuals.  It changes the weights, not the covariance: otherwise tilts with
    too small a sigma would outweigh turns of known angle.  wider (S, d, d): the part of ``own`` that is not noise but the uncertainty of
    single segments (bridged readings, impacts), or None.  references: parts of ``own`` and ``shared`` that references and stamps give, by
    cause; the gyroscope's white noise is the rest (``parts``).
    """

    own: np.ndarray
    shared: np.ndarray
    tilt_excess: float = 1.0
    wider: np.ndarray | None = None
    references: Mapping[str, Floor] = field(default_factory=dict)

    def widened(self, more: np.ndarray) -> Floor:
        """Add a covariance (S, 3, 3) rad^2 of single segments, about the axes of ``directions``."""
        d = self.own.shape[1]
        more = more[:, :d, :d]
        return replace(self, own=self.own + more, wider=more if self.wider is None else self.wider + more)

    def pick(self, which: np.ndarray) -> Floor:
        """The floor of some segments (S,) bool: two that were not neighbours share no still."""
        kept = np.flatnonzero(which)
        neighbours = np.diff(kept) == 1
        shared = np.where(neighbours[:, None, None], self.shared[kept[:-1]], 0.0)
        return replace(self, own=self.own[kept], shared=shared, wider=None if self.wider is None else self.wider[kept], references={})

    @property
    def parts(self) -> dict[str, Floor]:
        """The floor by cause, ``GYRO_NOISE`` first: their covariances add up to its own."""
        found = dict(self.references)
        if self.wider is not None:
            found[SINGLE_SEGMENTS] = Floor(self.wider, np.zeros_like(self.shared))
        own, shared = (
            sum((getattr(part, name) for part in found.values()), np.zeros_like(getattr(self, name))) for name in ("own", "shared")
        )
        return {GYRO_NOISE: Floor(self.own - own, self.shared - shared), **found}

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
    batch: Batch,
    attitudes: np.ndarray,
    ends: list[tuple[Still, Still]],
    noises: list[Noise],
    dial_sigma_rad: float,
    stamps: Sequence[StampErrors] = (),
) -> Floor:
    """Floor of S segments with attitudes (S, T, 4), the stills at their ends, the noise and the stamps' errors of each segment's log.

    Tilt has the accelerometer's white noise (including quantisation), a known yaw the dial's sigma, a known turn angle the stop's.
    Residual errors of the accelerometer's pre-calibration are not included, since they are not known.
    """
    axes = directions(batch, attitudes[:, -1])
    own = (axes @ gyro_variance(batch, attitudes, noises) @ axes.transpose(0, 2, 1))[:, : batch.angles, : batch.angles]
    none = np.zeros((max(len(batch) - 1, 0), batch.angles, batch.angles))
    accel = Floor(np.zeros_like(own), none.copy())
    references = {ACCEL_NOISE: accel}
    if batch.turns is not None:
        angles = np.zeros_like(own)
        angles[:, 2, 2] = np.where(batch.turns.known, np.nan_to_num(batch.turns.sigma_rad) ** 2, UNKNOWN_RAD2)
        references[STOPS] = Floor(angles, none)
    if batch.yaw_known:
        references[DIALS] = Floor(np.zeros_like(own), none.copy())
        references[DIALS].own[:, 2, 2] = 2 * dial_sigma_rad**2
    for i, ((first, last), noise) in enumerate(zip(ends, noises, strict=True)):
        begin, end = (still_tilt_variance(still, noise) for still in (first, last))
        accel.own[i, [0, 1], [0, 1]] = begin + end
        if i + 1 < len(ends) and ends[i + 1][0] is last:
            accel.shared[i, [0, 1], [0, 1]] = -end
            if batch.yaw_known:
                references[DIALS].shared[i, 2, 2] = -(dial_sigma_rad**2)
    late = stamp_variance(batch, attitudes, stamps) if stamps else np.zeros((len(batch), 3, 3))
    if np.trace(late, axis1=1, axis2=2).sum() > COUNTS * np.trace(own, axis1=1, axis2=2).sum():
        late = (axes @ late @ axes.transpose(0, 2, 1))[:, : batch.angles, : batch.angles]
        references[STAMPS] = Floor(late, none)
    own = sum((part.own for part in references.values()), own)
    shared = sum((part.shared for part in references.values()), none)
    return Floor(own, shared, references=references)


def gyro_variance(batch: Batch, attitudes: np.ndarray, noises: list[Noise]) -> np.ndarray:
    """(S, 3, 3) rad^2: the integrated white noise of the gyro, each axis with its own angle random walk."""
    weights = np.concatenate([batch.dt, np.zeros((len(batch), 1))], axis=1)
    turn = rotation.matrix(attitudes)
    walk = np.array([noise.angle_random_walk for noise in noises]) ** 2
    return np.einsum("st,stij,sj,stkj->sik", weights, turn, walk, turn, optimize=True)


def stamp_variance(batch: Batch, attitudes: np.ndarray, stamps: Sequence[StampErrors]) -> np.ndarray:
    """(S, 3, 3) rad^2, table axes: what the errors of the stamps of each segment's log make of its end, with attitudes (S, T, 4)."""
    found = np.zeros((len(batch), 3, 3))
    for some in parts(len(batch)):
        q_tb, dt = attitudes[some], batch.dt[some]
        step = 2 * rotation.multiply(q_tb[:, 1:], rotation.conjugate(q_tb[:, :-1]))[..., 1:]  # small, so its vector is twice this
        moved = moved_by_stamps(step / np.where(dt > 0, dt, np.inf)[..., None])
        for i, errors in enumerate(stamps[some]):
            found[some.start + i] = errors.variance(moved[i : i + 1])[0]
    return found


# Allan deviation (IEEE 952, annex C), and the bias instability that the uncertainties use.

# Overlapping Allan deviation pooled over stills (IEEE 952, annex C).
#
# Stills lie in different attitudes.  The Allan variance is built from second differences of the angle, which do not depend on the mean rate
# of a still.  So the stills are pooled, and no difference spans a turn.  Where there are too many to hold, their sums are kept
# (``AllanSums``).

#: the floor of the Allan deviation is this share of the bias instability: sqrt(2 ln 2 / pi) (IEEE 952, C.1)
FLICKER_FLOOR = 0.6643
#: averaging time at which the angle random walk is read: beyond the sensor's low-pass filter and well within a still
READ_S, READ_SAMPLES = 0.2, 20
#: relative sigma of the remaining departure from slope -1/2 there: the low-pass filter lowers the curve, bias drift raises it
BENT_SHARE = 0.015
#: deviations with fewer degrees of freedom are discarded
LEAST_FREEDOM = 5.0
#: the floor is searched only among deviations with at least these degrees of freedom
FLOOR_FREEDOM = 20.0
#: the minimum counts as a floor if it exceeds the white-noise slope by this many sigmas and by this share of its variance
LEAVES_SIGMAS, FLOOR_SHARE = 3.0, 0.5


@dataclass(frozen=True, eq=False)
class AllanCurve:
    """Allan deviation curve of three axes.

    tau_s (K,) s; deviation (K, 3) rad/s; freedom (K,) equivalent degrees of freedom; longest_s: the longest piece.
    """

    tau_s: np.ndarray
    deviation: np.ndarray
    freedom: np.ndarray
    longest_s: float

    @property
    def relative_sigma(self) -> np.ndarray:
        """(K,) relative standard error of each deviation."""
        return 1 / np.sqrt(2 * self.freedom)


@dataclass(frozen=True)
class Reading:
    """One noise coefficient of one axis, SI: value and sigma if observed; otherwise at_most, the k = 2 upper limit, or NaN."""

    value: float
    sigma: float
    observed: bool
    at_most: float = np.nan


def allan_curve(pieces: list[np.ndarray], period_s: float, per_octave: int = 4) -> AllanCurve:
    """Allan deviation pooled over pieces of rates (N_i, 3) rad/s, sampled every period_s, at ``per_octave`` averaging times per octave.

    Raises ValueError if no piece has four samples.
    """
    pieces = [piece for piece in pieces if len(piece) >= 4]
    if not pieces:
        raise ValueError("no piece of four samples or more")
    longest = max(map(len, pieces))
    return curve_of([AllanSums.of(piece, averaging_factors(longest, per_octave)) for piece in pieces], period_s, longest * period_s)


def averaging_factors(samples: int, per_octave: int) -> tuple[int, ...]:
    """Averaging factors, in samples, up to half of ``samples``."""
    return tuple(np.unique(np.round(2 ** np.arange(0, np.log2(samples / 2) + 1e-9, 1 / per_octave)).astype(int)).tolist())


@dataclass(frozen=True, eq=False)
class AllanSums:
    """Sums of one piece: factors (K,); total (K, 3) of squared second differences of the summed rate; count, freedom (K,)."""

    factors: tuple[int, ...]
    total: np.ndarray
    count: np.ndarray
    freedom: np.ndarray

    @classmethod
    def of(cls, piece: np.ndarray, factors: tuple[int, ...]) -> AllanSums:
        """Compute the sums of rates (N, 3)."""
        theta = np.vstack([np.zeros(3), np.cumsum(piece - piece.mean(axis=0), axis=0)])
        total, count, freedom = np.zeros((len(factors), 3)), np.zeros(len(factors)), np.zeros(len(factors))
        for k, m in enumerate(factors):
            if len(theta) <= 2 * m:
                continue
            second = theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m]
            total[k], count[k], freedom[k] = np.einsum("ij,ij->j", second, second), len(second), allan_freedom(len(theta), m)
        return cls(factors, total, count, freedom)


def curve_of(pieces: list[AllanSums], period_s: float, longest_s: float) -> AllanCurve:
    """Pool the sums of pieces with the same factors; averaging times with too few degrees of freedom are left out."""
    total, count, freedom = (sum(getattr(piece, name) for piece in pieces) for name in ("total", "count", "freedom"))
    variance = total / (2 * np.square(pieces[0].factors) * np.maximum(count, 1))[:, None]
    known = freedom >= LEAST_FREEDOM
    known[0] |= not known.any()
    return AllanCurve(np.multiply(pieces[0].factors, period_s)[known], np.sqrt(variance[known]), freedom[known], longest_s)


def allan_freedom(points: Any, m: int) -> Any:
    """Degrees of freedom of the overlapping estimate from ``points`` angles for white rate noise (NIST SP 1065, table 5)."""
    return np.maximum((3 * (points - 1) / (2 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5), 1.0)


def angle_random_walk(curve: AllanCurve, axis: int) -> Reading:
    """Angle random walk N, rad/sqrt(s): the deviation times sqrt(tau) on slope -1/2."""
    k = _read_at(curve)
    value = float(curve.deviation[k, axis] * np.sqrt(curve.tau_s[k]))
    enough = curve.tau_s[k] >= 0.5 * READ_S and curve.freedom[k] >= LEAST_FREEDOM
    return Reading(value, value * float(np.hypot(curve.relative_sigma[k], BENT_SHARE)), bool(enough and value > 0))


def bias_instability(curve: AllanCurve, axis: int) -> Reading:
    """Bias instability B, rad/s: the curve's floor less its white part, / 0.664; an upper limit if the curve has no floor."""
    walk = angle_random_walk(curve, axis)
    variance, spread = curve.deviation[:, axis] ** 2, np.sqrt(2 / curve.freedom)
    later = curve.tau_s > 2 * curve.tau_s[_read_at(curve)]
    if not later.any():
        return Reading(np.nan, np.nan, False)
    white = walk.value**2 / curve.tau_s
    sigma = np.hypot(spread * variance, 2 * walk.sigma * walk.value / curve.tau_s)
    excess = variance - white
    lowest = int(np.argmin(np.where(later & (curve.freedom >= FLOOR_FREEDOM), variance, np.inf)))
    if later[lowest] and excess[lowest] > max(LEAVES_SIGMAS * sigma[lowest], FLOOR_SHARE * variance[lowest]):
        value = float(np.sqrt(excess[lowest])) / FLICKER_FLOOR
        return Reading(value, value * float(sigma[lowest] / excess[lowest]) / 2, True)
    at_most = np.sqrt(np.min((np.maximum(excess, 0) + 2 * sigma)[later])) / FLICKER_FLOOR
    return Reading(np.nan, np.nan, False, float(at_most))


def _read_at(curve: AllanCurve) -> int:
    """Index of the averaging time nearest to the one at which the angle random walk is read."""
    sample_s = curve.tau_s[0]
    wanted = max(READ_S, READ_SAMPLES * sample_s)
    return int(np.argmin(np.abs(np.log(curve.tau_s / wanted))))


# The bias instability used for uncertainties: from session.toml, else typical of the sensor model, else estimated from the stills.
#
# The estimate uses the mean rates of the stills; long stills are cut into pieces, so averaging times within them count as well.  Beyond
# white noise their covariance is that of flicker noise times B^2.  Effects of gravity, the Earth, a steady drift and temperature are
# projected out.  The restricted likelihood of B (Patterson & Thompson 1971) over all axes, with a flat prior, gives its mean and sigma.
# A few disturbed stills (a knock) must not count as bias drift, so innovations follow a mixture: normal, or in one case of fifty far wider.
# A step of the bias must not count either: steps are detected and projected out.

GIVEN, ESTIMATED = "given", "estimated from this recording"
#: length of the pieces into which longer stills are cut, s; greatest number of pieces
PIECE_S, MOST_PIECES = 4.0, 300
#: grid of B, rad/s; the last is beyond any MEMS gyroscope that can hold an attitude for a turn
GRID_RPS = np.concatenate([[0.0], np.geomspace(0.1, 300.0, 70)]) * DEG_PER_HOUR
#: share and width of outlying innovations; without outliers this share costs 2 % of the estimate's sigma
OUTLIERS, OUTLIER_SIGMAS = 0.02, 20.0
#: chi-square (3 degrees of freedom) by which a bias step must improve the fit; some 100 moments reach it by chance in one of 700
#: recordings; greatest number of steps
STEP_CHI_SQUARE, MOST_STEPS = 25.0, 3
#: s left out at both ends of a still: the onset of a turn is too soft for the still detector
END_S = 0.2
#: elements of the covariances that are processed at once: some megabytes
SAMPLES_AT_ONCE = 500_000
#: degrees of freedom of all axes together below which the flat prior would dominate
LEAST_STILL_FREEDOM = 9
#: degC: a smaller change is the thermometer's noise
LEAST_CHANGE_C = 0.5


def bias_instability_of(sensor: Sensor, logs: list[StillSet], earths: dict[int, EarthRate]) -> BiasInstability:
    """Bias instability of a session's sensor, from the stills of its logs and the Earth's rate by yaw group."""
    if sensor.gyro_bias_instability_dph is not None:
        return BiasInstability(sensor.gyro_bias_instability_dph * DEG_PER_HOUR, GIVEN)
    if typical := sensor.typical("gyro_bias_instability_dph"):
        return BiasInstability(typical[1] * DEG_PER_HOUR, f"typical of {typical[0]}")
    return estimated(logs, earths)


def estimated(logs: list[StillSet], earths: dict[int, EarthRate]) -> BiasInstability:
    """Estimate the bias instability from the stills alone."""
    likelihood = likelihood_of_instability(logs, earths)
    return BiasInstability(0.0, UNKNOWN) if likelihood is None else _posterior_of_instability(likelihood)


def likelihood_of_instability(logs: list[StillSet], earths: dict[int, EarthRate]) -> np.ndarray | None:
    """(B,) restricted log-likelihood of the stills of all logs and axes at each of ``GRID_RPS``; None for too few stills."""
    pieces = [piece for number, log in enumerate(logs) for piece in _pieces_at_rest(number, logs)]
    if not pieces:
        return None
    rate, log, t_s, span_s, walk, down, q_tb, group, temp_c = (np.array(column) for column in zip(*pieces, strict=True))
    rate -= earths_in_body(earths, group, q_tb)
    heading_known = all(earths[int(g)].source in ("given", "estimated") for g in np.unique(group))
    sideways = [np.zeros((len(t_s), 0)) if heading_known else _sideways_columns(q_tb, group, axis) for axis in range(3)]
    white, flicker = walk**2 / span_s[:, None], wander_covariance(t_s, span_s, instability_rps=1.0)
    steps = np.zeros((len(t_s), 0))
    for _ in range(MOST_STEPS + 1):
        columns = [_other_causes(log, t_s, down, side, temp_c, steps) for side in sideways]
        if sum(len(t_s) - each.shape[1] for each in columns) < LEAST_STILL_FREEDOM:
            return None
        likelihood = np.sum([_restricted_likelihood(rate[:, axis], columns[axis], white[:, axis], flicker) for axis in range(3)], axis=0)
        step = _step_of_bias(rate, columns, white, _posterior_of_instability(likelihood).rps ** 2 * flicker)
        if step is None:
            break
        steps = np.concatenate([steps, step[:, None]], axis=1)
    return np.asarray(likelihood)


def _posterior_of_instability(likelihood: np.ndarray) -> BiasInstability:
    """Mean, sigma and 95 % limit of B under a flat prior, from its log-likelihood (B,) at each of ``GRID_RPS``."""
    cell = np.gradient(GRID_RPS)
    cell[[0, -1]] /= 2  # at its ends the grid has half a cell
    weight = np.exp(likelihood - likelihood.max()) * cell
    weight /= weight.sum()
    mean = float(weight @ GRID_RPS)
    sigma = float(np.sqrt(weight @ (GRID_RPS - mean) ** 2))
    edges = np.append((GRID_RPS[1:] + GRID_RPS[:-1]) / 2, GRID_RPS[-1])
    return BiasInstability(mean, ESTIMATED, sigma, float(np.interp(0.95, np.cumsum(weight), edges)), of_unit=True)


def _pieces_at_rest(number: int, logs: list[StillSet]) -> Iterator[tuple]:
    """Iterate over the reference stills of a log, whole or in parts: mean rate (3,) rad/s, log, moment and span s, angle random walk (3,),
    gravity's direction (3,), attitude (4,), yaw group, degC or NaN."""
    log, began = logs[number], sum(before.samples.duration_s for before in logs[:number])
    rested = sum(still.duration_s for each in logs for still in each.stills if still.problem is None)
    samples, walk, piece_s = log.samples, log.noise.angle_random_walk, max(PIECE_S, rested / MOST_PIECES)
    for q, group, still in zip(log.q_tb, log.group, log.stills, strict=True):
        if still.problem is not None:
            continue
        down = still.accel_mean / max(still.gravity_mps2, 1e-12)
        if still.bumps:
            middle_s = began + still.start_s + still.duration_s / 2
            yield still.gyro_mean, number, middle_s, still.duration_s, walk, down, q, group, still.temp_c
            continue
        end = min(round(END_S / samples.period_s), (still.stop - still.start) // 4)
        parts = max(1, int(still.duration_s / piece_s))
        for a, b in pairwise(np.linspace(still.start + end, still.stop - end, parts + 1).astype(int)):
            temp_c = np.nan if samples.temp_c is None else samples.temp_c[a:b].mean()
            middle_s = began + (samples.at_s(a) + samples.at_s(b - 1)) / 2
            yield samples.gyro[a:b].mean(axis=0), number, middle_s, (b - a) * samples.period_s, walk, down, q, group, temp_c


def _sideways_columns(q_tb: np.ndarray, group: np.ndarray, axis: int) -> np.ndarray:
    """(N, 2 groups) of pieces with attitudes (N, 4): columns of a horizontal rate fixed in the table, on one body axis.

    Gravity's direction covers the vertical rate.
    """
    turn = rotation.matrix(q_tb)
    return np.stack([np.where(group == g, turn[:, i, axis], 0.0) for g in np.unique(group) for i in (0, 1)], axis=1)


def _other_causes(
    log: np.ndarray, t_s: np.ndarray, down: np.ndarray, sideways: np.ndarray, temp_c: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """(N, r), orthonormal: other causes of bias changes, the likeliest first; r is at most half the number of pieces."""
    x, y, z = down.T
    own = [(log == number)[:, None].astype(float) for number in np.unique(log)]
    blocks = [np.concatenate([*own, steps], axis=1), down, sideways, (t_s - t_s.mean())[:, None]]
    if np.isfinite(temp_c).all() and np.ptp(temp_c) > LEAST_CHANGE_C:
        blocks.append((temp_c - temp_c.mean())[:, None])
    blocks.append(np.stack([x * x, y * y, x * y, x * z, y * z], axis=1))
    taken = blocks[0]
    for block in blocks[1:]:
        if taken.shape[1] + block.shape[1] <= len(t_s) / 2:
            taken = np.concatenate([taken, block], axis=1)
    u, s, _ = np.linalg.svd(taken / np.maximum(np.linalg.norm(taken, axis=0), 1e-300), full_matrices=False)
    return u[:, s > 1e-6]


def _restricted_likelihood(rate: np.ndarray, columns: np.ndarray, white: np.ndarray, flicker: np.ndarray) -> np.ndarray:
    """(B,) restricted log-likelihood of one axis at each of ``GRID_RPS``, with outliers; the columns' coefficients are fitted.

    rate (N,) rad/s; columns (N, r); white (N,) (rad/s)^2; flicker (N, N), the wander's covariance for B = 1 rad/s.
    """
    every = max(1, SAMPLES_AT_ONCE // len(flicker) ** 2)
    return np.concatenate([_of_some(rate, columns, white, flicker, GRID_RPS[k : k + every]) for k in range(0, len(GRID_RPS), every)])


def _of_some(rate: np.ndarray, columns: np.ndarray, white: np.ndarray, flicker: np.ndarray, tried_rps: np.ndarray) -> np.ndarray:
    """Compute the log-likelihood for some instabilities (B,): arrays are (B, N, …) here."""
    factor = np.linalg.cholesky(np.diag(white) + tried_rps[:, None, None] ** 2 * flicker)
    both = np.broadcast_to(np.column_stack([rate, columns]), (len(tried_rps), len(rate), 1 + columns.shape[1]))
    whitened = solve_lower(factor, both)
    y, A = whitened[..., :1], whitened[..., 1:]
    At, weight = A.swapaxes(1, 2), np.ones(y.shape)
    for _ in range(12):
        left = y - A @ np.linalg.solve(At @ (A * weight), At @ (weight * y))
        usual = (1 - OUTLIERS) * np.exp(-(left**2) / 2)
        wild = OUTLIERS / OUTLIER_SIGMAS * np.exp(-(left**2) / 2 / OUTLIER_SIGMAS**2) + 1e-300
        weight = (usual + wild / OUTLIER_SIGMAS**2) / (usual + wild)
    information = np.linalg.slogdet(At @ (A * weight))[1]
    diagonal = np.diagonal(factor, axis1=1, axis2=2)
    return np.sum(np.log(usual + wild), axis=(1, 2)) - np.sum(np.log(diagonal), axis=1) - information / 2


def _step_of_bias(rate: np.ndarray, columns: list[np.ndarray], white: np.ndarray, wander: np.ndarray) -> np.ndarray | None:
    """(N,) the bias step of rates (N, 3), common to all axes at one moment, that reduces chi-square most; None if it is not significant."""
    after = np.tril(np.ones((len(rate), len(rate))))[:, 1:]  # from each piece on
    gain = np.zeros(after.shape[1])
    for axis in range(3):
        factor = np.linalg.cholesky(np.diag(white[:, axis]) + wander)
        y, A, S = (solve_lower(factor, each) for each in (rate[:, axis], columns[axis], after))
        q, _ = np.linalg.qr(A)
        y, S = y - q @ (q.T @ y), S - q @ (q.T @ S)
        size = np.sum(S**2, axis=0)
        gain += np.where(size > 1e-6, (S.T @ y) ** 2 / np.maximum(size, 1e-6), 0.0)
    best = int(np.argmax(gain)) if len(gain) else 0
    return after[:, best] if len(gain) and gain[best] > STEP_CHI_SQUARE else None
