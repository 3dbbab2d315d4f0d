"""The authors' files of public sets, as ``python -m session.public`` reads them; every number of the seeds is ours."""

from __future__ import annotations

import contextlib
import io
import lzma
from pathlib import Path

import numpy as np
from annex import annex
from hdf5_and_rda import hdf5_bytes, rda_bytes

from fuzz_targets.material import COUNT, FORCES_G, RATES_DPS, T_US, lines
from fuzz_targets.rules import choose, finite, must_hold
from session.annexes.public import adis16405, broad, imucal, mikov, mimu, phones, repoimu, sundevil, tofupilot, xsens
from session.annexes.public import euroc as euroc_folders
from session.annexes.public.writing import REST
from session.annexes.turntable.folder import read_turn_session
from session.io.config import read_config
from session.io.errors import CalibrationError, DataError
from session.io.folder import read_session
from session.io.rests import read_rest
from session.io.units import DEG, G

RATES, FORCES = RATES_DPS * DEG, FORCES_G * G
IMU = "V1_01_easy/mav0/imu0/data.csv"
TRUTH = "V1_01_easy/mav0/state_groundtruth_estimate0/data.csv"
BROAD = "data_hdf5/05_undisturbed_slow_rotation_with_breaks_B.hdf5"
REPOIMU = "TStick/TStick_Test06_Trial1.csv"
SUNDEVIL = "Rev2_IMU_Data/IMU_Rev2_Data_Short.txt"
ADIS = "data/adis_16405_imu1.rda"
PHONE = "IphoneSE3G/Rotation/1/90/IphoneSE3G_ZG_1_90_1.csv"
EPOCH_NS = 1_403_715_273_262_142_976
T_NS = EPOCH_NS + 1000 * (T_US - T_US[0])
#: set, file that the input is, whether the accelerometer is as the authors give it
MODES = (
    (xsens, "xsens_acc.mat", True),
    (xsens, "xsens_gyro.mat", True),
    (mikov, "imu0.log", True),
    (mikov, "imu0.log", False),
    (mimu, "exp_1/data.bin", True),
    (mimu, "exp_1.npz", True),
    (euroc_folders, IMU, True),
    (euroc_folders, TRUTH, True),
    (euroc_folders, "euroc_V1_01_easy.npz", True),
    (imucal, imucal.FILE, True),
    (tofupilot, "imu_raw_data.csv", True),
    (broad, BROAD, True),
    (repoimu, REPOIMU, True),
    (sundevil, SUNDEVIL, True),
    (adis16405, ADIS, True),
    (phones, PHONE, True),
)


def _good() -> dict[str, bytes]:
    """A good file of each name."""
    seconds = (T_US - T_US[0]) / 1e6 + 0.01
    q = np.tile([1.0, 0, 0, 0], (COUNT, 1))
    state = np.column_stack([np.zeros((COUNT, 3)), np.ones(COUNT), np.zeros((COUNT, 12))])
    counts = np.full((COUNT, 3), 32768) + np.arange(COUNT)[:, None]
    names = ["timestamp", *(f"imu.{what}.{axis}" for what in ("gyro", "acc") for axis in "xyz"), "imu.status", "imu.temperature"]
    board = lines(T_US * 100, RATES, FORCES, np.zeros(COUNT, int), np.full(COUNT, 25.5), separator="\t", form="{:.9g}")
    return {
        "xsens_acc.mat": lines(seconds, counts, separator="   ", form="{:.7e}").encode(),
        "xsens_gyro.mat": lines(seconds, counts, separator="   ", form="{:.7e}").encode(),
        "imu0.log": lines(FORCES, RATES, separator=" ").encode(),
        "exp_1/data.bin": b"\xa0\x28\x00\xc8" + b"".join(map(_mimu_frame, range(4))),
        IMU: ("#timestamp\n" + lines(T_NS, RATES, FORCES, form="{:.9g}")).encode(),
        TRUTH: ("#timestamp\n" + lines(T_NS, state, form="{:.9g}")).encode(),
        imucal.FILE: (",".join(imucal.COLUMNS) + "\n" + lines(np.arange(COUNT), RATES_DPS, FORCES)).encode(),
        "imu_raw_data.csv": ("\t".join(names) + "\n" + board).encode(),
        BROAD: hdf5_bytes({"imu_gyr": RATES, "imu_acc": FORCES, "opt_quat": q}, {"sampling_rate": 285.714286}, chunk=3),
        REPOIMU: ("\n".join(repoimu.HEAD) + "\n" + lines(seconds, q, FORCES, RATES, FORCES, separator=";")).encode(),
        SUNDEVIL: lines(seconds, FORCES, RATES_DPS, np.zeros((COUNT, 5)), np.full(COUNT, 30.5), separator="\t").encode(),
        PHONE: ("time,wx,wy,wz\n" + lines(seconds, RATES, form="{:.3f}")).encode(),
        ADIS: lzma.compress(rda_bytes(np.column_stack([RATES_DPS, FORCES_G]))),
    }


def _mimu_frame(number: int) -> bytes:
    head = bytes([0xAA]) + number.to_bytes(2, "big") + bytes([100]) + (1024000 * number).to_bytes(4, "big")
    body = head + np.full(48, 100 * number, dtype=">i2").tobytes()
    return body + (sum(body) % 2**16).to_bytes(2, "big")


GOOD = _good()


def seeds() -> list[bytes]:
    """Each file as the authors write it, and archives as NumPy does."""

    def archive(**arrays: np.ndarray) -> bytes:
        file = io.BytesIO()
        np.savez(file, **arrays)
        return file.getvalue()

    found = [bytes([mode]) + GOOD[name] for mode, (_, name, _) in enumerate(MODES) if name in GOOD]
    registers = np.zeros((COUNT, 8, 6), np.int16)
    q = np.tile([1.0, 0, 0, 0], (COUNT, 1))
    euroc = archive(t_ns=T_NS, gyro=RATES, acc=FORCES, gt_t_ns=T_NS, gt_q_wxyz=q)
    return [*found, b"\5" + archive(ticks_64mhz=T_US, registers=registers), b"\x08" + euroc]


def run(data: bytes, folder: Path) -> None:
    """What is written is a session."""
    (module, name, given), data = choose(data, MODES)
    source, out = folder / "source", folder / "out"
    neighbours = {"xsens_acc.mat", "xsens_gyro.mat"} if module is xsens else {IMU, TRUTH} if name in (IMU, TRUTH) else set()
    for path, content in {**{each: GOOD[each] for each in neighbours}, name: data}.items():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        (source / path).write_bytes(content)
    for made in module.write(source, out, given):
        with must_hold(made.name), contextlib.suppress(DataError):  # of a single sample, or of a rest of a few
            if module in (tofupilot, adis16405):
                read_rest(made / REST, read_config(made / "session.toml").sensor)
                continue
            if module is phones:
                finite(read_turn_session(made).logs[0].samples.gyro)
                with contextlib.suppress(CalibrationError):  # such a log need not hold a turn
                    annex("tinygc.annexes.turntable.library").fit_turns(made)
                continue
            (log,) = read_session(made).logs
            finite(log.samples.gyro, log.samples.accel)
