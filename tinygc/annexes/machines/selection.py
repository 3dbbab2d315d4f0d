"""Which errors a comparison has: forward selection at a family-wise 5 %, with everything that is always free projected out.

Each candidate is judged by what is left of its columns beside the state's and those of the errors already named, in units of the noise:

    gain = |U^T y|^2, U the directions in which its sigma is below ``SEEN`` of its plausible size;  p of chi-square with that many freedoms.

The critical p-value is the 5 % quantile of the smallest p over all candidates, under noise alone, by Monte Carlo with their true
correlation.  Of those below it, the one with the most evidence (Gaussian priors of the plausible sizes; each of n forms of one error has
1/n of its prior) is named, if the evidence is for it.  Errors of another name whose evidence is within ``EQUIVALENT`` of it cannot be told
from it with these attitudes.

The latency of the machine's word is part of the state: it is estimated in any case, and is named where it is beyond the delay that a
sensor's filter and the stamps of a board have anyway.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from tinygc.annexes.machines.candidates import DROPPED, LATENCY, LOST, TABLE, Candidate, candidates_of
from tinygc.annexes.machines.observed import Observed
from tinygc.annexes.machines.rows import Comparison, moved, part_names, prior_of, start_of
from tinygc.annexes.machines.rows_noise import NoiseModel, RowsNoise

#: probability that anything is named in a clean recording
FAMILY_WISE = 0.05
#: draws behind the critical value: its own sigma is then 0.5 % of 5 %
DRAWS = 2000
#: a direction counts where its sigma is at most this share of its plausible size
SEEN = 0.5
#: difference of log evidence, 6 in chi-square, within which two errors are not told apart
EQUIVALENT = 3.0
#: steps of the state, which is nonlinear, at most; a step that moves no number by that share of its own sigma is the last
STEPS, SETTLED = 10, 0.03
#: sigmas of its prior that a number moves in one step, at most: beside an error that is not named yet a step may overshoot
FARTHEST = 2.0
MOST_NAMED = 8
#: power of 90 %, one-sided, in sigmas
POWER = 1.2816
#: share of an unseen direction that a part of the state takes up, from which it is named
HIDDEN_SHARE = 0.2
#: a turn's inside is not looked at where its rows are that many times as large as the axis' usual turn, and few turns are
ODD, FEW = 6.0, 0.25
#: losses in single turns that are weighed with the noise estimated anew: those that would be beyond so many sigmas of known noise
LOSSES, LOSS_SIGMAS = 4, 4.0
#: s: filter of a sensor and stamps of the board, one sigma: a latency within them is nobody's fault
DELAY_SIGMA_S = 0.005
#: sensor's effects that read as a latency, where all axes have them alike
AS_LATENCY = ("gyro.bandwidth", "timing.axis_skew")

Make = Callable[[Comparison], list[Candidate]]


@dataclass(frozen=True, eq=False)
class Named:
    """An error that is named: theta, sigma (P,) SI, of what is seen of it; p_value, family-wise; log_evidence; equivalent: ids of what
    cannot be told from it."""

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
    """named, strongest first; limits: by candidate, SI: the size seen with 90 % probability in its weakest visible direction, NaN where
    none
    is visible; unseen; first_p, smallest_p: family-wise, before anything is named and of what is left; noise, chi_square, count, latency_s
    and its sigma, of the last fit."""

    observed: Observed
    named: list[Named]
    limits: list[tuple[Candidate, float]]
    unseen: list[Unseen]
    first_p: float
    smallest_p: float
    noise: RowsNoise
    chi_square: float
    count: int
    latency_s: float
    latency_sigma_s: float


@dataclass(frozen=True, eq=False)
class _Judged:
    """A candidate beside a base: place: of its columns among all; s (P,): 1 / sigma of each singular direction in plausible sizes; right
    (P, P): these directions, in columns; gain of those that are seen; p_value of its own; log_evidence."""

    candidate: Candidate
    place: slice
    s: np.ndarray
    right: np.ndarray
    gain: float
    p_value: float
    log_evidence: float

    @property
    def seen(self) -> np.ndarray:
        """(P,) bool."""
        return self.s > 1 / SEEN


@dataclass(eq=False)
class _Base:
    """A fit of the state and of what is named: basis (n + p, .) orthonormal; left (n + p,); theta and covariance of all, SI."""

    comparison: Comparison
    noise: RowsNoise
    design: np.ndarray
    basis: np.ndarray
    left: np.ndarray
    theta: np.ndarray
    covariance: np.ndarray
    state: np.ndarray
    candidates: list[Candidate]
    count: int
    model: NoiseModel
    fitted: np.ndarray
    r: np.ndarray
    prior_left: np.ndarray

    @cached_property
    def columns(self) -> np.ndarray:
        """(n, T) of all candidates, in plausible sizes, whitened."""
        return self.noise.whiten(np.concatenate([each.columns * each.plausible for each in self.candidates], axis=1))

    @cached_property
    def _taken(self) -> np.ndarray:
        return self.basis[: self.count].T @ self.columns

    @cached_property
    def gram(self) -> np.ndarray:
        """(T, T): products of the candidates' columns with everything fitted projected out."""
        return self.columns.T @ self.columns - self._taken.T @ self._taken

    @cached_property
    def judged(self) -> list[_Judged]:
        """All candidates."""
        pull = self.columns.T @ self.left[: self.count]
        found, start = [], 0
        for each in self.candidates:
            place = slice(start, start + len(each.plausible))
            values, right = np.linalg.eigh(self.gram[place, place])
            s = np.sqrt(np.maximum(values, 0.0))
            z = right.T @ pull[place] / np.maximum(s, 1e-9)
            seen = s > 1 / SEEN
            gain = float(np.sum(z[seen] ** 2))
            weighed = np.where(seen, z**2 * s**2 / (1 + s**2) - np.log1p(s**2), 0.0)
            p_value = float(chi2.sf(gain, int(seen.sum()))) if seen.any() else 1.0
            found.append(_Judged(each, place, s, right, gain, p_value, float(weighed.sum()) / 2 - np.log(each.tried)))
            start = place.stop
        return self._losses_anew(found)

    def _losses_anew(self, judged: list[_Judged]) -> list[_Judged]:
        """The same, with the largest losses in single turns weighed by the likelihood of a noise that need not hold them.

        One turn far off makes the noise of all turns, as estimated, so large that it hardly stands out.
        """
        losses = [number for number, each in enumerate(judged) if each.candidate.id in (LOST, DROPPED)]
        if not losses:
            return judged
        known = self.model.known_alone(self.noise)
        columns = known.whiten(np.concatenate([self.candidates[number].columns for number in losses], axis=1))
        basis, _ = np.linalg.qr(np.concatenate([known.whiten(self.fitted), np.eye(self.fitted.shape[1])]))
        y = np.concatenate([known.whiten(self.r), self.prior_left])
        y = y - basis @ (basis.T @ y)
        taken = basis[: self.count].T @ columns
        length = np.sqrt(np.maximum(np.sum(columns**2, axis=0) - np.sum(taken**2, axis=0), 1e-12))
        sigmas = np.abs(columns.T @ y[: self.count]) / length
        for place in np.argsort(-sigmas)[:LOSSES]:
            if sigmas[place] < LOSS_SIGMAS:
                break
            number = losses[place]
            each = judged[number]
            column = each.candidate.columns * each.candidate.plausible
            evidence = (self.noise.value - self.model.value_of(self.r, np.concatenate([self.fitted, column], axis=1))) / 2
            gain = max(0.0, 2 * evidence + float(np.log1p(each.s[0] ** 2)))
            tried = each.candidate.tried
            judged[number] = replace(each, gain=gain, p_value=float(chi2.sf(gain, 1)), log_evidence=evidence - np.log(tried))
        return judged


def select(observed: Observed, seed: int = 0, make: Make = candidates_of) -> Selected:
    """Name the errors; seed: of the draws behind the critical values; make: what is weighed."""
    rng = np.random.default_rng(seed)
    named: list[Candidate] = []
    p_values: list[float] = []
    base, first_p = _fitted(observed, None, named, make), 1.0
    if (blind := _odd_inside(base)).any():
        observed = replace(observed, blind=blind)
        base = _fitted(observed, None, named, make)
    while True:
        judged = [each for each in base.judged if not _is_any(each.candidate, named)]
        smallest = _smallest_under_noise(base, judged, rng)
        least = _family_wise(min((each.p_value for each in judged), default=1.0), smallest)
        first_p = first_p if named else least
        bar = np.quantile(smallest, FAMILY_WISE)
        significant = [each for each in judged if each.p_value <= bar and each.log_evidence > 0]
        if not significant or len(named) == MOST_NAMED:
            break
        best = max(significant, key=lambda each: each.log_evidence)
        named = [*named, best.candidate]
        p_values.append(_family_wise(best.p_value, smallest))
        base = _fitted(observed, base, named, make)
    while True:  # an error that the later ones have made superfluous is taken back
        found = [_named(observed, base, named, number, p, make) for number, p in enumerate(p_values)]
        if all(each.log_evidence > 0 for each in found):
            break
        weakest = int(np.argmin([each.log_evidence for each in found]))
        named, p_values = named[:weakest] + named[weakest + 1 :], p_values[:weakest] + p_values[weakest + 1 :]
        base = _fitted(observed, base, named, make)
    latency, sigma = (
        float(base.state[-2] + base.theta[len(base.state) - 2]),
        float(np.sqrt(base.covariance[len(base.state) - 2, len(base.state) - 2])),
    )
    p_latency = float(chi2.sf(latency**2 / (sigma**2 + DELAY_SIGMA_S**2), 1))
    if p_latency < FAMILY_WISE / max(len(base.candidates), 1):
        late = Candidate(LATENCY, TABLE, "word", base.comparison.of_latency, np.ones(1), (("latency_ms", 1e-3, (0,)),), {})
        evidence = latency**2 / (sigma**2 + DELAY_SIGMA_S**2) / 2
        found.append(Named(late, np.array([latency]), np.array([sigma]), p_latency, float(evidence), AS_LATENCY))
    limits, unseen = _not_named(base, judged)
    found = sorted(found, key=lambda each: -each.log_evidence)
    chi_square = float(base.left @ base.left)
    return Selected(observed, found, limits, unseen, first_p, least, base.noise, chi_square, base.count, float(latency), sigma)


def _family_wise(p_value: float, smallest: np.ndarray) -> float:
    """Share of draws with so small a p-value; a bound where none has."""
    return float((np.sum(smallest <= p_value) + 1) / (len(smallest) + 1))


def _is_any(candidate: Candidate, named: list[Candidate]) -> bool:
    return any((candidate.id, candidate.where, candidate.shape) == (other.id, other.where, other.shape) for other in named)


def _fitted(observed: Observed, before: _Base | None, named: list[Candidate], make: Make) -> _Base:
    """Fit the state and what is named, from an earlier fit or from what is declared; the noise is estimated anew."""
    mean, sigma = prior_of(observed)
    state = start_of(observed) if before is None else before.state
    noise: RowsNoise | None = None if before is None else before.noise
    last = False
    for step in range(STEPS):
        comparison, last = Comparison(observed, state), last or step == STEPS - 1
        candidates = make(comparison) if named or last else []
        own = [next(each for each in candidates if _is_any(each, [other])) for other in named]
        N = np.concatenate([comparison.of_state() * sigma, *(each.columns * each.plausible for each in own)], axis=1)
        r = comparison.residuals().stacked()
        if noise is None or last:
            model = NoiseModel(comparison)
            noise = model.estimated(r, N)
        design = np.concatenate([noise.whiten(N), np.eye(N.shape[1])])
        y = np.concatenate([noise.whiten(r), -(state - mean) / sigma, np.zeros(N.shape[1] - len(state))])
        basis, triangle = np.linalg.qr(design)
        x = np.linalg.solve(triangle, basis.T @ y)
        inverse = np.linalg.inv(triangle)
        if last:
            break
        farthest = float(np.abs(x[: len(state)]).max())
        state = moved(state, x[: len(state)] * sigma * FARTHEST / max(farthest, FARTHEST))
        last = bool(np.all(np.abs(x[: len(state)]) < SETTLED * np.linalg.norm(inverse, axis=1)[: len(state)]))
    scale = np.concatenate([sigma, *(each.plausible for each in own)])
    covariance = inverse @ inverse.T * np.outer(scale, scale)
    left = y - basis @ (basis.T @ y)
    assert noise is not None  # the last step has estimated it
    return _Base(comparison, noise, design, basis, left, x * scale, covariance, state, candidates, len(r), model, N, r, y[len(r) :])


def _odd_inside(base: _Base) -> np.ndarray:
    """(S,) bool: turns whose rows within are unlike those of the axis' other turns."""
    seen, inner = base.comparison.observed, base.comparison.inner
    counts = inner.sum(axis=1)
    ends = np.cumsum(counts)
    rows = base.left[base.model.outer : base.count] ** 2
    usual = np.array([rows[end - count : end].mean() if count else np.nan for end, count in zip(ends, counts, strict=True)])
    odd = np.zeros(len(counts), dtype=bool)
    for axis in range(seen.said.shape[1]):
        own = (seen.alone == axis) & (counts > 0)
        if own.any():
            far = own & (np.nan_to_num(usual) > ODD * np.median(usual[own]))
            odd |= far if far.sum() <= FEW * own.sum() else False
    return odd


def _smallest_under_noise(base: _Base, judged: list[_Judged], rng: np.random.Generator) -> np.ndarray:
    """(DRAWS,) smallest p-value of some candidates under noise alone."""
    judged = [each for each in judged if each.seen.any()]
    if not judged:
        return np.ones(DRAWS)
    # Rotation of each candidate's columns to its seen singular directions, of unit length.
    size = [int(each.seen.sum()) for each in judged]
    edges = np.cumsum([0, *size])
    turn = np.zeros((len(base.gram), edges[-1]))
    for each, start, stop in zip(judged, edges, edges[1:], strict=False):
        turn[each.place, start:stop] = each.right[:, each.seen] / each.s[each.seen]
    values, axes = np.linalg.eigh(turn.T @ base.gram @ turn)
    kept = values > 1e-9 * values[-1]
    z = rng.standard_normal((DRAWS, int(kept.sum()))) @ (axes[:, kept] * np.sqrt(values[kept])).T
    gains = np.add.reduceat(z**2, edges[:-1], axis=1)
    return chi2.sf(gains, size).min(axis=1)


def _named(observed: Observed, base: _Base, named: list[Candidate], number: int, p_value: float, make: Make) -> Named:
    """The parameters of one named error in the last fit, and what could stand in its place beside the others."""
    others = named[:number] + named[number + 1 :]
    without = _fitted(observed, base, others, make)
    judged = [each for each in without.judged if not _is_any(each.candidate, others)]
    own = next(each for each in judged if _is_any(each.candidate, [named[number]]))
    near = {each.candidate.id for each in judged if each.log_evidence > own.log_evidence - EQUIVALENT}
    start = len(base.state) + sum(len(each.plausible) for each in named[:number])
    here = slice(start, start + len(own.s))
    size = own.candidate.plausible
    shown = (own.right[:, own.seen] @ own.right[:, own.seen].T) * size[:, None] / size
    covariance = shown @ base.covariance[here, here] @ shown.T
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Named(own.candidate, shown @ base.theta[here], sigma, p_value, own.log_evidence, tuple(sorted(near - {own.candidate.id})))


def _not_named(base: _Base, judged: list[_Judged]) -> tuple[list[tuple[Candidate, float]], list[Unseen]]:
    limits, unseen = [], []
    for each in judged:
        freedom = max(int(each.seen.sum()), 1)
        bar = np.sqrt(chi2.isf(FAMILY_WISE / max(len(judged), 1), freedom)) + POWER
        weakest = float(each.candidate.plausible.max() / each.s[each.seen].min()) if each.seen.any() else float("nan")
        limits.append((each.candidate, float(bar * weakest)))
        for direction in each.right[:, ~each.seen].T:
            unseen.append(Unseen(each.candidate, direction, _hidden_in(base, each, direction)))
    return limits, unseen


def _hidden_in(base: _Base, judged: _Judged, direction: np.ndarray) -> tuple[str, ...]:
    """Parts of the state that take up a direction of an error; empty where it has no rows at all."""
    column = base.columns[:, judged.place] @ direction
    size = float(np.linalg.norm(column))
    if size < 1:
        return ()
    state = base.design[: base.count, : len(base.state)]
    taken = np.linalg.lstsq(base.design[:, : len(base.state)], np.append(column, np.zeros(len(base.design) - base.count)), rcond=None)[0]
    names = np.array(part_names(base.comparison.observed.said.shape[1]))
    shares = {name: float(np.linalg.norm(state[:, names == name] @ taken[names == name])) / size for name in dict.fromkeys(names.tolist())}
    return tuple(name for name, share in sorted(shares.items(), key=lambda pair: -pair[1]) if share > HIDDEN_SHARE)
