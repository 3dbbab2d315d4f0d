"""``session.toml``: read, added to, written anew, and read again."""

from __future__ import annotations

import contextlib
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from fuzz_targets.rules import choose, finite, must_hold
from session.bench.session_file import SessionFile, toml_text
from session.detect.accelerometer import with_section
from session.io.config import Accelerometer, Config, LeftOut, read_config
from session.io.errors import CalibrationError, FormatError
from session.io.folder import add_exclude, add_notes

WHOLE = """schema = "tinygc-session/1"

[sensor]
model = "ASM330LHH"
serial = "42"
odr_hz = 208.0
gyro_fs_dps = 500
accel_fs_g = 4
gyro_bias_instability_dph = 3
gyro_noise_mdps_rthz = 5.0
gyro_mdps_per_lsb = 17.5
accel_mg_per_lsb = 0.122
temp_lsb_per_c = 256
temp_at_zero_c = 25

[accelerometer]
matrix = [[1.001, 0, 0], [0, 0.998, 1e-3], [0, 0, 1]]
bias_mps2 = [0.01, -0.02, 0.03]
sigma_mg = 0.3
own_stills = true

[site]
latitude_deg = 31.03
gravity_mps2 = 9.7946
heading_deg = -12

[protocol]
still_s = 1.5
segment_s = 5
reference = "truth"
truth_sigma_deg = 0.2

[truth]
offset_s = 0.25
frame = "nwu"
sense = "world_to_body"
order = "xyzw"
mounting = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]

[notes]
operator = "Mara"
when = 2026-01-02T03:04:05Z

[[exclude]]
log = "log0001.csv"
at_s = 12.5
"""
PLAIN = WHOLE[: WHOLE.index("gyro_bias")] + '[protocol]\nreference = "gravity"\n'
MODES = ("read", "add", "section", "recorder")
#: the numbers of a sensor, which are any float of their range: ``record`` writes them anew


def seeds() -> list[bytes]:
    """The whole of it and the least, each way."""
    return [bytes([mode]) + text.encode() for mode in range(len(MODES)) for text in (WHOLE, PLAIN)]


def run(data: bytes, folder: Path) -> None:
    """What is accepted is finite, and what the tool adds to it or makes of it is accepted as well, and says the same."""
    mode, data = choose(data, MODES)
    path = folder / "session.toml"
    path.write_bytes(data)
    config = read_config(path)
    sensor, accelerometer = config.sensor, config.accelerometer
    finite(sensor.odr_hz, sensor.gyro_fs_dps, sensor.accel_fs_g, *sensor.own_units.values(), accelerometer.matrix)
    finite(accelerometer.bias_mps2, config.truth.offset_s, config.truth.mounting, *(row.at_s for row in config.exclude))
    assert np.linalg.cond(accelerometer.matrix) < 1e9, "an accelerometer's matrix that cannot be undone"
    with contextlib.suppress(FormatError):  # of a sensor that is not known
        finite(sensor.register_units.gyro_rps, sensor.register_units.accel_mps2)
    if mode == "add":
        with contextlib.suppress(FormatError):  # some forms leave no place to add to
            add_notes(path, {"fuzz": 'a "b" \\ \n c', "a b": "\x1b[31m"})
            add_exclude(path, LeftOut("log0002.csv", 3.25))
        with must_hold("what was added to"):
            _alike(config, read_config(path))
    elif mode == "section":
        with contextlib.suppress(FormatError):
            path.write_text(with_section(path.read_text("utf-8"), Accelerometer(), "by its stills"), encoding="utf-8")
        with must_hold("what has a section put in"):
            assert astuple(read_config(path).site) == astuple(config.site)
    elif mode == "recorder":
        with must_hold("what is written anew"):
            _written_anew(config, path, folder)


def _written_anew(config: Config, path: Path, folder: Path) -> None:
    (folder / "new").mkdir()
    sensor, file = config.sensor, folder / "new" / "session.toml"
    try:
        made = SessionFile(file.parent, path, None, sensor.gyro_fs_dps, sensor.accel_fs_g).configure(None, 10.0)
        assert made is not None
        read_config(file)
    except CalibrationError:
        assert not file.exists(), "what is refused was written"
        assert not _has_known_registers(config), "what every command reads was refused"
        return
    (folder / "again.toml").write_text(toml_text(replace(config, unknown=())), encoding="utf-8")
    again = read_config(folder / "again.toml")
    _alike(config, again)
    assert again.notes == config.notes or "nan" in repr(config.notes)
    assert again.exclude == config.exclude
    SessionFile(file.parent, None, None, None, None, notes={"key": "value"}).configure(None, 10.0)
    assert read_config(file).notes["key"] == "value"


def _has_known_registers(config: Config) -> bool:
    try:
        return np.isfinite(config.sensor.register_units.gyro_rps + config.sensor.register_units.accel_mps2)
    except FormatError:
        return False


def _alike(one: Config, other: Config) -> None:
    assert (one.sensor, one.site, one.protocol) == (other.sensor, other.site, other.protocol)
    for name in ("accelerometer", "truth"):
        for key, value in vars(getattr(one, name)).items():
            assert np.array_equal(value, getattr(getattr(other, name), key)), f"{name}.{key}"
