"""Arrays: what the units of one body are to each other as a reference, on real boards.

Of ../shared/mimu, whether mountings and positions repeat over the four experiments within their stated sigmas; of mimu and mikov, what the
units have in common and what each has alone.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from common import markdown, progress
from public import mikov, mimu
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from session.base.numeric import rms_of
from session.base.units import DEG
from tinygc.features.arrays.fit import ArrayFit, UnitFit, fit_array
from tinygc.features.arrays.recording import read_array

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"
SETS = {"mimu": mimu.write_array, "mikov": mikov.write_array}


def best_gain(unit: UnitFit) -> float:
    """The largest ratio of sigma alone to the array's, over all directions of the twelve numbers: yaw about the vertical."""
    return float(np.sqrt(eigh(unit.covariance_alone, unit.covariance[:12, :12], eigvals_only=True)[-1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("which", nargs="*", metavar="mimu|mikov", help="of these (all)")
    chosen = parser.parse_args()
    fits = {}
    with tempfile.TemporaryDirectory() as place:
        for name, write in SETS.items():
            if (not chosen.which or name in chosen.which) and (SHARED / name).is_dir():
                fits[name] = [fitted(folder) for folder in write(SHARED / name, Path(place) / name)]
    if fits:
        real([fit for each in fits.values() for fit in each])
    if "mimu" in fits:
        repeat(fits["mimu"])


def fitted(folder: Path) -> ArrayFit:
    """With a line of progress."""
    progress(f"fitting {folder.name}")
    return fit_array(read_array(folder))


def real(fits: list[ArrayFit]) -> None:
    """Each array's common and own parts."""
    progress("")
    rows = []
    for fit in fits:
        split = fit.split
        found = "" if not split.predicted_rad else " ± ".join(f"{part / split.predicted_rad:.2f}" for part in split.fast_rad)
        own = ", ".join(f"{size / DEG:.2f}" for size, _ in split.own_rad)
        figures = (f"{angle / DEG:.3f}" for angle in (rms_of(split.minus_mean_rad), split.common_rad, split.predicted_rad))
        rows.append((fit.array.name, fit.bias, len(fit.same.spans), *figures, found, f"{split.common.p_value:.1g}", own))
    parts = ("unit minus mean", "common", "fast motion predicted", "found of it", "p of nothing common", "own excess")
    head = ("array", "bias", "turns", *parts)
    print(f"\nWhat turns miss by, degrees of tilt, rms a turn\n\n{markdown(head, rows)}")


def repeat(fits: list[ArrayFit]) -> None:
    """Mountings and positions over the experiments: scatter against stated sigma."""
    rows, ratios = [], []
    for number in fits[0].numbers[1:]:
        units = [unit for fit in fits for unit in fit.units if unit.number == number]
        middle = Rotation.from_matrix([unit.place.mounting for unit in units]).mean()
        turns = np.array([(Rotation.from_matrix(unit.place.mounting) * middle.inv()).as_rotvec() for unit in units])
        sigma = np.array([np.sqrt(np.diag(unit.place.mounting_covariance)) for unit in units])
        scatter = np.sqrt((turns**2).sum(axis=0) / (len(units) - 1))
        ratios.append(scatter / np.sqrt((sigma**2).mean(axis=0)))
        where = np.array([unit.place.position_m for unit in units if unit.place.position_m is not None])
        known = np.array([np.sqrt(np.diag(u.place.position_covariance)) for u in units if u.place.position_covariance is not None])
        gain = np.median([unit.sigma[:9] / unit.sigma_alone[:9] for unit in units])
        rows.append(
            (
                number,
                ", ".join(f"{x / DEG:.3f}" for x in scatter),
                f"{np.sqrt((sigma**2).mean()) / DEG:.3f}",
                ", ".join(f"{x * 1e3:.1f}" for x in where.mean(axis=0)),
                ", ".join(f"{x * 1e3:.1f}" for x in where.std(axis=0, ddof=1)),
                f"{np.sqrt((known**2).mean()) * 1e3:.1f}",
                f"{gain:.2f}",
                f"{np.median([best_gain(unit) for unit in units]):.1f} times",
            )
        )
    head = ("unit", "mounting repeats to, deg", "stated", "position, mm", "repeats to", "stated", "sigma of E over alone", "best direction")
    print(f"\nPlaces over {len(fits)} recordings\n\n{markdown(head, rows)}")
    print(f"\nMountings: scatter over stated sigma, rms over units and axes: {np.sqrt(np.mean(np.square(ratios))):.2f}")


if __name__ == "__main__":
    main()
