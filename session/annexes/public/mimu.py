"""Eight MPU-9150 on one MIMU4444 board (Carlsson, Skog, Jaldén 2021) as session folders."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.annexes.public.writing import arrays_of, bytes_of, found, write_array_folder, write_folder
from session.io.errors import FormatError

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
AGAIN = "download it again"


def read_frames(path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """ticks (N,) int64, 0 at the first frame; registers (N, 8, 6) int16; and how many bytes of a last frame were cut off the end.

    Raises FormatError for a wrong checksum, a missing frame, a file without frames.
    """
    raw = bytes_of(path)
    first = _first_frame(raw)
    if first is None:
        raise FormatError(f"{path}: no whole frame with a right checksum at its beginning; expected the authors' data.bin, {AGAIN}")
    count = (len(raw) - first) // LENGTH
    frames = raw[first : first + count * LENGTH].reshape(count, LENGTH)
    if not (right := _right(frames)).all():
        wrong = int(np.argmin(right))
        raise FormatError(f"{path}: frame {wrong} at byte {first + wrong * LENGTH} is cut short or has a wrong checksum; {AGAIN}")
    step = np.diff(_unsigned(frames[:, 1:3])) % 2**16
    if (step != 1).any():
        wrong = int(np.argmax(step != 1)) + 1
        raise FormatError(f"{path}: {(step[wrong - 1] - 1) % 2**16} frames are missing before frame {wrong}; {AGAIN}")
    rest = raw[first + count * LENGTH :]
    if len(rest) and rest[0] != HEAD:
        raise FormatError(f"{path}: its last {len(rest)} bytes are not the beginning of a frame; {AGAIN}")
    ticks = np.concatenate([[0], np.cumsum(np.diff(_unsigned(frames[:, 4:8])) % 2**32)])
    registers = np.ascontiguousarray(frames[:, 8:SUMMED]).view(">i2").astype(np.int16).reshape(count, UNITS, 6)
    return ticks, registers, len(rest)


def _first_frame(raw: np.ndarray) -> int | None:
    """Where the first whole frame begins."""
    for start in range(min(LONGEST_ANSWER, len(raw) - LENGTH) + 1):
        if _right(raw[None, start : start + LENGTH])[0]:
            return start
    return None


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
    """``out/e1u0`` and so on, one after the other.

    The authors give no calibration; not given: an accelerometer from each recording's own stills.  FormatError for a file that is
    damaged; not given: what ``placed`` raises.
    """
    for number, (ticks, registers) in experiments(source):
        for unit in range(UNITS):
            yield write_folder(out / f"e{number}u{unit}", _toml(f"mimu-{unit}"), HEADER, _lines(ticks, registers[:, unit]), given)


def write_array(source: Path, out: Path) -> Iterator[Path]:
    """``out/e1`` and so on, each an array of the eight units.  FormatError as from ``write``."""
    units = "".join(f'\n[[array.unit]]\nnumber = {unit}\nsensor.serial = "mimu-{unit}"\n' for unit in range(UNITS))
    for number, (ticks, registers) in experiments(source):
        logs = {f"log0001.unit{unit}.csv.gz": (HEADER, _lines(ticks, registers[:, unit])) for unit in range(UNITS)}
        yield write_array_folder(out / f"e{number}", _toml(f"mimu-e{number}") + units, logs)


def _toml(serial: str) -> str:
    return TOML.format(serial=serial)


def _lines(ticks: np.ndarray, registers: np.ndarray) -> Iterator[str]:
    """Rows of one unit: ticks (N,) of 64 MHz, registers (N, 6)."""
    t_ns = np.rint(ticks * NS_PER_TICK).astype(np.int64).tolist()
    rates, forces = registers[:, 3:] / GYRO_LSB_PER_DPS, registers[:, :3] / ACCEL_LSB_PER_G
    for t, rate, force in zip(t_ns, rates.tolist(), forces.tolist(), strict=True):
        yield f"{t},{','.join(map(repr, rate))},{','.join(map(repr, force))}"


def experiments(source: Path) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray]]]:
    """Number, then ticks (N,) int64 and registers (N, 8, 6) int16, of each ``exp_N/data.bin``, or of each ``exp_N.npz`` decoded before."""
    decoded = sorted(source.glob("exp_*.npz"))
    paths = decoded or found(source, "exp_*/data.bin", "experimental_data/calibration")
    by_number = {_number(path.stem if decoded else path.parent.name, path): path for path in paths}
    for number, path in sorted(by_number.items()):
        yield number, (_read_npz(path) if decoded else read_frames(path)[:2])


def _number(name: str, path: Path) -> int:
    digits = name.removeprefix("exp_")
    if not digits.isascii() or not digits.isdigit():
        raise FormatError(f"{path}: expected exp_ and the experiment's number")
    return int(digits)


def _read_npz(path: Path) -> tuple[np.ndarray, np.ndarray]:
    ticks, registers = arrays_of(path, {"ticks_64mhz": "f", "registers": "f"})
    if ticks.dtype != np.int64 or registers.dtype != np.int16 or ticks.ndim != 1 or registers.shape != (len(ticks), UNITS, 6):
        raise FormatError(f"{path}: expected ticks_64mhz (N,) int64 and registers (N, 8, 6) int16, as the authors' exp_N/data.bin gives")
    return ticks, registers
