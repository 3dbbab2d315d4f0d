"""Which errors a comparison has: forward selection at a family-wise 5 %, with everything that is always free projected out.

Each candidate is judged by what is left of its columns beside the state's and those of the errors already named, in units of the noise:

    gain = |U^T y|^2, U the directions in which its sigma is below ``SEEN`` of its plausible size;  p of chi-square with that many freedoms.

The critical p-value is the 5 % quantile of the smallest p over all candidates, under noise alone, by Monte Carlo with their true correlation.
Of those below it, the one with the most evidence (Gaussian priors of the plausible sizes; each of n forms of one error has 1/n of its prior)
is named.  Errors of another name whose evidence is within ``EQUIVALENT`` of it cannot be told from it with these attitudes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from tinygc.annexes.machines.candidates import Candidate, candidates_of
from tinygc.annexes.machines.observed import Observed
from tinygc.annexes.machines.rows import Comparison, part_names, prior_of, start_of
from tinygc.annexes.machines.rows_noise import NoiseModel, RowsNoise

#: probability that anything is named in a clean recording
FAMILY_WISE = 0.05
#: draws behind the critical value: its own sigma is then 0.5 % of 5 %
DRAWS = 2000
#: a direction counts where its sigma is at most this share of its plausible size
SEEN = 0.5
#: difference of log evidence, 6 in chi-square, within which two errors are not told apart
EQUIVALENT = 3.0
#: steps of the state, which is nonlinear, after each change of what is named
STEPS = 3
MOST_NAMED = 8
#: chi-square's 90 % power, one-sided, in sigmas
POWER = 1.2816
#: share of an unseen direction that a part of the state takes up, from which it is named
HIDDEN_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class Named:
    """An error that is named: theta, sigma (P,) SI; p_value, family-wise; log_evidence; equivalent: ids of what cannot be told from it."""

    candidate: Candidate
    theta: np.ndarray
    sigma: np.ndarray
    p_value: float
    log_evidence: float
    equivalent: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Unseen:
    """A direction of an error that these attitudes do not show; direction (P,), unit; hidden_in: parts of the state that take it up."""

    candidate: Candidate
    direction: np.ndarray
    hidden_in: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Selected:
    """named, strongest first; limits: by candidate, SI: the size seen with 90 % probability in its weakest visible direction, NaN where none
    is visible; unseen; smallest_p, family-wise, of what is left; noise, chi_square, count, state (P,) and its sigma, of the last fit."""

    observed: Observed
    named: list[Named]
    limits: list[tuple[Candidate, float]]
    unseen: list[Unseen]
    smallest_p: float
    noise: RowsNoise
    chi_square: float
    count: int
    state: np.ndarray
    state_sigma: np.ndarray


@dataclass(eq=False)
class _Base:
    """What is always free and what is named, projected out: basis (n + p, .) orthonormal, left (n + p,), whitened."""

    comparison: Comparison
    noise: RowsNoise
    basis: np.ndarray
    left: np.ndarray
    theta: np.ndarray
    covariance: np.ndarray
    state: np.ndarray
    candidates: list[Candidate]
    count: int
    scaled_state: np.ndarray
    judged: list[_Judged] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Judged:
    """A candidate beside a base: directions (n + p, d) that are seen; gain; p_value of its own; log_evidence; sigmas (P,) of all singular
    directions in plausible sizes, right singular vectors (P, P)."""

    candidate: Candidate
    directions: np.ndarray
    gain: float
    p_value: float
    log_evidence: float
    sigmas: np.ndarray
    right: np.ndarray


def select(observed: Observed, seed: int = 0, make: Callable[[Comparison], list[Candidate]] = candidates_of) -> Selected:
    """Name the errors; seed: of the draws behind the critical values."""
    rng = np.random.default_rng(seed)
    named: list[Candidate] = []
    p_values: list[float] = []
    state = start_of(observed)
    while True:
        base = _fitted(observed, state, named, make)
        state = base.state
        base.judged = [_judge(base, each) for each in base.candidates if not _is_any(each, named)]
        smallest = _smallest_under_noise(base, rng)
        significant = [each for each in base.judged if each.p_value <= np.quantile(smallest, FAMILY_WISE)]
        if not significant or len(named) == MOST_NAMED:
            break
        best = max(significant, key=lambda each: each.log_evidence)
        named.append(best.candidate)
        p_values.append(_family_wise(best.p_value, smallest))
    least = min((each.p_value for each in base.judged), default=1.0)
    found = [_named(observed, base, named, number, p, make) for number, p in enumerate(p_values)]
    return _selected(base, found, _family_wise(least, smallest))


def _family_wise(p_value: float, smallest: np.ndarray) -> float:
    """Share of draws with so small a p-value; a bound where none has."""
    return float((np.sum(smallest <= p_value) + 1) / (len(smallest) + 1))


def _is_any(candidate: Candidate, named: list[Candidate]) -> bool:
    return any((candidate.id, candidate.where, candidate.shape) == (other.id, other.where, other.shape) for other in named)


def _fitted(
    observed: Observed, state: np.ndarray, named: list[Candidate], make: Callable[[Comparison], list[Candidate]]
) -> _Base:
    mean, sigma = prior_of(observed)
    noise = None
    for step in range(STEPS):
        comparison = Comparison(observed, state)
        candidates = make(comparison) if named or step == STEPS - 1 else []
        own = [next(each for each in candidates if _is_any(each, [other])) for other in named]
        columns = [each.columns * each.plausible for each in own]
        N = np.concatenate([comparison.of_state() * sigma, *columns], axis=1)
        r = comparison.residuals().stacked()
        if step != 1 or noise is None:
            noise = NoiseModel(comparison).estimated(r, N)
        prior = np.eye(N.shape[1])
        design = np.concatenate([noise.whiten(N), prior])
        y = np.concatenate([noise.whiten(r), -(state - mean) / sigma, np.zeros(N.shape[1] - len(state))])
        basis, triangle = np.linalg.qr(design)
        x = np.linalg.solve(triangle, basis.T @ y)
        if step < STEPS - 1:
            state = state + x[: len(state)] * sigma
    inverse = np.linalg.inv(triangle)
    scale = np.concatenate([sigma, *(each.plausible for each in own)])
    covariance = inverse @ inverse.T * np.outer(scale, scale)
    left = y - basis @ (basis.T @ y)
    scaled_state = design[:, : len(state)]
    return _Base(comparison, noise, basis, left, x * scale, covariance, state, candidates, len(r), scaled_state)


def _judge(base: _Base, candidate: Candidate) -> _Judged:
    columns = np.zeros((len(base.left), candidate.columns.shape[1]))
    columns[: base.count] = base.noise.whiten(candidate.columns * candidate.plausible)
    columns -= base.basis @ (base.basis.T @ columns)
    U, s, right = np.linalg.svd(columns, full_matrices=False)
    z = U.T @ base.left
    seen = s > 1 / SEEN
    gain = float(np.sum(z[seen] ** 2))
    evidence = 0.5 * float(np.sum(z**2 * s**2 / (1 + s**2) - np.log1p(s**2))) - np.log(candidate.tried)
    p_value = float(chi2.sf(gain, int(seen.sum()))) if seen.any() else 1.0
    return _Judged(candidate, U[:, seen], gain, p_value, evidence, 1 / np.maximum(s, 1e-12), right)


def _smallest_under_noise(base: _Base, rng: np.random.Generator) -> np.ndarray:
    """(DRAWS,) smallest p-value of all candidates under noise alone."""
    judged = [each for each in base.judged if each.directions.shape[1]]
    if not judged:
        return np.ones(DRAWS)
    U = np.concatenate([each.directions for each in judged], axis=1)
    values, axes = np.linalg.eigh(U.T @ U)
    kept = values > 1e-9 * values[-1]
    z = rng.standard_normal((DRAWS, int(kept.sum()))) @ (axes[:, kept] * np.sqrt(values[kept])).T
    edges = np.cumsum([0, *(each.directions.shape[1] for each in judged)])
    gains = np.add.reduceat(z**2, edges[:-1], axis=1)
    return chi2.sf(gains, np.diff(edges)).min(axis=1)


def _named(
    observed: Observed, base: _Base, named: list[Candidate], number: int, p_value: float, make: Callable[[Comparison], list[Candidate]]
) -> Named:
    """The parameters of one named error in the last fit, and what could stand in its place beside the others."""
    others = named[:number] + named[number + 1 :]
    without = _fitted(observed, base.state, others, make)
    judged = [_judge(without, each) for each in without.candidates if not _is_any(each, others)]
    own = next(each for each in judged if _is_any(each.candidate, [named[number]]))
    near = {each.candidate.id for each in judged if each.log_evidence > own.log_evidence - EQUIVALENT and each.gain > 0}
    start = len(base.state) + sum(len(each.plausible) for each in named[:number])
    here = slice(start, start + len(named[number].plausible))
    sigma = np.sqrt(np.diag(base.covariance)[here])
    return Named(own.candidate, base.theta[here], sigma, p_value, own.log_evidence, tuple(sorted(near - {own.candidate.id})))


def _selected(base: _Base, named: list[Named], smallest_p: float) -> Selected:
    limits, unseen = [], []
    for each in base.judged:
        seen = each.sigmas < SEEN
        bar = np.sqrt(chi2.isf(FAMILY_WISE / max(len(base.judged), 1), max(int(seen.sum()), 1))) + POWER
        weakest = float(each.sigmas[seen].max() * each.candidate.plausible.max()) if seen.any() else float("nan")
        limits.append((each.candidate, bar * weakest))
        for direction in each.right[~seen]:
            if np.ptp(np.abs(each.sigmas)) >= 0:
                unseen.append(Unseen(each.candidate, direction, _hidden_in(base, each.candidate, direction)))
    sigma = np.sqrt(np.diag(base.covariance)[: len(base.state)])
    named = sorted(named, key=lambda each: -each.log_evidence)
    noise, left = base.noise, base.left
    return Selected(
        base.comparison.observed, named, limits, unseen, smallest_p, noise, float(left @ left), base.count, base.state, sigma
    )


def _hidden_in(base: _Base, candidate: Candidate, direction: np.ndarray) -> tuple[str, ...]:
    """Parts of the state that take up a direction of an error; empty where it has no rows at all."""
    column = np.zeros(len(base.left))
    column[: base.count] = base.noise.whiten(candidate.columns * candidate.plausible) @ direction
    size = float(np.linalg.norm(column))
    if size < 1:
        return ()
    taken = np.linalg.lstsq(base.scaled_state, column, rcond=None)[0]
    names = np.array(part_names(base.comparison.observed.said.shape[1]))
    shares = {}
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        shares[name] = float(np.linalg.norm(base.scaled_state[: base.count, mine] @ taken[mine])) / size
    return tuple(name for name, share in sorted(shares.items(), key=lambda pair: -pair[1]) if share > HIDDEN_SHARE)
