"""BROAD (Laidig, Caruso, Cereatti, Seel, Data 6 (7), 2021): an IMU moved by hand, whose attitude optical markers have followed.

``data_hdf5/05_undisturbed_slow_rotation_with_breaks_B.hdf5`` holds ``imu_gyr`` rad/s, ``imu_acc`` m/s^2 and ``opt_quat``, scalar first,
from the sensor's axes to a world whose z axis points up, NaN where the markers were not seen.  All have one row per sample, at
``sampling_rate``.  There is no time; it is the row's number over that rate.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from session.annexes.public.writing import found, write_folder
from session.io.errors import CalibrationError, FormatError
from session.io.files import MOST_ARCHIVE, require_file
from session.io.logfile import of_length_1
from session.io.units import NS_PER_S

WIDTHS = {"imu_gyr": 3, "imu_acc": 3, "opt_quat": 4}
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
    """``out/trial05`` and so on, a session folder with a truth file for each trial, one after the other.

    not given: with an accelerometer from the trial's own stills.  FormatError for files that are not the authors'; not given: what
    ``placed`` raises.
    """
    for path in found(source, "[0-9][0-9]_*.hdf5", "data_hdf5"):
        arrays = read_hdf5(path, tuple(WIDTHS), (RATE,))
        count, rate_hz = len(arrays["imu_gyr"]), arrays[RATE].astype(float).ravel()
        for name, width in WIDTHS.items():
            if arrays[name].dtype.kind != "f" or arrays[name].shape != (count, width):
                raise FormatError(f"{path}: {name} has not the shape ({count}, {width}); is it the authors' file?")
        if rate_hz.shape != (1,) or not 1 <= rate_hz[0] <= 1e5:
            raise FormatError(f"{path}: {RATE} is {rate_hz}, expected one number of Hz")
        t_ns = np.rint(np.arange(count) * (NS_PER_S / rate_hz[0])).astype(np.int64)
        q_wxyz = arrays["opt_quat"].astype(float)
        seen = np.isfinite(q_wxyz).all(axis=1)
        if not of_length_1(q_wxyz[seen]).all():
            raise FormatError(f"{path}: opt_quat holds quaternions that are not of length 1; download it again")
        toml = TOML.format(name=path.stem, rate_hz=float(rate_hz[0]))
        log = _lines(t_ns, np.column_stack([arrays["imu_gyr"], arrays["imu_acc"]]))
        truth = (TRUTH_HEADER, _lines(t_ns[seen], q_wxyz[seen]))
        yield write_folder(out / f"trial{path.name[:2]}", toml, HEADER, log, given, truth)


def read_hdf5(path: Path, names: tuple[str, ...], attributes: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """The root group's datasets and attributes of these names, each in its own shape and type.

    Raises FormatError for what is no such file, is damaged, or lacks one of the names, and where h5py is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise FormatError(f"{path}: an HDF5 file; reading it needs h5py: python -m pip install 'tinygc[logs]'") from None
    require_file(path)
    if not h5py.is_hdf5(path):
        raise FormatError(f"{path}: no HDF5 file; download it again")
    try:
        with warnings.catch_warnings(), h5py.File(path, "r") as file:
            warnings.simplefilter("ignore")
            if missing := [name for name in names if name not in file] + [name for name in attributes if name not in file.attrs]:
                raise FormatError(f"{path}: holds no {missing[0]}; is it the authors' file?")
            read = {}
            for name in names:
                inside = isinstance(file.get(name, getlink=True), h5py.HardLink) and isinstance(file[name], h5py.Dataset)
                if not inside or file[name].external or file[name].is_virtual or file[name].nbytes > MOST_ARCHIVE:
                    raise ValueError(f"{name} is no array in this file, or has more than {MOST_ARCHIVE} bytes")
                read[name] = np.asarray(file[name][()])
            return read | {name: np.asarray(file.attrs[name]) for name in attributes}
    except CalibrationError:
        raise
    except Exception as error:  # of the many that HDF5's damaged bytes come to
        said = " ".join(f"{error or type(error).__name__}".split())[:120]
        raise FormatError(f"{path}: not an HDF5 file that can be read here ({said}); download it again") from None


def _lines(t_ns: np.ndarray, values: np.ndarray) -> Iterator[str]:
    """Rows of t_ns (N,) and values (N, C)."""
    for t, row in zip(t_ns.tolist(), values.tolist(), strict=True):
        yield f"{t},{','.join(map(repr, row))}"
