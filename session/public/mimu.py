"""Eight MPU-9150 on one board, turned by hand (Carlsson, Skog, Jaldén, IEEE Sensors Journal 21 (6), 2021): ``exp_N/data.bin``.

Every experiment and unit becomes a session folder, ``e1u0`` for the first unit of the first experiment.  The axes are those of the chip,
which are turned against the board's in some units.  As arrays, every experiment is one folder, ``e1`` and so on.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.public.mimu_frames import UNITS, read_frames
from session.public.sources import arrays_of, found
from session.public.writing import write_array_folder, write_folder

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
