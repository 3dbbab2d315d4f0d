"""Noise terms at rest: are they chosen rightly, are their sigmas right, and what is said of those that are not there.

``python benchmarks/noise_terms.py`` simulates rests of 2 minutes to 20 hours with every subset of the terms beside N, in sizes
about what such a rest can show.  A subset can be seen if the evidence of its expected data ("Asimov" data: each sum of
products at its expectation) exceeds that of every other subset by ``SEEN``; there the choice is to be right in 95 of 100.

``--sizes 120`` asks so many mixtures of N, B and K, each with a probability of ``PRESENT``, whether the stated B and K lie within their
sigmas and limits, whether they can be told apart or not, and whether the halves of a rest contradict each other.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections import Counter

import numpy as np
from common import markdown
from scipy.signal import fftconvolve, lfilter

from session.base.units import NS_PER_S
from session.log.samples import Samples
from tinygc.features.noise.choice import Search, unit_covariance
from tinygc.features.noise.estimate import estimate_noise
from tinygc.features.noise.scales import Group, groups_of, rest_of
from tinygc.features.noise.summary import RestSums
from tinygc.noise.figures import TERMS, Term, unit_allan_variance

RATE_HZ = 25.0
#: rest -> s, data rate, seeds
RESTS = {"2 min": (120.0, 25.0, 3), "20 min": (1200.0, 25.0, 2), "3 h": (10_800.0, 25.0, 1), "20 h, 5 Hz": (72_000.0, 5.0, 1)}
#: steps of a period in which terms without a closed form are simulated, to be averaged like a reading
FINER = 8
#: ln: odds of the true subset over every other one, in data at their expectation, from which it can be seen: the logarithm of the odds m
#: scatters by the root of 2 m, so that at 8 it falls below 0 in 2 of 100
SEEN = 8.0


def simulated(sizes: dict[str, float], time_s: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Readings (count,) with terms of these sizes, a mean over each period; none of the estimator's code."""
    dt = 1 / RATE_HZ
    x = np.zeros(count)
    for name, size in sizes.items():
        if name == "N":
            x += size / np.sqrt(dt) * rng.standard_normal(count)
        if name == "Q":
            x += size / dt * np.diff(rng.standard_normal(count + 1))
        if name == "K":
            steps = np.sqrt(dt) * rng.standard_normal(count)  # the mean of a walk over a period: its begin, half the step, and its bridge
            x += size * (np.cumsum(steps) - steps / 2 + np.sqrt(dt / 12) * rng.standard_normal(count))
        if name == "R":
            x += size * dt * np.arange(count) * rng.choice([-1, 1])
        if name == "G":
            keep = np.exp(-dt / FINER / time_s)
            steps = size * np.sqrt(1 - keep**2) * rng.standard_normal(FINER * count)
            steps[0] = size * rng.standard_normal()
            x += lfilter([1.0], [1.0, -keep], steps).reshape(count, FINER).mean(axis=1)
        if (
            name == "B"
        ):  # fractional differences of order one half (Kasdin 1995): density B^2 dt / (2 sin(pi f dt)), at low f B^2 / (2 pi f)
            many = 2 * FINER * count
            k = np.arange(1, many)
            response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
            fine = fftconvolve(rng.standard_normal(many), response)[many // 2 : many]
            x += size * fine.reshape(count, FINER).mean(axis=1)
    return x


def drawn(terms: tuple[str, ...], duration_s: float, rng: np.random.Generator) -> tuple[dict[str, float], float]:
    """Sizes beside N = 1 that cross it within the rest: the Allan variance of each is 1 to 10 times that of N at some averaging time."""
    sizes, time_s = {"N": 1.0}, 10 ** rng.uniform(np.log10(20 / RATE_HZ), np.log10(duration_s / 30))
    for name in terms:
        low, high = (0.0, np.log10(4)) if name == "Q" else (1.0, np.log10(duration_s * RATE_HZ / 20))
        tau_s = time_s if name == "G" else 10 ** rng.uniform(low, high) / RATE_HZ
        share = 10 ** rng.uniform(0, 1)
        sizes[name] = float(np.sqrt(share / tau_s / unit_allan_variance(name, np.array([tau_s]), time_s)[0]))
    return sizes, float(time_s)


def rest(values: np.ndarray) -> RestSums:
    """Sums of readings (n, 6)."""
    sums = RestSums(RATE_HZ)
    t_ns = np.round(np.arange(len(values)) * (NS_PER_S / RATE_HZ)).astype(np.int64)
    sums.add(Samples(t_ns, values[:, :3], values[:, 3:], None))
    return sums


#: probability of B, and of K, in a mixture
PRESENT = 2 / 3
#: averaging time at which they cross N: at the earliest, s, and of the rest at the latest; apart from each other by up to a factor
CROSS_S, CROSS_SHARE, CROSS_APART = 15.0, 1 / 15, 2.0


def mixture(duration_s: float, rng: np.random.Generator) -> dict[str, float]:
    """Sizes of B and K, beside N = 1, that both rise above it about the same time, by up to 5 times its variance."""
    sizes = {"N": 1.0}
    cross_s = np.exp(rng.uniform(np.log(CROSS_S), np.log(CROSS_SHARE * duration_s)))
    for name in "BK":
        at_s = cross_s * CROSS_APART ** rng.uniform(-1, 1)
        share = 5 ** rng.uniform(0, 1)
        if rng.random() < PRESENT:
            sizes[name] = float(np.sqrt(share / at_s / unit_allan_variance(name, np.array([at_s]))[0]))
    return sizes


def sizes_table(mixtures: int) -> str:
    """Coverage of B and K."""
    z: dict[str, list[float]] = {"B": [], "K": []}
    limits: dict[str, list[bool]] = {"B": [], "K": []}
    apart, halves = [], Counter[str]()
    for number in range(-(-mixtures // 6)):
        rng = np.random.default_rng([54, number])
        duration_s = (1200.0, 3600.0)[number % 2]
        truth = [mixture(duration_s, rng) for _ in range(6)]
        count = round(duration_s * RATE_HZ)
        values = np.column_stack([simulated(sizes, 1.0, count, rng) for sizes in truth])
        whole, *parts = (
            [axis for sensor in estimate_noise([rest(each)]).figures.sensors().values() for axis in sensor.axes]
            for each in (values, values[: count // 2], values[count // 2 :])
        )
        for k, sizes in enumerate(truth):
            apart.append(not any(whole[k].terms[n].chosen and not whole[k].terms[n].is_determined for n in "BK"))
            for name in "BK":
                term, size = whole[k].terms[name], sizes.get(name, 0.0)
                if term.is_determined:
                    z[name].append((term.value - size) / (term.sigma or np.inf))
                elif term.at_most is not None:
                    limits[name].append(size <= term.at_most)
                one, other = (part[k].terms[name] for part in parts)
                halves["compared"] += 1
                halves["contradict"] += contradict(one, other) or contradict(other, one)
    rows = [
        [
            name,
            len(z[name]),
            *(f"{100 * np.mean(np.abs(z[name]) < bar):.0f} %" for bar in (1, 1.96)),
            f"{np.mean(z[name]):+.2f}",
            f"{100 * np.mean(limits[name]):.0f} % of {len(limits[name])}",
        ]
        for name in "BK"
    ]
    told = f"{apart.count(False)} of {len(apart)} axes do not tell them apart; "
    told += f"{halves['contradict']} of {halves['compared']} halves contradict."
    return markdown(["term", "stated", "within 1 sigma", "within 1.96", "mean, sigmas", "limits hold"], rows) + f"\n\n{told}"


def contradict(one: Term, other: Term) -> bool:
    """Whether two statements of one size differ by 3 sigmas: numbers, or a number above a limit."""
    if not one.is_determined:
        return False
    if other.is_determined:
        return abs(one.value - other.value) > 3 * np.hypot(one.sigma or 0, other.sigma or 0)
    return other.at_most is not None and one.value - 3 * (one.sigma or 0) > other.at_most


def margin(sizes: dict[str, float], time_s: float, like: RestSums) -> float:
    """ln of the odds of the true subset over the best other one, in data at their expectation."""
    ready = rest_of(like)
    groups = groups_of([ready], 0, [ready.blocks.mean[:, 0]], [np.zeros((len(ready.blocks), 0))])
    expected = []
    for group in groups:
        C = sum(size**2 * unit_covariance(name, [group], 1 / RATE_HZ, time_s)[0] for name, size in sizes.items())
        expected.append(Group(group.size, group.at, group.basis, C * group.count, group.count, group.top))
    search = Search(expected, 1 / RATE_HZ)
    best = search.best()
    true = search.of(frozenset(sizes) - {"N"}, best)
    if true is None:
        return -np.inf
    others = [each.log_evidence for each in search.tried.values() if each is not None and each.names != true.names]
    return true.log_evidence - max(others, default=-np.inf)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rests", nargs="*", default=list(RESTS), choices=list(RESTS))
    parser.add_argument("--sizes", type=int, metavar="MIXTURES", help="coverage of B and K alone, in so many mixtures")
    args = parser.parse_args()
    if args.sizes:
        print(sizes_table(args.sizes))
        return
    beside = [name for name in TERMS if name != "N"]
    subsets = [terms for n in range(len(beside) + 1) for terms in itertools.combinations(beside, n)]
    rows = []
    for label in args.rests:
        duration_s, globals()["RATE_HZ"], seeds = RESTS[label]
        counts: Counter[str] = Counter()
        wrong: Counter[str] = Counter()
        inside: list[bool] = []
        for number, terms in enumerate(subsets):
            for seed in range(seeds):
                rng = np.random.default_rng([seed, number, round(duration_s)])
                sizes, time_s = drawn(terms, duration_s, rng)
                count = round(duration_s * RATE_HZ)
                sums = rest(np.column_stack([simulated(sizes, time_s, count, rng) for _ in range(6)]))
                can_be_seen = margin(sizes, time_s, sums) > SEEN
                figures = estimate_noise([sums]).figures
                for axis in (axis for sensor in figures.sensors().values() for axis in sensor.axes):
                    chosen = {name for name, term in axis.terms.items() if term.chosen}
                    right = chosen == set(sizes)
                    counts["axes"] += 1
                    counts["seen"] += can_be_seen
                    counts["right of seen"] += can_be_seen and right
                    if can_be_seen and not right:
                        wrong["".join(sorted(sizes)) + ">" + "".join(sorted(chosen))] += 1
                    for name in set(TERMS) - set(sizes) if can_be_seen else ():
                        counts["absent"] += 1
                        counts["named of absent"] += name in chosen
                    for name in set(sizes) - chosen:
                        limit = axis.terms[name].at_most
                        if limit is not None:
                            counts["limits"] += 1
                            counts["within limit"] += sizes[name] <= limit
                    for name in set(sizes) if can_be_seen and right else ():
                        term = axis.terms[name]
                        inside.append(abs(term.value - sizes[name]) < (term.sigma or 0))
        rows.append(
            [
                label,
                counts["axes"],
                counts["seen"],
                f"{100 * counts['right of seen'] / max(counts['seen'], 1):.1f}%",
                f"{100 * counts['named of absent'] / max(counts['absent'], 1):.2f}%",
                f"{100 * counts['within limit'] / max(counts['limits'], 1):.0f}%",
                f"{100 * np.mean(inside or [np.nan]):.1f}%",
            ]
        )
        print(rows[-1], dict(wrong.most_common(12)), file=sys.stderr)
    print(markdown(["rest", "axes", "can be seen", "all terms right", "an absent term named", "limits hold", "within 1σ"], rows))


if __name__ == "__main__":
    main()
