"""BROAD (Laidig, Caruso, Cereatti, Seel, Data 6 (7), 2021): an IMU moved by hand, whose attitude optical markers have followed.

``data_hdf5/05_undisturbed_slow_rotation_with_breaks_B.hdf5`` holds ``imu_gyr`` rad/s, ``imu_acc`` m/s^2 and ``opt_quat``, scalar first,
from the sensor's axes to a world whose z axis points up, NaN where the markers were not seen.  All have one row per sample, at
``sampling_rate``.  There is no time; it is the row's number over that rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.units import NS_PER_S

from .writing import AGAIN, LOG, TRUTH, found, rows, write_folder

NAMES = ("imu_gyr", "imu_acc", "opt_quat")
RATE = "sampling_rate"
HEADER, TRUTH_HEADER = "t_ns,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2", "t_ns,qw,qx,qy,qz"
#: full scales by the steps of the readings, 0.061 dps and 0.5 mg; the sigma of an angle is an assumption about optical markers
TOML = """schema = "tinygc-session/1"

# BROAD (CC BY 4.0), {name}.  Full scales follow from the steps of the numbers.
[sensor]
model = "unknown"
serial = "BROAD"
odr_hz = {rate_hz!r}
gyro_fs_dps = 2000
accel_fs_g = 16

[protocol]
segment_s = 5.0
reference = "truth"
truth_sigma_deg = 0.1

[truth]
frame = "enu"
"""


def write(source: Path, out: Path, given: bool = True) -> Iterator[Path]:
    """``out/trial05`` and so on, a session folder with a truth file for each trial, one after the other."""
    for path in found(source, "[0-9][0-9]_*.hdf5", "data_hdf5"):
        read = read_hdf5(path, NAMES, (RATE,))
        gyro, accel, q_wxyz = (read[name].astype(float) for name in NAMES)
        rate_hz = float(read[RATE])
        t_ns = np.rint(np.arange(len(gyro)) * (NS_PER_S / rate_hz)).astype(np.int64)
        seen = np.isfinite(q_wxyz).all(axis=1)
        files = {LOG: (HEADER, rows(t_ns, gyro, accel)), TRUTH: (TRUTH_HEADER, rows(t_ns[seen], q_wxyz[seen]))}
        yield write_folder(out / f"trial{path.name[:2]}", TOML.format(name=path.stem, rate_hz=rate_hz), files, given)


def read_hdf5(path: Path, names: tuple[str, ...], attributes: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """The root group's datasets and attributes of these names.  FormatError for another file."""
    try:
        import h5py

        with h5py.File(path, "r") as file:
            return {name: file[name][()] for name in names} | {name: np.asarray(file.attrs[name]) for name in attributes}
    except ImportError:
        raise FormatError(f"{path}: an HDF5 file; reading it needs h5py: python -m pip install 'tinygc[logs]'") from None
    except (OSError, KeyError) as error:
        raise FormatError(f"{path}: not the authors' HDF5 file ({error}); {AGAIN}") from None
