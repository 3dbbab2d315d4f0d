"""Numbers of an accelerometer from the lengths of gravity: in each still it reads the same, however it lies.

Length alone fixes the sensor's own axes only up to a turn, so the matrix is upper triangular (``parameters.py``).  As many numbers are
fitted as the attitudes tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.accelerometer.parameters import BIASES, IDENTITY, PARAMETERS, RUNGS, Ladder, after, corrected, length_columns, units
from session.common.robust import sigma_of
from session.common.units import DEG, MG
from session.log.config import Accelerometer

APART_RAD = 10 * DEG  #: stills nearer than this are one attitude
#: m/s^2 of a number's error for one m/s^2 in every attitude.  The public recordings reach 0.9 to 1.6, 20 random attitudes 1.6, 20 in
#: one half of the sphere 9; attitudes all about one axis reach thousands
WORST_GAIN = 10.0
FIRST_BAR = 0.01  #: of gravity: what a still may miss before it counts less, until the stills themselves say how far they miss
BAR_SIGMAS = 2.0
LEAST_BAR = 1e-7  #: of gravity; below any noise, and above rounding
ROUNDS, STEPS, SETTLED = 20, 30, 0.01
SMALLEST_STEP = 1e-10
#: m/s^2: what a MEMS accelerometer wanders by within minutes: with no stills to spare, their scatter says nothing
WANDERS_MPS2 = 0.05 * MG


@dataclass(frozen=True, eq=False)
class LengthFit:
    """accelerometer, from what was measured; x (9,): the correction that it is of the one before; covariance (9, 9) of x, SI; rung: which
    numbers were fitted, None where the attitudes fix none; attitudes that lie apart; weight (S,) of each still, 1 for a good one;
    before, after (S,) m/s^2: by how much each length misses gravity's; sigma_mps2 of one still."""

    accelerometer: Accelerometer
    x: np.ndarray
    covariance: np.ndarray
    rung: Ladder | None
    attitudes: int
    weight: np.ndarray
    before: np.ndarray
    after: np.ndarray
    sigma_mps2: float

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Names of numbers that these attitudes do not tell."""
        return () if self.rung is not None and not self.rung.left else ("all of them",) if self.rung is None else self.rung.left


def fit_lengths(force: np.ndarray, gravity_mps2: float, before: Accelerometer | None = None, gravity_sigma_mps2: float = 0.0) -> LengthFit:
    """Of the stills' mean force (S, 3) m/s^2, under ``before`` (as measured without it), with gravity's length, known to a sigma.

    A few stills that are none hardly count.  Where the attitudes fix no number, the fit is ``before``.
    """
    before = before or Accelerometer(source="none")
    attitudes = attitudes_of(force)
    misses = np.linalg.norm(force, axis=1) - gravity_mps2
    for rung in RUNGS:
        if attitudes < rung.count:
            continue
        x, bar = _robust(rung, force, gravity_mps2)
        if not np.isfinite(x).all() or min(x[[0, 3, 5]]) <= 0:
            continue
        scaled = rung.directions * (units(gravity_mps2) @ np.abs(rung.directions))
        design = length_columns(x, force) @ scaled
        if _gain(design) > WORST_GAIN:
            continue
        left = _miss(x, force, gravity_mps2)
        weight, sigma = _weight(left, bar), _sigma(left, bar, rung.count)
        covariance = scaled @ np.linalg.inv(design.T @ design) @ scaled.T * sigma**2
        # All lengths in common: the matrix as a whole, and nothing else.
        common = np.where(np.arange(PARAMETERS) < BIASES[0], x, 0.0) * gravity_sigma_mps2 / gravity_mps2
        covariance = covariance + np.outer(common, common)
        return LengthFit(after(x, before), x, covariance, rung, attitudes, weight, misses, left, sigma)
    zero = np.zeros((PARAMETERS, PARAMETERS))
    return LengthFit(before, IDENTITY.copy(), zero, None, attitudes, np.ones(len(force)), misses, misses, 0.0)


def attitudes_of(force: np.ndarray) -> int:
    """How many of the directions of force (S, 3) lie apart from all that were counted before them."""
    kept = np.zeros((0, 3))
    for row in force:
        length = np.linalg.norm(row)
        if length and (not len(kept) or np.max(kept @ row) < length * np.cos(APART_RAD)):
            kept = np.concatenate([kept, [row / length]])
    return len(kept)


def _robust(rung: Ladder, force: np.ndarray, gravity_mps2: float) -> tuple[np.ndarray, float]:
    """x (9,), and what a still may miss before it counts less, by Cauchy's weights: a still far beyond the others stops counting.

    Under soft_l1 instead, one in 24 that is 5 % long moves the bias by 10 mg.
    """
    x = _least_squares(IDENTITY.copy(), np.ones(len(force)), rung, force, gravity_mps2)
    bar = max(FIRST_BAR * gravity_mps2, float(sigma_of(_miss(x, force, gravity_mps2))))
    for _ in range(ROUNDS):
        for _ in range(STEPS):
            moved = _least_squares(x, _weight(_miss(x, force, gravity_mps2), bar), rung, force, gravity_mps2, 1)
            done = np.abs((moved - x) / units(gravity_mps2)).max() < SMALLEST_STEP * gravity_mps2
            x = moved
            if done or not np.isfinite(x).all():
                break
        sigma = float(sigma_of(_miss(x, force, gravity_mps2))) * np.sqrt(len(force) / max(len(force) - rung.count, 1))
        was, bar = bar, max(BAR_SIGMAS * sigma, LEAST_BAR * gravity_mps2)
        if abs(bar / was - 1) < SETTLED:
            break
    return x, bar


def _weight(miss: np.ndarray, bar: float) -> np.ndarray:
    return 1 / (1 + (miss / bar) ** 2)


def _sigma(miss: np.ndarray, bar: float, count: int) -> float:
    """m/s^2 of one still, such that sigma^2 (X' X)^-1 is the covariance of Cauchy's estimate (Huber 1981, equation 6.5)."""
    spare = len(miss) - count
    if spare < count:
        return max(float(sigma_of(miss)), WANDERS_MPS2)
    u2 = (miss / bar) ** 2
    pull, slope = miss / (1 + u2), (1 - u2) / (1 + u2) ** 2
    mean = max(float(np.mean(slope)), 0.1)  # no estimate rests on a tenth of its stills
    small = 1 + count / len(miss) * float(np.var(slope)) / mean**2
    return small * float(np.sqrt(np.sum(pull**2) / spare)) / mean


def _least_squares(
    x: np.ndarray, weight: np.ndarray, rung: Ladder, force: np.ndarray, gravity_mps2: float, steps: int = STEPS
) -> np.ndarray:
    root = np.sqrt(weight)
    scale = units(gravity_mps2) @ np.abs(rung.directions)
    for _ in range(steps):
        design = length_columns(x, force) @ rung.directions * scale
        step = -np.linalg.lstsq(design * root[:, None], _miss(x, force, gravity_mps2) * root, rcond=None)[0]
        x = x + rung.directions @ (scale * step)
        if not np.abs(step).max(initial=0.0) > SMALLEST_STEP * gravity_mps2:
            break
    return x


def _miss(x: np.ndarray, force: np.ndarray, gravity_mps2: float) -> np.ndarray:
    return np.linalg.norm(corrected(x, force), axis=1) - gravity_mps2


def _gain(design: np.ndarray) -> float:
    """m/s^2 of the worst number's sigma for one m/s^2 of independent noise in every still."""
    smallest = np.linalg.svd(design, compute_uv=False)[-1]
    return float(1 / smallest) if smallest > 0 else float("inf")
