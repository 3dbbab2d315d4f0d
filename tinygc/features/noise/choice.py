"""Which terms a rest supports: the evidence of each set of them, never a slope.

The prior of a size is flat in its logarithm over ``DECADES``, that of a correlation time over the times that the rest can show; each term
apart from N is present with odds ``ODDS``.  The evidence is Laplace's: the likelihood at its maximum times the width of the peak over that
of the prior.  Sets are searched by adding, dropping and exchanging single terms from the best so far; N is in all of them.

Which set is named is often chance, above all between B and K, so a size is the mean over all sets, zero where a set has not the term, and
its sigma contains how the sets differ (Hoeting et al. 1999).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tinygc.features.noise.scales import Group
from tinygc.inference.choose import ONE_SIDED, averaged, climb, probabilities, weights_of
from tinygc.inference.noise import Cost, lowest, where_risen

# The likelihood of the noise terms, over all scales together.
#
# Contrasts z of windows are Gaussian with covariance C = sum s_k^2 V_k, V_k that of a term of size 1 (``unit_covariance``):
#
#     -2 log L = sum over groups  n log|C| + tr(C^-1 S),    S = sum of z z' over the n windows.
#
# The contrasts of a window do not contain its mean, nor do those of the coarsest vector contain the mean of the rest (restricted
# likelihood, Patterson & Thompson 1971).  Windows and levels are taken as independent, which they are for white noise.  For walks and
# flicker they are nearly so, like wavelet coefficients.

#: steps of Fisher scoring in ln s^2; change of -2 log L at which it ends; the longest step
STEPS, ENDS, FARTHEST = 40, 1e-4, 3.0
#: of a size: its logarithm is flat over so many decades; and the variance of ln s^2 over them
DECADES = 3.0
PRIOR_VARIANCE = (2 * DECADES * np.log(10)) ** 2 / 12
#: the trace of the sensor's filter in means that are longer than its memory.  It takes from the ends of a mean what it adds to the next
#: mean, whatever its order: white noise loses like a quantisation of negative variance, N^2 times the filter's time
FILTER = "F"
#: step of ln T for the derivative of the covariance of a Gauss-Markov term
LOG_STEP = 1e-3


def autocovariance(name: str, lag: np.ndarray, mean_s: float, correlation_s: float = 1.0) -> np.ndarray:
    """Return the covariance (n,) of two means of length mean_s, lag (n,) lengths apart, of a term of size 1.

    Of a term that is not stationary it is known up to a constant, which contrasts do not contain.

    Densities as in ``tinygc.noise.figures``; the second difference of the twice integrated covariance over the length.
    """
    h = np.abs(np.asarray(lag, dtype=float))
    if name == "N":
        return np.where(h == 0, 1 / mean_s, 0.0)
    if name in ("Q", FILTER):  # white angle at each sample: a mean is the difference of its ends
        return np.select([h == 0, h == 1], [2 / mean_s**2, -1 / mean_s**2], 0.0) * (1 if name == "Q" else -1)

    def twice(x: np.ndarray) -> np.ndarray:
        x = np.abs(x)
        if name == "B":
            return np.asarray(-(x**2) * (np.log(np.maximum(x, 1e-300)) / 2 - 0.75) / np.pi)
        if name == "K":
            return np.asarray(-mean_s * x**3 / 12)
        time = correlation_s / mean_s
        return np.asarray(time**2 * np.expm1(-x / time) + time * x)

    return twice(h + 1) - 2 * twice(h) + twice(h - 1)


def line_autocovariance(hz: float, lag: np.ndarray, mean_s: float) -> np.ndarray:
    """Return that of a line of rms 1."""
    return np.cos(2 * np.pi * hz * mean_s * np.asarray(lag)) * np.sinc(hz * mean_s) ** 2


def unit_covariance(name: str, groups: Sequence[Group], period_s: float, correlation_s: float = 1.0, hz: float = 0.0) -> list[np.ndarray]:
    """Return the covariance (d, d) of each group's contrasts for a term of size 1.

    A ramp is one slope for a whole rest: all windows have the same part of it, in which they are not independent.  That matters little,
    because the coarsest vector sees it by far the best.
    """
    found = []
    for group in groups:
        mean_s = group.size * period_s
        if name == "R":
            t = group.t() * mean_s
            found.append(np.outer(t, t))
            continue
        lag = np.abs(group.at[:, None] - group.at[None])
        every = np.arange(int(lag.max()) + 1)
        values = line_autocovariance(hz, every, mean_s) if name == "line" else autocovariance(name, every, mean_s, correlation_s)
        found.append(group.basis.T @ values[lag] @ group.basis)
    return found


#: covariances of all groups for one term, by stacks of groups with equally many contrasts: (g, d, d) each
Stacked = list[np.ndarray]


#: groups with d contrasts each: S (g, d, d); count (g,); places of the groups
Stack = tuple[np.ndarray, np.ndarray, list[int]]


def stacks_of(groups: Sequence[Group]) -> list[Stack]:
    """Put groups of the same shape together: their small matrices are inverted in one call."""
    width = np.array([len(group.S) for group in groups])
    found = []
    for d in np.unique(width):
        which = np.flatnonzero(width == d).tolist()
        found.append((np.stack([groups[k].S for k in which]), np.array([groups[k].count for k in which]), which))
    return found


def stacked(V: Sequence[np.ndarray], stacks: Sequence[Stack]) -> Stacked:
    """Stack the covariances of all groups like the groups."""
    return [np.stack([V[k] for k in which]) for *_, which in stacks]


@dataclass(frozen=True, eq=False)
class Fitted:
    """x (K,): variances s^2; value: -2 log L; information (K + f, K + f): of ln s^2, and of ln T of a Gauss-Markov term last."""

    x: np.ndarray
    value: float
    information: np.ndarray
    correlation_s: float = np.nan

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of ln s^2 (and ln T), from the expected information and the width of the prior."""
        return np.asarray(np.linalg.inv(self.information + np.eye(len(self.information)) / PRIOR_VARIANCE))


def cost(x: np.ndarray, V: Sequence[Stacked], stacks: Sequence[Stack]) -> tuple[float, np.ndarray, np.ndarray]:
    """Return -2 log L of variances x (K,), and its derivatives by each matrix of V (K', …): slope (K',), expected curvature (K', K').

    Matrices beyond the first K count in the derivatives alone.  Infinite where C is not positive.
    """
    terms = len(V)
    value, slope, curvature = 0.0, np.zeros(terms), np.zeros((terms, terms))
    for s, (S, count, _) in enumerate(stacks):
        every = np.stack([own[s] for own in V])
        C = np.tensordot(x, every[: len(x)], axes=1)
        try:
            factor = np.linalg.cholesky(C)
        except np.linalg.LinAlgError:
            return np.inf, slope, curvature
        inverse = np.linalg.inv(factor)
        inverse = np.swapaxes(inverse, 1, 2) @ inverse
        A = inverse @ every
        seen = inverse @ S
        log_size = 2 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        value += float(count @ log_size + np.trace(seen, axis1=1, axis2=2).sum())
        turned = np.ascontiguousarray(np.swapaxes(A, 2, 3)).reshape(terms, -1)
        slope += np.trace(A, axis1=2, axis2=3) @ count - turned @ seen.ravel()
        curvature += (A * count[:, None, None]).reshape(terms, -1) @ turned.T
    return value, slope, curvature


#: terms that may be added to N; the trace of a filter is none of the sensor's noise, but N is wrong without it
CANDIDATES = (FILTER, "Q", "G", "B", "K", "R")
#: prior odds of a term: with them a rest of white noise has another term named in less than 2 of 100 (benchmarks/noise_terms.py)
ODDS = 0.2
#: terms of even odds in the mean of a size over sets.  The odds of a name keep false names rare; a floor that rises has both as a rule, and
#: which one is named is chance (benchmarks/noise_terms.py --sizes)
EVEN = frozenset("BK")
#: prior odds of a filter's trace where a finer scale was left out, which the filter has shaped; at the finest scale there is none: means of
#: one sample are not longer than the filter's memory
ODDS_OF_FILTER = 100.0
#: of the variance of a mean of the finest scale: where the search for a filter's trace begins
FILTERED = 0.02
#: ln: a size whose logarithm has a larger sigma is not seen
UNSEEN = 1.0
#: times of a Gauss-Markov term that are tried, per decade
TIMES_PER_DECADE = 5
#: means of the finest scale, and share of the longest rest, within which a correlation time shows by both its sides
SHORTEST_MEANS, LONGEST_SHARE = 10.0, 1 / 30
#: of the shortest and the longest time: a shorter one is what a filter makes of the finest level, a longer one is a random walk
AT_BOUND = 1.1
#: share of a line's power that means of the finest scale pass, below which they do not show it
PASSED = 0.01
#: rise of -2 log L at an upper limit: 1.645 sigma would be 95 % of a term that is looked for alone; one that is not chosen has been drawn
#: low, and with 2 sigma the limits hold in 95 of 100.  Of B and K the mean over even sets knows it:
#: the larger of both limits counts (benchmarks/noise_terms.py --sizes)
AT_LIMIT, AT_EVEN_LIMIT = 2.0**2, ONE_SIDED**2
#: of the others at a limit: steps, and change of -2 log L at which they end; how near the limit is to be known
LIMIT_STEPS, LIMIT_ENDS, LIMIT_NEAR = 6, 1e-3, 0.03


@dataclass(frozen=True, eq=False)
class Chosen:
    """A set of terms: names, N first; their fit; log of the evidence."""

    names: tuple[str, ...]
    fitted: Fitted
    log_evidence: float

    @property
    def ids(self) -> frozenset[str]:
        """The terms that another set may lack: neither N nor a line."""
        return frozenset(name for name in self.names[1:] if not name.startswith("line"))

    @property
    def score(self) -> float:
        """-2 log of the evidence."""
        return -2 * self.log_evidence

    def variance(self, name: str) -> float:
        """s^2 of a term, 0 where it is not of the set."""
        return float(self.fitted.x[self.names.index(name)]) if name in self.names else 0.0

    def log_sigma(self, name: str) -> float:
        """Sigma of ln s."""
        return float(np.sqrt(self.fitted.covariance[(k := self.names.index(name)), k]) / 2)


@dataclass(eq=False)
class Search:
    """All that is tried on the groups of one channel; lines_hz: of lines, each a term ``line0``, ``line1``, … of every set;
    is_behind_filter: whether a finer scale was left out."""

    groups: Sequence[Group]
    period_s: float
    lines_hz: tuple[float, ...] = ()
    candidates: tuple[str, ...] = CANDIDATES
    is_behind_filter: bool = False
    tried: dict[frozenset[str], Chosen | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.stacks = stacks_of(self.groups)
        if not self.is_behind_filter:
            self.candidates = tuple(name for name in self.candidates if name != FILTER)
        self.lines_hz = tuple(hz for hz in self.lines_hz if np.sinc(hz * self.finest_s()) ** 2 > PASSED)
        names = [name for name in ("N", *self.candidates) if name != "G"]
        self.V = {name: self.unit(name) for name in names}
        self.always = ("N", *(f"line{k}" for k in range(len(self.lines_hz))))
        for name, hz in zip(self.always[1:], self.lines_hz, strict=True):
            self.V[name] = self.unit("line", hz=hz)
        self.bounds_s = self.bounds()

    def unit(self, name: str, correlation_s: float = 1.0, hz: float = 0.0) -> Stacked:
        """Return the covariance of all contrasts for a term of size 1."""
        return stacked(unit_covariance(name, self.groups, self.period_s, correlation_s, hz), self.stacks)

    def finest_s(self) -> float:
        """Return the length of a mean of the finest scale, s."""
        return min(group.size for group in self.groups) * self.period_s

    def bounds(self) -> tuple[float, float]:
        """Shortest and longest correlation time of a Gauss-Markov term, s."""
        shortest = SHORTEST_MEANS * self.finest_s()
        longest = max((group.at[-1] + 1) * group.size for group in self.groups) * self.period_s
        return shortest, max(LONGEST_SHARE * longest, 4 * shortest)

    def best(self) -> Chosen:
        """Search the sets and return the most probable one."""

        def near(best: Chosen) -> Iterator[Chosen]:
            here = best.ids
            sets = [here | {name} for name in self.candidates if name not in here]
            sets += [here - {name} for name in here]
            sets += [here - {name} | {other} for name in here for other in self.candidates if other not in here]
            return (chosen for each in sets if (chosen := self.of(each, best)) is not None)

        first = self.of(frozenset(), None)
        assert first is not None
        return climb(first, near)

    @property
    def seen(self) -> list[Chosen]:
        """All sets that were tried, of terms that are seen."""
        return [chosen for chosen in self.tried.values() if chosen is not None]

    def probability(self, name: str) -> float:
        """Probability of a term among all sets that were tried."""
        return probabilities(self.seen).get(name, 0.0)

    def average(self, name: str, wider: float = 1.0) -> tuple[float, float]:
        """Return the mean of s of a term over all sets, and its sigma; wider: factor on each set's own sigma.

        A set has the term lognormal, or is without it: s = 0.  Those of ``EVEN`` are present with even odds.
        """
        scores = [each.score + 2 * len(each.ids & EVEN) * np.log(ODDS) for each in self.seen]
        each = [(np.log(s) / 2, wider * chosen.log_sigma(name)) if (s := chosen.variance(name)) else (-np.inf, 0.0) for chosen in self.seen]
        log_s, sigma = np.array(each).T
        means = np.exp(log_s + sigma**2 / 2)
        return averaged(weights_of(scores), means, means * np.sqrt(np.expm1(sigma**2)))

    def of(self, terms: frozenset[str], near: Chosen | None = None) -> Chosen | None:
        """Return a set with its evidence; near: another set, where its search starts; None where a term is not seen."""
        if terms not in self.tried:
            self.tried[terms] = self._fit(terms, near)
        return self.tried[terms]

    def _fit(self, terms: frozenset[str], near: Chosen | None) -> Chosen | None:
        names = (*self.always, *(name for name in self.candidates if name in terms and name != "G"))
        if {FILTER, "Q"} <= terms:  # one is the other's negative
            return None
        at = [(near.variance(name) if near is not None else 0.0) or self._start(name, near) for name in names]
        if "G" not in terms:
            return self._judged(names, self._lowest(names, at))
        names = (*names, "G")
        if near is not None and "G" in near.names:
            return self._judged(names, self._lowest(names, [*at, near.variance("G")], near.fitted.correlation_s))
        # The variance and the correlation time of a Gauss-Markov term at which the likelihood rises most, to first order
        low, high = np.log10(self.bounds_s)
        own, gains = [self.V[name] for name in names[:-1]], []
        for time in np.logspace(low, high, max(round((high - low) * TIMES_PER_DECADE), 2) + 1):
            V = self.unit("G", time)
            _, slope, curvature = cost(np.array(at), [*own, V], self.stacks)
            size = max(-slope[-1] / _left(curvature), 0.0)
            gains.append((size * max(-slope[-1], 0.0), min(size, self.most(V)), float(time)))
        _, size, time = max(gains)
        return self._judged(names, self._lowest(names, [*at, size or 1e-3 * self.most(self.unit("G", time))], time))

    def _lowest(self, names: tuple[str, ...], start: list[float], correlation_s: float = np.nan) -> Fitted:
        """Maximise the likelihood over the variances (K,) of terms, and the correlation time of a Gauss-Markov term, the last, by scoring
        in their logarithms."""
        own, z = [self.V[name] for name in names if name != "G"], np.log(start)
        least, most = np.full(len(z), -300.0), np.full(len(z), 100.0)
        if "G" in names:
            z, (shortest, longest) = np.append(z, np.log(correlation_s)), np.log(self.bounds_s)
            least, most = np.append(least, shortest), np.append(most, longest)

        def at(z: np.ndarray) -> Cost:
            x, V = np.exp(z[: len(names)]), own
            if "G" in names:
                here, later = (self.unit("G", float(np.exp(z[-1] + step))) for step in (0.0, LOG_STEP))
                V = [*own, here, [x[-1] * (b - a) / LOG_STEP for a, b in zip(here, later, strict=True)]]
            value, slope, curvature = cost(x, V, self.stacks)
            scale = np.append(x, np.ones(len(z) - len(x)))
            return Cost(value, slope * scale, curvature * np.outer(scale, scale))

        z, found = lowest(at, z, least, most, STEPS, FARTHEST, ENDS)
        time = float(np.exp(z[-1])) if "G" in names else np.nan
        return Fitted(np.exp(z[: len(names)]), found.value, found.information / 2, time)

    def most(self, V: Stacked) -> float:
        """Largest variance that a term may have: at some scale it would be all that is there."""
        shares = []
        for (S, count, _), own in zip(self.stacks, V, strict=True):
            size = count * np.trace(own, axis1=1, axis2=2)
            shares += [float(s) for s in (np.trace(S, axis1=1, axis2=2)[size > 0] / size[size > 0])]
        return min(shares, default=1.0) or 1e-30

    def _start(self, name: str, near: Chosen | None) -> float:
        """Variance of a term that is not in the set near by."""
        if name == FILTER and near is not None:
            return FILTERED * near.variance("N") * self.finest_s()
        return 0.3 * self.most(self.V[name])

    def _judged(self, names: tuple[str, ...], fitted: Fitted) -> Chosen | None:
        """Return a set with its evidence; None where a term of it is not seen."""
        chosen = Chosen(names, fitted, 0.0)
        terms = [name for name in names if name not in self.always]
        if not np.isfinite(fitted.value) or any(chosen.log_sigma(name) > UNSEEN for name in terms):
            return None
        if "G" in names and not AT_BOUND * self.bounds_s[0] < fitted.correlation_s < self.bounds_s[1] / AT_BOUND:
            return None
        # Lines are in every set: what they add to the evidence is the same for all.
        own = [k for k, name in enumerate(names) if not name.startswith("line")] + ([len(names)] if "G" in names else [])
        log_width = len(own) / 2 * np.log(2 * np.pi) + np.linalg.slogdet(fitted.covariance[np.ix_(own, own)])[1] / 2
        log_prior = -(len(terms) + 1) * np.log(2 * DECADES * np.log(10)) + sum(
            np.log(ODDS_OF_FILTER if name == FILTER else ODDS) for name in terms
        )
        if "G" in names:
            log_prior -= float(np.log(np.log(self.bounds_s[1] / self.bounds_s[0])))
        return replace(chosen, log_evidence=float(-fitted.value / 2 + log_width + log_prior))

    def limit(self, chosen: Chosen, name: str) -> float:
        """Return the upper limit of s (95 %) of a term that is not of the set, the others estimated with it.

        A Gauss-Markov term has none: with its correlation time open, it could be anything that the others are.
        """
        V, bar = self.V[name], AT_EVEN_LIMIT if name in EVEN else AT_LIMIT
        own = [self.matrices(chosen, each) for each in chosen.names]

        def value(size: float) -> float:
            """-2 log L at a fixed size, the others by scoring."""

            def at(z: np.ndarray) -> Cost:
                x = np.exp(z)
                found, slope, curvature = cost(np.append(x, size**2), [*own, V], self.stacks)
                return Cost(found, slope[:-1] * x, curvature[:-1, :-1] * np.outer(x, x))

            return lowest(at, np.log(chosen.fitted.x), -300.0, 100.0, LIMIT_STEPS, FARTHEST, LIMIT_ENDS)[1].value

        _, slope, curvature = cost(chosen.fitted.x, [*own, V], self.stacks)
        left = _left(curvature)
        peak = max(-float(slope[-1]) / left, 0.0)
        low, high = np.sqrt(peak), np.sqrt(peak + np.sqrt(2 * bar / left))  # of the parabola in the variance
        least = value(low) if low else chosen.fitted.value
        return where_risen(lambda size: value(size) - least, float(low), float(high - low), bar, LIMIT_NEAR)

    def covariance(self, chosen: Chosen) -> Stacked:
        """Return the covariance of all contrasts."""
        every = [self.matrices(chosen, name) for name in chosen.names]
        return [np.tensordot(chosen.fitted.x, np.stack([own[s] for own in every]), axes=1) for s in range(len(self.stacks))]

    def matrices(self, chosen: Chosen, name: str) -> Stacked:
        """Return the covariance of all contrasts for a term of size 1."""
        return self.unit("G", chosen.fitted.correlation_s) if name == "G" else self.V[name]


def _left(curvature: np.ndarray) -> float:
    """Curvature by the last of several variances, with the best of the others."""
    inner, across = curvature[:-1, :-1], curvature[:-1, -1]
    return max(float(curvature[-1, -1] - across @ np.linalg.lstsq(inner, across, rcond=None)[0]), 1e-300)
