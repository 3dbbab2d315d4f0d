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
from tinygc.closure.allan import FLICKER_FLOOR
from tinygc.closure.floor import BiasInstability
from tinygc.models.linear import PARAMETERS, LinearModel

# How far units of an array may be apart, and are: their median, their noise, their ends, and what a calibration shows beyond these.

#: of one unit's disagreement to the units' median: no unit that lies in the calibration widens its own bar without end
MOST_OWN = 3.0
#: of the units' median share in the vote
MOST_SHARE = 1.5
#: of what is expected, squared: a residual beyond is a liar's, and does not count
TRIMMED = 9.0
_ROUNDS = 8
#: a unit with fewer common samples says nothing
FEWEST_SAMPLES = 10
#: s of a window, share of windows that may be worse, and what the mean of u, the greatest of three squares, may be there
WINDOW_S, WINDOWS, EXPECTED_U = 0.5, 0.005, 3.0
#: rad/s below which nothing turns that a scale or a delay would show in: 5 dps
QUIET_RPS = 5 * DEG
#: a single u counts as no more than this: one impact is no disagreement
MOST_U = 36.0
#: of the full scale: from here on a reading is the register's end
END = 1 - FULL_SCALE_ROUNDING


def disagreement(model: ArrayModel, measured: np.ndarray) -> Disagreement:
    """How much the units differ beyond white noise in a recording, measured (T, N, 3) rad/s of the same moments, NaN for none.

    Of each unit |d|^2 = noise + 3 bias^2 + (scale |omega|)^2 + (delay |domega/dt|)^2 about the units' weighted median, by least squares
    without negative terms, outliers trimmed, the bias at least what differences at rest wander by; of the units the greatest, but at most
    three times their median.  Delays and scales stand for seconds and do not average out within a window, so all three are widened until
    all but ``WINDOWS`` of the windows of ``WINDOW_S`` hold.
    """
    calibrated = np.einsum("nij,tnj->tni", model.matrices, measured) + model.offsets
    there = np.isfinite(calibrated).all(axis=2) & ~clips(model, measured)
    middle = weighted_median(calibrated, there, vote_weights(model))
    rate2 = np.square(middle).sum(axis=1)
    change = np.square(np.diff(middle, axis=0)).sum(axis=1) * model.rate_hz**2
    change2 = np.maximum(np.append(change, 0), np.insert(change, 0, 0))
    noise, fixed = sample_variance(model), fixed_variance(model)
    columns = np.column_stack([np.ones(len(rate2)), rate2, change2])
    by_vector = columns * [3, 1, 1]  # a bias is each axis' own; a scale and a delay may lie on one axis whole
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
    """Of all units (N, ...): the greatest, but at most what three times their median's root has."""
    return np.minimum(table.max(axis=0), MOST_OWN**2 * np.median(table, axis=0))


def _wander(apart: np.ndarray, use: np.ndarray, noise: np.ndarray, window: int) -> float:
    """(rad/s)^2: variance of the windows' means of differences (T, 3) where nothing turns, beyond what white noise has; greatest axis."""
    still = apart[use][: use.sum() // window * window].reshape(-1, window, 3).mean(axis=1)
    return float(max((np.square(still).mean(axis=0) - noise / window).max(), 0.0)) if len(still) else 0.0


def _components(columns: np.ndarray, square: np.ndarray, noise: float) -> np.ndarray:
    """(3,) variances that add up to squares (T,), their spread following their size; squares far beyond are trimmed."""
    size = np.maximum(columns.max(axis=0), 1e-300)
    theta = np.zeros(3)
    expected = np.full(len(square), noise + max(float(np.median(square)), 0.0))
    for _ in range(_ROUNDS):
        keep = square < TRIMMED * expected
        theta = nnls((columns[keep] / size) / expected[keep, None], square[keep] / expected[keep])[0] / size
        expected = noise + columns @ theta
    return theta


def vote_weights(model: ArrayModel) -> np.ndarray:
    """(N,): a unit's weight in the median: its share of the combination, at most one and a half times the units' median share, so
    that of three no single one can be the median by itself; sum 1."""
    share = np.maximum(np.trace(model.weights, axis1=1, axis2=2), 1e-6)
    share = np.minimum(share, MOST_SHARE * np.median(share))
    return share / share.sum()


def sample_variance(model: ArrayModel) -> np.ndarray:
    """(N, 3) (rad/s)^2 of one sample's white noise, unit by unit, in the array's frame."""
    return np.diag(model.density).reshape(-1, 3) * model.rate_hz / 2


def fixed_variance(model: ArrayModel) -> np.ndarray:
    """(N, 3) (rad/s)^2 in the array's frame of what stands still: the bias of the disagreement, bias instability, parameters at rest."""
    whole = np.full((len(model), 3), model.disagreement.bias_rps**2)
    for i, unit in enumerate(model.units):
        if unit.bias_instability is not None:
            whole[i] += np.diag(unit.in_array(unit.bias_instability))
        if unit.covariance is not None:
            columns = unit.parameter_columns(np.zeros(3))
            whole[i] += np.diag(columns @ unit.covariance @ columns.T)
    return whole


def ends(model: ArrayModel) -> np.ndarray:
    """(N,) rad/s: from where on a unit's reading is its end and no rate; infinite where its full scale is not known."""
    scales = [None if unit.sensor is None else unit.sensor.gyro_fs_dps for unit in model.units]
    return np.array([np.inf if scale is None else END * scale * DEG for scale in scales])


def clips(model: ArrayModel, measured: np.ndarray) -> np.ndarray:
    """(..., N): whether a unit reads its end on any axis, of measured rates (..., N, 3) rad/s."""
    with np.errstate(invalid="ignore"):
        return (np.abs(measured) >= ends(model)[:, None]).any(axis=-1)


# One unit's samples at the array's moments: cubic between four samples, in pieces, each sample once.
#
# A reading at one of the unit's own moments is that reading.  Between two, the Lagrange cubic through the two samples before and the two
# behind: the noise that remains of white noise has, on average over all moments, 0.79 of a sample's variance, and the same density at low
# frequencies; a motion of frequency f is held to (pi f T)^4 of itself and better, T the sample's period.  No reading is made up across a
# gap.

#: of the unit's median step: two samples farther apart have a gap between them
GAP = 1.75


class Resampler:
    """``push`` samples in time order, ``at`` moments in time order; what lies behind is forgotten."""

    def __init__(self, width: int):
        """width: of the values."""
        self._t, self._values = np.zeros(0), np.zeros((0, width))
        self._step: float | None = None

    @property
    def ends(self) -> float:
        """The last moment from which on two samples are known; -inf at the beginning."""
        return float(self._t[-2]) if len(self._t) >= 2 else -np.inf

    def push(self, t_s: np.ndarray, values: np.ndarray) -> None:
        """The next samples: t_s (K,) s, values (K, W)."""
        self._t, self._values = np.concatenate([self._t, t_s]), np.vstack([self._values, values])
        if self._step is None and len(self._t) > 2:
            self._step = float(np.median(np.diff(self._t)))

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """(K, W) at moments (K,) s, NaN where there is nothing on both sides of one."""
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
        """All that no moment from t_s on needs."""
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


# An array's model from what a joint fit gives: weights with their reason, and how much the units differ beyond their noise.

#: the weights are best at this averaging time: a turn takes seconds, and what a rate is integrated over is its attitude's error
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
    """The model of units whose parameters, places and noise are known; rate_hz: samples a second of the array.

    correlation (3 N, 3 N): of the units' white noise in the array's frame, where it was measured; joint_covariance (12 N, 12 N) of the
    units' E and B, unit by unit; measured (T, N, 3) rad/s: what the units read at the same moments in the calibration, NaN where one
    has none: how much they differ beyond noise is learnt from it; averaging_s: what the weights are best for.
    Raises CalibrationError for fewer than two units, and for noise that no combination can be best for.
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
    """As ``tinygc-array-model/1``, whole or not at all."""
    write_whole(path, to_table(model))


# An array's model of a joint fit: its units, their noise, and how much they differed in the recording itself.


class FittedUnit(Protocol):
    """What a joint fit says of a unit; covariance (K, K), K at least 12, begins with E row by row, then B."""

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
    """The model of fitted units; covariance (K N, K N) of all their numbers, unit by unit, as each unit's own is ordered.

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
    """(T, N, 3) rad/s that units measured at the first one's moments, all logs one after the other; NaN where one has none."""
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
