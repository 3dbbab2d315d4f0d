"""Logs as a session holds them, plain and packed, rest logs, and logs of other programs through the same reader."""

import gzip

import numpy as np

from fuzz_targets.rules import choose, finite
from session.base.errors import CalibrationError
from session.log.config import Sensor
from session.log.logfile import read_log
from session.log.reader import Piece
from session.log.rests import read_rest
from session.replay.options import Answers
from session.replay.tables import TableReader

SENSOR = Sensor("ASM330LHH", "1", 104.0, 500.0, 4.0)
UNKNOWN = Sensor("no such sensor", "", 104.0, 500.0, 4.0)
SCALES = {"odr_hz": 104.0, "gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
BY_NUMBER = "t_us=1,gx_dps=2,gy_dps=3,gz_dps=4,ax_g=5,ay_g=6,az_g=7"
BY_NAME = "t_ms=Time,gx=a,gy=b,gz=-c,ax_mg=d,ay_mg=e,az_mg=f,temp_c=g"
FOREIGN = (
    Answers(**SCALES),
    Answers(**SCALES, time_unit="us", gyro_unit="dps", accel_unit="g"),
    Answers(**SCALES, columns=BY_NUMBER),
    Answers(**SCALES, columns=BY_NAME, gyro_axes="y,-x,z"),
    Answers(**SCALES, columns="gx_dps=1,gy_dps=2,gz_dps=3,ax_g=4,ay_g=5,az_g=6"),
    Answers(**SCALES, time_unit="s", accel_unit="g/2048", gyro_unit="lsb"),
    Answers(**SCALES, gyro_unit="dps", accel_unit="g", packed="st"),
    Answers(**SCALES, columns="t_s=1+2*1e-9,gx_dps=3,gy_dps=4,gz_dps=5,ax_g=6,ay_g=7,az_g=8", lines="2-"),
)
MODES = ("standard", "packed", "gzip", "rest", "unknown", *FOREIGN)
SMALL = 200


def run(data, folder):
    """As a session's log, a rest log, or another program's."""
    mode, data = choose(data, MODES)
    path = folder / ("log0001.csv.gz" if mode in ("packed", "gzip") else "log0001.csv")
    path.write_bytes(gzip.compress(data, 1) if mode == "packed" else data)
    if isinstance(mode, Answers):
        _foreign(path, mode)
    elif mode == "rest":
        rest = read_rest(path, SENSOR)
        finite(rest.gyro, rest.accel, rest.gyro_sd, rest.accel_sd)
        assert (np.diff(rest.number) > 0).all()
    else:
        samples = read_log(path, UNKNOWN if mode == "unknown" else SENSOR).samples
        finite(samples.gyro, samples.accel, samples.temp_c)
        assert (np.diff(samples.t_ns) > 0).all()
        assert len(samples) == len(samples.gyro) == len(samples.accel)


def _foreign(path, answers):
    """In usual, and in small pieces: the same rows, unless a counter or a comma is told from more of them alone."""
    usual = list(TableReader(path, answers).pieces())
    if not usual:
        return
    parts = ([getattr(piece, name) for piece in usual] for name in ("t_ns", "gyro", "accel", "temp"))
    whole = Piece(*(None if part[0] is None else np.concatenate(part) for part in parts))
    finite(whole.gyro, whole.accel, whole.temp)
    assert whole.t_ns is None or (np.diff(whole.t_ns) >= 0).all()
    try:
        pieces = list(TableReader(path, answers).pieces(SMALL))
    except CalibrationError:
        return
    for name in ("gyro", "accel", "temp"):
        if (all_of_it := getattr(whole, name)) is not None:
            assert np.array_equal(all_of_it, np.concatenate([getattr(piece, name) for piece in pieces])), f"{name} depends on the pieces"
