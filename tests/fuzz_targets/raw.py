"""A recording's raw bytes with their arrival times and decisions, replayed into a session folder; a log that is still growing."""

import contextlib
from dataclasses import replace

import numpy as np

from fuzz_targets.material import UNIT_HEADER
from fuzz_targets.rules import choose, finite, must_hold
from session.base.errors import DataError
from session.bench.rawfile import RAW, TIMES, decision_of, read_marks
from session.log.config import read_config
from session.log.logfile import read_log
from session.replay.options import Answers
from session.replay.raw import convert_raw

SCALES = {"gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
MODES = (
    SCALES | {"odr_hz": 104.0},
    SCALES,
    {},
    SCALES | {"sensor": "MPU-9250"},
    SCALES | {"header": UNIT_HEADER},
    SCALES | {"sensor": "no such sensor"},
)
#: raw.times stands before it, raw.bin behind
BETWEEN = b"\n====\n"


def run(data, folder):
    """What is written is read by what reads it, with the samples that were counted; what fails leaves no folder behind."""
    options, data = choose(data, MODES)
    times, found, raw = data.partition(BETWEEN)
    path, out = folder / RAW, folder / "out"
    path.write_bytes(raw if found else data)
    (folder / TIMES).write_bytes(times if found else b"")
    for mark in read_marks(path):
        decision = decision_of(mark)
        assert decision is None or decision.kind
    try:
        header = options.get("header")
        made = convert_raw(path, out, Answers(**{name: value for name, value in options.items() if name != "header"}), header)
    except Exception:
        assert not out.exists(), "a folder is left behind"
        raise
    assert made.folder == out
    with must_hold("its session.toml"):
        sensor = read_config(out / "session.toml").sensor
    finite(sensor.odr_hz, sensor.gyro_fs_dps, sensor.accel_fs_g)
    # A board may call itself what nobody knows: a person corrects session.toml then, and nothing of the log is lost.
    sensor, rows = replace(sensor, gyro_mdps_per_lsb=17.5, accel_mg_per_lsb=0.122), 0
    for log in sorted(out.glob("*.csv")):
        rows += sum(not line.startswith("#") for line in log.read_text(encoding="utf-8").splitlines()) - 1
        with must_hold(log.name), contextlib.suppress(DataError):  # of a single sample
            samples = read_log(log, sensor).samples
            finite(samples.gyro, samples.accel, samples.temp_c)
            assert (np.diff(samples.t_ns) > 0).all()
    assert rows <= made.samples
