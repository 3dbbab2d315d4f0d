"""Which errors a comparison has: forward selection at a family-wise 5 %, with everything that is always free projected out.

Each candidate is judged by what is left of its columns beside the state's and those of the errors already named, in units of the noise:

    gain = |U^T y|^2, U the directions in which its sigma is below ``SEEN`` of its plausible size;  p of chi-square with that many freedoms.

Of those whose p is below 5 % over all candidates, drawn under noise alone with their true correlation (``Selection``), the one with the
most evidence (``over_scales``; each of n forms of one error has 1/n of its odds) is named, if the evidence is for it.  Errors of another
name whose evidence is within ``AS_PROBABLE`` of it cannot be told from it with these attitudes.

The latency of the machine's word is part of the state: it is estimated in any case, and is named where it is beyond the delay that a
sensor's filter and the stamps of a board have anyway; an early word is a late sensor.  What is named enters exactly, however large.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from session.base.errors import DataError
from session.base.units import DEG
from tinygc.features.tables.machines.description import TableErrors
from tinygc.features.tables.observed import Observed
from tinygc.features.tables.rows import (
    DROPPED,
    LATENCY,
    LOST,
    SENSOR,
    TABLE,
    Candidate,
    Comparison,
    candidates_of,
    moved,
    part_names,
    prior_of,
    start_of,
)
from tinygc.features.tables.rows_noise import NoiseModel, RowsNoise
from tinygc.inference.choose import AS_PROBABLE, LEVEL, PRIOR_ODDS, Selection, chi_square_above, over_scales, price, promised

#: a direction counts where its sigma is at most this share of its plausible size
SEEN = 0.5
#: steps of the state, which is nonlinear, at most; a step that moves no number by that share of its own sigma is the last
STEPS, SETTLED = 20, 0.03
#: a fit that the noise estimated there moves by more of its own sigmas is fitted again
ANEW = 1.0
#: sigmas of its prior that a number moves in one step, at most: beside an error that is not named yet a step may overshoot
FARTHEST = 2.0
MOST_NAMED, MOST_SUSPECTED = 8, 3
#: share of the said angles that the gyroscope reads at least; rad that gravity is at most from where the said angles have it
LEAST_SHARE, FARTHEST_RAD = 0.5, 10 * DEG
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
#: s: stamps of the word are late besides: an answer takes up to 20 ms (the timer of a USB converter, a busy computer), and is stamped in
#: the middle; root mean square of 0 to 10 ms, set such that 20 ms have no name and 34 ms have (benchmarks/table_errors.py stamps)
LATE_STAMPS_S = 0.01 / np.sqrt(3)
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
class Selected:
    """named, strongest first; limits: by candidate, SI: the size seen with 90 % probability in its weakest visible direction, NaN where
    none
    is visible; unseen: candidate of each direction that these attitudes do not show, and the parts of the state that take it up;
    first_p, smallest_p: family-wise, before anything is named and of what is left; noise, latency_s
    and its sigma, of the last fit; excess: sizes of the noise beyond what is declared (``NoiseModel.excess``); suspected: ids of what is
    left that is significant, or has evidence, and not both."""

    observed: Observed
    named: list[Named]
    limits: list[tuple[Candidate, float]]
    unseen: list[tuple[Candidate, tuple[str, ...]]]
    first_p: float
    smallest_p: float
    noise: RowsNoise
    latency_s: float
    latency_sigma_s: float
    excess: dict[str, float]
    suspected: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Judged:
    """A candidate beside a base: place: of its columns among all; s (P,): 1 / sigma of each singular direction in plausible sizes; right
    (P, P): these directions, in columns; p_value of its own; log_evidence."""

    candidate: Candidate
    place: slice
    s: np.ndarray
    right: np.ndarray
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
    model: NoiseModel
    fitted: np.ndarray
    r: np.ndarray
    prior_left: np.ndarray
    named: list[Candidate]

    @property
    def count(self) -> int:
        """Of the rows, without those of the priors."""
        return len(self.r)

    def place_of(self, candidate: Candidate) -> slice | None:
        """Of a named error among ``theta``; None where it is not named here."""
        start = len(self.state)
        for each in self.named:
            if _is_any(each, [candidate]):
                return slice(start, start + len(each.plausible))
            start += len(each.plausible)
        return None

    def theta_of(self, candidate: Candidate) -> np.ndarray:
        """(P,) SI; zero where it is not named here."""
        place = self.place_of(candidate)
        return np.zeros(len(candidate.plausible)) if place is None else self.theta[place]

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
            if each.one_sided and float(right[0, 0] * z[0]) < 0:
                z = np.zeros_like(z)
            p_value = chi_square_above(float(np.sum(z[seen] ** 2)), int(seen.sum())) if seen.any() else 1.0
            evidence = over_scales(np.diag(s[seen] ** 2), (s * z)[seen], [int(seen.sum())])
            found.append(_Judged(each, place, s, right, p_value, evidence + float(np.log(PRIOR_ODDS / each.tried))))
            start = place.stop
        return self._weighed_anew(found)

    def _weighed_anew(self, judged: list[_Judged]) -> list[_Judged]:
        """The same, with the largest losses in single turns weighed by the likelihood of a noise that need not hold them; and, where the
        noise is beyond what is declared, the largest of all that gravity and whole turns show.

        One turn far off makes the noise of all turns, as estimated, so large that it hardly stands out; a large error of all rests makes it
        so large that it does not stand out at all.
        """
        known = self.model.known_alone(self.noise)
        basis, _ = np.linalg.qr(np.concatenate([known.whiten(self.fitted), np.eye(self.fitted.shape[1])]))
        y = np.concatenate([known.whiten(self.r), self.prior_left])
        y = y - basis @ (basis.T @ y)

        def largest(numbers: list[int]) -> list[int]:
            """The numbers of those that stand out most against known noise."""
            some = [judged[number].candidate for number in numbers]
            if not some:
                return []
            columns = known.whiten(np.concatenate([each.columns * each.plausible for each in some], axis=1))
            taken, pull = basis[: self.count].T @ columns, columns.T @ y[: self.count]
            gram, gains, start = columns.T @ columns - taken.T @ taken, np.zeros(len(numbers)), 0
            for place, each in enumerate(some):
                own = slice(start, start + len(each.plausible))
                gains[place] = pull[own] @ np.linalg.solve(gram[own, own] + np.eye(len(each.plausible)), pull[own])
                start = own.stop
            order = np.argsort(-gains)[:LOSSES]
            return [numbers[place] for place in order if gains[place] > LOSS_SIGMAS**2]

        once = [number for number, each in enumerate(judged) if each.candidate.id in (LOST, DROPPED)]
        others = [
            number
            for number, each in enumerate(judged if self.model.excess(self.noise) else [])
            if number not in once and not each.candidate.columns[self.model.outer :].any()
        ]
        for number in largest(once) + largest(others):
            each = judged[number]
            column = each.candidate.columns * each.candidate.plausible
            # At the plausible size the likelihood pays for every direction; at their best scale each costs less (``promised``).
            gain = self.noise.value - self.model.value_of(self.r, np.concatenate([self.fitted, column], axis=1)) + np.log1p(each.s**2).sum()
            gain, size = max(0.0, float(gain)), len(each.s)
            evidence = (promised(gain, size) - price(size, each.candidate.tried)) / 2
            weighed = replace(each, p_value=chi_square_above(gain, size), log_evidence=evidence)
            if number in once or weighed.log_evidence > each.log_evidence:
                judged[number] = weighed
        return judged


def select(observed: Observed, seed: int = 0, make: Make = candidates_of) -> Selected:
    """Name the errors; seed: of the draws behind the critical values; make: what is weighed.

    Raises DataError where sensor and table are too far apart for any error of a table that is as described.
    """
    _agree(observed)
    named: list[Candidate] = []
    p_values: list[float] = []
    base, first_p = _fitted(observed, None, named, make), 1.0
    if (blind := _odd_inside(base)).any():
        observed = replace(observed, blind=blind)
        base = _fitted(observed, None, named, make)
    while True:
        judged = [each for each in base.judged if not _is_any(each.candidate, named)]
        chance = _chance(base, judged, seed)
        by_chance = [chance.family_wise(float(np.log(max(each.p_value, 1e-300)))) for each in judged]
        least = min(by_chance, default=1.0)
        first_p = first_p if named else least
        significant = [(each, p) for each, p in zip(judged, by_chance, strict=True) if p <= LEVEL and each.log_evidence > 0]
        if not significant or len(named) == MOST_NAMED:
            break
        best, p_value = max(significant, key=lambda pair: pair[0].log_evidence)
        named = [*named, best.candidate]
        p_values.append(p_value)
        base = _fitted(observed, base, named, make)
    while True:  # an error that the later ones have made superfluous is taken back
        found = [_named(observed, base, named, number, p, make) for number, p in enumerate(p_values)]
        if all(each.log_evidence > 0 for each in found):
            break
        weakest = int(np.argmin([each.log_evidence for each in found]))
        named, p_values = named[:weakest] + named[weakest + 1 :], p_values[:weakest] + p_values[weakest + 1 :]
        base = _fitted(observed, base, named, make)
    at = len(base.state) - 3
    latency, sigma = float(base.state[at] + base.theta[at]), float(np.sqrt(base.covariance[at, at]))
    evidence = latency**2 / (sigma**2 + DELAY_SIGMA_S**2 + (LATE_STAMPS_S**2 if latency > 0 else 0.0)) / 2
    p_latency = min(1.0, chi_square_above(2 * evidence, 1) * max(len(base.candidates), 1))
    if p_latency < LEVEL:
        found.append(_late(base, latency, sigma, p_latency, evidence))
        first_p = min(first_p, p_latency)
    doubtful = [each for each, p in zip(judged, by_chance, strict=True) if (p <= LEVEL) != (each.log_evidence > 0)]
    suspected = tuple(dict.fromkeys(each.candidate.id for each in sorted(doubtful, key=lambda each: each.p_value)))[:MOST_SUSPECTED]
    limits, unseen = [], []
    for each in judged:
        freedom = max(int(each.seen.sum()), 1)
        least_seen = np.sqrt(chdtri(freedom, LEVEL / max(len(judged), 1))) + POWER
        faintest = float(each.candidate.plausible.max() / each.s[each.seen].min()) if each.seen.any() else float("nan")
        limits.append((each.candidate, float(least_seen * faintest)))
        for direction in each.right[:, ~each.seen].T:
            unseen.append((each.candidate, _hidden_in(base, each, direction)))
    found = sorted(found, key=lambda each: -each.log_evidence)
    return Selected(observed, found, limits, unseen, first_p, least, base.noise, latency, sigma, base.model.excess(base.noise), suspected)


def _late(base: _Base, latency_s: float, sigma_s: float, p_value: float, evidence: float) -> Named:
    """A word that is late, which a machine or stamps of a board that are early may cause; a word that is early comes from a late sensor."""
    late, early = base.comparison.of_latency, AS_LATENCY[0]
    if latency_s > 0:
        candidate = Candidate(LATENCY, TABLE, "word", late, np.ones(1), (("latency_ms", 1e-3, (0,)),), {})
        return Named(candidate, np.array([latency_s]), np.array([sigma_s]), p_value, evidence, AS_LATENCY[1:])
    candidate = Candidate(early, SENSOR, "all axes", late, np.ones(3), (("tau_s", 1.0, (0, 1, 2)),), {})
    return Named(candidate, np.full(3, -latency_s), np.full(3, sigma_s), p_value, evidence, AS_LATENCY[1:])


def _agree(observed: Observed) -> None:
    """Raise DataError where an axis turns the other way than it says, or gravity is far from where the said angles have it."""
    comparison = Comparison(observed)
    zero = observed.rate.mean(axis=0)
    blocks = np.where(observed.inside[..., None], observed.rates - zero, 0.0) * observed.block_s[:, None, None]
    seen = np.einsum("sbi,si->s", blocks, comparison.axis)
    for number, axis in enumerate(observed.table.axes):
        own = observed.alone == number
        share = float(np.median(seen[own] / observed.turned[own, number])) if own.any() else 1.0
        if share < LEAST_SHARE:
            what = "the other way than it says" if share < -LEAST_SHARE else "about another direction than described"
            raise DataError(
                f"axis {axis.name} turns {what}: the gyroscope reads {share:.2f} of the said angles about it, expected 1; put the "
                f"direction of the axis, or the mounting, right in table.toml"
            )
    down = -observed.force / np.linalg.norm(observed.force, axis=1)[:, None]
    apart = np.arccos(np.clip(np.sum(down * comparison.down, axis=1), -1, 1))
    if apart.max() > FARTHEST_RAD:
        raise DataError(
            f"gravity is up to {apart.max() / DEG:.0f} deg from where the said angles have it (rest {int(apart.argmax())}), expected "
            f"within {FARTHEST_RAD / DEG:.0f} deg, too large for this method; are axes, zeros and mounting of table.toml right, and did no "
            f"motor lose its steps?"
        )


def _is_any(candidate: Candidate, named: list[Candidate]) -> bool:
    return any((candidate.id, candidate.where, candidate.shape) == (other.id, other.where, other.shape) for other in named)


def _fitted(observed: Observed, before: _Base | None, named: list[Candidate], make: Make) -> _Base:
    """Fit the state and what is named, from an earlier fit or from what is declared; the noise is estimated anew."""
    mean, sigma = prior_of(observed)
    state = start_of(observed) if before is None else before.state
    thetas = [np.zeros(len(each.plausible)) if before is None else before.theta_of(each) for each in named]
    noise: RowsNoise | None = None if before is None else before.noise
    exact = 3 * (len(observed.said) + len(observed.first))  # rows of force and rotation
    step, settled = 0, False
    while True:
        errors = TableErrors.none(observed.table)
        for each, theta in zip(named, thetas, strict=True):
            errors = errors if each.added is None else each.added(errors, theta)
        comparison, anew = Comparison(observed, state, errors), noise is None or settled or step == STEPS
        candidates = make(comparison) if named or settled or step == STEPS else []
        own = [next(each for each in candidates if _is_any(each, [other])) for other in named]
        N = np.concatenate([comparison.of_state() * sigma, *(each.columns * each.plausible for each in own)], axis=1)
        r = comparison.residuals().stacked()
        for each, theta in zip(own, thetas, strict=True):
            rows = each.columns @ theta
            rows[: exact if each.added is not None else 0] = 0.0  # the comparison has them already
            r = r - rows
        if anew:
            model = NoiseModel(comparison)
            noise = model.estimated(r, N)
        assert noise is not None
        design = np.concatenate([noise.whiten(N), np.eye(N.shape[1])])
        y = np.concatenate([noise.whiten(r), -(state - mean) / sigma, *(-t / each.plausible for t, each in zip(thetas, own, strict=True))])
        basis, triangle = np.linalg.qr(design)
        x = np.linalg.solve(triangle, basis.T @ y)
        inverse = np.linalg.inv(triangle)
        own_sigma = np.linalg.norm(inverse, axis=1)
        # With another noise the fit may lie elsewhere: where it does, there the slopes are others.
        if step == STEPS or (settled and bool(np.all(np.abs(x) < ANEW * own_sigma))):
            break
        farthest = max(float(np.abs(x[: len(state)]).max()) / FARTHEST, 1.0)
        state = moved(state, x[: len(state)] * sigma / farthest)
        at = len(state)
        for number, each in enumerate(own):
            thetas[number] = thetas[number] + x[at : at + len(each.plausible)] * each.plausible / farthest
            at += len(each.plausible)
        settled = bool(np.all(np.abs(x) < SETTLED * own_sigma))
        step += 1
    scale = np.concatenate([sigma, *(each.plausible for each in own)])
    covariance = inverse @ inverse.T * np.outer(scale, scale)
    left = y - basis @ (basis.T @ y)
    theta = x * scale + np.concatenate([np.zeros(len(state)), *thetas])
    return _Base(comparison, noise, design, basis, left, theta, covariance, state, candidates, model, N, r, y[len(r) :], list(named))


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


def _chance(base: _Base, judged: list[_Judged], seed: int) -> Selection[int]:
    """The chance of the best of some candidates, whose columns have these products beside all that is fitted."""
    values, axes = np.linalg.eigh(base.gram)
    kept = values > 1e-9 * values[-1]
    columns = (axes[:, kept] * np.sqrt(values[kept])).T
    groups = {number: columns[:, each.place] for number, each in enumerate(judged)}
    return Selection(np.zeros((len(columns), 0)), groups, seed, is_known=True, seen=1 / SEEN)


def _named(observed: Observed, base: _Base, named: list[Candidate], number: int, p_value: float, make: Make) -> Named:
    """The parameters of one named error in the last fit, and what could stand in its place beside the others."""
    others = named[:number] + named[number + 1 :]
    without = _fitted(observed, base, others, make)
    judged = [each for each in without.judged if not _is_any(each.candidate, others)]
    own = next(each for each in judged if _is_any(each.candidate, [named[number]]))
    near = {each.candidate.id for each in judged if each.log_evidence > own.log_evidence - AS_PROBABLE}
    here, size = base.place_of(named[number]), own.candidate.plausible
    # Of a direction with a sigma below ``SEEN`` of its plausible size, in the noise without this error, the posterior has this variance.
    shares, right = np.linalg.eigh(base.covariance[here, here] / np.outer(size, size))
    right = right[:, shares < 1 / (1 + 1 / SEEN**2)]
    shown = (right @ right.T) * size[:, None] / size
    covariance = shown @ base.covariance[here, here] @ shown.T
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Named(own.candidate, shown @ base.theta[here], sigma, p_value, own.log_evidence, tuple(sorted(near - {own.candidate.id})))


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
