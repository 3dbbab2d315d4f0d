"""Several units as one gyroscope: weights, fused rate, and the file format ``tinygc-array-model/1``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.numeric import sigmas_in
from session.base.records import ROTATION, read_record
from session.base.results import Array, Keys, Maybe, Number, Text
from session.base.texts import significant
from session.base.units import DEG
from session.detect.events import FULL_SCALE_ROUNDING
from session.log.config import OWN_UNITS, Accelerometer, Sensor
from tinygc.closure.floor import FLICKER_FLOOR
from tinygc.features.arrays.clocks import UnitClock
from tinygc.features.arrays.feature import LARGEST_NUMBER, MOST_UNITS, SCHEMA
from tinygc.models.files import UNITS
from tinygc.models.model import (
    ACCELEROMETER,
    COVARIANCE,
    FACTOR,
    MATRIX,
    RATE,
    ROUNDING,
    covariance,
    sensor_table,
)

# The best linear unbiased combination of units that measure one rate (Gauss and Markov; Aitken for correlated noise).
#
#     omega = sum_i W_i x_i,   sum_i W_i = I,   W = (A^T Q^-1 A)^-1 A^T Q^-1,   covariance (A^T Q^-1 A)^-1
#
# x_i is a unit's calibrated rate in the array's frame, Q the noise covariance of all of them, A identities stacked vertically.

#: ratio of eigenvalues to the largest one below which a covariance is singular
SINGULAR = 1e-12


def best_weights(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``(weights (N, 3, 3), covariance of the combination (3, 3))`` for a noise covariance (3 N, 3 N) of the units, unit by unit.

    Raises CalibrationError where the covariance is singular.  Weights may be negative where noise is correlated.
    """
    count = len(covariance) // 3
    scale = sigmas_in(covariance)
    if not (scale > 0).all():
        raise CalibrationError("a unit's noise is 0: no best combination; give the noise of every axis")
    whitened = covariance / np.outer(scale, scale)
    if np.linalg.eigvalsh(whitened)[0] <= SINGULAR:
        raise CalibrationError("the units' noise covariance is singular (two units with the same noise): no best combination")
    stacked = np.tile(np.eye(3), (count, 1)) / scale[:, None]
    solved = np.linalg.solve(whitened, stacked)  # of Q^-1 A, its rows times their scale
    fused = np.linalg.inv(stacked.T @ solved)
    fused = (fused + fused.T) / 2
    weights = fused @ (solved / scale[:, None]).T
    weights = weights.reshape(3, count, 3).transpose(1, 0, 2)
    return weights, fused


def combined(weights: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return (3, 3), the covariance of a combination by any weights (N, 3, 3) of units with covariance (3 N, 3 N)."""
    row = weights.transpose(1, 0, 2).reshape(3, -1)
    return row @ covariance @ row.T


# Several units as one gyroscope: each unit's model and noise, and the best linear combination.
#
#     omega = sum_i W_i R_i (E_i m_i + B_i),   sum_i W_i = I
#
# m_i is the rate that unit i measures (register x sensitivity, rad/s), R_i its mounting, omega the rate in the array's frame.

EQUATION = "omega = sum_i weights_i @ mounting_i @ (E_i @ m_i + B_i), m_i the measured rate of unit i in rad/s"
#: noise for which the weights can be optimal
WHITE, INSTABILITY = "white", "instability"


class _OfSensor(Keys):
    """The table ``sensor`` of a unit."""

    written = staticmethod(sensor_table)

    def made(self, value: Any) -> Sensor:
        """Of a table that was checked."""
        return Sensor(**{"model": "", "serial": ""} | {key: each for key, each in super().made(value).items() if each is not None})


_SPACE = Array((3, 3), sound=covariance)
_SENSOR = _OfSensor(
    {"odr_hz": Number(0, above=True), "gyro_fs_dps": Number(0, above=True), "accel_fs_g": Number(0, above=True)},
    {"model": Maybe(Text()), "serial": Maybe(Text()), **dict.fromkeys(OWN_UNITS, Number())},
)
_SIGMAS = Array((3,), Number(0, RATE.high, above=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class FusedUnit:
    """One unit of the fused gyroscope, and one of ``units`` in its file.

    E, B: omega = E m + B in its own body frame; covariance (12, 12) of E row by row, then B, rad/s, None where it is not known; clock,
    mounting and position as of a ``UnitPlace``; noise density (3,), one-sided, of its own axes; bias instability (3,), None where it is not
    known; weights (3, 3) of its rate in the combination; sha256 of the logs that it was fitted to; accelerometer: None where it is
    uncalibrated.
    """

    number: Annotated[int, Number(0, LARGEST_NUMBER, whole=True)]
    E: Annotated[np.ndarray, MATRIX]
    B: Annotated[np.ndarray, Array((3,), RATE)]
    covariance: Annotated[np.ndarray | None, Array((12, 12), sound=covariance)] = None
    mounting: Annotated[np.ndarray, Array((3, 3), sound=ROTATION.sound)]
    mounting_covariance: Annotated[np.ndarray, _SPACE] = field(default_factory=lambda: np.zeros((3, 3)))
    position_m: Annotated[np.ndarray | None, Array((3,), Number(-1e3, 1e3))] = None
    position_covariance: Annotated[np.ndarray | None, _SPACE] = None
    clock: UnitClock
    noise_density_rps_rthz: Annotated[np.ndarray, _SIGMAS]
    bias_instability_rps: Annotated[np.ndarray | None, _SIGMAS] = None
    accel_noise_density_mps2_rthz: Annotated[float | None, Number(0, above=True)] = None
    weights: Annotated[np.ndarray, Array((3, 3), FACTOR)]
    sha256: tuple[str, ...] = ()
    sensor: Annotated[Sensor | None, _SENSOR] = None
    accelerometer: Annotated[Accelerometer | None, ACCELEROMETER] = None

    @cached_property
    def matrix(self) -> np.ndarray:
        """Return (3, 3), which takes the measured rate to the array's frame."""
        return self.mounting @ self.E

    @cached_property
    def offset(self) -> np.ndarray:
        """Return (3,) rad/s in the array's frame."""
        return self.mounting @ self.B

    def in_array(self, per_axis: np.ndarray) -> np.ndarray:
        """Return the covariance (3, 3) in the array's frame of independent noise with sigmas (3,) on the unit's own axes."""
        return self.matrix @ np.diag(np.square(per_axis)) @ self.matrix.T


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayModel:
    """Model of an array as one gyroscope, and its file.

    rate_hz of the samples; best_for, ``white`` or ``instability``, and the reason; joint_covariance (12 N, 12 N) of all units' E and B,
    None where only the units' own are known; session it comes from.
    """

    schema = SCHEMA
    written = (
        *("version", "equation", "rates", "session", "rate_hz", "best_for", "reason"),
        *("units", "joint_covariance", "fused"),
    )
    version: str = VERSION
    equation: str = EQUATION
    rates: Annotated[str, Text((UNITS,))] = UNITS
    session: str = ""
    rate_hz: Annotated[float, Number(0, 1e6, above=True)]
    best_for: Annotated[str, Text((WHITE, INSTABILITY))] = WHITE
    reason: str = ""
    units: tuple[FusedUnit, ...]
    joint_covariance: Annotated[np.ndarray | None, COVARIANCE] = None

    @property
    def fused(self) -> Annotated[dict[str, np.ndarray | None], Keys()]:
        """The combination's own noise density, bias instability, and sigma of its parameters at rest, each (3,), for people."""
        return {
            "noise_density_rps_rthz": self.noise_density,
            "bias_instability_rps": self.bias_instability,
            "bias_sigma_rps": self.bias_sigma,
        }

    def __len__(self) -> int:
        return len(self.units)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the units' numbers."""
        return tuple(unit.number for unit in self.units)

    @cached_property
    def density(self) -> np.ndarray:
        """Return (3 N, 3 N) (rad/s)^2/Hz, one-sided: the white noise of all units in the array's frame."""
        return white_covariance(self.units)

    @property
    def noise_density(self) -> np.ndarray:
        """Return (3,) rad/s/sqrt(Hz), one-sided, of the combination."""
        return sigmas_in(combined(self.weights, self.density))

    @property
    def bias_instability(self) -> np.ndarray | None:
        """Return (3,) rad/s of the combination, with independent units; None where a unit's is not known."""
        wander = instability_covariance(self.units)
        return None if wander is None else sigmas_in(combined(self.weights, wander))

    @property
    def bias_sigma(self) -> np.ndarray | None:
        """Return (3,) rad/s, the combination's sigma at rest from the parameters' uncertainty; None where a unit's covariance is not
        known."""
        own = [unit.covariance for unit in self.units]
        if self.joint_covariance is None and any(each is None for each in own):
            return None
        # (3, 12) of each unit: derivatives by E and B of the rate in the array's frame
        columns = [unit.mounting @ np.hstack([np.kron(np.eye(3), np.linalg.solve(unit.E, -unit.B)), np.eye(3)]) for unit in self.units]
        row = np.hstack(self.weights @ columns)
        return sigmas_in(row @ (block_diag(*own) if self.joint_covariance is None else self.joint_covariance) @ row.T)

    def __call__(self, measured: np.ndarray) -> np.ndarray:
        """Combine all units' measured rates (..., N, 3) rad/s of the same times into (..., 3) rad/s in the array's frame."""
        return np.einsum("nij,...nj->...i", self.weights @ self.matrices, measured) + np.einsum("nij,nj->i", self.weights, self.offsets)

    @cached_property
    def weights(self) -> np.ndarray:
        """Return (N, 3, 3), which sum to identity."""
        return np.stack([unit.weights for unit in self.units])

    @cached_property
    def matrices(self) -> np.ndarray:
        """Return (N, 3, 3) of ``FusedUnit.matrix``."""
        return np.stack([unit.matrix for unit in self.units])

    @cached_property
    def offsets(self) -> np.ndarray:
        """Return (N, 3) rad/s of ``FusedUnit.offset``."""
        return np.stack([unit.offset for unit in self.units])

    @property
    def wrong(self) -> str:
        """What is wrong with a model whose keys are each sound, or nothing."""
        count = len(self)
        if not 2 <= count <= MOST_UNITS:
            return f"units has {count} entries, expected 2 to {MOST_UNITS}"
        if twice := next((number for number in self.numbers if self.numbers.count(number) > 1), None):
            return f"unit {twice} stands twice, expected each number once"
        if (joint := self.joint_covariance) is not None and len(joint) != 12 * count:
            return f"joint_covariance has {len(joint)} rows, expected {12 * count}, 12 of each unit"
        if (off := np.abs(self.weights.sum(axis=0) - np.eye(3)).max()) > ROUNDING:
            return f"the units' weights miss identity by {off:.2g}, expected weights that sum to identity"
        # ``fused^-1 W_i`` is a unit's information. Sums of positive ones have a positive symmetric part, so they can be inverted.
        wander = instability_covariance(self.units)
        best = self.density if self.best_for == WHITE or wander is None else wander
        information = np.linalg.solve(combined(self.weights, best), self.weights)
        if np.linalg.eigvalsh((information + information.transpose(0, 2, 1)) / 2).min() <= 0:
            return "a unit's weights are not positive, so that they cannot be shared out when a unit is out"
        return ""


def white_covariance(units: Sequence[FusedUnit]) -> np.ndarray:
    """Return (3 N, 3 N) (rad/s)^2/Hz of the units' white noise, each its own, in the array's frame."""
    return block_diag(*(unit.in_array(unit.noise_density_rps_rthz) for unit in units))


def instability_covariance(units: Sequence[FusedUnit]) -> np.ndarray | None:
    """Return (3 N, 3 N) (rad/s)^2 of the units' bias instability in the array's frame; None where a unit's is not known."""
    known = [unit.in_array(unit.bias_instability_rps) for unit in units if unit.bias_instability_rps is not None]
    return block_diag(*known) if len(known) == len(units) else None


def load_array_model(path: Path | str) -> ArrayModel:
    """Read a model file.  Raises FormatError, in one line, for a file that is no array's model."""
    model = read_record(ArrayModel, Path(path))
    if model.wrong:
        raise FormatError(f"{path}: {model.wrong}; fit again, or correct the file")
    return model


# Readings at the end of a unit's range.

#: share of the full scale from which a reading is saturated
END = 1 - FULL_SCALE_ROUNDING


def ends(model: ArrayModel) -> np.ndarray:
    """Return (N,) rad/s above which a unit is saturated; infinite where its full scale is not known."""
    scales = [None if unit.sensor is None else unit.sensor.gyro_fs_dps for unit in model.units]
    return np.array([np.inf if scale is None else END * scale * DEG for scale in scales])


# Fused rate: all units' rates in; one rate, its sigma, and the units that it is of.


def fuse(model: ArrayModel, raw: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Combine measured rates raw (N, 3) or (T, N, 3) rad/s, a row NaN where a unit has none.  Raises CalibrationError for another shape.

    Returns rate (T, 3) rad/s in the array's frame, NaN where no unit gave one; sigma (T, 3) rad/s, infinite where every unit is saturated;
    used (T, N): the units that the rate is of.

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
        inverse = np.linalg.inv(model.weights[mask].sum(axis=0))
        rate[rows] = np.einsum("nij,tnj->ti", inverse @ model.weights[mask], calibrated[rows][:, mask])
        variance = np.diag(inverse @ spread[mask].sum(axis=0) @ inverse.T)
        sigma[rows] = np.sqrt(variance + (0.0 if own is None else np.square(own)))
    sigma[at_end] = np.inf
    return rate, sigma, used


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
        white, bias = (significant(np.sqrt(part / 3) / DEG, 2) for part in (by_white, by_wander))
        words = {WHITE: "white noise", INSTABILITY: "bias instability"}[best_for]
        reason = f"over {AVERAGING_S:g} s white noise leaves {white} dps, bias instability {bias} dps: best for {words}"
        weights = weights if best_for == WHITE else slow
    weighed = tuple(replace(unit, weights=own) for unit, own in zip(units, weights, strict=True))
    return ArrayModel(
        units=weighed, rate_hz=float(rate_hz), best_for=best_for, reason=reason, joint_covariance=joint_covariance, session=session
    )
