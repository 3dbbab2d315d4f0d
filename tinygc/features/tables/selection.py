"""Which errors a comparison has: the set of errors with the most evidence, with everything that is always free.

A set is fitted exactly, however large its errors, with the noise estimated in it: a large error that is not named yet makes the noise of
all rows large.  Its score is -2 log of the restricted likelihood, with the price of each error (``price``; each of n forms of one error
has 1/n of its odds).  ``climb`` looks for the best set: from the errors so far one less, or one more of those that promise the most by
what is left of their columns next to all that is fitted,

    gain = |U^T y|^2, U the directions in which its sigma is below ``SEEN`` of its plausible size;  p of chi-square with that many freedoms

in units of the noise as estimated, and of the noise that is known beforehand.  p is family-wise, drawn under noise alone for these columns
(``Selection``).  Errors of another name whose evidence in its place is within ``AS_PROBABLE`` of it cannot be separated from it with these
attitudes.

The latency of the machine's word is part of the state: it is estimated in any case, and is named where it is beyond the delay that a
sensor's filter and the stamps of a board have anyway; an early word is a late sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from session.base.errors import DataError
from session.base.numeric import rms_of
from session.base.units import DEG
from tinygc.features.tables.machines.description import TableErrors
from tinygc.features.tables.observed import Observed
from tinygc.features.tables.rows import LATENCY, LOST, Candidate, Comparison, candidates_of, moved, parts_of, prior_of
from tinygc.features.tables.rows_noise import NoiseModel, RowsNoise
from tinygc.inference.choose import AS_PROBABLE, LEVEL, PRIOR_ODDS, Selection, chi_square_above, climb, over_scales, price
from tinygc.inference.solve import solve

#: a direction counts where its sigma is at most this share of its plausible size
SEEN = 0.5
#: steps of the state, which is nonlinear, at most; a step that moves no number by that share of its own sigma is the last
STEPS, SETTLED = 20, 0.03
#: sigmas of its prior that a number moves in one step, at most: next to an error that is not named yet a step may overshoot
FARTHEST = 2.0
MOST_NAMED, MOST_SUSPECTED = 8, 3
#: share of the reported angles that the gyroscope reads at least; rad that gravity is at most from where the reported angles have it
LEAST_SHARE, FARTHEST_RAD = 0.5, 10 * DEG
#: power of 90 %, one-sided, in sigmas
POWER = 1.2816
#: share of an unseen direction that a part of the state takes up, from which it is named
HIDDEN_SHARE = 0.2
#: a turn's inside is not looked at where its rows are that many times as large as the axis' usual turn, and few turns are
ODD, FEW = 6.0, 0.25
#: errors that are weighed exactly next to a set, of those that promise the most by either noise
TRIED = 2
#: s: filter of a sensor and stamps of the board, one sigma: a latency within them is no one's fault
DELAY_SIGMA_S = 0.005
#: s: stamps of the word are late as well: an answer takes up to 20 ms (the timer of a USB converter, a busy computer), and is stamped in
#: the middle; root mean square of 0 to 10 ms, set such that 20 ms have no name and 34 ms have (benchmarks/table_errors.py stamps)
LATE_STAMPS_S = 0.01 / np.sqrt(3)
#: sensor's effects that read as a latency, where all axes have them alike
AS_LATENCY = ("gyro.bandwidth", "timing.axis_skew")


@dataclass(frozen=True, eq=False)
class Named:
    """An error that is named: theta, sigma (P,) SI, of what is seen of it; p_value, family-wise; log_evidence; equivalent: ids of what
    cannot be separated from it."""

    candidate: Candidate
    theta: np.ndarray
    sigma: np.ndarray
    p_value: float
    log_evidence: float
    equivalent: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Selected:
    """named, strongest first.  By id and where, for a loss in any turn: limits of what is not named: the size that is seen with 90 %
    probability in the weakest visible direction of the form that is seen the least, and its unit; hidden: the parts of the state that take
    up what these attitudes do not show of it.
    first_p, smallest_p: family-wise, of anything at all and of what is left; noise, latency_s and its sigma, of the last fit; excess: sizes
    of the noise beyond what is declared (``NoiseModel.excess``); suspected: ids of what is left that is significant."""

    observed: Observed
    named: list[Named]
    limits: dict[tuple[str, str], tuple[float, str]]
    hidden: dict[tuple[str, str], tuple[str, ...]]
    first_p: float
    smallest_p: float
    noise: RowsNoise
    latency_s: float
    latency_sigma_s: float
    excess: dict[str, float]
    suspected: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Scored:
    """A candidate next to a set: place: of its columns among all; s (P,): 1 / sigma of each singular direction in plausible sizes; right
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


class _Look:
    """All candidates next to a fit, in units of a noise: design (n + p, p) of what is fitted and of the priors, its basis, and left (n +
    p,) next to it; columns (n, T) of all candidates, in plausible sizes, and gram (T, T), their products next to what is fitted."""

    def __init__(self, fit: _Fit, noise: RowsNoise):
        self.design = np.concatenate([noise.whiten(fit.fitted), np.eye(fit.fitted.shape[1])])
        self.basis, _ = np.linalg.qr(self.design)
        y = np.concatenate([noise.whiten(fit.r), fit.prior_left])
        self.left = y - self.basis @ (self.basis.T @ y)
        self.columns = noise.whiten(np.concatenate([each.columns * each.plausible for each in fit.candidates], axis=1))
        taken = self.basis[: len(self.columns)].T @ self.columns
        self.gram = self.columns.T @ self.columns - taken.T @ taken
        pull = self.columns.T @ self.left[: len(self.columns)]
        self.scored, start = [], 0
        for each in fit.candidates:
            place = slice(start, start + len(each.plausible))
            start = place.stop
            if each.key in fit.keys:
                continue
            values, right = np.linalg.eigh(self.gram[place, place])
            s = np.sqrt(np.maximum(values, 0.0))
            z = right.T @ pull[place] / np.maximum(s, 1e-9)
            seen = s > 1 / SEEN
            if each.one_sided and float(right[0, 0] * z[0]) < 0:
                z = np.zeros_like(z)
            p_value = chi_square_above(float(np.sum(z[seen] ** 2)), int(seen.sum())) if seen.any() else 1.0
            evidence = over_scales(np.diag(s[seen] ** 2), (s * z)[seen], [int(seen.sum())])
            self.scored.append(_Scored(each, place, s, right, p_value, evidence + float(np.log(PRIOR_ODDS / each.tried))))

    def chance(self, seed: int) -> Callable[[float], float]:
        """p-value -> the chance of as small a one, of the best of the candidates, whose columns have these products next to all that is
        fitted."""
        values, axes = np.linalg.eigh(self.gram)
        kept = values > 1e-9 * values[-1]
        columns = (axes[:, kept] * np.sqrt(values[kept])).T
        groups = {number: columns[:, each.place] for number, each in enumerate(self.scored)}
        drawn = Selection(np.zeros((len(columns), 0)), groups, seed, is_known=True, seen=1 / SEEN)
        return lambda p_value: drawn.family_wise(float(np.log(max(p_value, 1e-300))))

    def hidden_in(self, scored: _Scored, direction: np.ndarray, state: np.ndarray) -> tuple[str, ...]:
        """Parts of the state, by the name of each of its numbers (P,), that take up a direction of an error; empty where it has no rows."""
        column = self.columns[:, scored.place] @ direction
        size = float(np.linalg.norm(column))
        if size < 1:
            return ()
        design = self.design[:, : len(state)]
        taken = np.linalg.lstsq(design, np.append(column, np.zeros(len(design) - len(column))), rcond=None)[0]
        rows = design[: len(column)]
        shares = {
            name: float(np.linalg.norm(rows[:, state == name] @ taken[state == name])) / size for name in dict.fromkeys(state.tolist())
        }
        return tuple(name for name, share in sorted(shares.items(), key=lambda pair: -pair[1]) if share > HIDDEN_SHARE)


@dataclass(eq=False)
class _Fit:
    """A fit of the state and of a set of errors: fitted (n, p) columns of both in units of their priors, r (n,) what is left, and
    prior_left (p,); theta (p,) and covariance of all, SI; score: -2 log of evidence times prior."""

    comparison: Comparison
    named: list[Candidate]
    candidates: list[Candidate]
    model: NoiseModel
    noise: RowsNoise
    fitted: np.ndarray
    r: np.ndarray
    prior_left: np.ndarray
    theta: np.ndarray
    covariance: np.ndarray
    score: float

    @property
    def ids(self) -> frozenset[str]:
        """Ids of what is named."""
        return frozenset(each.id for each in self.named)

    @cached_property
    def keys(self) -> dict[tuple, slice]:
        """Key of each error that is named, and its place in ``theta``."""
        ends = len(self.comparison.state) + np.cumsum([0, *(len(each.plausible) for each in self.named)])
        return {each.key: slice(start, stop) for each, start, stop in zip(self.named, ends, ends[1:], strict=False)}

    @cached_property
    def look(self) -> _Look:
        """All other candidates, by the noise of this fit."""
        return _Look(self, self.noise)


class _Search:
    """Sets of errors of one comparison, each fitted once."""

    def __init__(self, observed: Observed):
        self._observed = observed
        self._known: dict[frozenset, _Fit] = {}

    def of(self, named: list[Candidate], before: _Fit | None = None) -> _Fit:
        """The fit of a set, from another fit or from what is declared."""
        keys = frozenset(each.key for each in named)
        if keys not in self._known:
            self._known[keys] = _fitted(self._observed, named, before)
        return self._known[keys]

    def near(self, fit: _Fit) -> Iterator[_Fit]:
        """The sets with one error less, and with one more that promises much."""
        for each in fit.named:
            yield self.of([other for other in fit.named if other is not each], fit)
        promising: dict[tuple, Candidate] = {}
        for look in (fit.look, _Look(fit, fit.model.known_alone(fit.noise))) if len(fit.named) < MOST_NAMED else ():
            best = sorted(look.scored, key=lambda each: -each.log_evidence)[:TRIED]
            promising |= {each.candidate.key: each.candidate for each in best if each.log_evidence > 0}
        for candidate in promising.values():
            yield self.of([*fit.named, candidate], fit)

    def named(self, best: _Fit, candidate: Candidate, chance: Callable[[float], float]) -> Named:
        """The parameters of one error of the best set, and what could stand in its place next to the others."""
        others = [each for each in best.named if each is not candidate]
        without = self.of(others, best)
        own = next(each.log_evidence for each in without.look.scored if each.candidate.key == candidate.key)
        near = [each for each in without.look.scored if each.candidate.id != candidate.id and each.log_evidence > own - AS_PROBABLE]
        rivals = {each.candidate.id: each.candidate for each in sorted(near, key=lambda each: each.log_evidence)}
        equal = {id for id, rival in rivals.items() if self.of([*others, rival], without).score < best.score + 2 * AS_PROBABLE}
        here, size = best.keys[candidate.key], candidate.plausible
        # Of a direction with a sigma below ``SEEN`` of its plausible size the posterior, whose prior is that size, has this share of it.
        shares, right = np.linalg.eigh(best.covariance[here, here] / np.outer(size, size))
        seen = shares < 1 / (1 + 1 / SEEN**2)
        shares, right = shares[seen], right[:, seen]
        theta = right.T @ (best.theta[here] / size)
        p_value = chi_square_above(float(np.sum(theta**2 / (shares * (1 - shares)))), len(shares)) if len(shares) else 1.0
        sigma = size * np.sqrt(np.sum(right**2 * shares, axis=1))
        return Named(candidate, size * (right @ theta), sigma, chance(p_value), (without.score - best.score) / 2, tuple(sorted(equal)))


def select(observed: Observed, seed: int = 0) -> Selected:
    """Name the errors; seed: of the draws behind the critical values.

    Raises DataError where sensor and table are too far apart for any error of a table that is as described.
    """
    _agree(observed)
    search = _Search(observed)
    nothing = search.of([])
    if (blind := _odd_inside(nothing)).any():
        observed = replace(observed, blind=blind)
        search = _Search(observed)
        nothing = search.of([])
    best = climb(nothing, search.near)
    scored, chance = best.look.scored, nothing.look.chance(seed)
    found = [search.named(best, each, chance) for each in best.named]
    chances = [chance(each.p_value) for each in nothing.look.scored]
    first_p = min([*chances, *(each.p_value for each in found)], default=1.0)
    if found:
        chance = best.look.chance(seed)
        chances = [chance(each.p_value) for each in scored]
    at = len(best.comparison.state) - 3
    latency, sigma = float(best.theta[at]), float(np.sqrt(best.covariance[at, at]))
    evidence = latency**2 / (sigma**2 + DELAY_SIGMA_S**2 + (LATE_STAMPS_S**2 if latency > 0 else 0.0)) / 2
    p_latency = min(1.0, chi_square_above(2 * evidence, 1) * max(len(best.candidates), 1))
    if p_latency < LEVEL:
        found.append(_late(best.comparison, latency, sigma, p_latency, evidence))
        first_p = min(first_p, p_latency)
    left = sorted((p, each.candidate.id) for each, p in zip(scored, chances, strict=True) if p <= LEVEL)
    suspected = tuple(dict.fromkeys(id for _, id in left))[:MOST_SUSPECTED]
    limits: dict[tuple[str, str], tuple[float, str]] = {}
    hidden: dict[tuple[str, str], tuple[str, ...]] = {}
    state = np.array([name for name, sigma in parts_of(observed).items() for _ in sigma])
    for each in scored:
        candidate, seen = each.candidate, each.seen
        place = candidate.id, "any turn" if candidate.id == LOST else candidate.where
        if seen.any() and not any((candidate.id, candidate.where) == (other.id, other.where) for other in best.named):
            least_seen = np.sqrt(chdtri(seen.sum(), LEVEL / len(scored))) + POWER
            name, si, _ = candidate.parts[0]
            limit = float(least_seen * candidate.plausible.max() / each.s[seen].min()) / si, name.rsplit("_", 1)[-1]
            limits[place] = max(limit, limits.get(place, limit))
        for direction in each.right[:, ~seen].T:
            parts = best.look.hidden_in(each, direction, state)
            hidden[place] = tuple(dict.fromkeys((*hidden.get(place, ()), *parts)))
    found = sorted(found, key=lambda each: -each.log_evidence)
    least = min(chances, default=1.0)
    return Selected(observed, found, limits, hidden, first_p, least, best.noise, latency, sigma, best.model.excess(best.noise), suspected)


def _late(comparison: Comparison, latency_s: float, sigma_s: float, p_value: float, evidence: float) -> Named:
    """A word that is late, which a machine or stamps of a board that are early may cause; a word that is early comes from a late sensor."""
    early, size = AS_LATENCY[0], 1 if latency_s > 0 else 3
    what = (LATENCY, "word", ("latency_ms", 1e-3, (0,))) if latency_s > 0 else (early, "all axes", ("tau_s", 1.0, (0, 1, 2)))
    candidate = Candidate(what[0], what[1], comparison.of_latency, np.ones(size), (what[2],), {})
    return Named(candidate, np.full(size, abs(latency_s)), np.full(size, sigma_s), p_value, evidence, AS_LATENCY[1:])


def _agree(observed: Observed) -> None:
    """Raise DataError where an axis turns the other way than it reports, or gravity is far from where the reported angles have it."""
    comparison = Comparison(observed)
    zero = observed.rate.mean(axis=0)
    blocks = np.where(observed.inside[..., None], observed.rates - zero, 0.0) * observed.block_s[:, None, None]
    seen = np.einsum("sbi,si->s", blocks, comparison.axis)
    for number, axis in enumerate(observed.table.axes):
        own = observed.alone == number
        share = float(np.median(seen[own] / observed.turned[own, number])) if own.any() else 1.0
        if share < LEAST_SHARE:
            what = "the other way than it reports" if share < -LEAST_SHARE else "about another direction than described"
            raise DataError(
                f"axis {axis.name} turns {what}: the gyroscope reads {share:.2f} of the reported angles about it, expected 1; put the "
                f"direction of the axis, or the mounting, right in table.toml"
            )
    down = -observed.force / np.linalg.norm(observed.force, axis=1)[:, None]
    apart = np.arccos(np.clip(np.sum(down * comparison.down, axis=1), -1, 1))
    if apart.max() > FARTHEST_RAD:
        raise DataError(
            f"gravity is up to {apart.max() / DEG:.0f} deg from where the reported angles have it (rest {int(apart.argmax())}), expected "
            f"within {FARTHEST_RAD / DEG:.0f} deg, too large for this method; are axes, zeros and mounting of table.toml right, and did no "
            f"motor lose its steps?"
        )


def _fitted(observed: Observed, named: list[Candidate], before: _Fit | None) -> _Fit:
    """Fit the state and what is named, from an earlier fit or from what is declared, each step with the noise that is estimated there.

    The best of all steps: one that is nearly a lag of the word may be followed too far, which bends it."""
    mean, sigma = prior_of(observed)
    state = mean if before is None else before.comparison.state
    known = {} if before is None else {key: before.theta[at] for key, at in before.keys.items()}
    thetas = [known.get(each.key, np.zeros(len(each.plausible))) for each in named]
    noise = None if before is None else before.noise
    states = len(state)
    best: _Fit | None = None
    exact = 3 * (len(observed.reported) + len(observed.first))  # rows of force and rotation
    step = 0
    while True:
        errors = TableErrors.none(observed.table)
        for each, theta in zip(named, thetas, strict=True):
            errors = errors if each.added is None else each.added(errors, theta)
        comparison = Comparison(observed, state, errors)
        candidates = candidates_of(comparison)
        named = [next(each for each in candidates if each.key == other.key) for other in named]
        size = np.concatenate([sigma, *(each.plausible for each in named)])
        N = np.concatenate([comparison.of_state(), *(each.columns for each in named)], axis=1) * size
        r = comparison.residuals()
        for each, theta in zip(named, thetas, strict=True):
            rows = each.columns @ theta
            rows[: exact if each.added is not None else 0] = 0.0  # the comparison has them already
            r = r - rows
        at = np.concatenate([(state - mean) / sigma, *(theta / each.plausible for each, theta in zip(named, thetas, strict=True))])
        # An error is as probable at every scale up to the plausible one: its best scale is the rms of its parameters.
        scales = [min(rms_of(theta / each.plausible) or 1.0, 1.0) for each, theta in zip(named, thetas, strict=True)]
        scale = np.concatenate([np.ones(states), *(np.full(len(theta), of) for theta, of in zip(thetas, scales, strict=True))])
        model = NoiseModel(comparison)
        noise = model.estimated(r + N[:, :states] @ at[:states], N * scale, noise)
        found = solve(np.concatenate([noise.whiten(N), np.eye(len(at))]), np.concatenate([noise.whiten(r), -at]))
        x = found.shortest
        score = noise.value
        for each, theta, of in zip(named, thetas, scales, strict=True):
            beyond = float(np.sum((theta / each.plausible / of) ** 2)) - len(theta)  # of an error larger than plausible
            score += price(len(theta), each.tried) + max(beyond, 0.0)
        if best is None or score < best.score:
            theta, covariance = x * size + np.concatenate([state, *thetas]), found.spread * np.outer(size, size)
            best = _Fit(comparison, named, candidates, model, noise, N, r, -at, theta, covariance, score)
        if step == STEPS or bool(np.all(np.abs(x) < SETTLED * np.sqrt(np.diag(found.spread)))):
            return best
        farthest = max(float(np.abs(x[:states]).max()) / FARTHEST, 1.0)
        state = moved(state, x[:states] * sigma / farthest)
        moves = np.split(x[states:], np.cumsum([len(theta) for theta in thetas])[:-1]) if named else []
        thetas = [theta + move * each.plausible / farthest for each, theta, move in zip(named, thetas, moves, strict=True)]
        step += 1


def _odd_inside(fit: _Fit) -> np.ndarray:
    """(S,) bool: turns whose rows within are unlike those of the axis' other turns."""
    seen, inner = fit.comparison.observed, fit.comparison.inner
    counts = inner.sum(axis=1)
    ends = np.cumsum(counts)
    rows = fit.look.left[fit.model.outer : len(fit.r)] ** 2
    usual = np.array([rows[end - count : end].mean() if count else np.nan for end, count in zip(ends, counts, strict=True)])
    odd = np.zeros(len(counts), dtype=bool)
    for axis in range(seen.reported.shape[1]):
        own = (seen.alone == axis) & (counts > 0)
        if own.any():
            far = own & (np.nan_to_num(usual) > ODD * np.median(usual[own]))
            odd |= far if far.sum() <= FEW * own.sum() else False
    return odd
