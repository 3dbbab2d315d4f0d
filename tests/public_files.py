"""Made-up files in the formats in which the authors of public recordings publish theirs; every number is ours."""

import numpy as np


def write_euroc(folder):
    """``mav0`` of one sequence: t_ns, gyro, accel, the truth's times and attitudes."""
    rng = np.random.default_rng(0)
    t_ns = 1403715273262142976 + 5_000_000 * np.arange(60)
    gyro, accel = rng.normal(0, 1, (2, 60, 3))
    truth_ns = t_ns[5:-5]
    state = rng.normal(0, 1, (len(truth_ns), 16))
    state[:, 3:7] /= np.linalg.norm(state[:, 3:7], axis=1, keepdims=True)
    _write_table(folder / "mav0" / "imu0", "#timestamp [ns],w,w,w,a,a,a", t_ns, np.c_[gyro, accel])
    _write_table(folder / "mav0" / "state_groundtruth_estimate0", "#timestamp", truth_ns, state)
    return t_ns, gyro, accel, truth_ns, state[:, 3:7]


def _write_table(folder, head, times, values):
    folder.mkdir(parents=True)
    rows = [",".join([str(t), *map(repr, row)]) for t, row in zip(times.tolist(), values.tolist(), strict=True)]
    (folder / "data.csv").write_text("\n".join([head, *rows, ""]))
