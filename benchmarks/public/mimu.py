"""Eight MPU-9150 on one MIMU4444 board (Carlsson, Skog, Jaldén 2021) as session folders."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import read_npz

from .writing import AGAIN, LOG, found, rows, write_folder

# The frames of a MIMU4444 board, as a host has received them.
#
# A frame is 106 bytes, big-endian: u8 0xAA, u16 number, u8 100 (bytes of payload), u32 ticks of 64 MHz, 48 x i16 (unit by unit: ax ay az
# gx gy gz), u16 sum of all bytes before it.  Number and ticks wrap.  Before the first frame lies the board's answer to the host's command.

UNITS = 8
HEAD, PAYLOAD = 0xAA, 100
LENGTH = 106
SUMMED = LENGTH - 2
#: bytes before the first frame: 4 in every file of the authors, and less than a frame, or a damaged first one would pass for an answer
LONGEST_ANSWER = 16


def read_frames(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """ticks (N,) int64, 0 at the first frame; registers (N, 8, 6) int16; a last frame that was cut off is left out.

    Raises FormatError for a wrong checksum, a missing frame, a file without frames.
    """
    raw = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    starts = range(min(LONGEST_ANSWER, len(raw) - LENGTH) + 1)
    first = next((start for start in starts if _right(raw[None, start : start + LENGTH])[0]), None)
    if first is None:
        raise FormatError(f"{path}: no whole frame with a right checksum at its beginning; {AGAIN}")
    count = (len(raw) - first) // LENGTH
    frames = raw[first : first + count * LENGTH].reshape(count, LENGTH)
    right = _right(frames)
    right[1:] &= np.diff(_unsigned(frames[:, 1:3])) % 2**16 == 1
    if not right.all():
        raise FormatError(f"{path}: frame {int(np.argmin(right))} is damaged, or frames are missing before it; {AGAIN}")
    ticks = np.concatenate([[0], np.cumsum(np.diff(_unsigned(frames[:, 4:8])) % 2**32)])
    return ticks, np.ascontiguousarray(frames[:, 8:SUMMED]).view(">i2").astype(np.int16).reshape(count, UNITS, 6)


def _right(frames: np.ndarray) -> np.ndarray:
    """(N,) bool: frames (N, 106) uint8 whose head and checksum are right."""
    total = frames[:, :SUMMED].sum(axis=1, dtype=np.int64) % 2**16
    return (frames[:, 0] == HEAD) & (frames[:, 3] == PAYLOAD) & (total == _unsigned(frames[:, SUMMED:]))


def _unsigned(columns: np.ndarray) -> np.ndarray:
    """(N,) int64 of big-endian bytes (N, B)."""
    return columns.astype(np.int64) @ (256 ** np.arange(columns.shape[1] - 1, -1, -1))


# Eight MPU-9150 on one board, turned by hand (Carlsson, Skog, Jaldén, IEEE Sensors Journal 21 (6), 2021): ``exp_N/data.bin``.
#
# Every experiment and unit becomes a session folder, ``e1u0`` for the first unit of the first experiment.  The axes are those of the chip,
# which are turned against the board's in some units.  As arrays, every experiment is one folder, ``e1`` and so on.

NS_PER_TICK = 15.625  #: of 64 MHz; exact in binary
ACCEL_LSB_PER_G = 2048
GYRO_LSB_PER_DPS = 16.4
HEADER = "t_ns,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"
#: gravity is normal gravity at that latitude (WGS 84); the authors state neither
TOML = """schema = "tinygc-session/1"

# Registers over 2048 LSB/g and 16.4 LSB/dps.
[sensor]
model = "MPU-9150"
serial = "{serial}"
odr_hz = 62.5
gyro_fs_dps = 2000
accel_fs_g = 16

[site]
latitude_deg = 59.35
gravity_mps2 = 9.8187

[protocol]
still_s = 1.0
segment_s = 5.0
reference = "gravity"
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/e1u0`` and so on, one after the other."""
    for number, (ticks, registers) in experiments(source):
        for unit in range(UNITS):
            toml, log = TOML.format(serial=f"mimu-{unit}"), (HEADER, _lines(ticks, registers[:, unit]))
            yield write_folder(out / f"e{number}u{unit}", toml, {LOG: log}, given)


def write_array(source: Path, out: Path) -> Iterator[Path]:
    """``out/e1`` and so on, each an array of the eight units."""
    units = "".join(f'\n[[array.unit]]\nnumber = {unit}\nsensor.serial = "mimu-{unit}"\n' for unit in range(UNITS))
    for number, (ticks, registers) in experiments(source):
        logs = {f"log0001.unit{unit}.csv.gz": (HEADER, _lines(ticks, registers[:, unit])) for unit in range(UNITS)}
        yield write_folder(out / f"e{number}", TOML.format(serial=f"mimu-e{number}") + units, logs)


def _lines(ticks: np.ndarray, registers: np.ndarray) -> Iterator[str]:
    """Rows of one unit: ticks (N,) of 64 MHz, registers (N, 6)."""
    t_ns = np.rint(ticks * NS_PER_TICK).astype(np.int64)
    return rows(t_ns, registers[:, 3:] / GYRO_LSB_PER_DPS, registers[:, :3] / ACCEL_LSB_PER_G)


def experiments(source: Path) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray]]]:
    """Number, then ticks (N,) int64 and registers (N, 8, 6) int16, of each ``exp_N/data.bin``, or of each ``exp_N.npz`` decoded before."""
    for path in sorted(source.glob("exp_*.npz")):
        ticks, registers = read_npz(path, ("ticks_64mhz", "registers")).values()
        yield int(path.stem.removeprefix("exp_")), (ticks, registers)
    if not any(source.glob("exp_*.npz")):
        for path in found(source, "exp_*/data.bin", "experimental_data/calibration"):
            yield int(path.parent.name.removeprefix("exp_")), read_frames(path)
