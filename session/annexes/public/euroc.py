"""EuRoC MAV recordings (Burri et al. 2016) as session folders."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from session.annexes.public.writing import arrays_of, found, placed, rows_of_numbers
from session.io.errors import FormatError
from session.io.files import read_npz
from session.io.logfile import Truth, of_length_1
from session.io.units import NS_PER_S

# EuRoC MAV recordings (Burri et al. 2016) as session folders: a log with its truth file.
#
# The truth's world has z up; the folder's has z down, so it is turned by half a turn about x.  Rows without a specific force, as one of
# the sequences has them, are written as exact zeros, which no accelerometer in this world reads.

#: of the ADIS16448's data sheet: full scales, and the data rate that these recordings have
TOML = """schema = "tinygc-session/1"

[sensor]
model = "ADIS16448"
serial = "EuRoC"
odr_hz = 200.0
gyro_fs_dps = 1000
accel_fs_g = 18

[protocol]
segment_s = {segment_s:g}
reference = "truth"
truth_sigma_deg = {truth_sigma_deg:g}
"""
LOG_HEADER = "t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
#: half a turn about x takes z up to z down
UP_TO_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
WINDOW_S = 2.0


def sequence_path(euroc: Path, name: str) -> Path:
    """The recording of a sequence such as ``V1_01``; FormatError where there is none."""
    found = sorted(euroc.glob(f"euroc_{name}*.npz"))
    if len(found) != 1:
        raise FormatError(f"{euroc}: {len(found)} recordings euroc_{name}*.npz, expected one")
    return found[0]


def read_sequence(euroc: Path, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, Truth]:
    """t_ns (N,), gyro (N, 3) rad/s, specific force (N, 3) m/s^2 with zeros where missing, and the truth with z down.

    FormatError where there is no such recording.
    """
    path = sequence_path(euroc, name)
    t_ns, gyro, measured, truth_ns, q_wxyz = arrays_of(path, {"t_ns": "i", "gyro": "f", "acc": "f", "gt_t_ns": "i", "gt_q_wxyz": "f"})
    shapes = {"gyro": (gyro, (len(t_ns), 3)), "acc": (measured, (len(t_ns), 3)), "gt_q_wxyz": (q_wxyz, (len(truth_ns), 4))}
    if t_ns.ndim != 1 or truth_ns.ndim != 1 or any(array.shape != shape for array, shape in shapes.values()):
        raise FormatError(f"{path}: t_ns, gyro, acc, gt_t_ns and gt_q_wxyz have not the shapes (N,), (N, 3), (N, 3), (M,) and (M, 4)")
    if not len(t_ns) or not of_length_1(q_wxyz).all():
        raise FormatError(f"{path}: no samples, or quaternions in gt_q_wxyz that are not of length 1; download it again")
    accel = np.where(np.isnan(measured).any(axis=1, keepdims=True), 0.0, measured)
    return t_ns, gyro, accel, Truth(Path(f"truth_{name}.csv"), truth_ns, to_down(q_wxyz))


def true_bias_rps(euroc: Path, name: str) -> np.ndarray:
    """(3,): what a sequence's gyro reads at rest by its own ground truth, as the authors' evaluation is handed it."""
    return -read_npz(sequence_path(euroc, name), ("yaml_bias_added",))["yaml_bias_added"]


def write_sequences(euroc: Path, names: Sequence[str], folder: Path, segment_s: float = 5.0, truth_sigma_deg: float = 0.1) -> Path:
    """A session folder of whole sequences, each with all its moments of truth."""
    for name in names:
        write_sequence(folder, name, *read_sequence(euroc, name))
    return write_config(folder, segment_s, truth_sigma_deg)


def write_sequence(folder: Path, name: str, t_ns: np.ndarray, gyro: np.ndarray, accel: np.ndarray, truth: Truth) -> None:
    """A sequence's log and truth file, as ``read_sequence`` gives them, without their ``session.toml``."""
    # The truth of one sequence goes on where its log has nothing.
    inside = (truth.t_ns >= t_ns[0]) & (truth.t_ns <= t_ns[-1])
    _write_log(folder, name, t_ns, gyro, accel)
    _write_truth(folder, name, truth.t_ns[inside], truth.q_nb[inside])


def write_training_windows(euroc: Path, folder: Path, *, mislabelled: bool = False, truth_sigma_deg: float = 0.1) -> Path:
    """A session folder of the paper's 261 training windows of 400 samples, a log a sequence, without the 18 mislabelled by default.

    The windows of one sequence are laid one after the other at their own times; those that are really of another sequence have times
    of their own, too, so each label gets one more log for them.
    """
    names = ("t", "gyro", "acc", "q_wxyz", "seq", "mislabelled")
    arrays = read_npz(euroc / "euroc_segments.npz", tuple(f"train_{name}" for name in names))
    data = {name.removeprefix("train_"): values for name, values in arrays.items()}
    kept = ~data["mislabelled"] | mislabelled
    return _write_windows(folder, {key: values[kept] for key, values in data.items()}, truth_sigma_deg)


def _write_windows(folder: Path, data: dict[str, np.ndarray], truth_sigma_deg: float) -> Path:
    for name in dict.fromkeys(data["seq"].tolist()):
        for wrong in (False, True):
            rows = np.flatnonzero((data["seq"] == name) & (data["mislabelled"] == wrong))
            rows = rows[np.argsort(data["t"][rows, 0])]
            if not len(rows):
                continue
            stem = f"{name}{'_mislabelled' if wrong else ''}"
            t_ns = np.rint(data["t"][rows] * NS_PER_S).astype(np.int64)
            ends = np.stack([np.zeros(len(rows), dtype=int), np.full(len(rows), t_ns.shape[1] - 1)], axis=1)
            accel = np.nan_to_num(data["acc"][rows].astype(float)).reshape(-1, 3)
            _write_log(folder, stem, t_ns.ravel(), data["gyro"][rows].astype(float).reshape(-1, 3), accel)
            q = np.take_along_axis(to_down(data["q_wxyz"][rows].astype(float)), ends[:, :, None], axis=1)
            window = np.repeat(np.arange(len(rows)), 2)
            _write_truth(folder, stem, np.take_along_axis(t_ns, ends, axis=1).ravel(), q.reshape(-1, 4), window)
    return write_config(folder, WINDOW_S, truth_sigma_deg)


def to_down(q_wxyz: np.ndarray) -> np.ndarray:
    """``q_nb`` (..., 4) of unit length, z down, from body to world with z up."""
    a, q = UP_TO_DOWN, q_wxyz / np.linalg.norm(q_wxyz, axis=-1, keepdims=True)
    w, v = q[..., :1], q[..., 1:]
    return np.concatenate([a[0] * w - np.sum(a[1:] * v, axis=-1, keepdims=True), a[0] * v + w * a[1:] + np.cross(a[1:], v)], axis=-1)


def write_config(folder: Path, segment_s: float, truth_sigma_deg: float) -> Path:
    """The ``session.toml`` of logs and truth files of these recordings."""
    (folder / "session.toml").write_text(TOML.format(segment_s=segment_s, truth_sigma_deg=truth_sigma_deg), encoding="utf-8")
    return folder


def _write_log(folder: Path, name: str, t_ns: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"log_{name}.csv").open("w", encoding="utf-8") as file:
        file.write(LOG_HEADER + "\n")
        for t, rate, force in zip(t_ns.tolist(), gyro.tolist(), accel.tolist(), strict=True):
            file.write(f"{t},{','.join(map(repr, rate))},{','.join(map(repr, force))}\n")


def _write_truth(folder: Path, name: str, t_ns: np.ndarray, q_nb: np.ndarray, window: np.ndarray | None = None) -> None:
    with (folder / f"truth_{name}.csv").open("w", encoding="utf-8") as file:
        file.write("t_ns,qw,qx,qy,qz" + (",window" if window is not None else "") + "\n")
        for k, (t, q) in enumerate(zip(t_ns.tolist(), q_nb.tolist(), strict=True)):
            file.write(f"{t},{','.join(map(repr, q))}" + (f",{window[k]}" if window is not None else "") + "\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """``python -m session.annexes.public.euroc EUROC OUT V1_01 …`` writes sequences; ``windows``: the paper's 243 training windows."""
    parser = argparse.ArgumentParser(prog="python -m session.annexes.public.euroc", description="EuRoC recordings as a session folder.")
    parser.add_argument("euroc", type=Path, help="folder of euroc_*.npz")
    parser.add_argument("out", type=Path, help="session folder to write")
    parser.add_argument("names", nargs="+", help="sequences such as V1_01, or the one word: windows")
    parser.add_argument("--segment-s", type=float, default=2.0, help="length of a segment of a sequence (%(default)g s)")
    args = parser.parse_args(arguments)
    try:
        if args.names == ["windows"]:
            write_training_windows(args.euroc, args.out)
        else:
            write_sequences(args.euroc, args.names, args.out, args.segment_s)
    except (FormatError, OSError) as error:
        parser.exit(2, f"euroc: {error}\n")
    print(args.out)
    return 0


if __name__ == "__main__":
    main()


# EuRoC sequences as their authors publish them: ``SEQUENCE/mav0/imu0/data.csv``, and the truth in ``state_groundtruth_estimate0``.
#
# Both are comma-separated, times in ns on one clock; the truth is of the IMU's own axes.  Archives ``euroc_*.npz`` of them serve as well.

SEGMENT_S = 2.0
TRUTH_SIGMA_DEG = 0.1
IMU = "mav0/imu0/data.csv"
TRUTH = "state_groundtruth_estimate0/data.csv"
IMU_COLUMNS = ("ns", *(f"{what}_{axis}" for what in "wa" for axis in "xyz"))
STATE = ("p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z", *(f"{what}_{axis}" for what in ("v", "b_w", "b_a") for axis in "xyz"))
TRUTH_COLUMNS = ("ns", *STATE)
#: an archive of separate windows is no sequence
PARTIAL = "PARTIAL"

SequenceFiles = tuple[np.ndarray, np.ndarray, np.ndarray, Truth]


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/V1_01`` and so on, a session folder with a truth file for each sequence, one after the other.

    not given: with an accelerometer from the sequence's own stills.  FormatError for files that are not the authors'; not given: what
    ``placed`` raises.
    """
    for name, sequence in sequences(source):
        yield placed(out / name, partial(_write, name, sequence), given)


def _write(name: str, sequence: SequenceFiles, folder: Path) -> None:
    write_sequence(folder, name, *sequence)
    write_config(folder, SEGMENT_S, TRUTH_SIGMA_DEG)


def sequences(source: Path) -> Iterator[tuple[str, SequenceFiles]]:
    """Short name, then t_ns (N,), gyro (N, 3) rad/s, specific force (N, 3) m/s^2 and the truth with z down, of each sequence."""
    archives = [path for path in sorted(source.glob("euroc_*_*_*.npz")) if PARTIAL not in path.name]
    for path in archives:
        name = _short(path.stem.removeprefix("euroc_"))
        yield name, read_sequence(source, name)
    for path in [] if archives else found(source, f"**/{IMU}"):
        yield _short(path.resolve().parts[-4]), read_folder(path)


def read_folder(imu: Path) -> SequenceFiles:
    """One sequence from its ``imu0/data.csv`` and its truth."""
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
