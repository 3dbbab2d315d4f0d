"""Build an array's model from its joint fit: agreement of the units, resampling, noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.optimize import nnls

from session.annexes.arrays.recording import ArraySession
from session.detect.events import FULL_SCALE_ROUNDING
from session.detect.stills import Noise
from session.io.config import Accelerometer
from session.io.errors import CalibrationError
from session.io.folder import Session, hash_of_log
from session.io.results import write_whole
from session.io.units import DEG, NS
from tinygc.annexes.arrays.clocks import UnitPlace
from tinygc.annexes.arrays.model import (
    INSTABILITY,
    WHITE,
    ArrayModel,
    Disagreement,
    FusedUnit,
    best_weights,
    combined,
    divisible,
    instability_covariance,
    to_table,
    weighted_median,
    white_covariance,
)
from tinygc.closure.floor import FLICKER_FLOOR, BiasInstability
from tinygc.models.linear import PARAMETERS, LinearModel

# Disagreement between the units of an array: the vote's median, the units' noise and full scale, and the errors a calibration shows.

#: limit of one unit's disagreement, relative to the units' median: no faulty unit in the calibration widens its own limit without bound
MOST_OWN = 3.0
#: largest share in the vote, relative to the units' median share
MOST_SHARE = 1.5
#: limit of a squared residual, relative to the expected one; beyond it, the residual is an outlier
TRIMMED = 9.0
_ROUNDS = 8
#: a unit with fewer common samples is left out
FEWEST_SAMPLES = 10
#: s of a window, share of windows that may be worse, and the limit of the mean of u, the greatest of three squares, in the others
WINDOW_S, WINDOWS, EXPECTED_U = 0.5, 0.005, 3.0
#: rad/s, 5 dps: below it, a scale or a delay error does not show
QUIET_RPS = 5 * DEG
#: limit of a single u, so that one impact is no disagreement
MOST_U = 36.0
#: share of the full scale from which a reading is saturated
END = 1 - FULL_SCALE_ROUNDING


def disagreement(model: ArrayModel, measured: np.ndarray) -> Disagreement:
    """Estimate how much the units differ beyond white noise in a recording, measured (T, N, 3) rad/s at the same times, NaN for none.

    Each unit's distance from the units' weighted median is modelled as |d|^2 = noise + 3 bias^2 + (scale |omega|)^2 + (delay
    |domega/dt|)^2, by least squares with non-negative terms and outliers trimmed. The bias is at least the wander of differences at rest.
    Of the units the greatest counts, but at most three times their median.  Delays and scales persist for seconds and do not average out
    within a window, so all three are widened until all but ``WINDOWS`` of the windows of ``WINDOW_S`` hold.
    """
    calibrated = np.einsum("nij,tnj->tni", model.matrices, measured) + model.offsets
    there = np.isfinite(calibrated).all(axis=2) & ~clips(model, measured)
    middle = weighted_median(calibrated, there, vote_weights(model))
    rate2 = np.square(middle).sum(axis=1)
    change = np.square(np.diff(middle, axis=0)).sum(axis=1) * model.rate_hz**2
    change2 = np.maximum(np.append(change, 0), np.insert(change, 0, 0))
    noise, fixed = sample_variance(model), fixed_variance(model)
    columns = np.column_stack([np.ones(len(rate2)), rate2, change2])
    by_vector = columns * [3, 1, 1]  # a bias is independent on each axis; a scale or a delay error may lie on one axis entirely
    apart_signed = calibrated - middle[:, None]
    apart = np.square(apart_signed)
    window = max(round(WINDOW_S * model.rate_hz), 2)
    known = there & np.isfinite(columns).all(axis=1)[:, None]
    quiet = np.nan_to_num(rate2, nan=np.inf) < QUIET_RPS**2
    units = [i for i in range(len(model)) if known[:, i].sum() >= FEWEST_SAMPLES]
    if not units:
        return Disagreement()
    parts = [_components(by_vector[known[:, i]], apart[known[:, i], i].sum(axis=1) - noise[i].sum(), float(noise[i].sum())) for i in units]
    table = np.array(parts)
    table[:, 0] = np.maximum(table[:, 0], [_wander(apart_signed[:, i], known[:, i] & quiet, noise[i], window) for i in units])
    theta = _common(table)
    worst = []
    for i in units:
        use = known[:, i]
        u = (apart[use, i] / (noise[i] + fixed[i] + (columns[use] @ theta)[:, None])).max(axis=1)
        means = np.convolve(np.minimum(u, MOST_U), np.full(window, 1 / window), "valid") if len(u) > window else u
        worst.append(np.quantile(means, 1 - WINDOWS))
    bias, scale, delay = np.sqrt(theta * max(float(_common(np.array(worst))) / EXPECTED_U, 1.0))
    return Disagreement(float(bias), float(scale), float(delay))


def _common(table: np.ndarray) -> np.ndarray:
    """Return the greatest over all units (N, ...), but at most what three times the root of their median has."""
    return np.minimum(table.max(axis=0), MOST_OWN**2 * np.median(table, axis=0))


def _wander(apart: np.ndarray, use: np.ndarray, noise: np.ndarray, window: int) -> float:
    """Return (rad/s)^2: variance, beyond white noise, of window means of differences (T, 3) at rest; greatest axis."""
    still = apart[use][: use.sum() // window * window].reshape(-1, window, 3).mean(axis=1)
    return float(max((np.square(still).mean(axis=0) - noise / window).max(), 0.0)) if len(still) else 0.0


def _components(columns: np.ndarray, square: np.ndarray, noise: float) -> np.ndarray:
    """Return (3,) variances that add up to squares (T,), whose spread follows their size; outliers are trimmed."""
    size = np.maximum(columns.max(axis=0), 1e-300)
    theta = np.zeros(3)
    expected = np.full(len(square), noise + max(float(np.median(square)), 0.0))
    for _ in range(_ROUNDS):
        keep = square < TRIMMED * expected
        theta = nnls((columns[keep] / size) / expected[keep, None], square[keep] / expected[keep])[0] / size
        expected = noise + columns @ theta
    return theta


def vote_weights(model: ArrayModel) -> np.ndarray:
    """Return (N,) weights of the units in the median, sum 1.

    Each is the unit's share of the combination, at most one and a half times the units' median share, so that of three units no single one
    can be the median by itself.
    """
    share = np.maximum(np.trace(model.weights, axis1=1, axis2=2), 1e-6)
    share = np.minimum(share, MOST_SHARE * np.median(share))
    return share / share.sum()


def sample_variance(model: ArrayModel) -> np.ndarray:
    """Return (N, 3) (rad/s)^2, each unit's white-noise variance of one sample, in the array's frame."""
    return np.diag(model.density).reshape(-1, 3) * model.rate_hz / 2


def fixed_variance(model: ArrayModel) -> np.ndarray:
    """Return (N, 3) (rad/s)^2 in the array's frame of constant errors: bias of the disagreement, bias instability, parameters at rest."""
    whole = np.full((len(model), 3), model.disagreement.bias_rps**2)
    for i, unit in enumerate(model.units):
        if unit.bias_instability is not None:
            whole[i] += np.diag(unit.in_array(unit.bias_instability))
        if unit.covariance is not None:
            columns = unit.parameter_columns(np.zeros(3))
            whole[i] += np.diag(columns @ unit.covariance @ columns.T)
    return whole


def ends(model: ArrayModel) -> np.ndarray:
    """Return (N,) rad/s above which a unit is saturated; infinite where its full scale is not known."""
    scales = [None if unit.sensor is None else unit.sensor.gyro_fs_dps for unit in model.units]
    return np.array([np.inf if scale is None else END * scale * DEG for scale in scales])


def clips(model: ArrayModel, measured: np.ndarray) -> np.ndarray:
    """Return (..., N): whether a unit is saturated on any axis, for measured rates (..., N, 3) rad/s."""
    with np.errstate(invalid="ignore"):
        return (np.abs(measured) >= ends(model)[:, None]).any(axis=-1)


# Resampling of one unit's samples at the array's sample times: cubic between four samples, in pieces, each sample read once.
#
# A reading at one of the unit's own sample times is kept. Between two, the Lagrange cubic through the two samples before and the two after
# is used. White noise keeps, on average over all times, 0.79 of a sample's variance, and the same density at low frequencies; a motion of
# frequency f is reproduced to (pi f T)^4 of itself or better, T the sample's period. Readings are not interpolated across a gap.

#: longest step without a gap, in median steps of the unit
GAP = 1.75


class Resampler:
    """Cubic resampler: ``push`` samples in time order, ``at`` times in time order; samples no longer needed are dropped."""

    def __init__(self, width: int):
        """width: number of values per sample."""
        self._t, self._values = np.zeros(0), np.zeros((0, width))
        self._step: float | None = None

    @property
    def ends(self) -> float:
        """Return the last time after which two samples are known; -inf at the beginning."""
        return float(self._t[-2]) if len(self._t) >= 2 else -np.inf

    def push(self, t_s: np.ndarray, values: np.ndarray) -> None:
        """Append samples: t_s (K,) s, values (K, W)."""
        self._t, self._values = np.concatenate([self._t, t_s]), np.vstack([self._values, values])
        if self._step is None and len(self._t) > 2:
            self._step = float(np.median(np.diff(self._t)))

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Return (K, W) at times (K,) s, NaN where samples are missing on either side."""
        out = np.full((len(t_s), self._values.shape[1]), np.nan)
        t, count = self._t, len(self._t)
        if not count:
            return out
        right = np.searchsorted(t, t_s, side="right")
        left = right - 1
        on = (left >= 0) & (t[np.maximum(left, 0)] == t_s)
        out[on] = self._values[left[on]]
        if count < 2:
            return out
        step = np.diff(t)
        limit = GAP * (self._step if self._step else float(step[0]))
        between = ~on & (left >= 0) & (right < count)
        between[between] &= step[left[between]] <= limit
        whole = between & (left >= 1) & (right < count - 1)
        whole[whole] &= (step[left[whole] - 1] <= limit) & (step[right[whole]] <= limit)
        out[whole] = self._cubic(t_s[whole], left[whole])
        plain = between & ~whole
        share = (t_s[plain] - t[left[plain]]) / step[left[plain]]
        out[plain] = (1 - share)[:, None] * self._values[left[plain]] + share[:, None] * self._values[right[plain]]
        return out

    def forget(self, t_s: float) -> None:
        """Drop the samples not needed for times from t_s on."""
        keep = max(int(np.searchsorted(self._t, t_s, side="right")) - 2, 0)
        self._t, self._values = self._t[keep:], self._values[keep:]

    def _cubic(self, moments: np.ndarray, left: np.ndarray) -> np.ndarray:
        nodes = left[:, None] + np.arange(-1, 3)
        times = self._t[nodes]
        found = np.zeros((len(moments), self._values.shape[1]))
        for k in range(4):
            weight = np.ones(len(moments))
            for other in range(4):
                if other != k:
                    weight *= (moments - times[:, other]) / (times[:, k] - times[:, other])
            found += weight[:, None] * self._values[nodes[:, k]]
        return found


# Build an array's model from a joint fit: weights with their reason, and the units' disagreement beyond noise.

#: averaging time for which the weights are optimal: a turn takes seconds, and the integrated rate is the attitude error
AVERAGING_S = 3.0


def build_array_model(
    units: Sequence[FusedUnit],
    rate_hz: float,
    *,
    correlation: np.ndarray | None = None,
    joint_covariance: np.ndarray | None = None,
    measured: np.ndarray | None = None,
    averaging_s: float = AVERAGING_S,
    session: str = "",
) -> ArrayModel:
    """Build the model of units with known parameters, extrinsics and noise; rate_hz: samples a second of the array.

    correlation (3 N, 3 N): of the units' white noise in the array's frame, where it was measured; joint_covariance (12 N, 12 N) of the
    units' E and B, unit by unit; measured (T, N, 3) rad/s: the units' readings at the same times in the calibration, NaN where one has
    none, from which their disagreement is estimated; averaging_s: averaging time for which the weights are optimal. Raises CalibrationError
    for fewer than two units, and for noise for which no combination is optimal.
    """
    units = tuple(units)
    if len(units) < 2:
        raise CalibrationError(f"an array of {len(units)} unit, expected two or more")
    if len(set(numbers := [unit.number for unit in units])) < len(numbers):
        raise CalibrationError(f"units {', '.join(map(str, numbers))}: a number stands twice")
    remark = ""
    white = white_covariance(units, correlation)
    weights, fused = best_weights(white)
    if correlation is not None and not divisible(weights, fused):
        correlation, white = None, white_covariance(units)
        weights, fused = best_weights(white)
        remark = "; the noise's correlation is left out, since by it a unit would have a negative weight"
    wander = instability_covariance(units)
    best_for, reason = WHITE, "no bias instability of every unit is known, so the weights are best for white noise"
    if wander is not None:
        # Allan variances: white N^2 / tau with N^2 half the one-sided density; flicker the square of 0.664 B, at any tau (IEEE 952, C.1)
        slow, _ = best_weights(wander)
        by_white = np.trace(fused) / 2 / averaging_s
        by_wander = FLICKER_FLOOR**2 * np.trace(combined(weights, wander))
        best_for = WHITE if by_white >= by_wander else INSTABILITY
        parts = [np.sqrt(part / 3) / DEG for part in (by_white, by_wander)]
        words = {WHITE: "white noise", INSTABILITY: "bias instability"}[best_for]
        reason = f"over {averaging_s:g} s white noise leaves {parts[0]:.2g} dps, bias instability {parts[1]:.2g} dps: best for {words}"
        weights = weights if best_for == WHITE else slow
    model = ArrayModel(units, weights, float(rate_hz), best_for, reason + remark, correlation, Disagreement(), joint_covariance, session)
    return model if measured is None else replace(model, disagreement=disagreement(model, measured))


def save_array_model(model: ArrayModel, path: Path) -> None:
    """Write ``tinygc-array-model/1`` atomically."""
    write_whole(path, to_table(model))


# Array's model of a joint fit: its units, their noise, and their disagreement in the recording.


class FittedUnit(Protocol):
    """What a joint fit provides for a unit; covariance (K, K), K at least 12, begins with E row by row, then B."""

    @property
    def number(self) -> int: ...  # noqa: D102
    @property
    def session(self) -> Session: ...  # noqa: D102
    @property
    def place(self) -> UnitPlace: ...  # noqa: D102
    @property
    def model(self) -> LinearModel: ...  # noqa: D102
    @property
    def accelerometer(self) -> Accelerometer: ...  # noqa: D102
    @property
    def covariance(self) -> np.ndarray: ...  # noqa: D102
    @property
    def noise(self) -> Noise: ...  # noqa: D102
    @property
    def instability(self) -> BiasInstability: ...  # noqa: D102


def array_model_of(array: ArraySession, fitted: Sequence[FittedUnit], covariance: np.ndarray | None = None) -> ArrayModel:
    """Build the model of fitted units; covariance (K N, K N) of all their numbers, unit by unit, each in the order of the unit's own.

    Raises CalibrationError as ``build_array_model``.
    """
    units = [
        FusedUnit(
            unit.place,
            unit.model,
            np.asarray(unit.noise.gyro, dtype=float),
            np.full(3, unit.instability.rps) if unit.instability.rps > 0 else None,
            unit.covariance[:PARAMETERS, :PARAMETERS],
            unit.session.config.sensor,
            None if unit.accelerometer.source == "none" else unit.accelerometer,
            float(np.sqrt(np.mean(np.square(unit.noise.accel)))) or None,
            tuple(hash_of_log(log) for log in (*unit.session.logs, *unit.session.closures)),
        )
        for unit in fitted
    ]
    joint = None
    if covariance is not None:
        each = len(covariance) // len(units)
        rows = np.concatenate([np.arange(PARAMETERS) + each * i for i in range(len(units))])
        joint = covariance[np.ix_(rows, rows)]
    rate_hz = 1 / fitted[0].session.logs[0].samples.period_s
    measured = together([unit.session for unit in fitted], [unit.place for unit in fitted])
    return build_array_model(units, rate_hz, joint_covariance=joint, measured=measured, session=array.name)


def together(sessions: Sequence[Session], places: Sequence[UnitPlace]) -> np.ndarray:
    """Return (T, N, 3) rad/s, all units' measured rates at the first one's sample times, log after log; NaN where one has none."""
    whole = []
    for logs in zip(*(session.logs for session in sessions), strict=True):
        begins_ns = int(logs[0].samples.t_ns[0])
        moments = (logs[0].samples.t_ns - begins_ns) * NS  # the array's clock is the first unit's
        columns = []
        for log, place in zip(logs, places, strict=True):
            since, clock = (log.samples.t_ns - begins_ns) * NS, place.clock
            resampler = Resampler(3)
            resampler.push(since + clock.offset_s + clock.rate * (since + (begins_ns * NS - clock.about_s)), log.samples.gyro)
            columns.append(resampler.at(moments))
        whole.append(np.stack(columns, axis=1))
    return np.concatenate(whole)
