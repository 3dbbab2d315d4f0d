"""The accelerometer's nine parameters from the stills of a recording, and the ``[accelerometer]`` section that holds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import MOST_TOML, copy_new, folder_whole, read_text, require_empty, write_new
from session.base.numeric import UPPER, sigma_of, sigmas_in
from session.base.texts import probability
from session.base.toml import edited
from session.base.units import DEG, MG
from session.detect.stills import Still
from session.log.config import Accelerometer
from session.log.samples import Samples, start_times

# The nine numbers of a triad of accelerometers, and which of them a recording can determine.
#
# The force is f = M (m - b), M upper triangular: the triad itself defines the body frame, x along the sensor's x axis, y in the plane
# of its x and y.  A full matrix, as another program may give it, is such a triangle behind a frame of its own: f = T (M0 (m - b0) - d).

MATRIX, BIAS = slice(0, 6), slice(6, 9)
PARAMETERS = BIAS.stop
#: in the order of a vector: the matrix's upper triangle row by row, then the bias
NAMES = ("scale x", "nonorthogonality xy", "nonorthogonality xz", "scale y", "nonorthogonality yz", "scale z", "bias x", "bias y", "bias z")
IDENTITY = np.array([1.0, 0, 0, 1, 0, 1, 0, 0, 0])
SCALES, SHEARS, BIASES = np.array([0, 3, 5]), np.array([1, 2, 4]), np.array([6, 7, 8])


@dataclass(frozen=True, eq=False)
class Ladder:
    """One choice of what is fitted: what a person calls it, and directions (9, K) of the vector."""

    description: str
    directions: np.ndarray

    @property
    def count(self) -> int:
        """Numbers that are fitted."""
        return self.directions.shape[1]


def _axes(*groups: np.ndarray) -> np.ndarray:
    return np.eye(PARAMETERS)[:, np.concatenate(groups)]


_ONE_SCALE = np.eye(PARAMETERS)[:, SCALES].sum(axis=1, keepdims=True)
#: what is tried, the most first.  Six faces up and down fix six numbers; a bias and one scale are the least that is worth its name
_RUNGS = (
    Ladder("scale, nonorthogonality and bias", np.eye(PARAMETERS)),
    Ladder("scale and bias", _axes(SCALES, BIASES)),
    Ladder("bias and one scale for all axes", np.concatenate([_ONE_SCALE, _axes(BIASES)], axis=1)),
)

#: m/s^2, sigmas of what is known without a calibration: 2 % of scale, 1 % of shear, 60 mg of zero-g level (docs/sensor.md, siblings: 2 %,
#: 0.5 %, 65 mg)
SPREAD_MPS2 = np.zeros(PARAMETERS)
SPREAD_MPS2[SCALES], SPREAD_MPS2[SHEARS], SPREAD_MPS2[BIASES] = 20 * MG, 10 * MG, 60 * MG
#: share of this spread: a number that is known no better is not observed, unless it is so many of its own sigmas from none
OBSERVED_BELOW, SURE_SIGMAS = 0.1, 3.0


def matrix_of(x: np.ndarray) -> np.ndarray:
    """(3, 3) of a vector (9,)."""
    matrix = np.zeros((3, 3))
    matrix[UPPER] = x[MATRIX]
    return matrix


def after(x: np.ndarray, before: Accelerometer, source: str = "stills") -> Accelerometer:
    """What a correction x (9,) of the force that ``before`` gives makes of it: f = T (M0 (m - b0) - d)."""
    matrix = matrix_of(x) @ before.matrix
    return Accelerometer(matrix, before.bias_mps2 + np.linalg.solve(before.matrix, x[BIAS]), source)


def corrected(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 3) m/s^2 of forces (S, 3) under a vector (9,)."""
    return (force - x[BIAS]) @ matrix_of(x).T


def length_columns(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 9): how each number changes the length of the corrected force: m/s^2 per 1, or per m/s^2."""
    matrix, moved = matrix_of(x), force - x[BIAS]
    unit = moved @ matrix.T
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    rows, columns = UPPER
    return np.concatenate([unit[:, rows] * moved[:, columns], -unit @ matrix], axis=1)


def force_columns(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 3, 9): how each number changes the corrected force."""
    rows, columns = UPPER
    found = np.zeros((len(force), 3, PARAMETERS))
    found[:, rows, np.arange(6)] = (force - x[BIAS])[:, columns]
    found[:, :, BIAS] = -matrix_of(x)
    return found


def units(gravity_mps2: float) -> np.ndarray:
    """(9,) one m/s^2 in each number's own unit."""
    return np.concatenate([np.full(6, 1 / gravity_mps2), np.ones(3)])


# Numbers of an accelerometer from the lengths of gravity: in each still it reads the same, however it lies.
#
# Length alone fixes the sensor's own axes only up to a turn, so the matrix is upper triangular (``parameters.py``).  As many numbers are
# fitted as the attitudes can separate.

APART_RAD = 10 * DEG  #: stills nearer than this are one attitude
#: m/s^2 of a number's error for one m/s^2 in every attitude.  The public recordings reach 0.9 to 1.6, 20 random attitudes 1.6, 20 in
#: one half of the sphere 9; attitudes all about one axis reach thousands
WORST_GAIN = 10.0
FIRST_BAR = 0.01  #: of gravity: what a still may miss before it counts less, until the stills themselves show how far they miss
BAR_SIGMAS = 2.0
LEAST_BAR = 1e-7  #: of gravity; below any noise, and above rounding
ROUNDS, STEPS, SETTLED = 20, 30, 0.01
SMALLEST_STEP = 1e-10
#: m/s^2: what a MEMS accelerometer wanders by within minutes: with no stills to spare, their scatter shows nothing
WANDERS_MPS2 = 0.05 * MG


# A drift of the accelerometer's zero within the session.
#
# The nine numbers are constants.  Stills lie in one attitude after the other, so a zero that moves with time passes for another matrix,
# nonorthogonality above all.  To first order it moves steadily: f = M (m - b - d s), s the share of the session from its middle, -1/2 to
# 1/2, so that b is the zero at the middle.  Its three numbers are fitted wherever stills are to spare, significant or not: what is not
# significant may still be there, and belongs into the sigmas of the nine.  Between six days of eight MPU-9150, nonorthogonalities differed
# by 0.9 of their sigmas so, by 2.3 without.

#: p-value at which a constant zero is rejected, as a fit is by its residuals (``tinygc/verdict/acceptance.py``)
DRIFT_P = 0.01
DRIFTS = 3
#: least F that has this p-value, of any number of stills: a third of chi-square's 11.34 with three degrees of freedom
DRIFT_F = 3.78


def _above(ratio: float, spare: int) -> float:
    """Probability that Fisher's F with 3 and ``spare`` >= 2 degrees of freedom exceeds a ratio: that of Student's t, a finite sum, and the
    step of the incomplete beta function from 1/2 to 3/2 (Abramowitz & Stegun 1964, 26.5.16, 26.7.3, 26.7.4)."""
    share = spare / (spare + DRIFTS * ratio)
    odd, sine = spare % 2, math.sqrt(1 - share)
    k = np.arange(2 + odd, spare - 1, 2)
    terms = sine * (1 + float(np.sum(np.cumprod((k - 1) / k * share))))
    below = 2 / math.pi * (math.asin(sine) + terms * math.sqrt(share)) if odd else terms
    logs = math.lgamma((spare + 1) / 2) - math.lgamma(spare / 2) - math.lgamma(0.5) + spare / 2 * math.log(share)
    return 1 - below + 2 * sine * math.exp(logs)


@dataclass(frozen=True, eq=False)
class ZeroDrift:
    """mps2 (3,): how far the zero moves over a session of duration_s, in the sensor's axes; covariance (3, 3); ratio: Fisher's F against
    a constant zero; spare: degrees of freedom that are left."""

    mps2: np.ndarray
    covariance: np.ndarray
    ratio: float
    spare: int
    duration_s: float

    @property
    def p_value(self) -> float:
        """Of a constant zero."""
        if self.ratio <= DRIFT_F:
            return _above(self.ratio, self.spare)
        from scipy.special import fdtrc  # late: hardly any zero drifts, and the import takes longer than all checks

        return float(fdtrc(DRIFTS, self.spare, self.ratio))

    @property
    def significant(self) -> bool:
        """Whether the recording shows it; else it is a bound."""
        return self.ratio > DRIFT_F and self.p_value < DRIFT_P

    @property
    def sigma_mps2(self) -> np.ndarray:
        """(3,) m/s^2 over the session."""
        return sigmas_in(self.covariance)

    @property
    def words(self) -> str:
        """``the zero drifts by -4.6 ± 0.4 mg on z within 600 s (p < 0.001)``: the most significant axis."""
        axis = int(np.argmax(np.abs(self.mps2) / self.sigma_mps2))
        size = f"{self.mps2[axis] / MG:+.2f} ± {self.sigma_mps2[axis] / MG:.2f} mg on {'xyz'[axis]}"
        return f"the zero drifts by {size} within {self.duration_s:.0f} s ({probability(self.p_value)})"

    def turned(self, before: Accelerometer) -> ZeroDrift:
        """The drift of what was measured, from that of the force which a calibration makes of it."""
        back = np.linalg.inv(before.matrix)
        return replace(self, mps2=back @ self.mps2, covariance=back @ self.covariance @ back.T)


def shares(middle_s: np.ndarray, duration_s: float) -> np.ndarray:
    """(S,) of moments (S,) s of a session: their share of it, from its middle."""
    return middle_s / duration_s - 0.5


@dataclass(frozen=True, eq=False)
class LengthFit:
    """accelerometer, from what was measured; x (9,): the correction that it is of the one before; covariance (9, 9) of x, SI; rung: which
    numbers were fitted, None where the attitudes fix none; attitudes that lie apart; weight (S,) of each still, 1 for a good one;
    before, after (S,) m/s^2: by how much each length misses gravity's; sigma_mps2 of one still; unobserved: names of numbers that these
    attitudes do not determine; drift of the zero, where the stills' times are given and enough stills are to spare.

    The covariance counts what the rung leaves alone, of its spread beforehand: in few attitudes it passes for the numbers that are fitted.
    """

    accelerometer: Accelerometer
    x: np.ndarray
    covariance: np.ndarray
    rung: Ladder | None
    attitudes: int
    weight: np.ndarray
    before: np.ndarray
    after: np.ndarray
    sigma_mps2: float
    unobserved: tuple[str, ...]
    drift: ZeroDrift | None = None

    @property
    def fixes_all(self) -> bool:
        """Whether the attitudes fix all nine numbers."""
        return self.rung is _RUNGS[0]

    @property
    def zero(self) -> tuple[np.ndarray, np.ndarray]:
        """(3,) m/s^2 in the sensor's axes, and its sigmas (3,)."""
        back = np.linalg.solve(self.accelerometer.matrix, matrix_of(self.x))  # of M0 in f = T (M0 (m - b0) - d)
        return self.accelerometer.bias_mps2, sigmas_in(back @ self.covariance[BIAS, BIAS] @ back.T)


def fit_lengths(
    force: np.ndarray,
    gravity_mps2: float,
    before: Accelerometer | None = None,
    gravity_sigma_mps2: float = 0.0,
    white_mps2: float = 0.0,
    middle_s: np.ndarray | None = None,
    duration_s: float = 0.0,
) -> LengthFit:
    """Of the stills' mean force (S, 3) m/s^2, under ``before`` (as measured without it), with gravity's length, known to a sigma.

    white_mps2: what white noise alone scatters a still's mean by; counts where few stills are to spare.  middle_s (S,): the stills'
    times in a session of duration_s; with them a drift of the zero is among the fitted numbers.  A few stills that are none
    hardly count.  Where the attitudes fix no number, the fit is ``before``.
    """
    before = before or Accelerometer(source="none")
    attitudes = attitudes_of(force)
    misses = np.linalg.norm(force, axis=1) - gravity_mps2
    for rung in _RUNGS:
        if attitudes < rung.count:
            continue
        fitted = _fitted(rung, force, gravity_mps2, white_mps2)
        if fitted is None:
            continue
        (x, left, weight, sigma, covariance), bar = fitted
        drift = None
        if middle_s is not None and len(force) - rung.count >= 2 * DRIFTS:
            moving = _with_drift(rung, x, bar, force, gravity_mps2, shares(middle_s, duration_s))
            if moving is not None:
                found, ratio, spare = moving
                drift = ZeroDrift(found[0][PARAMETERS:], found[-1][PARAMETERS:, PARAMETERS:], ratio, spare, duration_s)
                x, left, weight, sigma, covariance = found
                drift = drift.turned(before)
        x, covariance = x[:PARAMETERS], covariance[:PARAMETERS, :PARAMETERS]
        hidden = unobserved_of(x - IDENTITY, sigmas_in(covariance), gravity_mps2)
        # All lengths in common: the matrix as a whole, and nothing else.
        common = np.where(np.arange(PARAMETERS) < BIASES[0], x, 0.0) * gravity_sigma_mps2 / gravity_mps2
        covariance = covariance + np.outer(common, common)
        return LengthFit(after(x, before), x, covariance, rung, attitudes, weight, misses, left, sigma, hidden, drift)
    spread = np.diag((SPREAD_MPS2 * units(gravity_mps2)) ** 2)
    return LengthFit(before, IDENTITY.copy(), spread, None, attitudes, np.ones(len(force)), misses, misses, 0.0, NAMES)


def unobserved_of(size: np.ndarray, sigma: np.ndarray, gravity_mps2: float) -> tuple[str, ...]:
    """Names of the numbers, of this size (9,) and sigma (9,), that are not observed: no better known than beforehand, and perhaps none."""
    seen = (sigma < OBSERVED_BELOW * SPREAD_MPS2 * units(gravity_mps2)) | (np.abs(size) > SURE_SIGMAS * sigma)
    return tuple(name for name, ok in zip(NAMES, seen, strict=True) if not ok)


def attitudes_of(force: np.ndarray) -> int:
    """How many of the directions of force (S, 3) lie apart from all that were counted before them."""
    kept = np.zeros((0, 3))
    for row in force:
        length = np.linalg.norm(row)
        if length and (not len(kept) or np.max(kept @ row) < length * np.cos(APART_RAD)):
            kept = np.concatenate([kept, [row / length]])
    return len(kept)


#: x (9,), or (12,) with a drift; misses and weights (S,); sigma of one still; covariance of x
_Fitted = tuple[np.ndarray, np.ndarray, np.ndarray, float, np.ndarray]


def _fitted(rung: Ladder, force: np.ndarray, gravity_mps2: float, white_mps2: float) -> tuple[_Fitted, float] | None:
    """Without a drift.  None where the attitudes do not fix these numbers."""
    x, bar = _robust(rung, force, gravity_mps2)
    if not np.isfinite(x).all() or min(x[[0, 3, 5]]) <= 0:
        return None
    columns = _columns(x, force)
    if _gain(columns @ (rung.directions * _scale(rung, gravity_mps2))) > WORST_GAIN:
        return None
    left = _miss(x, force, gravity_mps2)
    sigma = _sigma(left, bar, rung.count, white_mps2)
    return (x, left, _weight(left, bar), sigma, _covariance(rung, columns, sigma, gravity_mps2)), bar


def _covariance(rung: Ladder, columns: np.ndarray, sigma: float, gravity_mps2: float) -> np.ndarray:
    """Covariance (n, n) of x, n = 9 or 12 with a drift, fitted along the rung's directions; columns (S, n) of misses, weighed.

        x - truth = D (X' X)^-1 X' e + (D (X' X)^-1 X' C - 1) delta,   X = C D,   delta: what the sensor is, of the spread beforehand

    The second term vanishes in the fitted directions.
    """
    scaled = rung.directions * _scale(rung, gravity_mps2)
    design = columns @ scaled
    inverse = np.linalg.inv(design.T @ design)
    spread = np.zeros(len(scaled))
    spread[:PARAMETERS] = SPREAD_MPS2 * units(gravity_mps2)
    missed = (scaled @ inverse @ design.T @ columns - np.eye(len(scaled))) * spread
    return scaled @ inverse @ scaled.T * sigma**2 + missed @ missed.T


def _with_drift(
    rung: Ladder, constant: np.ndarray, bar: float, force: np.ndarray, gravity_mps2: float, share: np.ndarray
) -> tuple[_Fitted, float, int] | None:
    """The fit with a drift, Fisher's F against none, and the degrees of freedom left; constant (9,) and its bar: the fit without a drift.

    Few stills scatter less about a robust fit than their errors are.  So both fits have the same weights: a still counts less where it
    misses both by as much as ``bar``.
    """
    # The same numbers and a drift of the zero: directions (12, K + 3).
    directions = np.zeros((PARAMETERS + DRIFTS, rung.count + DRIFTS))
    directions[:PARAMETERS, : rung.count], directions[PARAMETERS:, rung.count :] = rung.directions, np.eye(DRIFTS)
    moving = replace(rung, directions=directions)
    x, spare = np.concatenate([constant, np.zeros(DRIFTS)]), len(force) - moving.count
    for _ in range(ROUNDS):
        least = np.minimum(np.abs(_miss(constant, force, gravity_mps2)), np.abs(_miss(x, force, gravity_mps2, share)))
        weight = _weight(least, bar)
        constant = _least_squares(constant, weight, rung, force, gravity_mps2)
        before, x = x, _least_squares(x, weight, moving, force, gravity_mps2, share=share)
        if not np.isfinite(x).all():
            return None
        if np.abs(x - before).max() < SMALLEST_STEP * gravity_mps2:
            break
    root = np.sqrt(weight)
    columns = _columns(x, force, share) * root[:, None]
    if _gain(columns @ (moving.directions * _scale(moving, gravity_mps2))) > WORST_GAIN:
        return None
    left = _miss(x, force, gravity_mps2, share)
    with_it, without = float(np.sum((root * left) ** 2)), float(np.sum((root * _miss(constant, force, gravity_mps2)) ** 2))
    sigma = np.sqrt(with_it / spare)
    ratio = float(max(without - with_it, 0.0) / DRIFTS / max(sigma**2, np.finfo(float).tiny))
    return (x, left, weight, float(sigma), _covariance(moving, columns, float(sigma), gravity_mps2)), ratio, spare


def _scale(rung: Ladder, gravity_mps2: float) -> np.ndarray:
    """(K,) one m/s^2 of each direction in its own unit."""
    size = np.concatenate([units(gravity_mps2), np.ones(len(rung.directions) - PARAMETERS)])
    return np.asarray(size @ np.abs(rung.directions))


def _at_the_middle(x: np.ndarray, force: np.ndarray, share: np.ndarray | None) -> np.ndarray:
    """Forces (S, 3) without the drift."""
    return force if share is None else force - share[:, None] * x[PARAMETERS:]


def _columns(x: np.ndarray, force: np.ndarray, share: np.ndarray | None = None) -> np.ndarray:
    """As ``length_columns``, and those of a drift (S, 12)."""
    found = length_columns(x[:PARAMETERS], _at_the_middle(x, force, share))
    return found if share is None else np.concatenate([found, found[:, BIAS] * share[:, None]], axis=1)


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


def _sigma(miss: np.ndarray, bar: float, count: int, white_mps2: float) -> float:
    """m/s^2 of one still, such that sigma^2 (X' X)^-1 is the covariance of Cauchy's estimate (Huber 1981, equation 6.5).

    Where fewer stills are to spare than numbers are fitted, never less than their scatter is known to be beforehand.
    """
    spare = len(miss) - count
    least = float(np.hypot(WANDERS_MPS2, white_mps2)) if spare < count else 0.0
    if spare <= 0:
        return least
    u2 = (miss / bar) ** 2
    pull, slope = miss / (1 + u2), (1 - u2) / (1 + u2) ** 2
    mean = max(float(np.mean(slope)), 0.1)  # no estimate rests on a tenth of its stills
    small = 1 + count / len(miss) * float(np.var(slope)) / mean**2
    sigma = small * float(np.sqrt(np.sum(pull**2) / spare)) / mean
    # Of few, the weights make too little of what misses by more than the median does.
    return sigma if spare >= count else max(sigma, float(sigma_of(miss)) * np.sqrt(len(miss) / spare), least)


def _least_squares(
    x: np.ndarray,
    weight: np.ndarray,
    rung: Ladder,
    force: np.ndarray,
    gravity_mps2: float,
    steps: int = STEPS,
    share: np.ndarray | None = None,
) -> np.ndarray:
    """x (9,), or (12,) with the shares (S,) of the stills: Gauss-Newton steps with these weights (S,)."""
    root, scale = np.sqrt(weight), _scale(rung, gravity_mps2)
    for _ in range(steps):
        design = _columns(x, force, share) @ rung.directions * scale
        step = -np.linalg.lstsq(design * root[:, None], _miss(x, force, gravity_mps2, share) * root, rcond=None)[0]
        x = x + rung.directions @ (scale * step)
        if not np.abs(step).max(initial=0.0) > SMALLEST_STEP * gravity_mps2:
            break
    return x


def _miss(x: np.ndarray, force: np.ndarray, gravity_mps2: float, share: np.ndarray | None = None) -> np.ndarray:
    return np.linalg.norm(corrected(x[:PARAMETERS], _at_the_middle(x, force, share)), axis=1) - gravity_mps2


def _gain(design: np.ndarray) -> float:
    """m/s^2 of the worst number's sigma for one m/s^2 of independent noise in every still."""
    smallest = np.linalg.svd(design, compute_uv=False)[-1]
    return float(1 / smallest) if smallest > 0 else float("inf")


# The stills of whole logs.


def times_of(stills: Sequence[Sequence[Still]], samples: Sequence[Samples]) -> tuple[np.ndarray, float]:
    """(S,) s of the session at the middles of the stills of each log, and s that the session takes; logs follow each other."""
    began = start_times(samples)
    middles = [began[log] + still.start_s + still.duration_s / 2 for log, own in enumerate(stills) for still in own]
    return np.array(middles), float(began[-1])


def force_of(stills: Sequence[Still]) -> np.ndarray:
    """(S, 3) m/s^2: the mean specific force of each still."""
    return np.array([still.accel_mean for still in stills]).reshape(-1, 3)


def why_not(found: LengthFit) -> str:
    """What the attitudes of the stills do not fix of an accelerometer."""
    lie = f"{found.attitudes} attitude{'s' * (found.attitudes != 1)}"
    if found.attitudes < PARAMETERS:
        return f"the stills lie in {lie}, too few for an accelerometer's {PARAMETERS} numbers"
    return f"the {lie} of the stills do not fix an accelerometer's {PARAMETERS} numbers"


# A copy of a session folder, with the accelerometer's calibration that its own stills give.


def with_section(text: str, accelerometer: Accelerometer) -> str:
    """The text of a session.toml with this calibration of its own stills, 1e-9 and 1e-8 m/s^2 its last digits, put there or in the place of
    the one that is; nothing else is touched."""
    from tomlkit import parse

    rows = ", ".join("[" + ", ".join(f"{value:.9f}" for value in row) + "]" for row in accelerometer.matrix)
    bias = ", ".join(f"{value:.8f}" for value in accelerometer.bias_mps2)
    section = f"""\
[accelerometer]
# From the recording's own stills: in each of them the corrected force has gravity's length.
matrix = [{rows}]
bias_mps2 = [{bias}]
own_stills = true  # leave this line out where another recording is to have it as a prior

"""
    return edited(text, lambda document: document.update(parse(section)))


def write_calibrated_copy(folder: Path, out: Path, accelerometer: Accelerometer) -> None:
    """Copy the folder's files, not what was made of them (its sub-folders), and put the calibration into session.toml.

    Raises FormatError where ``out`` is there and not empty, and StorageError for a full disk.
    """
    require_empty(out, "is there already; give --out another folder, nothing is written over")
    if out.resolve().is_relative_to(folder.resolve()):
        raise FormatError(f"{out}: lies within the session folder; give --out another folder")
    with folder_whole(out) as work:
        for path in sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")):
            if path.name == "session.toml":
                write_new(work / path.name, with_section(read_text(path, MOST_TOML).replace("\r\n", "\n"), accelerometer))
            else:
                copy_new(path, work / path.name)
