"""EuRoC sequences as their authors publish them: ``SEQUENCE/mav0/imu0/data.csv``, and the truth in ``state_groundtruth_estimate0``.

Both are comma-separated, times in ns on one clock; the truth is of the IMU's own axes.  Archives ``euroc_*.npz`` of them serve as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.log.truth import Truth, of_length_1
from session.public.euroc import read_sequence, to_down, write_config, write_sequence
from session.public.sources import found, rows_of_numbers
from session.public.writing import placed

SEGMENT_S = 2.0
TRUTH_SIGMA_DEG = 0.1
IMU = "mav0/imu0/data.csv"
TRUTH = "state_groundtruth_estimate0/data.csv"
IMU_COLUMNS = ("ns", *(f"{what}_{axis}" for what in "wa" for axis in "xyz"))
STATE = ("p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z", *(f"{what}_{axis}" for what in ("v", "b_w", "b_a") for axis in "xyz"))
TRUTH_COLUMNS = ("ns", *STATE)
#: an archive of separate windows is no sequence
PARTIAL = "PARTIAL"

Sequence = tuple[np.ndarray, np.ndarray, np.ndarray, Truth]


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/V1_01`` and so on, a session folder with a truth file for each sequence, one after the other.

    not given: with an accelerometer from the sequence's own stills.  FormatError for files that are not the authors'; not given: what
    ``placed`` raises.
    """
    for name, sequence in sequences(source):
        yield placed(out / name, partial(_write, name, sequence), given)


def _write(name: str, sequence: Sequence, folder: Path) -> None:
    write_sequence(folder, name, *sequence)
    write_config(folder, SEGMENT_S, TRUTH_SIGMA_DEG)


def sequences(source: Path) -> Iterator[tuple[str, Sequence]]:
    """Short name, then t_ns (N,), gyro (N, 3) rad/s, specific force (N, 3) m/s^2 and the truth with z down, of each sequence."""
    archives = [path for path in sorted(source.glob("euroc_*_*_*.npz")) if PARTIAL not in path.name]
    for path in archives:
        name = _short(path.stem.removeprefix("euroc_"))
        yield name, read_sequence(source, name)
    for path in [] if archives else found(source, f"**/{IMU}"):
        yield _short(path.resolve().parts[-4]), read_folder(path)


def read_folder(imu: Path) -> Sequence:
    """One sequence from its ``imu0/data.csv`` and the truth beside it."""
    t_ns, values = _table(imu, IMU_COLUMNS)
    truth = imu.parents[1] / TRUTH
    truth_ns, state = _table(truth, TRUTH_COLUMNS)
    q_wxyz = state[:, 3:7]
    if not (unit := of_length_1(q_wxyz)).all():
        row = int(np.argmin(unit))
        raise FormatError(f"{truth}: the quaternion at {truth_ns[row]} ns has length {math.hypot(*q_wxyz[row]):.3g}, expected 1")
    return t_ns, values[:, :3], values[:, 3:], Truth(truth, truth_ns, to_down(q_wxyz))


def _table(path: Path, columns: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """t_ns (N,) int64, increasing, and the other columns (N, C)."""
    rows = rows_of_numbers(path, columns, ",")
    try:
        t_ns = np.array([int(row[0]) for row in rows], dtype=np.int64)
    except (ValueError, OverflowError):
        raise FormatError(f"{path}: times such as {rows[0][0]}, expected whole ns; spreadsheets round them: download it again") from None
    if (np.diff(t_ns) <= 0).any():
        raise FormatError(f"{path}: {t_ns[int(np.argmax(np.diff(t_ns) <= 0)) + 1]} ns does not go on from the time before")
    return t_ns, np.array([row[1:] for row in rows], dtype=float)


def _short(name: str) -> str:
    """``V1_01`` of ``V1_01_easy``."""
    return "_".join(name.split("_")[:2])
