"""Scale of each axis and sense, the table's play, and turns that miss, from measured and stated angles.

    measured_i = (1 + s_group) A_i + T_i d_axis + e_i,      e_i ~ N(0, v_i + stop_i^2 + play^2 + (repeat A_i)^2 + share^2 vibration_i)

A_i is the stated angle, v_i the gyroscope's own variance (``angles.py``), stop_i the sigma that turns.csv states, d_axis a rate that
rounding hides.  ``play`` is an error that each turn has, whatever its angle: a table's backlash, a stop.  ``repeat`` is one that grows with
the angle: the scale itself does not repeat.  Turns of several angles separate the two.  ``share`` is how much of the vibration that the
data rate cannot follow is left in an angle: all of it if readings are wrong independently, little if a motor's steps come evenly.

Play, repeat and share are not known: everything is averaged over a grid of them, each point weighed with its restricted likelihood (s and
d integrated out, which is what REML maximises) and with a prior: perhaps none, else alike on a logarithmic scale, Jeffreys' prior of a
scale, up to ten times the known error.  So sigmas of few turns are as wide as Student's t has them.

A turn is good, or lost: then its angle may be anything from 0 to twice the stated one.  Before the data one turn in a hundred is lost.
A turn is left out where, given the others, it is ten times as probable to be lost as to be good: turns change sides one at a time, from two
beginnings, until none has a reason to, and of two ends the more probable one counts.  With known errors that is from some 5.2 sigmas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc, logsumexp, ndtr

from session.base.numeric import running_sum, sigma_of, sigmas_in
from tinygc.estimation.between_sessions import ONE_SIGMA
from tinygc.features.turns.angles import TurnAngle

#: probability that a turn is lost, before the data
LOST = 0.01
#: times as probable as that it is good: from then on a turn is left out
SURE = 10.0
#: one sigma of a scale factor error before the data: 20 %, as for every linear model here
SCALE_SIGMA = 0.2
#: times the known error: a play that is larger is less probable, and a turn that misses by more than the others is rather lost
KNEE = 10.0
#: of play, repeat and share of vibration: the probability before the data that there is any, as a table has play more often than a scale
#: changes between two turns; sizes from and to, in units of the known error or of all the vibration; points of the grid, and none
PRIORS = ((0.8, (0.1, 200.0), 12), (0.2, (0.1, 200.0), 12), (0.8, (0.03, 1.0), 6))
#: of the heaviest size: what weighs less is left out of the next, finer grid; how many grids there are
NEGLIGIBLE, GRIDS = 1e-4, 3
#: turns of one log whose common rests are taken into account together
BLOCK = 40
#: a point of the grid that weighs less is left out
NO_WEIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class Component:
    """An error of unknown size, rad or 1: its median, and the limits of 68 % and 95 % of its distribution; estimated: whether turns
    repeat, so that it shows."""

    median: float
    low: float
    high: float
    upper: float
    estimated: bool


@dataclass(frozen=True, eq=False)
class TurnsEstimate:
    """groups: (axis, sense) of each scale; scale (G,) and covariance (G, G) of measured / true - 1; turns of each group that are used;
    residual_rad (n,) of all turns, NaN without a scale, and predicted_rad (n,), one sigma of it; lost (n,): probability that it is lost,
    NaN of those that could not be measured; used (n,) bool; play and repeat; chi2 with the stated errors alone, dof, p."""

    groups: tuple[tuple[int, int], ...]
    scale: np.ndarray
    covariance: np.ndarray
    turns: tuple[int, ...]
    residual_rad: np.ndarray
    predicted_rad: np.ndarray
    lost: np.ndarray
    used: np.ndarray
    play: Component
    repeat: Component
    chi2: float
    dof: int
    p_value: float


@dataclass(frozen=True, eq=False)
class _Data:
    """Of n measured turns: r (n,) measured less stated; A (n,) stated; J (n, p) columns of scales and hidden rates, in units of their
    prior sigmas (p,); known (n,) variance of gyroscope and stop, vibration (n,) at most; coupled: rows of a log and their covariances
    (m, m) without variances, where turns share rests; group (n,)."""

    r: np.ndarray
    A: np.ndarray
    J: np.ndarray
    prior: np.ndarray
    known: np.ndarray
    vibration: np.ndarray
    coupled: list[tuple[np.ndarray, np.ndarray]]
    group: np.ndarray


def estimate(angles: Sequence[TurnAngle]) -> TurnsEstimate:
    """The estimate from all turns; those with a problem are not used."""
    measured = [i for i, angle in enumerate(angles) if angle.problem is None]
    groups = tuple(sorted({(angles[i].axis, angles[i].sense) for i in measured}, key=lambda group: (group[0], -group[1])))
    data = _data([angles[i] for i in measured], groups)
    good, odds, grid = _sound(data)
    points, weights, means, covariances = _posterior(data, good, grid)
    mean = weights @ means
    spread = np.einsum("k,kij->ij", weights, covariances) + np.einsum("k,ki,kj->ij", weights, means - mean, means - mean)
    width = [_half_width(weights, means[:, j], np.sqrt(covariances[:, j, j])) for j in range(len(mean))]
    rescale = np.array(width) / sigmas_in(spread)
    covariance = spread * np.outer(rescale, rescale)
    error = weights @ _variance(data, points)
    inside = np.einsum("ij,jk,ik->i", data.J, covariance, data.J)
    predicted = np.sqrt(np.where(good, np.maximum(error - inside, 0), error + inside))
    kept = [g for g in range(len(groups)) if (good & (data.group == g)).any()]
    with_scale = np.isin(data.group, kept)
    chi2, dof = _chi_square(data, good)

    def of_all(values: np.ndarray) -> np.ndarray:
        found = np.full(len(angles), np.nan)
        found[measured] = values
        return found

    used = np.zeros(len(angles), dtype=bool)
    used[measured] = good
    unit = data.prior[kept]
    return TurnsEstimate(
        tuple(groups[g] for g in kept),
        mean[kept] * unit,
        covariance[np.ix_(kept, kept)] * np.outer(unit, unit),
        tuple(int((good & (data.group == g)).sum()) for g in kept),
        of_all(np.where(with_scale, data.r - data.J @ mean, np.nan)),
        of_all(np.where(with_scale, predicted, np.nan)),
        of_all(1 / (1 + np.exp(np.clip(odds, -700, 700)))),
        used,
        _component(weights, points[:, 0], grid.sizes[0], dof > 0),
        _component(weights, points[:, 1], grid.sizes[1], dof > 0),
        chi2,
        dof,
        float(chdtrc(dof, chi2)) if dof else float("nan"),
    )


def _data(angles: Sequence[TurnAngle], groups: tuple[tuple[int, int], ...]) -> _Data:
    n = len(angles)
    A = np.array([angle.stated_rad for angle in angles])
    r = np.array([angle.measured_rad for angle in angles]) - A
    group = np.array([groups.index((angle.axis, angle.sense)) for angle in angles], dtype=int)
    columns = [np.where(group == g, A, 0.0) * SCALE_SIGMA for g in range(len(groups))]
    prior = [SCALE_SIGMA] * len(groups)
    for axis in range(3):
        hidden = [angle.shared_rps2 for angle in angles if angle.axis == axis]
        if hidden and (sigma := float(np.sqrt(np.mean(hidden)))) > 0:
            columns.append(np.array([-angle.sense * angle.duration_s * sigma if angle.axis == axis else 0.0 for angle in angles]))
            prior.append(sigma)
    known = np.array([angle.gyro_variance + angle.turn.sigma_rad**2 for angle in angles])
    vibration = np.array([angle.variance["vibration"] for angle in angles])
    by_log: dict[str, list[int]] = {}
    for i, angle in enumerate(angles):
        by_log.setdefault(angle.log, []).append(i)
    parts = [part for rows in by_log.values() for part in np.array_split(rows, -(-len(rows) // BLOCK))]
    coupled = [(part, matrix) for part in parts if np.any(matrix := _shared_rests(part, angles))]
    return _Data(r, A, np.column_stack(columns) if n else np.zeros((0, 0)), np.array(prior), known, vibration, coupled, group)


def _shared_rests(rows: np.ndarray, angles: Sequence[TurnAngle]) -> np.ndarray:
    """Covariances of turns of one log, without their variances, by the rests that neighbours about one axis have in common."""
    matrix = np.zeros((len(rows), len(rows)))
    for a, i in enumerate(rows):
        for b, j in enumerate(rows[:a]):
            if angles[i].axis == angles[j].axis:
                shared = [x * y * v for x_rest, x, v in angles[i].rests for y_rest, y, _ in angles[j].rests if x_rest == y_rest]
                matrix[a, b] = matrix[b, a] = sum(shared)
    return matrix


@dataclass(frozen=True, eq=False)
class _Grid:
    """Play, repeat and share of vibration: none, or one of sizes (S,) of each, in units of its own, alike before the data on a logarithmic
    scale from the least, and beyond KNEE falling as the square."""

    units: tuple[float, ...]
    sizes: tuple[np.ndarray, ...]

    @classmethod
    def whole(cls, data: _Data) -> _Grid:
        """From a tenth of the known errors to 200 times these."""
        sigma = np.sqrt(data.known)
        return cls(
            (float(np.median(sigma)), float(np.median(sigma / data.A)), 1.0), tuple(np.geomspace(*ends, count) for _, ends, count in PRIORS)
        )

    @cached_property
    def points(self) -> np.ndarray:
        """(K, 3), SI: all combinations."""
        axes = [np.append(0.0, own * unit) for own, unit in zip(self.sizes, self.units, strict=True)]
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)

    @cached_property
    def prior(self) -> np.ndarray:
        """(K,) logarithm of the probability of each, as far as it is not beyond the sizes."""
        parts = []
        for own, (there, (least, most), _) in zip(self.sizes, PRIORS, strict=True):
            whole = np.log(most / least) - np.log((1 + (most / KNEE) ** 2) / (1 + (least / KNEE) ** 2)) / 2  # the integral
            parts.append(np.log(np.append(1 - there, there * np.gradient(np.log(own)) / (1 + (own / KNEE) ** 2) / whole)))
        play, repeat, share = parts
        return (play[:, None, None] + repeat[:, None] + share).ravel()

    def finer(self, weights: np.ndarray) -> _Grid:
        """As many sizes where weights (K,) are not negligible, and a size on either side."""
        cube, sizes = weights.reshape([len(own) + 1 for own in self.sizes]), []
        for k, own in enumerate(self.sizes):
            mass = cube.sum(axis=tuple({0, 1, 2} - {k}))[1:]
            heavy = np.flatnonzero(mass > NEGLIGIBLE * mass.max())
            sizes.append(np.geomspace(own[max(heavy[0] - 1, 0)], own[min(heavy[-1] + 1, len(own) - 1)], len(own)))
        return replace(self, sizes=tuple(sizes))


def _variance(data: _Data, grid: np.ndarray) -> np.ndarray:
    """(K, n) rad^2 of each turn at each point of the grid (K, 3)."""
    play, repeat, share = grid.T[:, :, None] ** 2
    return np.asarray(data.known + play + repeat * data.A**2 + share * data.vibration)


def _fits(data: _Data, good: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """For each of K points, with independent turns: variance (K, n), log of the restricted likelihood (K,) of the good ones, residual
    (K, n) and leverage (K, n), as a variance, of all."""
    variance = _variance(data, grid)
    information, pull, squares = _normal_equations(data, good, variance, [])
    inverse = np.linalg.inv(information)
    beta = np.einsum("kij,kj->ki", inverse, pull)
    square = np.log(2 * np.pi * variance) @ good + squares - np.sum(pull * beta, axis=1)
    leverage = np.einsum("kni,ni->kn", data.J @ inverse, data.J, optimize=True)
    return variance, -0.5 * (square + np.linalg.slogdet(information)[1]), data.r - beta @ data.J.T, leverage


def _sound(data: _Data) -> tuple[np.ndarray, np.ndarray, _Grid]:
    """Which turns (n,) are good, the logarithm of each one's odds to be good given the others, and a grid that is fine where they need
    it."""
    n = len(data.r)
    lost = np.log(LOST / (1 - LOST)) - np.log(2 * data.A)
    grid = _Grid.whole(data)

    def odds(good: np.ndarray) -> tuple[float, np.ndarray]:
        variance, value, residual, leverage = _fits(data, good, grid.points)
        # Of a good turn the prediction from the others: its own weight is taken out of the fit.
        own = np.where(good, 1 - leverage / variance, 1.0)
        error = np.where(good, variance / own, variance + leverage)
        own_value = -0.5 * (np.log(2 * np.pi * error) + (residual / own) ** 2 / error)
        weighed = grid.prior + value
        total = logsumexp(weighed)
        without = logsumexp(weighed[:, None] - own_value, axis=0)
        others = logsumexp(weighed[:, None] + own_value, axis=0)
        return float(total + lost[~good].sum()), np.where(good, total - without, others - total) - lost

    def climbed(good: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        evidence, each = odds(good)
        for _ in range(4 * n):
            gain = np.where(good, -each, each) + np.where(good, -1, 1) * np.log(SURE)
            flip = int(np.argmax(gain))
            if gain[flip] <= 1e-9:
                break
            good = good.copy()
            good[flip] = not good[flip]
            evidence, each = odds(good)
        return evidence, good, each

    _, good, each = max((climbed(begin) for begin in (np.ones(n, dtype=bool), _near_the_median(data))), key=lambda found: found[0])
    for _ in range(GRIDS - 1):
        weighed = grid.prior + _fits(data, good, grid.points)[1]
        grid = grid.finer(np.exp(weighed - weighed.max()))
        _, good, each = climbed(good)
    return good, each, grid


def _near_the_median(data: _Data) -> np.ndarray:
    """(n,) bool: turns within six robust sigmas of the median scale of their group."""
    off = data.r / data.A
    for g in np.unique(data.group):
        off[data.group == g] -= np.median(off[data.group == g])
    off = off * data.A / np.sqrt(data.known)
    return np.asarray(np.abs(off) <= 6 * max(float(sigma_of(off)), 1.0))


def _normal_equations(
    data: _Data, good: np.ndarray, variance: np.ndarray, coupled: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information (K, p, p) with the prior, pull (K, p) and sum of squares (K,) of the good turns, of variance (K, n) rad^2; coupled: turns
    that share rests, as of the data, or none."""
    alone = good.copy()
    for rows, _ in coupled:
        alone[rows] = False
    w = np.where(alone, 1 / variance, 0.0)
    information = np.eye(data.J.shape[1]) + np.einsum("kn,nij->kij", w, data.J[:, :, None] * data.J[:, None], optimize=True)
    pull, square = (w * data.r) @ data.J, (w * data.r) @ data.r
    for rows, matrix in coupled:
        own = rows[good[rows]]
        C = matrix[np.ix_(good[rows], good[rows])] + variance[:, own, None] * np.eye(len(own))
        columns = np.column_stack([data.J[own], data.r[own]])
        product = columns.T @ np.linalg.solve(C, np.broadcast_to(columns, (len(variance), *columns.shape)))
        information, pull, square = information + product[:, :-1, :-1], pull + product[:, :-1, -1], square + product[:, -1, -1]
    return information, pull, square


def _posterior(data: _Data, good: np.ndarray, grid: _Grid) -> tuple[np.ndarray, ...]:
    """The points that count (K, 3), their weights (K,), and means (K, p) and covariances (K, p, p) of the parameters, in units of their
    priors.

    The weights are those of independent turns; means and covariances know of rests that turns share.  Where no turn repeats, no play
    shows, and all the vibration counts.
    """
    if good.sum() <= len(np.unique(data.group[good])):
        points, weights = np.array([[0.0, 0.0, 1.0]]), np.ones(1)
    else:
        weighed = grid.prior + _fits(data, good, grid.points)[1]
        weights = np.exp(weighed - logsumexp(weighed))
        points, weights = grid.points[weights > NO_WEIGHT], weights[weights > NO_WEIGHT]
    information, pull, _ = _normal_equations(data, good, _variance(data, points), data.coupled)
    covariances = np.linalg.inv(information)
    return points, weights / weights.sum(), np.einsum("kij,kj->ki", covariances, pull), covariances


def _half_width(weights: np.ndarray, means: np.ndarray, sigmas: np.ndarray) -> float:
    """Half of the central interval about the mean that holds as much of the mixture of normals as one sigma of a normal does."""
    centre, low, high = float(weights @ means), 0.0, float(20 * sigmas.max() + np.ptp(means))
    for _ in range(80):
        half = (low + high) / 2
        held = float(weights @ (ndtr((centre + half - means) / sigmas) - ndtr((centre - half - means) / sigmas)))
        low, high = (half, high) if held < ONE_SIGMA else (low, half)
    return (low + high) / 2


def _component(weights: np.ndarray, values: np.ndarray, sizes: np.ndarray, repeats: bool) -> Component:
    """Of the weights of points (K,) of the grid, with their values (K,) of sizes (S,); each stands for all that are nearest to it."""
    if not repeats:
        return Component(np.nan, np.nan, np.nan, np.nan, False)
    at, which = np.unique(values, return_inverse=True)
    mass, half = np.bincount(which, weights), np.sqrt(sizes[1] / sizes[0])
    none = float(mass[at == 0].sum())
    if (at == 0).all():
        return Component(0.0, 0.0, 0.0, 0.0, True)
    at, mass = at[at > 0], mass[at > 0]
    edges, below = np.concatenate([[at[0] / half], at * half]), none + running_sum(mass)
    median, low, high, upper = (float(np.interp(share, below, edges)) if share > none else 0.0 for share in (0.5, 0.1587, 0.8413, 0.95))
    return Component(median, low, high, upper, True)


def _chi_square(data: _Data, good: np.ndarray) -> tuple[float, int]:
    """Of the good turns with the errors that are stated and the gyroscope's own, and its degrees of freedom."""
    dof = int(good.sum()) - len(np.unique(data.group[good]))
    if dof <= 0:
        return 0.0, 0
    information, pull, square = _normal_equations(data, good, _variance(data, np.zeros((1, 3))), data.coupled)
    return float(square[0] - pull[0] @ np.linalg.solve(information[0], pull[0])), dof
