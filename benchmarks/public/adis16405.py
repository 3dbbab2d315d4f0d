"""Three hours at rest of each of six ADIS16405 (SMAC-Group's imudata; recorded at the University of Calgary): 1 000 000 samples at 100 Hz.

``data/adis_16405_imu1.rda`` is an R workspace, packed by xz: one matrix of Gyro. X to Accel. Z, in dps and g by the steps of its numbers,
with the attribute ``freq``.  There is no time and no temperature.
"""

from __future__ import annotations

import lzma
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import read_npz

from .writing import AGAIN, REST, found, write_folder

#: of R's format 2, big-endian: a vector of doubles that is an object with attributes.  R Internals, 1.8 Serialization Formats
MATRIX = b"\x00\x00\x03\x0e"
#: of the attribute: a vector of one double
FREQ = b"freq\x00\x00\x00\x0e\x00\x00\x00\x01"
HEADER = "t_ns,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"
#: full scales of the data sheet at 0.05 dps and 3.33 mg per LSB
TOML = """schema = "tinygc-session/1"

# SMAC-Group's imudata (CC BY-NC-SA 4.0), {name}.
[sensor]
model = "ADIS16405"
serial = "{name}"
odr_hz = {rate_hz:g}
gyro_fs_dps = 300
accel_fs_g = 18
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/imu1`` and so on, each a folder with one rest log: nothing is turned, so ``given`` means nothing.

    A folder of ``adis16405_imuN.npz`` with the arrays ``gyro_dps``, ``accel_g`` and ``rate_hz`` serves as well.
    """
    decoded = sorted(source.glob("adis16405_imu*.npz"))
    for path in decoded or found(source, "adis_16405_imu*.rda", "data"):
        values, rate_hz = (_read_npz if decoded else read_rda)(path)
        name = path.stem.split("_")[-1]
        toml = TOML.format(name=f"adis16405 {name}", rate_hz=rate_hz)
        yield write_folder(out / name, toml, {REST: (HEADER, _lines(values, rate_hz))})


def _lines(values: np.ndarray, rate_hz: float) -> Iterator[str]:
    """Rows of values (N, 6), dps and g, to the fifth decimal: 3.33 mg is no decimal number."""
    t_ns = np.rint(np.arange(len(values)) * (1e9 / rate_hz)).astype(np.int64)
    for t, row in zip(t_ns.tolist(), values.tolist(), strict=True):
        yield f"{t},{','.join(f'{value:.2f}' for value in row[:3])},{','.join(f'{value:.5f}' for value in row[3:])}"


def read_rda(path: Path) -> tuple[np.ndarray, float]:
    """The matrix (N, 6), dps and g, and its rate in Hz.  FormatError for another file."""
    try:
        data = lzma.decompress(path.read_bytes())
        start = data.index(MATRIX) + len(MATRIX)
        (count,) = struct.unpack_from(">i", data, start)
        (rate_hz,) = struct.unpack_from(">d", data, data.index(FREQ, start + 8 * count) + len(FREQ))
        return np.frombuffer(data, ">f8", count, start + 4).reshape(6, -1).T, rate_hz
    except (lzma.LZMAError, ValueError, struct.error) as error:
        raise FormatError(f"{path}: no R workspace of one matrix with its rate ({error}); {AGAIN}") from None


def _read_npz(path: Path) -> tuple[np.ndarray, float]:
    gyro, accel, rate = read_npz(path, ("gyro_dps", "accel_g", "rate_hz")).values()
    return np.column_stack([gyro, accel]).astype(float), float(rate)
