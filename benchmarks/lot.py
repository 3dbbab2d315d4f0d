"""Lot statistics: how time and memory grow with the units, and whether spreads, means and alarms are what they say.

scaling    units, CPU seconds to read and to fit, megabytes at the most
coverage   how often the truth is within one and two sigmas (mean, drift), or within the 95 % interval (spread, repeatability)
robust     the same with one unit in twenty that does not belong
alarms     lots in control: how often any chart, rule or outlier rings; degrees of freedom of sigmas from moving ranges
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator

import numpy as np
from common import markdown

from session.io.units import DEG
from tinygc.annexes.lots.capability import chart
from tinygc.annexes.lots.hierarchy import hierarchy
from tinygc.annexes.lots.lot import NAMES, UnitResult, lot_sessions
from tinygc.annexes.lots.outliers import outliers
from tinygc.annexes.lots.report import _interval

COUNT = len(NAMES)
#: between units, one sigma of each number, SI
SPREAD = np.array([3e-3] * 9 + [0.6 * DEG] * 3 + [2e-3, 1e-3, 1e-3, 2e-3, 1e-3, 2e-3, 0.1, 0.1, 0.1])
KINDS = 50
PARTS = ("scaling", "coverage", "robust", "alarms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=list(PARTS), metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--lots", type=int, default=100, help="of coverage and alarms (%(default)s)")
    parser.add_argument("--units", type=int, default=60, help="of each of these (%(default)s)")
    parser.add_argument("--most", type=int, default=100_000, help="units of the largest lot of scaling (%(default)s)")
    args = parser.parse_args()
    for part in args.parts:
        {"scaling": scaling, "coverage": coverage, "robust": robust, "alarms": alarms}[part](args)


def scaling(args: argparse.Namespace) -> None:
    """From a thousand units on, ten times as many each time."""
    rows, units = [], 1000
    while units <= args.most:
        began = time.process_time()
        lot = lot_sessions(many(units, 0))
        read = time.process_time()
        found = hierarchy(lot)
        ended = time.process_time()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        ratio = float(np.mean(np.sqrt(np.diag(found.spread)) / SPREAD))
        rows.append(
            [
                str(units),
                f"{read - began:.1f}",
                f"{ended - read:.1f}",
                f"{1e3 * (ended - began) / units:.2f}",
                f"{peak:.0f}",
                f"{ratio:.4f}",
            ]
        )
        units *= 10
    print(markdown(["units", "read, CPU s", "fit, CPU s", "ms per unit", "peak, MB", "spread / truth"], rows))


def coverage(args: argparse.Namespace, wild: float = 0.0) -> None:
    """Of lots of some units, every second with three sessions."""
    mean, _ = truth()
    inside: dict[str, list] = {
        "mean, 1 sigma": [],
        "mean, 2 sigma": [],
        "drift, 2 sigma": [],
        "spread, 95 %": [],
        "repeatability, 95 %": [],
    }
    size: list[np.ndarray] = []
    again: list[np.ndarray] = []
    for seed in range(args.lots):
        found = hierarchy(lot_sessions(many(args.units, seed, repeated=0.5, sessions=3, wild=wild)))
        z = (found.mean - mean) / np.sqrt(np.diag(found.mean_covariance))
        inside["mean, 1 sigma"].append(np.abs(z) < 1)
        inside["mean, 2 sigma"].append(np.abs(z) < 2)
        inside["drift, 2 sigma"].append(np.abs(found.drift) < 2 * np.sqrt(np.diag(found.drift_covariance)))
        inside["spread, 95 %"].append(_within(np.sqrt(np.diag(found.spread)), found.spread_freedom, SPREAD))
        inside["repeatability, 95 %"].append(_within(np.sqrt(np.diag(found.repeatability)), found.repeatability_freedom, 0.1 * SPREAD))
        size.append(np.diag(found.spread) / SPREAD**2)
        again.append(np.diag(found.repeatability) / (0.1 * SPREAD) ** 2)
    rows = [[name, f"{100 * float(np.mean(each)):.1f} %"] for name, each in inside.items()]
    rows += [["variance of units / truth, mean", f"{np.mean(size):.3f}"], ["variance of repeats / truth, mean", f"{np.mean(again):.3f}"]]
    print(markdown([f"{args.lots} lots of {args.units}, {100 * wild:.0f} % off", "truth inside"], rows))


def robust(args: argparse.Namespace) -> None:
    """With 5 % of units 20 sigmas off."""
    coverage(args, 0.05)


def alarms(args: argparse.Namespace) -> None:
    """In lots and charts where nothing is wrong."""
    rows = []
    for units in (50, 300, 2000):
        rung = np.zeros(3)
        charts = max(10 * args.lots, 100)
        for seed in range(charts):
            rng = np.random.default_rng(seed)
            sigma = 0.3 * np.exp(0.5 * rng.normal(size=units))
            found = chart(rng.normal(size=units) + sigma * rng.normal(size=units), sigma)
            rung += [len(found.alarms) > 0, len(found.ewma_alarms) > 0, len(found.broken) > 0]
        rows.append([str(units), *(f"{100 * share:.1f} %" for share in rung / charts)])
    print(markdown(["units of a chart", "a point", "moving average", "a rule"], rows))
    off = 0
    for seed in range(args.lots):
        lot = lot_sessions(many(args.units, seed, repeated=0.5))
        off += len(outliers(lot, hierarchy(lot))) > 0
    print(f"\nlots of {args.units} with an outlier that is none: {off} of {args.lots}\n")
    rng = np.random.default_rng(0)
    for units in (50, 300):
        ranges = np.abs(np.diff(rng.normal(size=(4000, units)), axis=1))
        told = {"median": np.median(ranges, axis=1), "mean": ranges.mean(axis=1)}
        words = ", ".join(f"{name} {each.mean() ** 2 / (2 * each.var()) / (units - 1):.2f}" for name, each in told.items())
        print(f"degrees of freedom for each of {units} points, of moving ranges: {words}")


def _within(sigma: np.ndarray, freedom: np.ndarray, true: np.ndarray) -> list[bool]:
    ends = [_interval(float(s), float(f)) for s, f in zip(sigma, freedom, strict=True)]
    return [lo <= t and not hi < t for (lo, hi), t in zip(ends, true, strict=True)]


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
