"""session.toml of a recording: written from what the board says, never over a user's own, and never against it."""

import contextlib
import inspect
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from session.bench.clocks import ClockRatio
from session.bench.events import Info
from session.bench.session_file import SessionFile, toml_text
from session.log.config import Site, read_config
from tinygc import CalibrationError

INFO = Info(500.0, 4.0, 425.98, 'S/N "7"\\')


OWN = """# mine
schema = "tinygc-session/1"
[sensor]
odr_hz = 416.0
gyro_fs_dps = 500
accel_fs_g = 4
[accelerometer]
matrix = [[1.01, 0, 0], [0, 0.99, 0.002], [0, 0, 1]]
bias_mps2 = [0.01, -0.2, 1e-05]
[site]
latitude_deg = 31.03
[protocol]
still_s = 1.5
"""


def file_of(folder, like=None, odr_hz=None, gyro_fs_dps=None, accel_fs_g=None, bench=None):
    return SessionFile(folder, like, odr_hz, gyro_fs_dps, accel_fs_g, bench=bench)


def test_the_boards_clock_is_written_with_its_sigma_and_joined_with_an_earlier_part(tmp_path):
    """Two parts of one recording, each ± 40 ppm; a clock that the user knows stays, and a recording like this one has its own."""
    file = file_of(tmp_path / "new")
    assert file.measured(ClockRatio(1.0045, 40e-6, 60.0)) == ""  # there is no file yet
    file.configure(INFO)
    assert "runs 4500 ± 50 ppm fast" in file.measured(ClockRatio(1.0045, 40e-6, 60.0))
    file_of(tmp_path / "new").measured(ClockRatio(1.00452, 40e-6, 60.0))
    sensor = read_config(tmp_path / "new" / "session.toml").sensor
    assert sensor.clock_ratio == pytest.approx(1.00451, abs=1e-9)
    assert sensor.clock_sigma_ppm == pytest.approx(np.hypot(40 / np.sqrt(2), 30), rel=0.01)  # the computer's own clock is one
    like = file_of(tmp_path / "like", tmp_path / "new").configure(INFO).sensor
    assert (like.clock_ratio, like.clock_sigma_ppm) == (None, None)
    (tmp_path / "session.toml").write_text(OWN.replace("odr_hz", "clock_sigma_ppm = 5\nodr_hz"))
    assert "has its own clock_sigma_ppm, 5" in file_of(tmp_path).measured(ClockRatio(1.0045, 40e-6, 60.0))
    assert read_config(tmp_path / "session.toml").sensor.clock_ratio is None


def test_the_site_is_where_the_operator_or_else_the_board_states_it(tmp_path):
    info = replace(INFO, latitude_deg=-33.9)
    assert file_of(tmp_path / "board").configure(info).site == Site(-33.9)
    assert file_of(tmp_path / "operator", bench=Site(48.1, 9.81)).configure(info).site == Site(48.1, 9.81)


def test_like_lends_accelerometer_site_and_protocol(tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "session.toml").write_text(OWN)
    file = file_of(tmp_path, tmp_path / "other")
    assert file.protocol.still_s == 1.5
    file.configure(Info(1000.0, 8.0, 208.0, "9"))
    read = read_config(tmp_path / "session.toml")
    assert (read.sensor.gyro_fs_dps, read.sensor.accel_fs_g, read.sensor.odr_hz, read.sensor.serial) == (1000.0, 8.0, 208.0, "9")
    np.testing.assert_array_equal(read.accelerometer.matrix, [[1.01, 0, 0], [0, 0.99, 0.002], [0, 0, 1]])
    np.testing.assert_array_equal(read.accelerometer.bias_mps2, [0.01, -0.2, 1e-05])
    assert read.site.latitude_deg == 31.03
    assert read.protocol.still_s == 1.5
    assert toml_text(read) == (tmp_path / "session.toml").read_text()


def test_a_board_that_contradicts_is_not_believed_in_silence(tmp_path):
    (tmp_path / "session.toml").write_text(OWN)
    with pytest.raises(CalibrationError, match=r"sensor.gyro_fs_dps is 500, the board gives 1000; correct"):
        file_of(tmp_path).configure(Info(1000.0, 4.0, 416.0, ""))
    with pytest.raises(CalibrationError, match=r"sensor.accel_fs_g is 4, the command line gives 8"):
        file_of(tmp_path, accel_fs_g=8.0)
    with pytest.raises(CalibrationError, match=r"the board reports gyro_fs_dps = 500, --gyro-fs gives 250: leave it out"):
        file_of(tmp_path / "new", gyro_fs_dps=250.0).configure(INFO)
    assert not (tmp_path / "new" / "session.toml").exists()


def test_a_board_that_says_nothing_is_waited_for_and_then_the_user_is_believed(tmp_path):
    assert file_of(tmp_path / "a").configure(None, 9.0) is None
    assert file_of(tmp_path / "b", None, 208.0, 500.0, None).configure(None, 9.0) is None
    assert file_of(tmp_path / "c", None, 208.0, 500.0, 4.0).configure(None).sensor.odr_hz == 208.0
    (tmp_path / "other.toml").write_text(OWN)
    like = file_of(tmp_path / "d", tmp_path / "other.toml")
    assert like.configure(None, 1.0) is None
    assert like.configure(None, 3.1).sensor.gyro_fs_dps == 500


@pytest.mark.parametrize("module", ["session.log.folder", "session.bench.session_file"])
def test_what_a_file_said_is_known_from_the_moment_that_somebody_can_remove_it(module, tmp_path, monkeypatch):
    """The folder goes in the very moment in which the file, or its note, gets its name."""
    folder, saved = tmp_path / "s", tmp_path / "saved"
    file = SessionFile(folder, None, 416.0, 500.0, 4.0, notes={"operator": "Mara"})
    replace, texts = os.replace, []

    def and_gone(fresh, path):
        replace(fresh, path)
        if inspect.stack(0)[3].frame.f_globals["__name__"] == module:  # behind the context of the file that is written
            texts.append(Path(path).read_text())
            shutil.rmtree(folder)

    monkeypatch.setattr(os, "replace", and_gone)
    with contextlib.suppress(CalibrationError):  # there may be no file any more to add the note to
        file.configure(None, 10.0)
    saved.mkdir()
    file.save_copy(saved)
    assert [(saved / "session.toml").read_text()] == texts
    assert ("Mara" in texts[0]) == (module == "session.log.folder")
