"""Choose among hypotheses: chance, evidence, rivals, and the standing of what is stated.

    rows         r = -X theta - J p + noise          X: columns of a hypothesis, J: what is fitted in any case; all in units of the noise
    chance       of the best of many hypotheses where nothing is missing: drawn for these very columns (``Selection``)
    evidence     p(r | H) / p(r | none) = mean over s of |1 + s^2 M|^-1/2 exp(y' (1 / s^2 + M)^-1 y / 2),    M = X' P X,  y = X' P r
                 theta ~ N(0, s^2) in plausible sizes, s equally probable at every scale over ``SCALES``; P projects J out
                 where the size of the noise is not known either, it is integrated out (``of_any_scale``)
    prior        odds of one hypothesis, and a share of them for each of its forms (``price``)
    statement    for, against, bounded or undecided (``standing_of``)

Where a hypothesis is fitted exactly, its best scale is the rms of its parameters, and ``penalty`` is what the mean over s leaves of it.

A p-value above its level is no evidence of absence.  Absence is stated only as a bound: the upper 95 % limit of the size (two one-sided
tests, Schuirmann 1987).  A difference is stated only by a test of the difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from itertools import product
from statistics import NormalDist
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from session.base.texts import probability
from tinygc.inference.solve import UNSEEN, left_of, orthonormal, unit_columns

#: level of every test, family-wise where several are made, and of the limits, which hold with 95 %; of 200 sessions with nothing wrong the
#: test of ``explain`` is below it in 6.5 % +- 1.7 %, and far fewer have a name (benchmarks/doors.py)
LEVEL = 0.05
#: p-value below which a recording contradicts a model
MISMATCH_P = 0.01
#: sigmas of a one-sided limit at ``LEVEL``
ONE_SIDED = NormalDist().inv_cdf(1 - LEVEL)

# Probabilities of a few statistics: importing ``scipy.stats`` takes longer than a fit.
#
# tests/test_least_squares_physics.py compares them with it.


def chi_square_above(value: float, freedom: int) -> float:
    """Probability that chi-square with ``freedom`` >= 1 degrees of freedom exceeds a value.

    For integer degrees the incomplete gamma function is a finite sum of positive terms (Abramowitz & Stegun 1964, 26.4.4 and 26.4.5).
    """
    half = value / 2
    if not 0 < half < math.inf:
        return value if math.isnan(value) else float(half <= 0)
    odd = freedom % 2
    powers = np.arange(freedom // 2) + odd / 2
    logs = powers * math.log(half) - half - np.array([math.lgamma(power + 1) for power in powers])
    return min(1.0, odd * math.erfc(math.sqrt(half)) + float(np.sum(np.exp(logs))))


def normal_above(value: float) -> float:
    """Probability that a standard normal variable exceeds a value."""
    return math.erfc(value / math.sqrt(2)) / 2


# Chance: the group of columns that explains the residuals beyond it.
#
# What is fitted in any case is projected out of everything.  Each candidate's group of P columns is tested with Fisher's F, which uses
# the residuals' own scale, so its false-alarm rate holds if the noise is larger than stated; where the noise is known, with chi-square.
# The smallest p-value of so many correlated groups is not itself a p-value; its distribution when nothing is missing is drawn by Monte
# Carlo for this design.

#: Monte Carlo draws: the 5 % level is then known to 0.7 % (binomial)
DRAWS = 1000
#: draws that are tested at once, as those of thousands of rows are the largest arrays of a session
TOGETHER = 200
#: the least part of a column that may be left by allowances, which are finite differences themselves (``twin.SMALL_SHARE``)
UNSEEN_LEFT = 1e-3

#: key of a candidate: an id, a number or the effect itself
Name = TypeVar("Name")


class Selection(Generic[Name]):
    """Tests of candidates against one set of nuisance columns.

    nuisance (n, p); candidates: name -> columns (n, P); allowances (n, m): directions along which the covariance is wide; scale_rows: rows
    that determine the noise scale; along: names of the candidates that are also tested along the allowances.  is_known: whether the rows
    are in units of a known noise; otherwise their own scale counts, with ``further``: squares and degrees of freedom of it as well.
    seen: columns are changes of a plausible size, and a direction counts if it is at least so many sigmas; None: it counts if more than
    ``UNSEEN`` of it is left.
    """

    def __init__(
        self,
        nuisance: np.ndarray,
        candidates: Mapping[Name, np.ndarray],
        seed: int,
        *,
        allowances: np.ndarray | None = None,
        scale_rows: slice | np.ndarray = slice(None),
        along: frozenset = frozenset(),
        is_known: bool = False,
        further: tuple[float, float] = (0.0, 0.0),
        seen: float | None = None,
    ):
        self.q = orthonormal(nuisance)
        #: each candidate's orthonormal columns (n, r) after projection; a candidate with none left is dropped
        self.groups = {name: basis for name, each in candidates.items() if (basis := left_of(self.q, each, seen=seen)).shape[1]}
        self.n = len(nuisance)
        self._seed, self._rows, self._along = seed, scale_rows, along
        self._candidates, self._nuisance, self._allowances = candidates, nuisance, allowances
        self._is_known, self._further = is_known, further

    def gains(self, r: np.ndarray) -> dict[Name, float]:
        """Chi-square that each candidate would remove of residuals r (n,)."""
        r = r - self.q @ (self.q.T @ r)
        return {name: float(np.sum((basis.T @ r) ** 2)) for name, basis in self.groups.items()}

    def p_value(self, r: np.ndarray) -> float:
        """Probability that some candidate explains as much of residuals r (n,) as the best one does if nothing is missing."""
        return self.family_wise(float(self.lowest_log_p(r[:, None])[0]))

    def family_wise(self, log_p: float) -> float:
        """Probability that the smallest p-value of all groups is as small as this if nothing is missing."""
        if np.isnan(log_p):
            return float("nan")
        drawn = float((1 + np.searchsorted(self._lowest, log_p, side="right")) / (DRAWS + 1))
        if log_p >= self._lowest[DRAWS // 100]:
            return drawn
        # The draws give the effective number of independent tests; Sidak's formula then extrapolates beyond the draws.
        tests = np.log1p(-0.1) / np.log1p(-np.exp(self._lowest[DRAWS // 10]))
        return min((1 + DRAWS // 100) / (DRAWS + 1), float(-np.expm1(tests * np.log1p(-np.exp(max(log_p, -700))))))

    @cached_property
    def _lowest(self) -> np.ndarray:
        """(DRAWS,) sorted logarithms of the smallest p-value where nothing is missing."""
        rng = np.random.default_rng(self._seed)
        r = rng.standard_normal((self.n, DRAWS))
        more = rng.chisquare(self._further[1], DRAWS) if self._further[1] else np.zeros(DRAWS)
        some = [slice(first, first + TOGETHER) for first in range(0, DRAWS, TOGETHER)]
        return np.sort(np.concatenate([self.lowest_log_p(r[:, own], more[own]) for own in some]))

    @cached_property
    def _tested(self) -> tuple[np.ndarray, list[tuple[np.ndarray, bool]]]:
        """Orthonormal nuisance including the allowances, and the remaining groups, each with whether it is tested along the allowances."""
        if self._allowances is None:
            return self.q, [(basis, False) for basis in self.groups.values()]
        q = orthonormal(np.concatenate([unit_columns(self._nuisance), unit_columns(self._allowances)], axis=1), UNSEEN)
        groups = []
        for name, columns in self._candidates.items():
            basis = left_of(self.q, columns) if name in self._along else left_of(q, columns, UNSEEN_LEFT)
            if basis.shape[1]:
                groups.append((basis, name in self._along))
        return q, groups

    def lowest_log_p(self, r: np.ndarray, more: np.ndarray | None = None) -> np.ndarray:
        """(draws,) logarithm of the smallest p-value of residuals r (n, draws); more (draws,): further squares, those given if None."""
        from scipy.special import chdtrc, fdtrc  # late: a fit asks for no chance

        q, groups = self._tested
        r = r - self.q @ (self.q.T @ r)
        left = (r - q @ (q.T @ r))[self._rows]
        rss = np.sum(left**2, axis=0) + (self._further[0] if more is None else more)
        freedom = len(left) - np.sum(q[self._rows] ** 2) + self._further[1]
        lowest = np.zeros(r.shape[1])
        for basis, is_along in groups:
            rank = basis.shape[1]
            gain = np.sum((basis.T @ r) ** 2, axis=0)
            if self._is_known:
                lowest = np.minimum(lowest, _log_tail(chdtrc(rank, gain), -gain / 2))
                continue
            rest, rest_freedom = (rss, freedom) if is_along else (np.maximum(rss - gain, 1e-12 * rss), freedom - rank)
            if rest_freedom > 1 - 1e-9:  # a difference of rounded sums
                ratio = (gain / rank) / np.maximum(rest / rest_freedom, 1e-300)
                far = -rest_freedom / 2 * np.log1p(ratio * rank / rest_freedom)  # the tail of F is a power law
                lowest = np.minimum(lowest, _log_tail(fdtrc(rank, rest_freedom, ratio), far))
        return lowest


def _log_tail(above: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Logarithm of a probability, ``far`` where that underflows."""
    with np.errstate(divide="ignore"):
        value = np.log(above)
    return np.where(np.isfinite(value), value, far)


def tail(statistic: float, known: np.ndarray, uncertain: Sequence[tuple[np.ndarray, np.ndarray]], seed: int = 0) -> float:
    """Probability that t' t is at least ``statistic`` for t (k,) of covariance known + sum f_i P_i, over the draws of the factors f_i.

    uncertain: P_i (k, k) with the draws (D,) of its factor (``factors_by_freedom``, ``factors_by_size``); without any, chi-square's tail.
    """
    k = len(known)
    if not uncertain:
        return chi_square_above(statistic, k)
    count = len(uncertain[0][1])
    covariance = np.repeat(known[None], count, axis=0)
    for part, factors in uncertain:
        covariance += factors[:, None, None] * part
    size = np.linalg.eigvalsh(covariance)
    drawn = np.random.default_rng(seed).standard_normal((count, k)) ** 2
    return float((1 + np.sum(np.sum(drawn * np.maximum(size, 0.0), axis=1) >= statistic)) / (count + 1))


def factors_by_freedom(freedom: float, seed: int, draws: int) -> np.ndarray:
    """(draws,) of the true variance over its estimate from a sample with these degrees of freedom: nu / chi^2_nu."""
    return freedom / np.random.default_rng([1, seed]).chisquare(freedom, draws)


def factors_by_size(s: float, sigma: float, seed: int, draws: int) -> np.ndarray:
    """(draws,) of the true variance of a component, of size 1, from its size and that one's sigma, never below zero."""
    return np.maximum(s + sigma * np.random.default_rng([2, seed]).standard_normal(draws), 0.0) ** 2


def level_of_each(level: float, count: int) -> float:
    """Level of each of ``count`` independent tests with this probability of any false alarm (Sidak)."""
    return float(-np.expm1(np.log1p(-level) / max(count, 1)))


def chance_of_any(p_value: float, count: int) -> float:
    """Probability that the best of ``count`` independent tests has as small a p-value (Sidak)."""
    return float(-np.expm1(count * np.log1p(-min(p_value, 1 - 1e-16))))


# Evidence of a hypothesis against none.

#: prior odds of any effect of the catalogue, and of any shape without a name: about one recording in three shows none of twenty effects
PRIOR_ODDS = 1 / 30
#: log width of the prior of a hypothesis' scale, from unobservable to larger than any sensor has
SCALES = 10.0
#: scales over which the evidence is the mean, of the plausible size
STEPS = np.exp(-np.linspace(0.0, SCALES, 11))
#: natural logarithms of the odds from which an effect is suspected, being more probable than not as a name of ``explain`` is; and from
#: which the recording contradicts the model: it is there with 95 %
SUSPECTED, SURE = float(np.log(1 / PRIOR_ODDS)), float(np.log(19 / PRIOR_ODDS))
#: that of odds between two effects that one fit does not separate: "positive" evidence (Kass & Raftery 1995)
AS_PROBABLE = 3.0


def penalty(size: int, shapes: float) -> float:
    """What the evidence pays for ``size`` parameters, -2 log: their scale, the number of trial shapes, their position in the prior."""
    return 2 * float(np.log(SCALES) + np.log(shapes)) + size


def price(size: int, shapes: float) -> float:
    """``penalty`` with the prior odds, -2 log."""
    return penalty(size, shapes) - 2 * float(np.log(PRIOR_ODDS))


def least_gain(size: int, shapes: int) -> float:
    """Chi-square that a hypothesis must remove to be as probable as none.  Each parameter also costs the logarithm of its signal-to-noise
    ratio."""
    from scipy.special import lambertw

    # Of gain - size ln(gain / size) = price the larger root: Lambert's lower branch.
    return -size * float(lambertw(-np.exp(-price(size, shapes) / size), -1).real)


def promised(gain: Any, size: Any) -> Any:
    """Twice the log evidence, without its price, of ``size`` columns that remove this chi-square, at their best scale: each parameter costs
    the logarithm of its signal-to-noise ratio.  Of numbers, or of arrays that go together."""
    return gain - size * np.log(np.maximum(gain / size, 1.0))


def scales_of(counts: Sequence[int]) -> np.ndarray:
    """(K, sum of counts) all sets of ``STEPS`` of hypotheses with these counts of parameters, one scale for all parameters of each."""
    each = np.array(list(product(STEPS, repeat=len(counts))))
    return np.repeat(each.reshape(len(each), len(counts)), counts, axis=1)


def log_evidence(information: np.ndarray, pull: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """(K,) logarithm of the evidence of columns X against none for each set of prior sigmas, scales (K, P); information X' P X (P, P) and
    pull X' P r (P,) of whitened rows."""
    inner = np.eye(len(information)) + information * scales[:, :, None] * scales[:, None, :]
    scaled = pull * scales
    _, size = np.linalg.slogdet(inner)
    solved = np.linalg.solve(inner, scaled[..., None])[..., 0]
    return np.asarray(np.einsum("ki,ki->k", scaled, solved) - size) / 2


def over_scales(information: np.ndarray, pull: np.ndarray, counts: Sequence[int]) -> float:
    """``log_evidence`` of hypotheses with these counts of parameters, their mean over all scales."""
    found = log_evidence(information, pull, scales_of(counts))
    return float(np.logaddexp.reduce(found) - np.log(len(found)))


#: share of its square below which nothing is left of a column by others
NOTHING_LEFT = 1e-9


def each_alone(r: np.ndarray, J: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pull and information (K,) of each column (n, K) by itself, given J (n, p), in whitened rows r (n,) = column size + J p + noise; NaN
    where J leaves nothing of it.

    Its size is pull / information, of sigma information^-1/2, and removes a chi-square of pull^2 / information.
    """
    q = orthonormal(J)
    left = columns - q @ (q.T @ columns)
    information = np.sum(left**2, axis=0)
    return left.T @ r, np.where(information > NOTHING_LEFT * np.sum(columns**2, axis=0), information, np.nan)


def of_any_scale(squares: float | np.ndarray, freedom: float, parameters: int, width: float) -> np.ndarray:
    """-2 log evidence of rows whose noise has an unknown size, which is integrated out, its logarithm flat.

        nu ln(squares / 2) - 2 ln Gamma(nu / 2) + k ln(width)

    squares: of the residuals, any shape; nu: their degrees of freedom; k: parameters, each of a prior as wide as what moves the rows by
    ``width`` in squares.
    """
    from scipy.special import gammaln

    return np.asarray(freedom * np.log(squares / 2) - 2 * gammaln(freedom / 2) + parameters * np.log(width))


#: sigma, in units of an effect's plausible size, of the prior that keeps unobservable components finite.  At ten it biases a value that is
#: known to a tenth of the plausible size by one in ten thousand
WIDE = 10.0


def linear_estimate(r: np.ndarray, J: np.ndarray, columns: np.ndarray, plausible: float) -> tuple[np.ndarray, np.ndarray]:
    """Estimate theta (P,) and its covariance (P, P) from whitened residuals r (n,), the columns J (n, p) of what is fitted with it, and its
    own columns (n, P).  The remaining residual is r + columns theta."""
    q = orthonormal(J)
    own = columns - q @ (q.T @ columns)
    covariance = np.linalg.inv(own.T @ own + np.eye(own.shape[1]) / (WIDE * plausible) ** 2)
    return -covariance @ (own.T @ r), covariance


# Several hypotheses.

#: -2 log evidence by which an equivalent may be worse and still be listed: beyond it evidence is "very strong" (Kass & Raftery 1995)
STAND_IN = 10.0


class Weighed(Protocol):
    """A set of hypotheses that has been weighed: their ids; score: -2 log of its evidence times its prior."""

    @property
    def ids(self) -> frozenset[str]:
        """Ids of its hypotheses."""

    @property
    def score(self) -> float:
        """-2 log of evidence times prior."""


Some = TypeVar("Some", bound=Weighed)


def climb(best: Some, near: Callable[[Some], Iterable[Some]], least: float = 1e-6) -> Some:
    """The set of most evidence that single steps reach: of those near the best so far the best is taken, until none is better by more than
    ``least`` in log evidence."""
    while (ahead := min(near(best), key=lambda each: each.score, default=best)).score < best.score - 2 * least:
        best = ahead
    return best


def weights_of(scores: Sequence[float] | np.ndarray) -> np.ndarray:
    """Posterior probability (N,) of each set by its score."""
    weight = np.exp((np.min(scores) - np.asarray(scores)) / 2)
    return np.asarray(weight / weight.sum())


def probabilities(weighed: Sequence[Weighed]) -> dict[str, float]:
    """Posterior probability of each id, over all sets; "" for none."""
    found: dict[str, float] = {}
    for each, weight in zip(weighed, weights_of([each.score for each in weighed]), strict=True):
        for name in each.ids or ("",):
            found[name] = found.get(name, 0.0) + float(weight)
    return {name: min(p, 1.0) for name, p in found.items()}


def rivals_of(weighed: Sequence[Weighed], best: Weighed, own: str) -> dict[str, float]:
    """-2 log evidence by which each id that was weighed in place of ``own`` is worse."""
    others = best.ids - {own}
    found: dict[str, float] = {}
    for each in weighed:
        extra = each.ids - others
        if others <= each.ids and len(extra) == 1 and own not in extra:
            (name,) = extra
            found[name] = min(found.get(name, np.inf), each.score - best.score)
    return found


class Division(NamedTuple):
    """Whose an effect is: numbers of the units, as text, with a value each, and ``ONE_VALUE`` where all others have one; its score."""

    ids: frozenset[str]
    score: float


ONE_VALUE = "one value"


def divided(values: np.ndarray, covariances: np.ndarray, share: float = 0.0) -> list[Division]:
    """Weigh whether units have one value, each its own, or none; the best first.

    values (U, P) of the units, in plausible sizes, with covariances (U, P, P); share: of their errors that units have in common, below 1,
    which more units do not reduce.  Each value pays the prior odds once; those of units by themselves have one scale.
    """
    count, size = values.shape
    roots = np.linalg.cholesky(covariances).reshape(-1, size)
    precision = np.linalg.inv(roots @ roots.T * np.where(np.kron(np.eye(count), np.ones((size, size))), 1.0, share))
    columns = np.eye(count * size).reshape(count, size, -1)
    names = [*map(str, range(count)), ONE_VALUE]
    weighed = {frozenset[str](): Division(frozenset(), 0.0)}

    def weigh(ids: frozenset[str]) -> Division:
        apart, rest = ([k for k in range(count) if (str(k) in ids) == own] for own in (True, False))
        if ONE_VALUE in ids and len(rest) < 2:  # what is left is by itself
            return weigh(frozenset(names[:-1]))
        if ids not in weighed:
            sets = [columns[apart].reshape(-1, count * size)] * bool(apart) + [columns[rest].sum(axis=0)] * (ONE_VALUE in ids)
            X = np.concatenate(sets)
            evidence = over_scales(X @ precision @ X.T, X @ precision @ values.ravel(), [len(each) for each in sets])
            weighed[ids] = Division(ids, -2 * (evidence + len(ids) * float(np.log(PRIOR_ODDS))))
        return weighed[ids]

    for start in (frozenset[str](), frozenset({ONE_VALUE})):
        climb(weigh(start), lambda best: [weigh(best.ids ^ {name}) for name in names])
    return sorted(weighed.values(), key=lambda each: each.score)


def averaged(weights: np.ndarray, values: np.ndarray, sigmas: np.ndarray) -> tuple[float, float]:
    """Mean of a number over sets with these weights (N,), and its sigma, which contains how the sets differ (Hoeting et al. 1999)."""
    mean = float(weights @ values)
    return mean, float(np.sqrt(weights @ (sigmas**2 + (values - mean) ** 2)))


# Statements.


class Standing(StrEnum):
    """Standing of a statement by the evidence."""

    FOR = "for"
    AGAINST = "against"
    BOUNDED = "bounded"
    UNDECIDED = "undecided"


def standing_of(p_value: float, *, p_claimed: float = 1.0, upper: float = np.inf, matters: float = 0.0) -> Standing:
    """Return the standing of a size.

    p_value: of the test that the size is zero; p_claimed: of the test that it is the claimed one, 1 if none is claimed; upper: its upper
    95 % limit, and matters: the size from which on it matters, in one unit.  A size that is neither zero nor the claimed one counts against
    the claim.
    """
    if p_claimed < LEVEL:
        return Standing.AGAINST
    if p_value < LEVEL:
        return Standing.FOR
    return Standing.BOUNDED if upper < matters else Standing.UNDECIDED


def upper_limit(value: float, sigma: float) -> float:
    """Upper 95 % limit of the magnitude of a normal estimate: each sign is excluded by a one-sided test."""
    return abs(value) + ONE_SIDED * sigma


@dataclass(frozen=True, eq=False)
class Agreement:
    """Whether independent estimates are of one value: chi-square of homogeneity (Cochran 1954), its degrees of freedom and its p-value;
    pooled (P,): their weighted mean, with its covariance (P, P)."""

    written = ("chi_square", "freedom", "p_value")
    chi_square: float
    freedom: int
    p_value: float
    pooled: np.ndarray
    covariance: np.ndarray


def agreement(values: np.ndarray, covariances: np.ndarray) -> Agreement:
    """Of estimates (U, P) with covariances (U, P, P); each number is scaled to its own size, against rounding."""
    scale = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)).min(axis=0)
    both = np.outer(scale, scale)
    weights = np.linalg.inv(covariances / both)
    covariance = np.linalg.inv(weights.sum(axis=0))
    pooled = covariance @ np.einsum("uij,uj->i", weights, values / scale)
    apart = values / scale - pooled
    chi_square, freedom = float(np.einsum("ui,uij,uj->", apart, weights, apart)), values.size - len(pooled)
    p_value = chi_square_above(chi_square, freedom) if freedom else 1.0
    return Agreement(chi_square, freedom, p_value, pooled * scale, covariance * both)


@dataclass(frozen=True)
class Statement:
    """A statement with its evidence.  what: its subject; test: the name of the test; size, limit: with units; claimed: the size that was
    claimed, if one was; more: text behind it; value, sigma, upper: the size, its sigma and its upper 95 % limit as numbers, where
    they are known; figures: what else its table has."""

    what: str
    standing: Standing
    test: str
    p_value: float
    size: str
    limit: str
    claimed: str = ""
    more: str = ""
    value: float = np.nan
    sigma: float = np.nan
    upper: float = np.inf
    figures: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, what: str, test: str, p_value: float, size: str, limit: str, *, p_claimed: float = 1.0, matters: float = 0.0, **more: Any
    ) -> Statement:
        """Return it with the standing that its tests give it (``standing_of``), and the p-value of the one that decides."""
        standing = standing_of(p_value, p_claimed=p_claimed, upper=more.get("upper", np.inf), matters=matters)
        return cls(what, standing, test, p_claimed if standing is Standing.AGAINST else p_value, size, limit, **more)

    @property
    def words(self) -> str:
        """Return one sentence without its full stop."""
        words = {
            Standing.FOR: self.size,
            Standing.AGAINST: f"{self.size}, not {self.claimed}",
            Standing.BOUNDED: f"below {self.limit} with 95 %",
            Standing.UNDECIDED: f"undecided; {self.size}; more than {self.limit} is excluded with 95 %",
        }
        return f"{self.what}: {words[self.standing]} ({self.test}, {probability(self.p_value)}){self.more}"

    def table(self) -> dict[str, Any]:
        """Return it for JSON."""
        of = {name: getattr(self, name) for name in ("what", "standing", "test", "p_value")}
        return of | {"description": self.words, **self.figures}
