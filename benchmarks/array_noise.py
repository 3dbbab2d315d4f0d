"""Noise of an array's fused rate at rest, against single units: the eight of ../shared/mimu.

Single: root mean square over the units.  Best: what the weights predict from the units' own densities, independent.  Fused: measured.
rho: mean correlation of two units, in the band.  Densities are means of Welch's spectra of rests.
"""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "annexes"))

import numpy as np
from common import markdown
from real_array import aligned, recordings
from scipy.signal import csd

from session.io.units import DEG
from tinygc.annexes.arrays.fusion import fuse
from tinygc.annexes.arrays.model import ArrayModel

SHARED = Path(__file__).resolve().parents[2] / "shared" / "mimu"
#: samples of a spectrum; Hz of the bands, of 62.5 samples a second
WINDOW = 256
BANDS = ((0.25, 1.0), (1.0, 5.0), (5.0, 15.0), (15.0, 30.0))
#: of the speed's deviation within a second: below, the board is at rest; rests of at least so many s
REST_DPS, LONGEST_S = 0.35, 5.0


def rests(rates: np.ndarray, rate_hz: float) -> list[np.ndarray]:
    """Pieces (K, N, 3) of rates (T, N, 3) in the array's frame in which no axis of the units' median moves."""
    middle, size = np.median(rates, axis=1) / DEG, round(rate_hz)
    seconds = middle[: len(middle) // size * size].reshape(-1, size, 3)
    still = (seconds.std(axis=1) < REST_DPS).all(axis=1)
    still &= (np.abs(seconds.mean(axis=1) - np.median(seconds[still].mean(axis=1), axis=0)) < REST_DPS).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    return [rates[a * size : b * size] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= LONGEST_S]


def spectra(pieces: list[np.ndarray], rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """``(f (F,), cross power (F, M, M, 3) (rad/s)^2/Hz)`` of pieces (K, M, 3), weighed by their lengths."""
    pieces = [piece for piece in pieces if len(piece) >= WINDOW]
    found = [csd(each[:, :, None], each[:, None], rate_hz, nperseg=WINDOW, detrend="linear", axis=0) for each in pieces]
    return found[0][0], np.average([power.real for _, power in found], axis=0, weights=[len(each) for each in pieces])


def table(model: ArrayModel, pieces: list[np.ndarray]) -> list[list[str]]:
    """A row for each axis and band, of pieces (K, N + 1, 3): all units, then the fused rate."""
    count, rows = len(model), []
    frequency, power = spectra(pieces, model.rate_hz)
    for axis, (low, high) in product(range(3), BANDS):
        matrix = power[(frequency >= low) & (frequency < high), ..., axis].mean(axis=0)
        own, sigma = np.diag(matrix)[:count], np.sqrt(np.diag(matrix)[:count])
        single, best, fused = np.sqrt([own.mean(), model.weights[:, axis, axis] ** 2 @ own, matrix[-1, -1]]) * 1e3 / DEG
        rho = ((matrix[:count, :count] / np.outer(sigma, sigma)).sum() - count) / (count * (count - 1))
        densities = [f"{each:.2f}" for each in (single, best, fused)]
        rows.append(["xyz"[axis], f"{low:g}–{high:g}", *densities, f"{single / fused:.2f}", f"{rho:+.3f}"])
    return rows


def shown(number: int, model: ArrayModel, raw: np.ndarray) -> None:
    """The table of one recording."""
    units = np.einsum("nij,tnj->tni", model.matrices, raw) + model.offsets
    together = np.concatenate([units, fuse(model, raw).rate[:, None]], axis=1)
    pieces = rests(together, model.rate_hz)
    print(f"\n## mimu, experiment {number}: {len(model)} units, {sum(map(len, pieces)) / model.rate_hz:.0f} s of rest\n")
    print(markdown(["axis", "Hz", "single, mdps/√Hz", "best", "fused", "better by", "rho"], table(model, pieces)))


def main() -> None:
    """Tables."""
    for number, raw in recordings(SHARED).items():
        shown(number, aligned(raw), raw)


if __name__ == "__main__":
    main()
