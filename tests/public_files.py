"""Made-up files in the formats in which the authors of public recordings publish theirs; every number is ours."""

import struct

import numpy as np

MIMU_ANSWER = b"\xa0\x28\x00\xc8"


def mimu_frame(number, ticks, registers):
    """One frame of the board; registers (8, 6)."""
    head = bytes([0xAA]) + number.to_bytes(2, "big") + bytes([100]) + (ticks % 2**32).to_bytes(4, "big")
    body = head + np.asarray(registers, dtype=">i2").tobytes()
    return body + (sum(body) % 2**16).to_bytes(2, "big")


def mimu_frames(ticks, registers, first_number=65530):
    """Frames of ticks (N,) and registers (N, 8, 6), their number wrapping."""
    rows = zip(ticks, registers, strict=True)
    return [mimu_frame((first_number + row) % 2**16, int(tick), values) for row, (tick, values) in enumerate(rows)]


def mimu_data(count=40, seed=0):
    """ticks (N,), which wrap after some rows, and registers (N, 8, 6) of all sizes."""
    rng = np.random.default_rng(seed)
    ticks = 2**32 - 10 * 1024000 + np.cumsum(rng.integers(1023990, 1024010, count))
    return ticks, rng.integers(-32768, 32768, (count, 8, 6)).astype(np.int16)


def write_mimu(folder, frames, number=1, tail=b""):
    path = folder / f"exp_{number}" / "data.bin"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(MIMU_ANSWER + b"".join(frames) + tail)
    return path


def xsens_text(t_s, counts):
    """Times (N,) and counts (N, 3) as MATLAB's ``save -ascii`` writes them."""
    return "".join("".join(f"   {value:.7e}" for value in (t, *row)) + "\n" for t, row in zip(t_s, counts, strict=True))


def write_xsens(folder, count=30, seed=0):
    """Both files; their times and counts."""
    rng = np.random.default_rng(seed)
    t_s = np.round(0.05 + 0.01 * np.arange(count), 6)
    accel, gyro = rng.integers(0, 65536, (2, count, 3))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "xsens_acc.mat").write_text(xsens_text(t_s, accel))
    (folder / "xsens_gyro.mat").write_text(xsens_text(t_s, gyro))
    return t_s, accel, gyro


def mikov_text(accel, gyro):
    return "".join(" ".join(f"{value:.5f}" for value in (*force, *rate)) + "\n" for force, rate in zip(accel, gyro, strict=True))


def write_euroc(folder, count=60, seed=0):
    """``mav0`` of one sequence: t_ns, gyro, accel, the truth's times and attitudes."""
    rng = np.random.default_rng(seed)
    t_ns = 1403715273262142976 + 5_000_000 * np.arange(count)
    gyro, accel = rng.normal(0, 1, (2, count, 3))
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


def tofupilot_text(count=60, seed=0):
    """A header and rows (count, 9) with tabs, as TofuPilot's example has them."""
    rng = np.random.default_rng(seed)
    names = ["timestamp", *(f"imu.gyro.{a}" for a in "xyz"), *(f"imu.acc.{a}" for a in "xyz"), "imu.status", "imu.temperature"]
    rows = np.column_stack(
        [rng.normal(size=(count, 3)) * 0.01, rng.normal(size=(count, 3)) * 0.1 - [0, 0, 9.7], np.linspace(50, 20, count)]
    )
    lines = [
        "\t".join([f"{256551281491968 + 505403 * k}", *(f"{v:.9g}" for v in row[:6]), "0", f"{row[6]:.8f}"]) for k, row in enumerate(rows)
    ]
    return "\n".join(["\t".join(names), *lines]) + "\n", rows


def broad_arrays(count=25, seed=0):
    """As BROAD's files hold them, the markers unseen in the first rows."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q[:3] = np.nan
    gyro, accel = rng.normal(0, 5, (2, count, 3))
    return {"imu_gyr": gyro, "imu_acc": accel, "opt_quat": q, "movement": np.arange(count, dtype=np.int8) % 2}


def repoimu_text(count=25, seed=0):
    """Two header lines and rows (count, 14) with semicolons; the cameras saw nothing in the second row."""
    rng = np.random.default_rng(seed)
    rows = np.round(rng.normal(size=(count, 14)), 5)
    rows[:, 0] = np.round(2.69 + 0.01 * np.arange(count), 2)
    rows[:, 1:5] /= np.linalg.norm(rows[:, 1:5], axis=1, keepdims=True)
    rows[1, 1:5] = 0
    head = "Time (s);Vicon Orientation;;;;IMU Acceleration;;;IMU Gyroscope;;;IMU Magnetometer;;;\n;W;X;Y;Z;X;Y;Z;X;Y;Z;X;Y;Z;\n"
    return head + "".join(";".join(f"{value:.8g}" for value in row) + "\n" for row in rows), rows


def rda_bytes(values, rate_hz=100.0):
    """An R workspace of one matrix (N, 6) as SMAC-Group's imudata holds it, before it is packed."""

    def text(word):
        return struct.pack(">II", 0x00040009, len(word)) + word.encode()

    def attribute(name, body):
        return struct.pack(">II", 0x402, 1) + text(name) + body

    dim = struct.pack(">IIii", 0xD, 2, *values.shape)
    attributes = attribute("dim", dim) + attribute("freq", struct.pack(">IId", 0xE, 1, rate_hz))
    body = struct.pack(">II", 0x30E, values.size) + values.T.astype(">f8").tobytes() + attributes + struct.pack(">I", 0xFE)
    start = b"RDX2\nX\n" + struct.pack(">III", 2, 0x30401, 0x20300)
    return start + struct.pack(">II", 0x402, 1) + text("adis_16405_imu1") + body + struct.pack(">I", 0xFE)
