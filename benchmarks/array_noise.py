"""Noise of an array's fused rate at rest, against single units and against one over the root of their number.

    python benchmarks/array_noise.py                     # simulated units, then ../shared/mimu if it is there
    python benchmarks/array_noise.py --only simulated

Single: root mean square over the units.  1/sqrt(N): that over the root of N, what equal, independent units give.  Best: what the weights
predict from the units' own densities, independent.  Fused: measured.  rho: mean correlation of two units, in the band; equal units of
that correlation have a fused variance (1 + (N - 1) rho) / N of a single one's.  Densities are medians of Welch's spectra of rests.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from common import markdown
from scipy.signal import csd, welch

from session.io.units import DEG
from tinygc.annexes.arrays.fusion import fuse
from tinygc.annexes.arrays.model import ArrayModel
from tinygc.closure.floor import allan_curve

HERE = Path(__file__).resolve().parent.parent
SHARED = HERE.parent / "shared" / "mimu"
sys.path.insert(0, str(HERE / "tests"))
#: samples of a spectrum; Hz of the bands, of 62.5 samples a second
WINDOW = 256
BANDS = ((0.25, 1.0), (1.0, 5.0), (5.0, 15.0), (15.0, 30.0))
#: of the speed's deviation within a second: below, the board is at rest; rests of at least so many s
REST_DPS, LONGEST_S = 0.35, 5.0
LSB_DPS = 1 / 16.4
SEEDS = 4


def rests(rates: np.ndarray, rate_hz: float) -> list[np.ndarray]:
    """Pieces (K, N, 3) of rates (T, N, 3) in the array's frame in which no axis of the units' median moves."""
    middle, size = np.median(rates, axis=1) / DEG, round(rate_hz)
    seconds = middle[: len(middle) // size * size].reshape(-1, size, 3)
    still = (seconds.std(axis=1) < REST_DPS).all(axis=1)
    still &= (np.abs(seconds.mean(axis=1) - np.median(seconds[still].mean(axis=1), axis=0)) < REST_DPS).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    return [rates[a * size : b * size] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= LONGEST_S]


def in_band(frequency: np.ndarray, power: np.ndarray, band: tuple[float, float]) -> np.ndarray:
    """Mean over the band's lines of spectra (F, ...)."""
    return power[(frequency >= band[0]) & (frequency < band[1])].mean(axis=0)


def spectra(pieces: list[np.ndarray], rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """``(f (F,), cross power (F, 3, M, M) (rad/s)^2/Hz)`` of pieces (K, M, 3), weighed by their lengths."""
    whole, total, frequency = None, 0, np.zeros(0)
    for piece in pieces:
        if len(piece) < WINDOW:
            continue
        count = piece.shape[1]
        power = np.empty((WINDOW // 2 + 1, 3, count, count))
        for axis in range(3):
            for i in range(count):
                for j in range(i, count):
                    kind = dict(fs=rate_hz, nperseg=WINDOW, detrend="linear")
                    frequency, found = welch(piece[:, i, axis], **kind) if i == j else csd(piece[:, i, axis], piece[:, j, axis], **kind)
                    power[:, axis, i, j] = power[:, axis, j, i] = found.real
        whole = len(piece) * power + (0 if whole is None else whole)
        total += len(piece)
    assert whole is not None, "no rest is long enough"
    return frequency, whole / total


def table(model: ArrayModel, pieces: list[np.ndarray], fused: list[np.ndarray]) -> list[list[str]]:
    """A row for each axis and band."""
    count = len(model)
    whole = [np.concatenate([piece, each[:, None]], axis=1) for piece, each in zip(pieces, fused, strict=True)]
    frequency, power = spectra(whole, model.rate_hz)
    rows = []
    for axis in range(3):
        for band in BANDS:
            matrix = in_band(frequency, power[:, axis], band)
            own = np.diag(matrix)[:count]
            single, whole_one = np.sqrt(own.mean()), np.sqrt(matrix[-1, -1])
            share = model.weights[:, axis, axis]
            best = np.sqrt((share**2 * own).sum())
            sigma = np.sqrt(own)
            rho = ((matrix[:count, :count] / np.outer(sigma, sigma)).sum() - count) / (count * (count - 1))
            expected = np.sqrt((1 + (count - 1) * rho) / count)
            rows.append(
                [
                    "xyz"[axis],
                    f"{band[0]:g}–{band[1]:g}",
                    f"{1e3 * single / DEG:.2f}",
                    f"{1e3 * single / DEG / np.sqrt(count):.2f}",
                    f"{1e3 * best / DEG:.2f}",
                    f"{1e3 * whole_one / DEG:.2f}",
                    f"{single / whole_one:.2f}",
                    f"{rho:+.3f}",
                    f"{1 / expected:.2f}",
                ]
            )
    return rows


HEAD = ["axis", "Hz", "single", "1/√N", "best", "fused, mdps/√Hz", "better by", "rho", "by rho"]


def allan(name: str, pieces: list[np.ndarray], fused: list[np.ndarray], rate_hz: float) -> None:
    """Allan deviations of units (root mean square) and of the fused rate at some averaging times."""
    units = [allan_curve([piece[:, i] for piece in pieces], 1 / rate_hz) for i in range(pieces[0].shape[1])]
    one = allan_curve(fused, 1 / rate_hz)
    rms = np.sqrt(np.mean([curve.deviation**2 for curve in units], axis=0))
    rows = []
    for tau in (0.05, 0.2, 1.0, 3.0, 10.0):
        if tau < one.tau_s[-1]:
            k = int(np.argmin(np.abs(np.log(one.tau_s / tau))))
            numbers = [
                f"{1e3 * rms[k, a] / DEG:.2f} → {1e3 * one.deviation[k, a] / DEG:.2f} ({rms[k, a] / one.deviation[k, a]:.2f})"
                for a in range(3)
            ]
            rows.append([f"{one.tau_s[k]:.2f}", *numbers])
    print(f"\n{name}: Allan deviation, mdps, single → fused (better by)\n")
    print(markdown(["tau, s", "x", "y", "z"], rows))


def shown(name: str, model: ArrayModel, raw: np.ndarray) -> None:
    """All tables of one recording."""
    units = np.einsum("nij,tnj->tni", model.matrices, raw) + model.offsets
    fused = fuse(model, raw)
    together = np.concatenate([units, fused.rate[:, None]], axis=1)
    whole = rests(together, model.rate_hz)
    pieces, rates = [piece[:, :-1] for piece in whole], [piece[:, -1] for piece in whole]
    print(f"\n## {name}: {len(model)} units, {sum(map(len, pieces)) / model.rate_hz:.0f} s of rest in {len(pieces)} pieces\n")
    print(markdown(HEAD, table(model, pieces, rates)))
    allan(name, pieces, rates, model.rate_hz)


def simulated(seconds: float) -> None:
    """Independent units, equal and unequal: the measured gain against what the weights say, with its sampling error."""
    from simulated_array import DENSITY, RATE_HZ, measured, model_of, units

    rows = []
    for name, density in (("equal", 1.0), ("1 to 3", np.linspace(1, 3, 8))):
        for count in (2, 4, 8):
            model = model_of(units(count, density=DENSITY * (density if np.isscalar(density) else density[:count])))
            samples = SEEDS * round(seconds * RATE_HZ)
            still = np.zeros((samples // SEEDS, 3))
            each = [fuse(model, measured(model, still, seed=10 * count + seed)).rate.std(axis=0) for seed in range(SEEDS)]
            found = np.sqrt(np.mean(np.square(each), axis=0)) / np.sqrt(RATE_HZ / 2)
            single = np.sqrt(np.mean([np.diag(unit.in_array(unit.noise_density)) for unit in model.units], axis=0))
            off = (found / model.noise_density - 1) * np.sqrt(2 * samples)
            gain = single / found
            rows.append([name, str(count), f"{np.sqrt(count):.3f}", *(f"{gain[a]:.3f} ({off[a]:+.1f} σ)" for a in range(3))])
    print("\n## Simulated, independent units: better by, per axis; off the weights' prediction, in its sampling errors\n")
    print(markdown(["densities", "N", "√N", "x", "y", "z"], rows))


def quantisation(raw: np.ndarray) -> None:
    """How much of a unit's white noise its registers make."""
    rest = raw[:1250]
    sigma = np.sqrt(np.mean(np.square(np.diff(rest, axis=0).std(axis=0)) / 2)) / DEG
    print(
        f"\nA sample's sigma is {1e3 * sigma:.1f} mdps; a register's rounding {1e3 * LSB_DPS / np.sqrt(12):.1f} mdps, "
        f"{(LSB_DPS / np.sqrt(12) / sigma) ** 2:.1%} of the variance, independent between units."
    )


def main() -> None:
    """Tables."""
    command = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    command.add_argument("--experiments", type=int, nargs="*", default=[1, 2, 3, 4])
    command.add_argument("--only", choices=("simulated", "mimu"))
    args = command.parse_args()
    if args.only != "mimu":
        simulated(1000.0)
    if args.only == "simulated":
        return
    if not SHARED.exists():
        print(f"{SHARED} is not there")
        return
    from real_array import aligned, recordings

    for number, raw in recordings(SHARED).items():
        if number in args.experiments:
            shown(f"mimu, experiment {number}", aligned(raw), raw)
            quantisation(raw)


if __name__ == "__main__":
    main()
