"""Logs: every header that docs/formats.md allows gives the same physics, and ordinary disorder does no harm."""

import gzip

import numpy as np
import pytest
from four_readings import ACCEL_G, ACCELS, GYRO_DPS, GYROS, HEADER, SENSOR, TEMPS, TIMES, G, assert_the_four_readings, read, text_of

from session.io.config import Sensor
from session.io.errors import DataError
from session.io.logfile import read_log


@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize("gyro", GYROS)
@pytest.mark.parametrize("accel", ACCELS)
@pytest.mark.parametrize("temp", TEMPS)
def test_every_unit_gives_the_same_samples(tmp_path, time, gyro, accel, temp):
    log = read(tmp_path, text_of(time, gyro, accel, temp))
    assert_the_four_readings(log, temp is not None)
    assert log.notes == ()
    assert log.raw == ("" in (gyro, accel))


def test_the_sensitivity_follows_the_full_scale(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text_of())
    wide = read_log(path, Sensor("ASM330LHH", "", 208.0, 2000.0, 16.0)).samples
    np.testing.assert_allclose(np.rad2deg(wide.gyro), 4 * GYRO_DPS)
    np.testing.assert_allclose(wide.accel, 4 * ACCEL_G * G)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("extra", ["", ","])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
def test_line_ends_byte_order_marks_and_trailing_commas_do_no_harm(tmp_path, end, extra, mark, name):
    assert_the_four_readings(read(tmp_path, mark + text_of(end=end, extra=extra), name))


def test_a_last_line_without_an_end_is_whole(tmp_path):
    log = read(tmp_path, text_of().rstrip("\n"))
    assert_the_four_readings(log)
    assert log.notes == ()


def test_columns_may_stand_in_any_order_with_others_between(tmp_path):
    lines = text_of().splitlines()
    shuffled = []
    for i, line in enumerate(lines):
        t, gx, gy, gz, ax, ay, az, temp = line.split(",")
        shuffled.append(",".join([ax, "note" if i == 0 else "text, no", temp, gz, gy, gx, az, ay, t, "crc" if i == 0 else "0x1f"]))
    shuffled[0] = shuffled[0].replace("note", "note,more")
    assert_the_four_readings(read(tmp_path, "\n".join(shuffled) + "\n"))


def test_comments_are_kept_wherever_they_stand(tmp_path):
    lines = text_of().splitlines()
    log = read(tmp_path, "# a board\n\n# gyro_fs_dps=500 accel_fs_g=4 odr_hz=211.3\n" + "\n".join(lines[:3]))
    assert log.comments == {"gyro_fs_dps": "500", "accel_fs_g": "4", "odr_hz": "211.3"}
    lines.insert(3, "# odr_hz=211.4 serial=7")
    log = read(tmp_path, "\n".join(lines) + "\n")
    assert_the_four_readings(log)
    assert log.comments == {"odr_hz": "211.4", "serial": "7"}


def test_nanosecond_stamps_of_a_running_clock_keep_every_nanosecond(tmp_path):
    start = 1_700_000_000_123_456_789
    rows = [f"{start + i * 4_807_693},1,2,3,4,5,6,7" for i in range(5)]
    log = read(tmp_path, HEADER.replace("t_us", "t_ns") + "\n" + "\n".join(rows) + "\n")
    assert set(np.diff(log.samples.t_ns)) == {4_807_693}


def test_a_wrapped_counter_runs_on(tmp_path):
    stamps = (2**32 - 10_000 + 4808 * np.arange(6)) % 2**32
    log = read(tmp_path, HEADER + "\n" + "".join(f"{t},1,2,3,4,5,6,7\n" for t in stamps))
    assert set(np.diff(log.samples.t_ns)) == {4_808_000}
    assert any("came round 1x" in note for note in log.notes)


def test_a_repeated_stamp_is_left_out_and_said(tmp_path):
    lines = text_of().splitlines()
    log = read(tmp_path, "\n".join([*lines[:3], lines[2], *lines[3:]]) + "\n")
    assert_the_four_readings(log)
    assert any("1 rows repeat the row before" in note for note in log.notes)


def late(kind, t_us, rng):
    """Stamps of a sensor's samples (N,) us: rounded to 5 or 10 ms, of arrival, or, every 5 s, those of some rows that of their end."""
    if kind == "arrival":
        return np.maximum.accumulate(t_us + rng.exponential(4000, len(t_us)))
    if isinstance(kind, int):
        return np.rint(t_us / kind) * kind
    into = t_us % 5e6
    return np.where((into < kind * 1e6) & (t_us > 1e6), t_us - into + kind * 1e6, t_us)


@pytest.mark.parametrize("lost", [0, 12])
@pytest.mark.parametrize(
    ("kind", "says"), [(5000, "counted along"), (10_000, "counted along"), ("arrival", "counted"), (0.4, "counted"), (0.03, "placed")]
)
def test_rows_that_share_a_stamp_keep_their_readings_and_get_their_times(tmp_path, kind, says, lost):
    """207.06 Hz: none is missing, though the stamps say 200; where some are, none is made up."""
    rng, t_us = np.random.default_rng(1), np.arange(12_000) * 1e6 / 207.06
    kept = np.delete(np.arange(len(t_us)), slice(5000, 5000 + lost))
    stamps = np.rint(late(kind, t_us, rng))[kept].astype(int)
    readings = rng.integers(-3000, 3000, (len(t_us), 6))[kept]
    text = "".join(f"{t},{','.join(map(str, row))},7\n" for t, row in zip(stamps, readings, strict=True))
    if lost and kind in (10_000, "arrival"):
        with pytest.raises(DataError, match=r"share a stamp.*samples are missing, or stamps come too late.* --odr HZ"):
            read(tmp_path, f"{HEADER}\n{text}")
        return
    log = read(tmp_path, f"{HEADER}\n{text}")
    off_us = (log.samples.t_ns - log.samples.t_ns[0]) / 1000 - (t_us - t_us[0])[kept]
    assert any(("placed" if lost else says) in note for note in log.notes)
    assert np.abs(off_us).max() < (0.5 if lost else 0.15) * 1e6 / 207.06  # of stamps of 5 ms that stay: half of these
    if not lost:
        assert 1 / log.samples.period_s == pytest.approx(207.06, rel=1e-5)


@pytest.mark.parametrize("cut", ["1019231,4", "1019231,4,5,6,1,2,3,", "1019231,4,5,6,1,2,3,-", "10"])
def test_a_last_line_that_was_cut_off_is_left_out_and_said(tmp_path, cut):
    log = read(tmp_path, text_of() + cut)
    assert_the_four_readings(log)
    assert len(log.notes) == 1
    assert "line 6" in log.notes[0]
    assert "cut off" in log.notes[0]


def test_a_compressed_log_that_breaks_off_is_used_up_to_there(tmp_path):
    rows = "".join(f"{4808 * i},{i % 7},2,3,4,5,-8197,{i % 11}\n" for i in range(20_000))
    data = gzip.compress((HEADER + "\n" + rows).encode())
    path = tmp_path / "log.csv.gz"
    path.write_bytes(data[: len(data) // 2])
    log = read_log(path, SENSOR)
    assert 5_000 < len(log.samples) < 15_000
    assert set(np.diff(log.samples.t_ns)) == {4_808_000}
    assert any("breaks off" in note for note in log.notes)


# Folders


def test_zeros_that_a_lost_power_left_at_the_end_are_left_out(tmp_path):
    rows = "".join(f"{4808 * i},1,2,3,4,5,6,7\n" for i in range(200))
    log = read(tmp_path, (HEADER + "\n" + rows).encode() + bytes(300))
    assert len(log.samples) == 200
    assert "cut off" in log.notes[0]
