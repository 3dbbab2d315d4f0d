"""One pass over a lot: what all units together say of mean, spread and repeatability, given what is believed of them (EM, REML).

    y_us = X_u beta + b_u + v_us + e_us     b_u ~ (0, Sigma / w_u)     v_us ~ N(0, V)     e_us ~ N(0, R_us), as stated

X_u beta is the mean and its drift through production.  w_u has the gamma distribution that makes units and their noise Student's t.  A
unit that does not belong has one number, or all of them, several times as far off, and counts for the lot by the probability that it
does belong.  beta has no prior, so what it costs of freedom is given back: Sigma is the restricted likelihood's.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import stats
from scipy.special import gammaln, logsumexp

from tinygc.lot.sessions import COUNT, Chunk

#: by how many times its spread a number of a unit that does not belong is off: all as probable
OFF_SCALES = np.array([5.0, 15.0, 50.0])
#: a repeated session this improbable beside its unit's others is no measure of how sessions repeat
BAD_SESSION_P = 1e-4
#: units of a lot in which none is said not to belong: of so few, nobody knows which
FEWEST_JUDGED = 10
#: exact restricted likelihood up to so many units; beyond, the mean's uncertainty is shared out by the mean weight
EXACT_UNITS = 3000


@dataclass(frozen=True, eq=False)
class Belief:
    """In scales about the centre: beta (2, 21), mean at the middle of production and drift over all of it; beta_covariance (42, 42);
    spread Sigma (21, 21) of the t distribution's normal, not its covariance; repeatability V (21, 21); tails, degrees of freedom; off,
    the share of units that do not belong."""

    beta: np.ndarray
    beta_covariance: np.ndarray
    spread: np.ndarray
    repeatability: np.ndarray
    tails: float = np.inf
    off: float = 0.01


@dataclass(eq=False)
class Sums:
    """Over the units so far: weights, beta's normal equations, Sigma's and V's moments, twice Fisher's information of their variances, and
    of each unit its squared distance delta, how many numbers it tells, and the probability that it belongs."""

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
    """Each unit's sessions as one: y (U, 21) and noise (U, 21, 21), V in it; precision (S, 21, 21) of each session of the units with
    more than one, and which sessions those are (S,)."""

    y: np.ndarray
    noise: np.ndarray
    precision: np.ndarray
    several: np.ndarray


def combined(chunk: Chunk, repeatability: np.ndarray) -> Combined:
    """Sessions of each unit, weighed by what they state and by how units repeat."""
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
    """(U,): of Student's t in ``told`` numbers at a squared distance, without the determinant."""
    if np.isinf(tails):
        return -0.5 * delta - 0.5 * told * np.log(2 * np.pi)
    shape = gammaln((tails + told) / 2) - gammaln(tails / 2) - 0.5 * told * np.log(tails * np.pi)
    return shape - 0.5 * (tails + told) * np.log1p(delta / tails)


def membership(delta: np.ndarray, told: np.ndarray, pulled: np.ndarray, W: np.ndarray, belief: Belief) -> np.ndarray:
    """(U,): the probability that a unit belongs, against one number, or all of them, being ``OFF_SCALES`` times as far off."""
    alone = log_density(delta, told, belief.tails)
    size = OFF_SCALES[:, None, None] ** 2 * np.diag(belief.spread)
    share = size * np.einsum("uii->ui", W)
    one = log_density(delta[None, :, None] - pulled**2 * size / (1 + share), told[None, :, None], belief.tails) - 0.5 * np.log1p(share)
    every = log_density(delta / OFF_SCALES[:, None] ** 2, told, belief.tails) - told * np.log(OFF_SCALES)[:, None]
    off = np.logaddexp(logsumexp(one, axis=(0, 2)) - np.log(one.shape[0] * one.shape[2]), logsumexp(every, axis=0) - np.log(len(every)))
    odds = np.log(belief.off / 2) - np.log1p(-belief.off) + off - alone
    return 1 / (1 + np.exp(np.minimum(odds, 700)))


def add(sums: Sums, chunk: Chunk, belief: Belief, units: int) -> None:
    """A chunk's units into the sums; units: how many there are in all."""
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


def _repeats(sums: Sums, chunk: Chunk, of: Combined, W: np.ndarray, pulled: np.ndarray, member: np.ndarray, belief: Belief) -> None:
    """V's moments, of the units with more than one session."""
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
    total = np.linalg.inv(np.linalg.inv(of.precision) + doubt[unit])
    far = np.einsum("si,sij,sj->s", d, total, d)
    keep = member[unit] * (stats.chi2.sf(far, told) > BAD_SESSION_P)
    sums.repeated += (left * keep[:, None]).T @ left + (keep @ moved.reshape(len(moved), -1)).reshape(COUNT, COUNT)
    sums.repeats += keep.sum()
    variance = np.einsum("sii->si", chunk.noise[of.several]) + np.diag(V)
    more = chunk.count[unit]
    sums.repeat_info += np.sum((keep * (more - 1) / more)[:, None] / variance**2, axis=0)
