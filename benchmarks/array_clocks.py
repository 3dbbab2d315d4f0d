"""Arrays of units on one body: their clocks, mountings and the ages of their readings, on real recordings and on simulated ones.

``python benchmarks/array_clocks.py`` prints the tables of ../shared/mikov and ../shared/mimu, where they are there; ``simulated`` the
pulls of clocks and ages, and how often a beat is claimed where there is none.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common import markdown, progress
from public import mikov, mimu
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from turn_differences import TurnDifferences, turn_differences

from session.annexes.arrays.recording import ArraySession, read_array
from session.io.units import DEG
from tinygc.annexes.arrays.extrinsics import clock_fits, places_of
from tinygc.annexes.arrays.latency import SampleAges, ages_of

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
#: s of each still that a fit integrates with a turn of theirs
STILL_S = 2.0
SETS = {"mikov": mikov.write_array, "mimu": mimu.write_array}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", nargs="?", choices=("real", "simulated"), default="real", help="which tables (%(default)s)")
    parser.add_argument("--seeds", type=int, default=100, help="simulated arrays of each kind (%(default)s)")
    args = parser.parse_args()
    if args.what == "simulated":
        return simulated(args.seeds)
    return real(list(recordings()))


def recordings() -> Iterator[ArraySession]:
    """Every real array beside the checkout."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as out:
        for name, write in SETS.items():
            if (SHARED / name).is_dir():
                for folder in write(SHARED / name, Path(out)):
                    yield read_array(folder)


def real(arrays: list[ArraySession]) -> None:
    clocks, ages_rows, turns_rows, mountings = [], [], [], []
    for array in arrays:
        progress(array.name)
        fits = clock_fits(array)
        ages = ages_of(array, fits)
        for number, fit, place in list(zip(array.numbers, fits, places_of(array), strict=True))[1:]:
            clock, turned = fit.clock, Rotation.from_matrix(place.mounting).as_rotvec() / DEG
            told = (
                f"{clock.offset_s * 1e3:+.3f} ± {clock.offset_sigma_s * 1e3:.3f}",
                f"{clock.rate * 1e6:+.1f} ± {clock.rate_sigma * 1e6:.1f}",
            )
            clocks.append((array.name, str(number), *told, f"{fit.agreement:.5f}", f"{fit.rms_rps / DEG:.2f}"))
            sigma = np.sqrt(np.diag(place.mounting_covariance)).max() / DEG
            mountings.append((array.name, str(number), *(f"{angle:.3f}" for angle in turned), f"{sigma:.3f}"))
        ages_rows += [(array.name, *_age_row(each)) for each in ages]
        as_fitted = turn_differences(array, fits, beside_s=STILL_S, one_zero=True)
        turns_rows.append(_turns_row(array, as_fitted, turn_differences(array, fits), turn_differences(array, fits, ages)))
    progress("")
    print(markdown(("array", "unit", "offset, ms", "rate, ppm (positive: slow)", "agreement", "left, dps rms"), clocks), end="\n\n")
    print(markdown(("array", "unit", "mounting x, °", "y, °", "z, °", "largest sigma, °"), mountings), end="\n\n")
    print(markdown(("array", "unit", "beat, Hz", "sigma", "period, ms", "left, ms", "p", "gain, nats"), ages_rows), end="\n\n")
    figures = ("as a fit has it, ° rms", "the turn alone", "ages taken off", "white noise", "median turn", "ages taken off", "largest")
    print(markdown(("array", "turns", *figures), turns_rows))


def _age_row(ages: SampleAges) -> tuple[str, ...]:
    if not ages.found:
        return str(ages.number), "none", "", "", "", f"{ages.p_value:.0e}", ""
    period = f"{ages.period_s * 1e3:.3f} ± {ages.period_sigma_s * 1e3:.3f}"
    left = f"{ages.scatter_s * 1e3:.3f}"
    return str(ages.number), f"{ages.beat_hz:+.4f}", f"{ages.beat_sigma_hz:.4f}", period, left, f"{ages.p_value:.0e}", f"{ages.gain:.0f}"


def _turns_row(array: ArraySession, as_fitted: TurnDifferences, before: TurnDifferences, after: TurnDifferences) -> tuple[str, ...]:
    def by_turn(found: TurnDifferences) -> np.ndarray:
        return np.asarray(np.sqrt(np.square(found.rotation).sum(axis=2).mean(axis=0)) / DEG)

    def rms(values: np.ndarray) -> str:
        return f"{np.sqrt(np.mean(np.square(values))):.4f}"

    whole, one, two = by_turn(as_fitted), by_turn(before), by_turn(after)
    figures = rms(whole), rms(one), rms(two), rms(before.white / DEG), f"{np.median(one):.4f}", f"{np.median(two):.4f}", f"{one.max():.3f}"
    return array.name, str(len(one)), *figures


def simulated(seeds: int) -> None:
    sys.path.insert(0, str(ROOT / "tests" / "annexes"))
    from array_twins import Body, any_unit, array_of

    body = Body(turns=8, seed=4, still_s=2.0, shaken_s=12.0)
    random, pulls, beats, claims = np.random.default_rng(0), [], [], []
    for seed in range(seeds):
        progress(f"{seed} of {seeds}")
        offset_s, rate = random.uniform(-3, 3), random.uniform(-0.01, 0.01)
        array = array_of(body, [any_unit(2 * seed), any_unit(2 * seed + 1, offset_s=offset_s, rate=rate)], 100.0, seed)
        clock = clock_fits(array)[1].clock
        expected = offset_s + rate * (clock.about_s - body.duration_s / 2)
        pulls.append([(clock.offset_s - expected) / clock.offset_sigma_s, (clock.rate - rate) / clock.rate_sigma])
        quiet = array_of(body, [any_unit(9000 + 4 * seed + n, noise_dps=0.15) for n in range(4)], 62.5, seed)
        claims += [each.found for each in ages_of(quiet, clock_fits(quiet))]
        if seed % 5 == 0:
            true_hz = random.uniform(-3, 3, 4)
            units = [
                any_unit(5000 + 4 * seed + n, noise_dps=0.1, beat_hz=true_hz[n], phase=random.uniform(), period_s=1e-3) for n in range(4)
            ]
            aged = array_of(body, units, 62.5, seed)
            for each, hz in zip(ages_of(aged, clock_fits(aged)), true_hz, strict=True):
                pull = (each.period_s - 1e-3) / each.period_sigma_s if each.found else np.nan
                beats.append([each.found, (each.beat_hz - hz) / each.beat_sigma_hz if each.found else np.nan, pull])
    progress("")
    beat = np.array(beats, dtype=float)
    rows = [_pulls_row(name, values) for name, values in zip(("offset of a clock", "rate of a clock"), np.transpose(pulls), strict=True)]
    rows += [_pulls_row(name, beat[beat[:, 0] > 0, k]) for k, name in ((1, "beat"), (2, "period"))]
    rows += [("beats found", f"{beat[:, 0].mean():.2f}", "", str(len(beat)))]
    rows += [("beat claimed where there is none", f"{np.mean(claims):.4f}", "", str(len(claims)))]
    print(markdown(("simulated", "share", "rms in sigmas", "of"), rows))


def _pulls_row(name: str, values: np.ndarray) -> tuple[str, ...]:
    return f"{name}, within one sigma", f"{np.mean(np.abs(values) < 1):.2f}", f"{np.sqrt(np.mean(values**2)):.2f}", str(len(values))


if __name__ == "__main__":
    main()
