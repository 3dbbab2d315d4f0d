"""Noise of an array's fused rate at rest, against single units: the eight of ../shared/mimu.

Single: root mean square over the units.  Best: what the weights predict from the units' own densities, independent.  Fused: measured.
rho: mean correlation of two units, in the band.  Densities are means of Welch's spectra of rests.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
from common import markdown
from scipy.signal import csd

from benchmarks.public.mimu import experiments
from session.io.config import Sensor
from session.io.units import DEG
from tinygc.annexes.arrays.clocks import UnitPlace
from tinygc.annexes.arrays.extrinsics import nearest_rotation
from tinygc.annexes.arrays.fusion import END, build_array_model, fuse
from tinygc.annexes.arrays.model import ArrayModel, FusedUnit
from tinygc.models.linear import LinearModel

SHARED = Path(__file__).resolve().parents[2] / "shared" / "mimu"
#: samples of a spectrum; Hz of the bands, of 62.5 samples a second
WINDOW = 256
BANDS = ((0.25, 1.0), (1.0, 5.0), (5.0, 15.0), (15.0, 30.0))
#: of the speed's deviation within a second: below, the board is at rest; rests of at least so many s
REST_DPS, LONGEST_S = 0.35, 5.0

RATE_HZ, FULL_SCALE_DPS, LSB_PER_DPS = 62.5, 2000.0, 16.4
#: s at the beginning of each recording in which the board lies still
FIRST_REST_S = 20.0


def recordings(source: Path) -> dict[int, np.ndarray]:
    """Of each experiment, what the units read: (T, 8, 3) rad/s."""
    return {number: registers[:, :, 3:] / LSB_PER_DPS * DEG for number, (_, registers) in experiments(source)}


def aligned(raw: np.ndarray) -> ArrayModel:
    """Each unit's E and mounting by least squares against the mean of all, its bias and noise from the first rest.

    Relative only: what all units have in common (the mean's own scale and axes) a joint fit finds, and no figure here depends on it.
    """
    rest = slice(0, round(FIRST_REST_S * RATE_HZ))
    zero = raw[rest].mean(axis=0)
    moved = raw - zero
    whole = (np.abs(raw) < END * FULL_SCALE_DPS * DEG).all(axis=(1, 2))
    units = raw.shape[1]
    first = [np.linalg.lstsq(moved[whole, i], moved[whole, 0], rcond=None)[0].T for i in range(units)]
    mean = np.mean([moved[:, i] @ first[i].T for i in range(units)], axis=0)
    matrices = [np.linalg.lstsq(moved[whole, i], mean[whole], rcond=None)[0].T for i in range(units)]
    back = nearest_rotation(matrices[0]).T
    found = []
    for i, matrix in enumerate(matrices):
        mounting = nearest_rotation(back @ matrix)
        E = mounting.T @ back @ matrix
        density = np.diff(raw[rest, i], axis=0).std(axis=0) / np.sqrt(RATE_HZ)  # of white noise: sqrt(2) sigma in a difference
        sensor = Sensor("MPU-9150", f"mimu-{i}", RATE_HZ, FULL_SCALE_DPS, 16.0)
        found.append(FusedUnit(UnitPlace(i, mounting=mounting), LinearModel(E, -E @ zero[i]), density, sensor=sensor))
    return build_array_model(found, RATE_HZ)


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
