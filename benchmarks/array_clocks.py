"""Clocks, mountings and ages of readings of the units of one body: ../shared/mikov and ../shared/mimu, where they are there."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common import markdown, progress
from public import mikov, mimu
from scipy.spatial.transform import Rotation

from session.base.units import DEG
from tinygc.features.arrays.extrinsics import clock_fits, places_of
from tinygc.features.arrays.latency import SampleAges, ages_of
from tinygc.features.arrays.recording import ArraySession, read_array

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
SETS = {"mikov": mikov.write_array, "mimu": mimu.write_array}


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    real(list(recordings()))


def recordings() -> Iterator[ArraySession]:
    """Every real array beside the checkout."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as out:
        for name, write in SETS.items():
            if (SHARED / name).is_dir():
                for folder in write(SHARED / name, Path(out)):
                    yield read_array(folder)


def real(arrays: list[ArraySession]) -> None:
    clocks, ages_rows, mountings = [], [], []
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
    progress("")
    print(markdown(("array", "unit", "offset, ms", "rate, ppm (positive: slow)", "agreement", "left, dps rms"), clocks), end="\n\n")
    print(markdown(("array", "unit", "mounting x, °", "y, °", "z, °", "largest sigma, °"), mountings), end="\n\n")
    print(markdown(("array", "unit", "beat, Hz", "sigma", "period, ms", "left, ms", "p", "gain, nats"), ages_rows))


def _age_row(ages: SampleAges) -> tuple[str, ...]:
    if ages.track is None:
        return str(ages.number), "none", "", "", "", f"{ages.p_value:.0e}", ""
    period = f"{ages.period_s * 1e3:.3f} ± {ages.period_sigma_s * 1e3:.3f}"
    left = f"{ages.scatter_s * 1e3:.3f}"
    hz, sigma_hz = ages.track.beat
    gain = f"{ages.track.log_probability:.0f}"
    return str(ages.number), f"{hz:+.4f}", f"{sigma_hz:.4f}", period, left, f"{ages.p_value:.0e}", gain


if __name__ == "__main__":
    main()
