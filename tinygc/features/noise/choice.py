"""Which terms a rest supports: the evidence of each set of them, never a slope.

The prior of a size is flat in its logarithm over ``DECADES``, that of a correlation time over the times that the rest can show; each term
beside N is present with odds of ``ODDS``.  The evidence is Laplace's: the likelihood at its maximum times the width of the peak over that
of the prior.  Sets are searched by adding, dropping and exchanging single terms from the best so far; N is in all of them.

Which set is named is often chance, above all between B and K, so a size is the mean over all sets, zero where a set lacks the term, and
its sigma contains how the sets differ (Hoeting et al. 1999).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr

from tinygc.features.noise.likelihood import DECADES, FILTER, Fitted, Stacked, cost, fit, fit_with_time, stacked, stacks_of, unit_covariance
from tinygc.features.noise.scales import Group

#: terms that may be added to N; the trace of a filter is none of the sensor's noise, but N is wrong without it
CANDIDATES = (FILTER, "Q", "G", "B", "K", "R")
#: prior odds of a term: with them a rest of white noise has another term named in less than 2 of 100 (benchmarks/noise_terms.py)
ODDS = 0.2
#: prior odds of B and of K in the mean of a size over sets.  The odds of a name keep false names rare; a floor that rises has both as a
#: rule, and which one is named is chance (benchmarks/noise_terms.py --sizes)
EVEN = dict.fromkeys("BK", 1.0)
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
AT_LIMIT, AT_EVEN_LIMIT = 2.0**2, 1.645**2


@dataclass(frozen=True, eq=False)
class Chosen:
    """A set of terms: names, N first; their fit; log of the evidence."""

    names: tuple[str, ...]
    fitted: Fitted
    log_evidence: float

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
        best = self.of(frozenset(), None)
        assert best is not None
        while True:
            here = frozenset(best.names) & frozenset(self.candidates)
            near = [here | {name} for name in self.candidates if name not in here]
            near += [here - {name} for name in here]
            near += [here - {name} | {other} for name in here for other in self.candidates if other not in here]
            found = [chosen for each in near if (chosen := self.of(each, best)) is not None]
            step = max(found, key=lambda chosen: chosen.log_evidence, default=best)
            if step.log_evidence <= best.log_evidence + 1e-6:
                return best
            best = step

    def probability(self, name: str) -> float:
        """Probability of a term among all sets that were tried."""
        return float(sum(weight for weight, chosen in self._sets() if name in chosen.names))

    def average(self, name: str, wider: float = 1.0) -> tuple[float, float, float]:
        """Return the mean of s of a term over all sets, its sigma and its upper limit (95 %); wider: factor on each set's own sigma.

        A set has the term lognormal, or lacks it: s = 0.  B and K are present with odds ``EVEN``.
        """
        sets = self._sets(EVEN)
        present = np.array([weight for weight, chosen in sets if name in chosen.names])
        own = [chosen for _, chosen in sets if name in chosen.names]
        if not own:
            return 0.0, 0.0, 0.0
        log_s = np.array([np.log(chosen.variance(name)) / 2 for chosen in own])
        sigma = wider * np.array([chosen.log_sigma(name) for chosen in own])
        mean, square = (float(present @ np.exp(power * log_s + (power * sigma) ** 2 / 2)) for power in (1, 2))
        low, high = float((log_s - 4 * sigma).min()), float((log_s + 4 * sigma).max())
        if 1 - present.sum() >= 0.95:
            return mean, float(np.sqrt(square - mean**2)), 0.0
        while high - low > 1e-6:
            at = (low + high) / 2
            low, high = (low, at) if present @ ndtr((log_s - at) / sigma) < 0.05 else (at, high)
        return mean, float(np.sqrt(square - mean**2)), float(np.exp(high))

    def _sets(self, odds: Mapping[str, float] = {}) -> list[tuple[float, Chosen]]:
        """Return all sets that were tried with their probabilities; odds: of terms, where they are not ``ODDS``."""
        sets = [chosen for chosen in self.tried.values() if chosen is not None]
        log = np.array([each.log_evidence + sum(np.log(odds[n] / ODDS) for n in each.names if n in odds) for each in sets])
        weight = np.exp(log - log.max())
        return list(zip((weight / weight.sum()).tolist(), sets, strict=True))

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
            return self._judged(names, fit(names, self.V, self.stacks, np.array(at)))
        names = (*names, "G")
        if near is not None and "G" in near.names:
            x, time = near.variance("G"), near.fitted.correlation_s
        else:
            # The variance and the correlation time of a Gauss-Markov term at which the likelihood rises most, to first order
            low, high = np.log10(self.bounds_s)
            times = np.logspace(low, high, max(round((high - low) * TIMES_PER_DECADE), 2) + 1)
            own = [self.V[name] for name in names[:-1]]
            gains = []
            for time in times:
                V = self.unit("G", time)
                _, slope, curvature = cost(np.array(at), [*own, V], self.stacks)
                left = curvature[-1, -1] - curvature[-1, :-1] @ np.linalg.lstsq(curvature[:-1, :-1], curvature[:-1, -1], rcond=None)[0]
                size = max(-slope[-1] / max(left, 1e-300), 0.0)
                gains.append((size * max(-slope[-1], 0.0), min(size, self.most(V)), float(time)))
            _, size, time = max(gains)
            x = size or 1e-3 * self.most(self.unit("G", time))
        return self._judged(names, fit_with_time(names, self.V, self.stacks, np.array([*at, x]), time, self.bounds_s, self.unit))

    def most(self, V: Stacked) -> float:
        """Largest variance that a term may have: at some scale it would be all that is there."""
        shares = []
        for stack, own in zip(self.stacks, V, strict=True):
            size = stack.count * np.trace(own, axis1=1, axis2=2)
            shares += [float(s) for s in (np.trace(stack.S, axis1=1, axis2=2)[size > 0] / size[size > 0])]
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
        V, names, bar = self.V[name], chosen.names, AT_EVEN_LIMIT if name in EVEN else AT_LIMIT
        own = [self.matrices(chosen, each) for each in names]

        def rise(log_x: float) -> float:
            """-2 log L at a fixed variance above that without the term, the others by scoring."""
            z, best = np.log(chosen.fitted.x), np.inf
            for _ in range(6):
                value, slope, curvature = cost(np.append(np.exp(z), np.exp(log_x)), [*own, V], self.stacks)
                if not value < best - 1e-3:
                    break
                best, x = value, np.exp(z)
                z = z + np.clip(-np.linalg.lstsq(curvature[:-1, :-1] * np.outer(x, x), slope[:-1] * x, rcond=None)[0], -2, 2)
            return float(best) - chosen.fitted.value

        _, slope, curvature = cost(chosen.fitted.x, [*own, V], self.stacks)
        inner = curvature[:-1, :-1]
        left = float(curvature[-1, -1] - curvature[-1, :-1] @ np.linalg.lstsq(inner, curvature[:-1, -1], rcond=None)[0])
        peak = max(-float(slope[-1]) / max(left, 1e-300), 0.0)
        at = np.log(peak + np.sqrt(2 * bar / max(left, 1e-300)))  # of the parabola in the variance
        low, high, lowest = -np.inf, np.inf, 0.0
        for _ in range(10):
            up = rise(at)
            lowest = min(lowest, up)
            if up - lowest > bar:
                high = at
            else:
                low = at
            if np.isfinite(low) and np.isfinite(high):
                if high - low < 0.1:
                    break
                at = (low + high) / 2
            else:
                at = at + 0.7 if np.isinf(high) else at - 0.7
        return float(np.exp(at / 2))

    def covariance(self, chosen: Chosen) -> Stacked:
        """Return the covariance of all contrasts."""
        every = [self.matrices(chosen, name) for name in chosen.names]
        return [np.tensordot(chosen.fitted.x, np.stack([own[s] for own in every]), axes=1) for s in range(len(self.stacks))]

    def matrices(self, chosen: Chosen, name: str) -> Stacked:
        """Return the covariance of all contrasts for a term of size 1."""
        return self.unit("G", chosen.fitted.correlation_s) if name == "G" else self.V[name]
