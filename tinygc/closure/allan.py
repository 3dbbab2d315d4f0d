"""Allan deviation (IEEE 952, annex C), and the bias instability that the uncertainties use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.io.config import Sensor
from session.io.units import DEG_PER_HOUR
from tinygc.attitude import rotation
from tinygc.attitude.earth import EarthRate
from tinygc.closure.floor import UNKNOWN, BiasInstability, wander_covariance
from tinygc.closure.least_squares import solve_lower
from tinygc.closure.stills import StillSet

# Overlapping Allan deviation pooled over stills (IEEE 952, annex C).
#
# Stills lie in different attitudes.  The Allan variance is built from second differences of the angle, which do not depend on the mean rate
# of a still.  So the stills are pooled, and no difference spans a turn.  Where there are too many to hold, their sums are kept
# (``AllanSums``).  Curves at short and at long averaging times can be joined.

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
            total[k], count[k], freedom[k] = np.einsum("ij,ij->j", second, second), len(second), _freedom(len(theta), m)
        return cls(factors, total, count, freedom)


def curve_of(pieces: list[AllanSums], period_s: float, longest_s: float) -> AllanCurve:
    """Pool the sums of pieces with the same factors; averaging times with too few degrees of freedom are left out."""
    total, count, freedom = (sum(getattr(piece, name) for piece in pieces) for name in ("total", "count", "freedom"))
    variance = total / (2 * np.square(pieces[0].factors) * np.maximum(count, 1))[:, None]
    known = freedom >= LEAST_FREEDOM
    known[0] |= not known.any()
    return AllanCurve(np.multiply(pieces[0].factors, period_s)[known], np.sqrt(variance[known]), freedom[known], longest_s)


def joined_curves(short: AllanCurve, long: AllanCurve) -> AllanCurve:
    """Join two curves: all of ``short``, then the longer averaging times of ``long``."""
    later = long.tau_s > short.tau_s[-1]
    tau_s, deviation, freedom = (
        np.concatenate([getattr(short, name), getattr(long, name)[later]]) for name in ("tau_s", "deviation", "freedom")
    )
    return AllanCurve(tau_s, deviation, freedom, max(short.longest_s, long.longest_s))


def _freedom(points: int, m: int) -> float:
    """Degrees of freedom of the overlapping estimate for white rate noise (NIST SP 1065, table 5)."""
    return max((3 * (points - 1) / (2 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5), 1.0)


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
    pieces = [piece for number, log in enumerate(logs) for piece in _pieces(number, logs)]
    if not pieces:
        return BiasInstability(0.0, UNKNOWN)
    rate, log, t_s, span_s, walk, down, q_tb, group, temp_c = (np.array(column) for column in zip(*pieces, strict=True))
    for g in np.unique(group):
        rate[group == g] -= earths[int(g)].in_body(q_tb[group == g])
    heading_known = all(earths[int(g)].source in ("given", "estimated") for g in np.unique(group))
    sideways = [np.zeros((len(t_s), 0)) if heading_known else _sideways(q_tb, group, axis) for axis in range(3)]
    white, flicker = walk**2 / span_s[:, None], wander_covariance(t_s, span_s, instability_rps=1.0)
    steps = np.zeros((len(t_s), 0))
    for _ in range(MOST_STEPS + 1):
        columns = [_columns(log, t_s, down, side, temp_c, steps) for side in sideways]
        if sum(len(t_s) - each.shape[1] for each in columns) < LEAST_STILL_FREEDOM:
            return BiasInstability(0.0, UNKNOWN)
        likelihood = [_log_likelihood(rate[:, axis], columns[axis], white[:, axis], flicker) for axis in range(3)]
        found = _posterior(np.sum(likelihood, axis=0))
        step = _step(rate, columns, white, found.rps**2 * flicker)
        if step is None:
            break
        steps = np.concatenate([steps, step[:, None]], axis=1)
    return found


def _posterior(likelihood: np.ndarray) -> BiasInstability:
    """Mean, sigma and limit under a flat prior over the grid."""
    weight = np.exp(likelihood - likelihood.max()) * np.gradient(GRID_RPS)
    weight /= weight.sum()
    mean = float(weight @ GRID_RPS)
    sigma = float(np.sqrt(weight @ (GRID_RPS - mean) ** 2))
    return BiasInstability(mean, ESTIMATED, sigma, float(np.interp(0.95, np.cumsum(weight), GRID_RPS)), of_unit=True)


def _pieces(number: int, logs: list[StillSet]) -> Iterator[tuple]:
    """Iterate over the reference stills of a log, whole or in parts: mean rate, log, moment and span s, angle random walk, gravity's
    direction, attitude, yaw group, degC or NaN."""
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
            middle_s = began + (samples.t_s[a] + samples.t_s[b - 1]) / 2
            yield samples.gyro[a:b].mean(axis=0), number, middle_s, (b - a) * samples.period_s, walk, down, q, group, temp_c


def _sideways(q_tb: np.ndarray, group: np.ndarray, axis: int) -> np.ndarray:
    """(N, 2 groups): columns of a horizontal rate fixed in the table, on one body axis; gravity's direction covers the vertical rate."""
    turn = rotation.matrix(q_tb)
    return np.stack([np.where(group == g, turn[:, i, axis], 0.0) for g in np.unique(group) for i in (0, 1)], axis=1)


def _columns(log: np.ndarray, t_s: np.ndarray, down: np.ndarray, sideways: np.ndarray, temp_c: np.ndarray, steps: np.ndarray) -> np.ndarray:
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


def _log_likelihood(rate: np.ndarray, columns: np.ndarray, white: np.ndarray, flicker: np.ndarray) -> np.ndarray:
    """(B,) restricted log-likelihood of one axis at each of ``GRID_RPS``, with outliers; the columns' coefficients are fitted."""
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


def _step(rate: np.ndarray, columns: list[np.ndarray], white: np.ndarray, wander: np.ndarray) -> np.ndarray | None:
    """(N,) the bias step, common to all axes at one moment, that reduces chi-square most; None if it is not significant."""
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
