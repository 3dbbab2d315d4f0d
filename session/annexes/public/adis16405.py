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

from session.annexes.public.writing import arrays_of, bytes_of, found, write_rest_folder
from session.io.errors import FormatError
from session.io.files import MOST_ARCHIVE

#: of R's format 2, big-endian: a list of one pair with a tag, which is a symbol of a name.  R Internals, 1.8 Serialization Formats
MAGIC = b"RDX2\nX\n"
#: a vector of doubles that is an object with attributes
MATRIX = b"\x00\x00\x03\x0e"
#: of the attribute: a vector of one double
FREQ = b"freq\x00\x00\x00\x0e\x00\x00\x00\x01"
DIM = b"dim\x00\x00\x00\x0d\x00\x00\x00\x02"
NAMES = tuple(f"{what}. {axis}".encode() for what in ("Gyro", "Accel") for axis in "XYZ")
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
    """``out/imu1`` and so on, each a folder with one rest log.

    A folder of ``adis16405_imuN.npz`` with the arrays ``gyro_dps``, ``accel_g`` and ``rate_hz`` serves as well.  FormatError for files that
    are not the authors', and where nothing is turned: not given, an accelerometer from stills in one attitude.
    """
    if not given:
        raise FormatError("adis16405: the sensors lay in one attitude, which calibrates no accelerometer; leave --accelerometer out")
    decoded = sorted(source.glob("adis16405_imu*.npz"))
    for path in decoded or found(source, "adis_16405_imu*.rda", "data"):
        values, rate_hz = (_read_npz if decoded else read_rda)(path)
        name = path.stem.split("_")[-1]
        yield write_rest_folder(out / name, TOML.format(name=f"adis16405 {name}", rate_hz=rate_hz), HEADER, _lines(values, rate_hz))


def _lines(values: np.ndarray, rate_hz: float) -> Iterator[str]:
    """Rows of values (N, 6), dps and g, to the fifth decimal: 3.33 mg is no decimal number."""
    t_ns = np.rint(np.arange(len(values)) * (1e9 / rate_hz)).astype(np.int64)
    for t, row in zip(t_ns.tolist(), values.tolist(), strict=True):
        yield f"{t},{','.join(f'{value:.2f}' for value in row[:3])},{','.join(f'{value:.5f}' for value in row[3:])}"


def read_rda(path: Path) -> tuple[np.ndarray, float]:
    """The matrix (N, 6), dps and g, and its rate in Hz.  FormatError for another file."""
    try:
        data = lzma.LZMADecompressor().decompress(bytes_of(path).tobytes(), MOST_ARCHIVE)
        start = data.index(MATRIX) + len(MATRIX)
        (count,) = struct.unpack_from(">i", data, start)
        rest = data[start + 4 + 8 * count :]
        rows, columns = struct.unpack_from(">ii", rest, rest.index(DIM) + len(DIM))
        (rate_hz,) = struct.unpack_from(">d", rest, rest.index(FREQ) + len(FREQ))
        values = np.frombuffer(data, ">f8", count, start + 4)
    except (lzma.LZMAError, EOFError, ValueError, struct.error) as error:
        raise FormatError(f"{path}: no R workspace of one matrix with its rate ({error}); download it again") from None
    if not data.startswith(MAGIC) or columns != len(NAMES) or rows * columns != count or not all(name in rest for name in NAMES):
        raise FormatError(f"{path}: no matrix of {', '.join(map(bytes.decode, NAMES))}; download it again")
    return _sound(path, values.reshape(columns, rows).T, rate_hz)


def _read_npz(path: Path) -> tuple[np.ndarray, float]:
    gyro, accel, rate = arrays_of(path, {"gyro_dps": "f", "accel_g": "f", "rate_hz": "f"})
    if gyro.ndim != 2 or gyro.shape[1:] != (3,) or accel.shape != gyro.shape or rate.size != 1:
        raise FormatError(f"{path}: expected gyro_dps (N, 3), accel_g (N, 3) and one rate_hz")
    return _sound(path, np.column_stack([gyro, accel]).astype(float), float(rate.ravel()[0]))


def _sound(path: Path, values: np.ndarray, rate_hz: float) -> tuple[np.ndarray, float]:
    if not (np.isfinite(values).all() and 1 <= rate_hz <= 1e5):
        raise FormatError(f"{path}: holds what is no number, or a rate of {rate_hz:g} Hz; download it again")
    return values, rate_hz
