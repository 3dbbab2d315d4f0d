"""Build an array's model from its joint fit; the fused rate; resampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.detect.events import FULL_SCALE_ROUNDING
from tinygc.closure.floor import FLICKER_FLOOR
from tinygc.features.arrays.model import (
    INSTABILITY,
    WHITE,
    ArrayModel,
    FusedUnit,
    best_weights,
    combined,
    instability_covariance,
    white_covariance,
)

# Readings at the end of a unit's range.

#: share of the full scale from which a reading is saturated
END = 1 - FULL_SCALE_ROUNDING


def ends(model: ArrayModel) -> np.ndarray:
    """Return (N,) rad/s above which a unit is saturated; infinite where its full scale is not known."""
    scales = [None if unit.sensor is None else unit.sensor.gyro_fs_dps for unit in model.units]
    return np.array([np.inf if scale is None else END * scale * DEG for scale in scales])


# Fused rate: all units' rates in; one rate, its sigma, and the units that it is of.


class Fused(NamedTuple):
    """Rate of T moments.

    rate (T, 3) rad/s in the array's frame, NaN where no unit gave one; sigma (T, 3) rad/s, infinite where every unit is saturated; used
    (T, N): the units that the rate is of.
    """

    rate: np.ndarray
    sigma: np.ndarray
    used: np.ndarray


def fuse(model: ArrayModel, raw: ArrayLike) -> Fused:
    """Combine measured rates raw (N, 3) or (T, N, 3) rad/s, a row NaN where a unit has none.  Raises CalibrationError for another shape.

    A saturated unit is used only where all are.  The weights of the used units are renormalised, ``(sum of theirs)^-1 W_i``, which is
    optimal where noise is independent.
    """
    rates = np.asarray(raw, dtype=float)
    if rates.shape[-2:] != (len(model), 3) or rates.ndim not in (2, 3):
        raise CalibrationError(f"raw has shape {rates.shape}, expected ({len(model)}, 3) or (T, {len(model)}, 3), rad/s")
    rates = rates.reshape(-1, len(model), 3)
    calibrated = np.einsum("nij,tnj->tni", model.matrices, rates) + model.offsets
    present = np.isfinite(rates).all(axis=2)
    with np.errstate(invalid="ignore"):
        used = present & ~(np.abs(rates) >= ends(model)[:, None]).any(axis=2)
    at_end = ~used.any(axis=1) & present.any(axis=1)
    used = np.where(at_end[:, None], present, used)
    own = model.bias_sigma
    # (N, 3, 3) (rad/s)^2, each unit's part of a sample's variance; the contribution of correlation to the total is shared equally by all
    white = model.density * model.rate_hz / 2
    alone = np.stack([white[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(model))])
    spread: np.ndarray = model.weights @ alone @ model.weights.transpose(0, 2, 1)
    spread = spread * np.trace(combined(model.weights, white)) / np.trace(spread.sum(axis=0))
    rate, sigma = np.full((len(used), 3), np.nan), np.full((len(used), 3), np.nan)
    kinds, which = np.unique(used, axis=0, return_inverse=True)
    which = which.reshape(-1)
    for kind, mask in enumerate(kinds):
        if not mask.any():
            continue
        rows = which == kind
        undo = np.linalg.inv(model.weights[mask].sum(axis=0))
        rate[rows] = np.einsum("nij,tnj->ti", undo @ model.weights[mask], calibrated[rows][:, mask])
        variance = np.diag(undo @ spread[mask].sum(axis=0) @ undo.T)
        sigma[rows] = np.sqrt(variance + (0.0 if own is None else np.square(own)))
    sigma[at_end] = np.inf
    return Fused(rate, sigma, used)


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


# Build an array's model from a joint fit: weights with their reason.

#: averaging time for which the weights are optimal: a turn takes seconds, and the integrated rate is the attitude error
AVERAGING_S = 3.0


def with_best_weights(
    units: Sequence[FusedUnit], rate_hz: float, joint_covariance: np.ndarray | None = None, session: str = ""
) -> ArrayModel:
    """Build the model of units with known parameters, extrinsics and noise; rate_hz: samples a second of the array.

    joint_covariance (12 N, 12 N) of the units' E and B, unit by unit.  Raises CalibrationError for noise for which no combination is
    optimal.
    """
    weights, fused = best_weights(white_covariance(units))
    wander = instability_covariance(units)
    best_for, reason = WHITE, "no bias instability of every unit is known, so the weights are best for white noise"
    if wander is not None:
        # Allan variances: white N^2 / tau with N^2 half the one-sided density; flicker the square of 0.664 B, at any tau (IEEE 952, C.1)
        slow, _ = best_weights(wander)
        by_white = np.trace(fused) / 2 / AVERAGING_S
        by_wander = FLICKER_FLOOR**2 * np.trace(combined(weights, wander))
        best_for = WHITE if by_white >= by_wander else INSTABILITY
        parts = [np.sqrt(part / 3) / DEG for part in (by_white, by_wander)]
        words = {WHITE: "white noise", INSTABILITY: "bias instability"}[best_for]
        reason = f"over {AVERAGING_S:g} s white noise leaves {parts[0]:.2g} dps, bias instability {parts[1]:.2g} dps: best for {words}"
        weights = weights if best_for == WHITE else slow
    weighed = tuple(replace(unit, weights=own) for unit, own in zip(units, weights, strict=True))
    return ArrayModel(
        units=weighed, rate_hz=float(rate_hz), best_for=best_for, reason=reason, joint_covariance=joint_covariance, session=session
    )
