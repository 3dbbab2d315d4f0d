"""Lot statistics: how time and memory grow with the units, and whether means, drifts and spreads are what they say.

scaling    units, CPU seconds to read and to fit, megabytes at the most
coverage   how often the truth is within one and two sigmas; variances against the true ones; lots with an outlier that is none
robust     the same with one unit in twenty that does not belong
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator

import numpy as np
from common import markdown

from session.io.units import DEG
from tinygc.annexes.lots.estimate import estimate
from tinygc.annexes.lots.lot import NAMES, UnitResult, lot_sessions

COUNT = len(NAMES)
#: between units, one sigma of each number, SI
SPREAD = np.array([3e-3] * 9 + [0.6 * DEG] * 3 + [2e-3, 1e-3, 1e-3, 2e-3, 1e-3, 2e-3, 0.1, 0.1, 0.1])
KINDS = 50


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["scaling", "coverage", "robust"], metavar="PART", help="scaling, coverage, robust")
    parser.add_argument("--lots", type=int, default=100, help="of coverage (%(default)s)")
    parser.add_argument("--units", type=int, default=60, help="of each of these (%(default)s)")
    parser.add_argument("--most", type=int, default=100_000, help="units of the largest lot of scaling (%(default)s)")
    args = parser.parse_args()
    for part in args.parts:
        scaling(args.most) if part == "scaling" else coverage(args.lots, args.units, 0.05 * (part == "robust"))


def scaling(most: int) -> None:
    """From a thousand units on, ten times as many each time."""
    rows, units = [], 1000
    while units <= most:
        began = time.process_time()
        lot = lot_sessions(many(units, 0))
        read = time.process_time()
        found = estimate(lot)
        ended = time.process_time()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        ratio = float(np.mean(found.spread / SPREAD))
        times = (f"{read - began:.1f}", f"{ended - read:.1f}", f"{1e3 * (ended - began) / units:.2f}")
        rows.append([str(units), *times, f"{peak:.0f}", f"{ratio:.4f}"])
        units *= 10
    print(markdown(["units", "read, CPU s", "fit, CPU s", "ms per unit", "peak, MB", "spread / truth"], rows))


def coverage(lots: int, units: int, wild: float) -> None:
    """Of lots of some units, every second with three sessions; a share of the units is 20 sigmas off."""
    mean, _ = truth()
    inside: dict[str, list] = {"mean, 1 sigma": [], "mean, 2 sigma": [], "drift, 2 sigma": []}
    sizes, odd = [], 0
    for seed in range(lots):
        lot = lot_sessions(many(units, seed, repeated=0.5, sessions=3, wild=wild))
        found = estimate(lot)
        z = np.abs(found.mean - mean) / found.mean_sigma
        drift = np.abs(found.drift) / found.drift_sigma
        for name, hits in zip(inside, (z < 1, z < 2, drift < 2), strict=True):
            inside[name].append(hits)
        sizes.append([(found.spread / SPREAD) ** 2, (found.repeatability / (0.1 * SPREAD)) ** 2])
        odd += found.odd.any()
    rows = [[name, f"{100 * float(np.mean(each)):.1f} %"] for name, each in inside.items()]
    names = ("variance of units / truth, mean", "variance of repeats / truth, mean")
    rows += [[name, f"{size:.3f}"] for name, size in zip(names, np.mean(sizes, axis=(0, 2)), strict=True)]
    rows.append(["lots with an outlier", str(odd)])
    print(markdown([f"{lots} lots of {units}, {100 * wild:.0f} % off", "truth inside"], rows))


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Mean (21,) and covariance (21, 21)."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(COUNT, COUNT))
    C = A @ A.T + 10 * np.eye(COUNT)
    size = np.sqrt(np.diag(C))
    mean = np.where(np.isin(NAMES, ("E_xx", "E_yy", "E_zz")), 1.0, 0.0) + SPREAD * rng.normal(size=COUNT)
    return mean, C / np.outer(size, size) * np.outer(SPREAD, SPREAD)


def many(units: int, seed: int, repeated: float = 0.05, sessions: int = 2, wild: float = 0.0) -> Iterator[UnitResult]:
    """Sessions of a lot: noise 0.2 of the spread, in one of some kinds of covariance; repeats 0.1; a share of units with several."""
    mean, covariance = truth()
    rng, root, kinds = np.random.default_rng(seed), np.linalg.cholesky(covariance), []
    for _ in range(KINDS):
        B = np.eye(COUNT) + 0.3 * rng.normal(size=(COUNT, COUNT))
        R = B @ B.T
        size = 0.2 * SPREAD * np.exp(0.3 * rng.normal(size=COUNT)) / np.sqrt(np.diag(R))
        R = R * np.outer(size, size)
        kinds.append((R, np.linalg.cholesky(R)))
    for u in range(units):
        unit = mean + root @ rng.normal(size=COUNT)
        if rng.random() < wild:
            unit = unit + 20 * SPREAD * rng.normal(size=COUNT)
        for s in range(sessions if rng.random() < repeated else 1):
            R, half = kinds[rng.integers(KINDS)]
            values = unit + 0.1 * SPREAD * rng.normal(size=COUNT) + half @ rng.normal(size=COUNT)
            yield UnitResult(f"{u}-{s}", f"{u:06d}", f"{u}-{s}", values, R, order=float(u))


if __name__ == "__main__":
    main()
