"""Mean, drift, spread and repeatability of a lot, without measurement noise (docs/lots.md)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc, gammaln, logsumexp, stdtr

from session.io.numeric import MEDIAN_SIGMAS
from tinygc.annexes.lots.lot import COUNT, LotSessions, UnitChunk

# One pass over a lot: all units' contribution to mean, spread and repeatability, given the current estimate (EM, REML).
#
#     y_us = X_u beta + b_u + v_us + e_us     b_u ~ (0, Sigma / w_u)     v_us ~ N(0, V)     e_us ~ N(0, R_us), as stated
#
# X_u beta is the mean and its drift through production. w_u has the gamma distribution that makes units and their noise Student's t. A unit
# that does not belong has one number, or all of them, several times as far off; each unit is weighted by its probability of belonging. beta
# has no prior, so its degrees of freedom are accounted for: Sigma is the restricted likelihood's.

#: factors by which a number of a unit that does not belong is off, in spreads: equally probable
OFF_SCALES = np.array([5.0, 15.0, 50.0])
#: p-value of a repeated session, against the unit's others, below which it does not count for repeatability
BAD_SESSION_P = 1e-4
#: fewest units for outliers: with fewer, the outlying one is not identifiable
FEWEST_JUDGED = 10
#: most units for the exact restricted likelihood; beyond, the mean's uncertainty is shared out by the mean weight
EXACT_UNITS = 3000


@dataclass(frozen=True, eq=False)
class Belief:
    """Current estimate, in scales about the centre.

    beta (2, 21), mean at the middle of production and drift over all of it; beta_covariance (42, 42); spread Sigma (21, 21) of the t
    distribution's normal, not its covariance; repeatability V (21, 21); tails, degrees of freedom; off, the share of units that do not
    belong.
    """

    beta: np.ndarray
    beta_covariance: np.ndarray
    spread: np.ndarray
    repeatability: np.ndarray
    tails: float = np.inf
    off: float = 0.01


@dataclass(eq=False)
class Sums:
    """Sums over the units so far.

    weights, beta's normal equations, Sigma's and V's moments, twice Fisher's information of their variances, and of each unit its squared
    distance delta, the number of its known values, and the probability that it belongs.
    """

    belongs: float = 0.0
    information: np.ndarray = field(default_factory=lambda: np.zeros((2 * COUNT, 2 * COUNT)))
    right: np.ndarray = field(default_factory=lambda: np.zeros(2 * COUNT))
    outer: np.ndarray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    weight: np.ndarray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    repeated: np.ndarray = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    repeats: float = 0.0
    spread_info: np.ndarray = field(default_factory=lambda: np.zeros(COUNT))
    repeat_info: np.ndarray = field(default_factory=lambda: np.zeros(COUNT))
    delta: list = field(default_factory=list)
    told: list = field(default_factory=list)
    member: list = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Combined:
    """Each unit's sessions combined: y (U, 21) and noise (U, 21, 21), V in it.

    precision (S, 21, 21) of each session of the units with more than one, and which sessions those are (S,).
    """

    y: np.ndarray
    noise: np.ndarray
    precision: np.ndarray
    several: np.ndarray


def combined(chunk: UnitChunk, repeatability: np.ndarray) -> Combined:
    """Combine the sessions of each unit, weighted by their stated covariance and the repeatability."""
    noise = chunk.noise + repeatability
    more = chunk.count > 1
    unit = np.repeat(np.arange(len(chunk.count)), chunk.count)
    rows = np.flatnonzero(more[unit])
    y, whole = chunk.y[chunk.first].copy(), noise[chunk.first].copy()
    precision = np.linalg.inv(noise[rows]) if len(rows) else np.empty((0, COUNT, COUNT))
    if len(rows):
        starts = np.concatenate([[0], np.cumsum(chunk.count[more])[:-1]])
        whole[more] = np.linalg.inv(np.add.reduceat(precision, starts))
        pulled = np.add.reduceat(np.einsum("sij,sj->si", precision, chunk.y[rows]), starts)
        y[more] = np.einsum("uij,uj->ui", whole[more], pulled)
    return Combined(y, whole, precision, rows)


def log_density(delta: np.ndarray, told: np.ndarray, tails: float) -> np.ndarray:
    """Return (U,), log density of Student's t in ``told`` numbers at a squared distance, without the determinant."""
    if np.isinf(tails):
        return -0.5 * delta - 0.5 * told * np.log(2 * np.pi)
    shape = gammaln((tails + told) / 2) - gammaln(tails / 2) - 0.5 * told * np.log(tails * np.pi)
    return shape - 0.5 * (tails + told) * np.log1p(delta / tails)


def membership(delta: np.ndarray, told: np.ndarray, pulled: np.ndarray, W: np.ndarray, belief: Belief) -> np.ndarray:
    """Return (U,): the probability that a unit belongs, against one number, or all of them, being ``OFF_SCALES`` times as far off."""
    alone = log_density(delta, told, belief.tails)
    size = OFF_SCALES[:, None, None] ** 2 * np.diag(belief.spread)
    share = size * np.einsum("uii->ui", W)
    one = log_density(delta[None, :, None] - pulled**2 * size / (1 + share), told[None, :, None], belief.tails) - 0.5 * np.log1p(share)
    every = log_density(delta / OFF_SCALES[:, None] ** 2, told, belief.tails) - told * np.log(OFF_SCALES)[:, None]
    off = np.logaddexp(logsumexp(one, axis=(0, 2)) - np.log(one.shape[0] * one.shape[2]), logsumexp(every, axis=0) - np.log(len(every)))
    odds = np.log(belief.off / 2) - np.log1p(-belief.off) + off - alone
    return 1 / (1 + np.exp(np.minimum(odds, 700)))


def add(sums: Sums, chunk: UnitChunk, belief: Belief, units: int) -> None:
    """Add a chunk's units to the sums; units: total number."""
    of = combined(chunk, belief.repeatability)
    W = np.linalg.inv(of.noise + belief.spread)
    along = chunk.place - 0.5
    r = of.y - belief.beta[0] - along[:, None] * belief.beta[1]
    pulled = (W @ r[..., None])[..., 0]
    delta = np.einsum("ui,ui->u", pulled, r)
    t_weight = np.ones(len(r)) if np.isinf(belief.tails) else (belief.tails + chunk.told) / (belief.tails + delta)
    member = membership(delta, chunk.told, pulled, W, belief) if units >= FEWEST_JUDGED else np.ones(len(r))
    powers = np.stack([np.ones_like(along), along, along**2])
    m0, m1, m2 = ((powers * member * t_weight) @ W.reshape(len(W), -1)).reshape(3, COUNT, COUNT)
    sums.information += np.block([[m0, m1], [m1, m2]])
    back = (W @ of.y[..., None])[..., 0] * (member * t_weight)[:, None]
    sums.right += np.concatenate([back.sum(axis=0), (along[:, None] * back).sum(axis=0)])
    sums.outer += (pulled * (member * t_weight)[:, None]).T @ pulled
    g0 = (member @ W.reshape(len(W), -1)).reshape(COUNT, COUNT)
    sums.weight += g0
    sums.spread_info += np.sum(member[:, None] / (np.einsum("uii->ui", of.noise) + np.diag(belief.spread)) ** 2, axis=0)
    K = belief.beta_covariance.reshape(2, COUNT, 2, COUNT)
    K00, K01, K11 = K[0, :, 0], K[0, :, 1] + K[1, :, 0], K[1, :, 1]
    if units <= EXACT_UNITS:
        of_mean = K00 + along[:, None, None] * K01 + along[:, None, None] ** 2 * K11
        sums.outer += ((member * t_weight) @ (W @ of_mean @ W).reshape(len(W), -1)).reshape(COUNT, COUNT)
    else:
        per = g0 / max(member.sum(), 1e-9)
        sums.outer += per @ (K00 * member.sum() + K01 * (member @ along) + K11 * (member @ along**2)) @ per
    sums.belongs += member.sum()
    sums.delta.append(delta)
    sums.told.append(chunk.told)
    sums.member.append(member)
    if len(of.several):
        _repeats(sums, chunk, of, W, pulled, member, belief)


def _repeats(sums: Sums, chunk: UnitChunk, of: Combined, W: np.ndarray, pulled: np.ndarray, member: np.ndarray, belief: Belief) -> None:
    """Add V's moments, from the units with more than one session."""
    unit = np.repeat(np.arange(len(chunk.count)), chunk.count)[of.several]
    along = chunk.place - 0.5
    z = belief.beta[0] + along[:, None] * belief.beta[1] + pulled @ belief.spread
    doubt = belief.spread - belief.spread @ W @ belief.spread
    d = chunk.y[of.several] - z[unit]
    V = belief.repeatability
    gain = V @ of.precision
    left = np.einsum("sij,sj->si", gain, d)
    moved = gain @ doubt[unit] @ gain.swapaxes(1, 2) + V - gain @ V
    told = (np.einsum("sii->si", chunk.noise[of.several]) < 1e7).sum(axis=1)
    # The session has its part in the unit's estimate: what is left of it varies by less than the session itself.
    total = np.linalg.inv(np.linalg.inv(of.precision) - doubt[unit])
    far = np.einsum("si,sij,sj->s", d, total, d)
    keep = member[unit] * (chdtrc(told, far) > BAD_SESSION_P)
    sums.repeated += (left * keep[:, None]).T @ left + (keep @ moved.reshape(len(moved), -1)).reshape(COUNT, COUNT)
    sums.repeats += keep.sum()
    variance = np.einsum("sii->si", chunk.noise[of.several]) + np.diag(V)
    more = chunk.count[unit]
    sums.repeat_info += np.sum((keep * (more - 1) / more)[:, None] / variance**2, axis=0)


# Mean, drift, spread and repeatability of a lot, without the measurement noise of single sessions (docs/lots.md).
#
# A pass is ``add`` over all chunks. A large lot starts with a part of it, then a larger one: all of it is needed only for the last digits.

#: units of the first, smaller lot, and the growth factor of the following ones
BEGIN_UNITS, GROWTH = 1500, 8
#: most passes; over a part of the units, and over all of more than a part
MOST_PASSES, LAST_PASSES = 400, 9
#: convergence: change of every number below this share of its own sigma
SETTLED = 0.1
#: p-value of the likelihood ratio between tails and none, below which tails are used: one lot of a hundred by chance
TAILS_P = 0.01
#: fewest degrees of freedom: below, the covariance is meaningless
LEAST_TAILS = 2.5
#: p-value of a drift of any number (over all of them) below which it is included in the mean of the next unit
DRIFT_P = 0.01
#: passes before an extrapolation; largest ratio of successive steps, and largest extrapolation of a variance's logarithm
LEAP_AFTER, FASTEST, LEAP = 3, 0.97, 1.5
#: limit of an extrapolation relative to the last one, so that oscillation decays
TIRED = 0.9
_LEAST = 1e-9


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Estimates of a lot, SI, in the order of ``NAMES``, NaN where unknown.

    mean (21,) at the middle of production and mean_covariance (21, 21); drift (21,) from the first unit to the last, drift_covariance;
    drift_p, that none of them drifts; next_mean (21,) and next_covariance of the next unit's, with the drift if it is significant (drifts);
    spread (21, 21), covariance between units; spread_freedom (21,): its variances' degrees of freedom of chi-square; tails; repeatability
    (21, 21); off: share of units that do not belong; belongs (U,): the probability that each does; belief: the same in scales; whether
    settled.
    """

    mean: np.ndarray
    mean_covariance: np.ndarray
    drift: np.ndarray
    drift_covariance: np.ndarray
    drift_p: float
    drifts: bool
    next_mean: np.ndarray
    next_covariance: np.ndarray
    spread: np.ndarray
    spread_freedom: np.ndarray
    tails: float
    repeatability: np.ndarray
    off: float
    belongs: np.ndarray
    belief: Belief
    settled: bool


def hierarchy(lot: LotSessions) -> Hierarchy:
    """Estimate the lot's numbers by restricted likelihood."""
    belief = _begin(lot)
    rng = np.random.default_rng(0)
    shuffled = rng.permutation(lot.units)
    size = BEGIN_UNITS
    while True:
        units = None if size * 2 >= lot.units else _part(lot, shuffled, size)
        most = MOST_PASSES if units is not None or lot.units <= 2 * BEGIN_UNITS else LAST_PASSES
        belief, sums, settled = _settle(lot, belief, units, most)
        if units is None:
            return in_si(lot, belief, sums, settled)
        size *= GROWTH


def _part(lot: LotSessions, shuffled: np.ndarray, size: int) -> np.ndarray:
    """Draw this many units, up to half of them with several sessions, since repeatability converges most slowly."""
    several = shuffled[lot.count[shuffled] > 1][: size // 2]
    rest = shuffled[~np.isin(shuffled, several)]
    return np.concatenate([several, rest[: size - len(several)]])


def _begin(lot: LotSessions) -> Belief:
    """Start from medians: zero mean, the scales as spread, and the differences between sessions of one unit as repeatability."""
    y = (lot.values - lot.centre) / lot.scale
    noise = np.zeros(COUNT)
    noise[lot.known] = np.nanmedian((lot.sigmas()[:, lot.known] / lot.scale[lot.known]) ** 2, axis=0)
    apart = np.full(COUNT, 1e-2)
    several = np.flatnonzero(lot.count[lot.unit] > 1)
    if len(several):
        middle = np.add.reduceat(np.where(lot.told, y, 0.0), lot.first) / np.maximum(np.add.reduceat(lot.told.astype(int), lot.first), 1)
        off = np.where(lot.told[several], y[several] - middle[lot.unit[several]], np.nan)
        told = np.isfinite(off).any(axis=0)
        apart[told] = np.maximum((np.nanmedian(np.abs(off[:, told]), axis=0) / MEDIAN_SIGMAS) ** 2 * 2, 1e-4)
    spread = np.maximum(1 - noise - np.where(lot.twice, apart, 0), 0.1)
    return Belief(np.zeros((2, COUNT)), np.zeros((2 * COUNT,) * 2), np.diag(spread), np.diag(np.where(lot.twice, apart, 0.0)))


def _settle(lot: LotSessions, belief: Belief, units: np.ndarray | None, most: int) -> tuple[Belief, Sums, bool]:
    """Run passes until all changes are small against the sigmas; every third one extrapolates the two before it."""
    count = lot.units if units is None else len(units)
    sums, steps, leap = Sums(), [], LEAP
    for number in range(1, most + 1):
        sums = Sums()
        for _, chunk in lot.chunks(units):
            add(sums, chunk, belief, count)
        after = updated(lot, belief, sums, count)
        steps.append(_step(lot, belief, after))
        rate = _rates(steps)
        moved = _moved(lot, belief, after, sums, steps[-1], rate)
        belief = after
        if moved < SETTLED and (len(steps) > 1 or lot.units > BEGIN_UNITS):
            return belief, sums, True
        if len(steps) == LEAP_AFTER and number < most:
            belief, steps, leap = _leapt(belief, steps[-1], rate, leap), [], leap * TIRED
    return belief, sums, False


def _step(lot: LotSessions, before: Belief, after: Belief) -> np.ndarray:
    """Return (2, 21), the change of the logarithms of both kinds of variances."""
    known = np.stack([lot.known, lot.twice])
    sizes = [np.stack([np.diag(each.spread), np.diag(each.repeatability)]) for each in (before, after)]
    return np.where(known, np.log(np.maximum(sizes[1], _LEAST) / np.maximum(sizes[0], _LEAST)), 0.0)


def _rates(steps: list[np.ndarray]) -> np.ndarray:
    """Return (2, 21), the ratio of the next step to this one; 0 where not known yet."""
    if len(steps) < 2:
        return np.zeros_like(steps[-1])
    before = np.where(np.abs(steps[-2]) > 1e-12, steps[-2], np.inf)
    return np.clip(steps[-1] / before, 0.0, FASTEST)


def _leapt(belief: Belief, step: np.ndarray, rate: np.ndarray, longest: float) -> Belief:
    """Extrapolate the variances to the limit of geometric steps, with at most this change of their logarithms."""
    spread, again = np.exp(np.clip(step * rate / (1 - rate), -longest, longest) / 2)
    grown = belief.spread * np.outer(spread, spread)
    return replace(belief, spread=grown, repeatability=belief.repeatability * np.outer(again, again))


def updated(lot: LotSessions, belief: Belief, sums: Sums, units: int) -> Belief:
    """Return the estimate after a pass: generalised least squares for beta, one step of expectation and maximisation for the rest."""
    known = np.tile(lot.known, 2)
    block = np.ix_(known, known)
    covariance = np.zeros((2 * COUNT,) * 2)
    covariance[block] = np.linalg.pinv(sums.information[block], hermitian=True)
    beta = (covariance @ sums.right).reshape(2, COUNT)
    told = int(lot.known.sum())
    S = belief.spread
    spread = S + S @ (sums.outer - sums.weight) @ S / max(sums.belongs, 1.0)
    spread = _sound(spread, max(sums.belongs - 2, 1.0), told, lot.known)
    repeatability = belief.repeatability
    if sums.repeats > 1:
        repeatability = _sound(sums.repeated / sums.repeats, sums.repeats, told, lot.twice)
    delta, numbers, member = (np.concatenate(part) for part in (sums.delta, sums.told, sums.member))
    found = tails_of(delta, numbers, member) if units > 3 * told else np.inf
    off = (len(member) - sums.belongs + 0.2) / (len(member) + 20)
    return Belief(beta, covariance, spread, repeatability, found, float(off))


def _sound(matrix: np.ndarray, freedom: float, told: int, known: np.ndarray) -> np.ndarray:
    """Make symmetric, shrink correlations towards zero for few units, and set unknown numbers to zero."""
    diagonal = np.maximum(np.diag(matrix), _LEAST)
    found = (matrix + matrix.T) / 2 * (freedom**2 / (freedom**2 + (told + 1) ** 2))
    np.fill_diagonal(found, diagonal)
    return np.where(known[:, None] & known, found, 0.0)


def tails_of(delta: np.ndarray, told: np.ndarray, member: np.ndarray) -> float:
    """Return the maximum-likelihood degrees of freedom; infinity where a normal distribution fits the distances as well."""
    from scipy.optimize import minimize_scalar

    def cost(inverse: float) -> float:
        # The determinant belongs to the scale, which is fitted separately: the covariance is fixed, not the scale.
        tails = 1 / inverse if inverse > 0 else np.inf
        return -float(member @ log_density(delta, told, tails))

    found = minimize_scalar(cost, bounds=(1e-4, 1 / LEAST_TAILS), method="bounded")
    gain = 2 * (cost(0.0) - found.fun)
    return float(1 / found.x) if chdtrc(1, max(gain, 0.0)) / 2 < TAILS_P else np.inf


def _moved(lot: LotSessions, before: Belief, after: Belief, sums: Sums, step: np.ndarray, rate: np.ndarray) -> float:
    """Return the largest expected remaining change, in its own sigmas."""
    sigma = np.sqrt(np.maximum(np.diag(after.beta_covariance), 1e-12)).reshape(2, COUNT)
    freedom = np.stack([np.diag(after.spread) ** 2 * sums.spread_info, np.diag(after.repeatability) ** 2 * sums.repeat_info])
    # A variance's own sigma is from 2 / freedom of its square; with less than one degree of freedom it is not distinct from zero.
    sizes = np.abs(step) / (1 - rate) * np.sqrt(np.where(freedom > 1, freedom, 0.0) / 2)
    return float(max(np.max(np.abs(after.beta - before.beta) / sigma), np.max(sizes)))


def in_si(lot: LotSessions, belief: Belief, sums: Sums, settled: bool) -> Hierarchy:
    """Convert the estimate to SI."""
    factor = belief.tails / (belief.tails - 2) if np.isfinite(belief.tails) else 1.0
    numbers = max(int(lot.known.sum()), 1)
    # Fisher's information of Student's t about a mean
    widened = (belief.tails + numbers + 2) / (belief.tails + numbers) if np.isfinite(belief.tails) else 1.0
    K = belief.beta_covariance.reshape(2, COUNT, 2, COUNT) * widened
    hidden = ~lot.known
    mean = np.where(hidden, np.nan, belief.beta[0])
    drift, drift_covariance = np.where(hidden, np.nan, belief.beta[1]), _hidden(K[1, :, 1], hidden)
    z = np.abs(drift[lot.known]) / np.sqrt(np.diag(drift_covariance)[lot.known])
    freedom = max(lot.units - 2, 1)
    drift_p = float(min(1.0, numbers * 2 * stdtr(freedom, -z.max()))) if len(z) and lot.units > 2 else 1.0
    drifts = bool(drift_p < DRIFT_P)
    if drifts:
        end = 0.5 + 1 / max(lot.units - 1, 1)
        next_mean, next_K = mean + end * drift, K[0, :, 0] + end * (K[0, :, 1] + K[1, :, 0]) + end**2 * K[1, :, 1]
    else:
        next_mean, next_K = _without_drift(lot, sums, widened)
    spread, repeatability = _hidden(belief.spread * factor, hidden), _hidden(belief.repeatability, ~lot.twice)
    s = lot.scale
    return Hierarchy(
        lot.centre + s * mean,
        np.outer(s, s) * _hidden(K[0, :, 0], hidden),
        s * drift,
        np.outer(s, s) * drift_covariance,
        drift_p,
        drifts,
        lot.centre + s * next_mean,
        np.outer(s, s) * _hidden(next_K, hidden),
        np.outer(s, s) * spread,
        _freedom(lot, belief, sums),
        belief.tails,
        np.outer(s, s) * repeatability,
        max(0.0, 1 - sums.belongs / lot.units),
        np.concatenate(sums.member),
        belief,
        settled,
    )


def _without_drift(lot: LotSessions, sums: Sums, widened: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and its covariance without drift."""
    known = lot.known
    block = np.ix_(known, known)
    covariance = np.zeros((COUNT, COUNT))
    covariance[block] = np.linalg.pinv(sums.information[:COUNT, :COUNT][block], hermitian=True)
    return np.where(known, covariance @ sums.right[:COUNT], np.nan), covariance * widened


def _hidden(matrix: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Make exactly symmetric, with NaN in the hidden rows and columns."""
    return np.where(hidden[:, None] | hidden, np.nan, (matrix + matrix.T) / 2)


def _freedom(lot: LotSessions, belief: Belief, sums: Sums) -> np.ndarray:
    """Return the degrees of freedom of chi-square of the spread's variances (21,).

    2 variance^2 / (its own variance), by Fisher's information of each alone; tails reduce them: a Student's t of p numbers tells less of
    its scale, and of the scale of all together least (Tyler 1982).
    """
    kurtosis, numbers = 1.0, max(int(lot.known.sum()), 1)
    if np.isfinite(belief.tails):
        kurtosis = (belief.tails + numbers) / (belief.tails + numbers + 2) * belief.tails / (belief.tails + 1)
    freedom = np.diag(belief.spread) ** 2 * sums.spread_info * (max(lot.units - 2, 0.5) / lot.units) * kurtosis
    return np.where(lot.known, freedom, np.nan)
