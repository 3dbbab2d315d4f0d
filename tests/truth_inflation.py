"""The inflation of a recording with a truth (docs/measured/noise-inflation.md).

The integrated rate is compared with the truth over adjacent windows of tau.  The difference of the two errors, in body
axes at the moment that they share, has the Allan variance of the rate error

    3 r^2 / tau^2                                     each moment of truth errs by r, apart from all others
    s^2 (3 - 4 rho(tau) + rho(2 tau)) / tau^2         the truth's error wanders by s with the autocorrelation rho
    n^2 / tau                                         the gyroscope's white noise, whose angle has no bound
    k^2 tau / 3                                       its bias walk

with rho = exp(-t / c) or, where it is smooth, (1 + t / c) exp(-t / c), for times c an octave apart.  A truth errs by a bounded angle and
the gyroscope by one that grows, so windows of several lengths tell them apart.  Below c nothing does: a wandering truth is then white noise
of density s sqrt(2 / c).  What the windows do not tell apart, at 95 %, is put on the gyroscope: a filter that trusts it too little loses
less than one that trusts it too much.  The smallest n that they allow is stated beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from session.io.errors import DataError
from tinygc.annexes.noise.inflation import ONE_SIDED_95, _inflation, _rms, at_rest
from tinygc.attitude import rotation
from tinygc.noise.figures import Inflation, NoiseFigures


def end_differences(rate: np.ndarray, dt: np.ndarray, truth: np.ndarray, window: int, known: np.ndarray | None = None) -> np.ndarray:
    """Differences (n, 3) rad of the attitude errors of adjacent windows, in body axes at the moment that they share.

    rate (N, 3) rad/s, calibrated and without its mean bias; dt (N-1,) s; truth (N, 4) q_wb, world fixed; window: in samples; known (N,)
    bool: the samples at which the truth is one.  Windows with an unknown sample are left out.  They overlap by three quarters.
    """
    steps = rotation.steps(rate, dt)
    known = np.ones(len(rate), dtype=bool) if known is None else known
    unknown = np.concatenate([[0], np.cumsum(~known)])
    found = []
    for first in range(0, window, max(1, window // 4)):
        count = (len(steps) - first) // window
        if count < 2:
            continue
        begin = first + window * np.arange(count)
        turned = rotation.compose(steps[first : first + count * window].reshape(count, window, 4))
        true = rotation.multiply(rotation.conjugate(truth[begin]), truth[begin + window])
        end = rotation.log(rotation.multiply(rotation.conjugate(true), turned))
        start = rotation.log(rotation.multiply(turned, rotation.conjugate(true)))
        good = unknown[begin + window + 1] == unknown[begin]
        found.append((start[1:] - end[:-1])[good[1:] & good[:-1]])
    return np.concatenate(found) if found else np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Wander:
    """A wandering error of a truth: its correlation time; whether it is smooth (rho = (1 + t / c) exp(-t / c)) or not (exp(-t / c));
    sigma_rad (3,)."""

    time_s: float
    smooth: bool
    sigma_rad: np.ndarray

    def unit_allan_variance(self, tau_s: np.ndarray) -> np.ndarray:
        """Allan variance (K,) 1/s^2 of the rate, for an angle of 1 rad rms."""
        x = tau_s / self.time_s
        more = x if self.smooth else 0 * x
        return (3 - 4 * (1 + more) * np.exp(-x) + (1 + 2 * more) * np.exp(-2 * x)) / tau_s**2


@dataclass(frozen=True, eq=False)
class TruthDensities:
    """What the rate error against a truth is made of, for each axis.

    white2 (3,) rad^2/s: square of the gyroscope's white density beyond N, the largest that the windows allow (95 %), and with it walk (3,)
    rad/s/sqrt(s), truth_rad (3,), the error of each moment, and wanders, those that the truth then has; least2 (3,): the smallest square
    that they allow (95 %); tau_s (K,); allan, model (K, 3) (rad/s)^2; follows: whether the Allan variance is below N^2 / tau, so that the
    truth follows the gyroscope and is none.
    """

    white2: np.ndarray
    least2: np.ndarray
    walk: np.ndarray
    truth_rad: np.ndarray
    wanders: tuple[Wander, ...]
    tau_s: np.ndarray
    allan: np.ndarray
    model: np.ndarray
    follows: bool


#: sigmas by which the Allan variance is below that of N alone where the truth follows the gyroscope
FOLLOWS_SIGMAS = 4.0
#: a wandering truth's correlation time is at most this share of the longest window: beyond it nothing tells it from white noise
LONGEST_SHARE = 1 / 3
#: rounds of reweighting; the weights are those of the model's own Allan variances
ROUNDS = 12
#: of the interval that holds a limit
HALVINGS = 20


def truth_densities(tau_s: np.ndarray, allan: np.ndarray, freedom: np.ndarray, white: np.ndarray) -> TruthDensities:
    """Densities from Allan variances (K, 3) (rad/s)^2 of the rate error at tau_s (K,) s, each with ``freedom`` (K,) degrees of freedom.

    white (3,): N at rest, which the gyroscope has in any case.  The likelihood is that of independent gamma-distributed variances; those of
    neighbouring windows are not, so the limit is somewhat low.
    """
    times = np.exp(np.arange(np.log(tau_s[0]), np.log(LONGEST_SHARE * tau_s[-1]), np.log(2)))
    bank = [Wander(float(time), smooth, np.ones(3)) for time in times for smooth in (False, True)]
    columns = np.column_stack([3 / tau_s**2, tau_s / 3, *(each.unit_allan_variance(tau_s) for each in bank)])
    known = white**2 / tau_s[:, None]
    squares, model = np.zeros((3, columns.shape[1])), np.zeros(allan.shape)
    white2, least2 = np.zeros(3), np.zeros(3)
    for axis in range(3):
        data = allan[:, axis]
        best, _, least = _variances(np.column_stack([1 / tau_s, columns]), data, freedom, known[:, axis])
        # The profile's limits: more white noise or less, all else estimated anew.
        limits = []
        for outside in (float(np.max(data * tau_s)), 0.0):
            inside = best[0]
            for _ in range(HALVINGS):
                middle = (inside + outside) / 2
                loss = _variances(columns, data, freedom, known[:, axis] + middle / tau_s)[2]
                inside, outside = (inside, middle) if 2 * (loss - least) > ONE_SIDED_95**2 else (middle, outside)
            limits.append(inside)
        white2[axis], least2[axis] = limits
        squares[axis], model[:, axis], _ = _variances(columns, data, freedom, known[:, axis] + white2[axis] / tau_s)
    shown = [i for i in range(len(bank)) if squares[:, 2 + i].any()]
    return TruthDensities(
        white2,
        least2,
        np.sqrt(squares[:, 1]),
        np.sqrt(squares[:, 0]),
        tuple(Wander(bank[i].time_s, bank[i].smooth, np.sqrt(squares[:, 2 + i])) for i in shown),
        tau_s,
        allan,
        model,
        bool(np.any(allan < known * (1 - FOLLOWS_SIGMAS * np.sqrt(2 / freedom[:, None])))),
    )


def _variances(columns: np.ndarray, data: np.ndarray, freedom: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Variances (C,), 0 or more, of columns (K, C) beside known ones (K,); the model (K,); minus the logarithm of its likelihood."""
    best, model = (np.zeros(columns.shape[1]), known, np.inf), np.maximum(data, known)
    for _ in range(ROUNDS):
        weight = np.sqrt(freedom / 2) / model
        scaled = columns * weight[:, None]
        size = np.linalg.norm(scaled, axis=0)
        found = nnls(scaled / size, (data - known) * weight)[0] / size
        model = known + columns @ found
        loss = float(np.sum(freedom / 2 * (np.log(model) + data / model)))
        if loss < best[2]:
            best = found, model, loss
    return best


def truth_inflation(
    rate: np.ndarray,
    dt: np.ndarray,
    truth: np.ndarray,
    figures: NoiseFigures,
    windows: Sequence[int],
    motion: str,
    known: np.ndarray | None = None,
) -> tuple[Inflation, TruthDensities]:
    """The inflation on the motion of a recording with a truth: arguments as ``end_differences``, with several windows in samples.

    Raises DataError where the truth follows the gyroscope or no two windows are known, and as ``at_rest``.
    """
    rest = at_rest(figures)
    assert rest.walk_density is not None
    period_s, kept = float(np.median(dt)), []
    for window in sorted(windows):
        difference = end_differences(rate, dt, truth, window, known)
        # Three quarters of overlap give little more than windows side by side.
        freedom = len(difference) / len(range(0, window, max(1, window // 4)))
        if freedom >= 4:
            kept.append((window * period_s, np.mean(difference**2, axis=0) / (2 * (window * period_s) ** 2), freedom))
    if len(kept) < 4:
        raise DataError(f"{motion}: {len(kept)} window lengths have four windows of known truth each, expected 4; give a longer truth")
    tau_s, allan, freedom_of = (np.array(each) for each in zip(*kept, strict=True))
    N = figures.gyro.values("N")
    found = truth_densities(tau_s, allan, freedom_of, N)
    if found.follows:
        raise DataError(f"{motion}: the truth follows the gyroscope closer than its noise at rest allows; give one of another sensor")
    walk = np.maximum(found.walk, rest.walk_density)
    least = _rms(np.sqrt(1 + found.least2 / N**2))
    source = f"a truth of {len(rate) * period_s:.0f} s, windows {tau_s[0]:.2g} to {tau_s[-1]:.2g} s; no less than {least:.2f}"
    return _inflation(figures, motion, {"motion": found.white2}, np.zeros(3), np.zeros(3), walk, source), found
