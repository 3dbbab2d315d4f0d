"""A recording's raw bytes with their arrival times and decisions, replayed into a session folder; a log that is still growing."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from fuzz_targets.material import FRAMES, INFO, INFO_FRAME, REGISTER_HEADER, REGISTER_LINES, UNIT_HEADER, UNIT_LINES
from fuzz_targets.rules import choose, finite, must_hold
from session.bench.rawfile import RAW, TIMES, TIMES_HEADER, decision_of, read_marks
from session.io.config import read_config
from session.io.errors import DataError
from session.io.logfile import read_log
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


def seeds() -> list[bytes]:
    """Frames and text, with every decision between them."""
    text, units = f"{REGISTER_HEADER}\n{REGISTER_LINES}".encode(), f"{UNIT_HEADER}\n{UNIT_LINES}".encode()
    said = f"# {INFO.text} sensor=MPU-9250\n".encode()
    events = [
        "open x",
        "begin log0001",
        "begin closure0001",
        "keep closure0002",
        "pause",
        "drop 4060000",
        "begin log0002",
        "note a b",
        "close",
    ]
    marks = "".join(f"{1000 + k},{40 * k},{event}\n" for k, event in enumerate(events))
    times = f"{TIMES_HEADER}\n{marks}".encode()
    return [
        b"\0" + times + BETWEEN + INFO_FRAME + FRAMES,
        b"\1" + times + BETWEEN + said + text + b"\0" + FRAMES,
        b"\2" + BETWEEN + said + text,
        b"\2" + BETWEEN + said + units,
        b"\3" + times + BETWEEN + text + text,
        b"\4" + times + BETWEEN + UNIT_LINES.encode(),
        b"\0" + BETWEEN + FRAMES,
    ]


def run(data: bytes, folder: Path) -> None:
    """What is written is read by what reads it, with the samples that were counted; what fails leaves no folder behind."""
    options, data = choose(data, MODES)
    times, found, raw = data.partition(BETWEEN)
    path, out = folder / RAW, folder / "out"
    path.write_bytes(raw if found else data)
    (folder / TIMES).write_bytes(times if found else b"")
    for mark in read_marks(path):
        decision = decision_of(mark)
        assert decision is None or decision.text
    try:
        made = convert_raw(path, out, **options)
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
