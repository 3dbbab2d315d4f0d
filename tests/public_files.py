"""Made-up files in the formats in which the authors of public recordings publish theirs; every number is ours."""

import numpy as np

MIMU_ANSWER = b"\xa0\x28\x00\xc8"


def mimu_frame(number, ticks, registers):
    """One frame of the board; registers (8, 6)."""
    head = bytes([0xAA]) + number.to_bytes(2, "big") + bytes([100]) + (ticks % 2**32).to_bytes(4, "big")
    body = head + np.asarray(registers, dtype=">i2").tobytes()
    return body + (sum(body) % 2**16).to_bytes(2, "big")


def mimu_frames(ticks, registers):
    """Frames of ticks (N,) and registers (N, 8, 6), their number wrapping."""
    rows = zip(ticks, registers, strict=True)
    return [mimu_frame((65530 + row) % 2**16, int(tick), values) for row, (tick, values) in enumerate(rows)]


def mimu_data():
    """ticks (N,), which wrap after some rows, and registers (N, 8, 6) of all sizes."""
    rng = np.random.default_rng(0)
    ticks = 2**32 - 10 * 1024000 + np.cumsum(rng.integers(1023990, 1024010, 40))
    return ticks, rng.integers(-32768, 32768, (40, 8, 6)).astype(np.int16)


def write_mimu(folder, frames, tail=b""):
    path = folder / "exp_1" / "data.bin"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(MIMU_ANSWER + b"".join(frames) + tail)
    return path


def xsens_text(t_s, counts):
    """Times (N,) and counts (N, 3) as MATLAB's ``save -ascii`` writes them."""
    return "".join("".join(f"   {value:.7e}" for value in (t, *row)) + "\n" for t, row in zip(t_s, counts, strict=True))


def write_xsens(folder):
    """Both files; their times and counts."""
    rng = np.random.default_rng(0)
    t_s = np.round(0.05 + 0.01 * np.arange(30), 6)
    accel, gyro = rng.integers(0, 65536, (2, 30, 3))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "xsens_acc.mat").write_text(xsens_text(t_s, accel))
    (folder / "xsens_gyro.mat").write_text(xsens_text(t_s, gyro))
    return t_s, accel, gyro


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
