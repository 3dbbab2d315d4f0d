"""How far units of an array may be apart, and are: their median, their noise, their ends, and what a calibration shows beyond these."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from session.common.units import DEG
from session.detect.clipping import FULL_SCALE_ROUNDING
from tinygc.array.fused.medians import weighted_median
from tinygc.array.fused.model import ArrayModel, Disagreement

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
