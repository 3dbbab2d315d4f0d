"""Logs of other programs made session folders: ``import``, its options and the first look included."""

import contextlib
from dataclasses import replace

from fuzz_targets import logs
from fuzz_targets.rules import choose, finite, must_hold
from session.base.errors import DataError
from session.log.config import read_config
from session.log.folder import read_session
from session.replay.convert import convert
from session.replay.options import Answers

FULL = Answers(odr_hz=104.0, gyro_fs_dps=500.0, accel_fs_g=4.0, sensor="ASM330LHH")
NONE = Answers()
UNKNOWN = Answers(gyro_fs_dps=2000.0, accel_fs_g=16.0, sensor="Some chip", time_unit="ms")
UNITS = Answers(gyro_fs_dps=500.0, accel_fs_g=4.0, gyro_unit="0.0175dps", accel_unit="g/8192", gyro_axes="y,-x,z", accel_axes="-y,x,z")
#: answers, and the serial number
MODES = (
    *((answers, "") for answers in (FULL, NONE, UNKNOWN, UNITS)),
    *((replace(each, sensor="ASM330LHH"), "7") for each in logs.FOREIGN),
)
#: between two files of one recording
BETWEEN = b"\n====\n"


def run(data, folder):
    """What is made of them is a session; what fails leaves nothing behind."""
    (answers, serial), data = choose(data, MODES)
    files = data.split(BETWEEN)[:2]
    paths = [folder / f"{name}.csv" for name, _ in zip(("Gyroscope", "Accelerometer"), files, strict=False)]
    for path, text in zip(paths, files, strict=True):
        path.write_bytes(text)
    out = folder / "out"
    try:
        made = convert(paths, out, answers, serial=serial)
    except Exception:
        assert sorted(folder.iterdir()) == sorted(paths), "something is left behind"
        raise
    with must_hold("its session.toml"):
        config = read_config(out / "session.toml")
    assert config.sensor.gyro_fs_dps > 0
    with must_hold("its folder"), contextlib.suppress(DataError):  # of a single sample: the first look says so
        session = read_session(out)
        (log,) = session.logs
        finite(log.samples.gyro, log.samples.accel, log.samples.temp_c)
        assert len(log.samples) <= made.samples
    for line in (*made.notes, *made.next, *(str(finding) for finding in made.findings)):
        assert "\n" not in line
