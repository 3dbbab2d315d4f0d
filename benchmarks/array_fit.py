"""Arrays: what the units of one body are to each other as a reference, on simulated arrays and on real ones.

``python benchmarks/array_fit.py [simulated|mimu|mikov]``: coverage of the joint estimate and what it gains over each unit alone; of
../shared/mimu, whether mountings and positions repeat over the four experiments within their stated sigmas, what the units have in common
and what each has alone.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from session.common.units import DEG
from session.log.array_reading import read_array
from session.public import mikov, mimu
from tinygc.array.fit import ArrayFit, fit_array
from tinygc.simulation.array.options import ArrayOptions
from tinygc.simulation.array.simulate import simulate_array
from tinygc.simulation.array.write import write_array
from tinygc.simulation.options import SimulationOptions

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"
SEEDS = 40


def simulated() -> None:
    """Inject and recover: how many of the errors lie within one sigma, and how wide that is against a unit alone."""
    print(f"{SEEDS} simulated arrays of 3 units, 14 turns, 104 Hz: errors over stated sigma")
    print(f"{'bias from':10} {'what':10} {'within 1':>9} {'rms':>6}   sigma of E, array / alone   best direction")
    for bias in ("ends", "stills"):
        off: dict[str, list] = {name: [] for name in ("E", "B", "mounting", "position", "clock rate")}
        gain, best = [], []
        for seed in range(SEEDS):
            chosen = SimulationOptions(segments=14, closure_s=0, odr_hz=104, seed=seed)
            made = simulate_array(chosen, ArrayOptions(units=3))
            with tempfile.TemporaryDirectory() as place:
                fit = fit_array(read_array(write_array(made, Path(place) / "array")), bias=bias)
            for unit, truth, true in zip(fit.units, made.truths, made.units, strict=True):
                apart = (unit.model.vector - np.concatenate([true.unit.E.ravel(), true.unit.B])) / unit.sigma
                off["E"].append(apart[:9])
                off["B"].append(apart[9:])
                gain.append(unit.sigma[:9] / unit.sigma_alone[:9])
                best.append(unit.best_gain)
                if unit is fit.units[0]:
                    continue
                turn = Rotation.from_matrix(unit.place.mounting @ truth.mounting.T).as_rotvec()
                off["mounting"].append(turn / np.sqrt(np.diag(unit.place.mounting_covariance)))
                off["clock rate"].append([(unit.place.clock.rate - truth.rate) / unit.place.clock.rate_sigma])
                if unit.place.position_m is not None:
                    off["position"].append((unit.place.position_m - truth.position_m) / np.sqrt(np.diag(unit.place.position_covariance)))
        for name, values in off.items():
            z = np.concatenate(values)
            more = f"{np.median(gain):.2f}                        {np.median(best):.1f} times" if name == "E" else ""
            print(f"{bias:10} {name:10} {np.mean(np.abs(z) < 1):9.2f} {np.std(z):6.2f}   {more}")


def real(folders: list[Path]) -> list[ArrayFit]:
    """Each array's common and own parts."""
    print(f"{'array':7} bias    turns  minus mean  exps' common  predicted  found of it      own excess of each unit, deg rms a turn")
    fits = []
    for folder in folders:
        fit = fit_array(read_array(folder))
        fits.append(fit)
        split = fit.split
        factor, sigma = (np.divide(part, split.predicted) if split.predicted else np.nan for part in split.fast)
        own = " ".join(f"{unit.own_rad[0] / DEG:.3f}" for unit in fit.units)
        print(
            f"{folder.name:7} {fit.bias:7} {len(fit.same.spans):5}  {split.minus_mean_rad / DEG:9.3f}   {split.common / DEG:9.3f}  "
            f"{split.predicted / DEG:10.3f}  {factor:5.2f} ± {sigma:4.2f}     {own}"
        )
        print(f"{'':9}{split.words}")
    return fits


def repeat(fits: list[ArrayFit]) -> None:
    """Mountings and positions over the experiments: scatter against stated sigma."""
    print("unit   mounting repeats within, deg    stated    position repeats within, mm   stated    gain of sigma of E, best direction")
    ratios = []
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
        best = np.median([unit.best_gain for unit in units])
        print(
            f"{number:4}   {np.array2string(scatter / DEG, precision=4):28} {np.sqrt((sigma**2).mean()) / DEG:8.4f}    "
            f"{np.array2string(where.std(axis=0, ddof=1) * 1e3, precision=2):26} {np.sqrt((known**2).mean()) * 1e3:7.2f}    "
            f"{gain:.2f}, {best:.1f} times;  at {np.array2string(where.mean(axis=0) * 1e3, precision=1)} mm"
        )
    print(f"mountings: scatter over stated sigma, rms over units and axes: {np.sqrt(np.mean(np.square(ratios))):.2f}")


def main(which: list[str]) -> None:
    """What was asked for, or all."""
    with tempfile.TemporaryDirectory() as place:
        if not which or "simulated" in which:
            simulated()
        if not which or "mimu" in which:
            repeat(real(list(mimu.write_array(SHARED / "mimu", Path(place) / "mimu"))))
        if not which or "mikov" in which:
            real(list(mikov.write_array(SHARED / "mikov", Path(place) / "mikov")))


if __name__ == "__main__":
    main(sys.argv[1:])
