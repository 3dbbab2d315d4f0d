"""EuRoC MAV recordings (Burri et al. 2016) as session folders: a log with its truth file.

``SEQUENCE/mav0/imu0/data.csv`` and ``state_groundtruth_estimate0/data.csv`` have times in ns on one clock; the truth is of the IMU's own
axes.  Archives ``euroc_*.npz`` of them serve as well.  The truth's world has z up; the folder's has z down, so it is turned by half a turn
about x.  Rows without a specific force, as one of the sequences has them, are written as exact zeros, which no accelerometer reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import read_npz
from session.base.units import NS_PER_S
from tinygc.features.truth.reading import of_length_1

from .writing import AGAIN, Table, found, rows, rows_of_numbers, write_folder

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
HEADER, TRUTH_HEADER = "t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2", "t_ns,qw,qx,qy,qz"
#: of a sequence's segments, of the paper's windows, and of the truth
SEGMENT_S, WINDOW_S, TRUTH_SIGMA_DEG = 2.0, 2.0, 0.1
IMU, TRUTH = "mav0/imu0/data.csv", "state_groundtruth_estimate0/data.csv"
IMU_COLUMNS = ("ns", *(f"{what}_{axis}" for what in "wa" for axis in "xyz"))
STATE = ("p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z", *(f"{what}_{axis}" for what in ("v", "b_w", "b_a") for axis in "xyz"))

#: t_ns (N,), gyro (N, 3) rad/s, specific force (N, 3) m/s^2 with zeros where missing, t_ns (M,) and q_nb (M, 4) of the truth, z down
SequenceData = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/V1_01`` and so on, a session folder with a truth file for each sequence, one after the other."""
    archives = [path for path in sorted(source.glob("euroc_*_*_*.npz")) if "PARTIAL" not in path.name]  # of separate windows: no sequence
    for path in archives or found(source, f"**/{IMU}"):
        name = "_".join((path.stem.removeprefix("euroc_") if archives else path.resolve().parts[-4]).split("_")[:2])
        files = _files(name, (read_archive if archives else read_folder)(path))
        yield write_folder(out / name, TOML.format(segment_s=SEGMENT_S, truth_sigma_deg=TRUTH_SIGMA_DEG), files, given)


def write_sequences(euroc: Path, names: Sequence[str], folder: Path, segment_s: float = 5.0) -> Path:
    """A session folder of whole sequences such as ``V1_01``, from their archives."""
    files: dict[str, Table] = {}
    for name in names:
        files |= _files(name, read_archive(sequence_path(euroc, name)))
    return write_folder(folder, TOML.format(segment_s=segment_s, truth_sigma_deg=TRUTH_SIGMA_DEG), files)


def sequence_path(euroc: Path, name: str) -> Path:
    """The archive of a sequence."""
    return found(euroc, f"euroc_{name}*.npz")[0]


def read_archive(path: Path) -> SequenceData:
    """One sequence from an archive."""
    t_ns, gyro, accel, truth_ns, q_wxyz = read_npz(path, ("t_ns", "gyro", "acc", "gt_t_ns", "gt_q_wxyz")).values()
    return t_ns, gyro, np.where(np.isnan(accel).any(axis=1, keepdims=True), 0.0, accel), truth_ns, to_down(q_wxyz, path)


def read_folder(imu: Path) -> SequenceData:
    """One sequence from its ``imu0/data.csv`` and its truth."""
    t_ns, values = _table(imu, IMU_COLUMNS)
    truth_ns, state = _table(imu.parents[1] / TRUTH, ("ns", *STATE))
    return t_ns, values[:, :3], values[:, 3:], truth_ns, to_down(state[:, 3:7], imu.parents[1] / TRUTH)


def _table(path: Path, columns: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """t_ns (N,) int64, and the other columns (N, C)."""
    cells = rows_of_numbers(path, columns, ",")
    try:
        return np.array([int(row[0]) for row in cells]), np.array([row[1:] for row in cells], dtype=float)
    except ValueError:
        raise FormatError(f"{path}: times such as {cells[0][0]}, expected whole ns; spreadsheets round them: {AGAIN}") from None


def true_bias_rps(euroc: Path, name: str) -> np.ndarray:
    """(3,): what a sequence's gyro reads at rest by its own ground truth, as the authors' evaluation is handed it."""
    return -read_npz(sequence_path(euroc, name), ("yaml_bias_added",))["yaml_bias_added"]


def to_down(q_wxyz: np.ndarray, path: Path) -> np.ndarray:
    """``q_nb`` (N, 4), z down, from body to world with z up.  FormatError for what is not of length 1."""
    if not of_length_1(q_wxyz).all():
        raise FormatError(f"{path}: quaternions that are not of length 1; {AGAIN}")
    q = q_wxyz / np.linalg.norm(q_wxyz, axis=1, keepdims=True)
    return q[:, [1, 0, 3, 2]] * [-1, 1, -1, 1]


def _files(name: str, sequence: SequenceData) -> dict[str, Table]:
    t_ns, gyro, accel, truth_ns, q_nb = sequence
    inside = (truth_ns >= t_ns[0]) & (truth_ns <= t_ns[-1])  # the truth of one sequence goes on where its log has nothing
    truth = (TRUTH_HEADER, rows(truth_ns[inside], q_nb[inside]))
    return {f"log_{name}.csv": (HEADER, rows(t_ns, gyro, accel)), f"truth_{name}.csv": truth}


# The paper's windows of 400 samples, in ``euroc_segments.npz``.


def write_training_windows(euroc: Path, folder: Path, *, mislabelled: bool = False) -> Path:
    """A session folder of the 261 training windows, a log a sequence, without the 18 mislabelled by default.

    The windows of one sequence are laid one after the other at their own times; those that are really of another sequence have times
    of their own, too, so each label gets one more log for them.
    """
    names = ("t", "gyro", "acc", "q_wxyz", "seq", "mislabelled")
    arrays = read_npz(euroc / "euroc_segments.npz", tuple(f"train_{name}" for name in names))
    data = {name.removeprefix("train_"): values for name, values in arrays.items()}
    kept = ~data["mislabelled"] | mislabelled
    return _write_windows(folder, {key: values[kept] for key, values in data.items()})


def _write_windows(folder: Path, data: dict[str, np.ndarray]) -> Path:
    files: dict[str, Table] = {}
    for name in dict.fromkeys(data["seq"].tolist()):
        for wrong in (False, True):
            mine = np.flatnonzero((data["seq"] == name) & (data["mislabelled"] == wrong))
            mine = mine[np.argsort(data["t"][mine, 0])]
            if not len(mine):
                continue
            stem = f"{name}{'_mislabelled' if wrong else ''}"
            t_ns = np.rint(data["t"][mine] * NS_PER_S).astype(np.int64)
            gyro, accel = (np.nan_to_num(data[key][mine].astype(float)).reshape(-1, 3) for key in ("gyro", "acc"))
            files[f"log_{stem}.csv"] = (HEADER, rows(t_ns.ravel(), gyro, accel))
            q_nb = to_down(data["q_wxyz"][mine][:, [0, -1]].astype(float).reshape(-1, 4), folder)
            lines = rows(t_ns[:, [0, -1]].ravel(), q_nb)
            files[f"truth_{stem}.csv"] = (f"{TRUTH_HEADER},window", [f"{line},{k // 2}" for k, line in enumerate(lines)])
    return write_folder(folder, TOML.format(segment_s=WINDOW_S, truth_sigma_deg=TRUTH_SIGMA_DEG), files)
