"""Logs and folders: every header that docs/formats.md allows gives the same physics, and every malformed file says where."""

import gzip
import re

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, write_session

from session.common.errors import CalibrationError, DataError, FormatError
from session.log.config import Sensor
from session.log.folder import read_session
from session.log.logfile import read_log

SENSOR = Sensor("ASM330LHH", "42", 208.0, 500.0, 4.0)
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"
G = 9.80665

#: six readings: rates in dps, specific force in g, as exact multiples of the registers' steps
GYRO_LSB = np.array([[100, -200, 300], [101, -201, 301], [-32768, 32767, 0], [4, 5, 6]])
ACCEL_LSB = np.array([[-10, 20, -8197], [-11, 21, -8198], [0, 0, -8197], [1, 2, 3]])
TEMP_LSB = np.array([0, 256, -128, 64])
T_NS = np.array([1_000_000_000, 1_004_808_000, 1_009_615_000, 1_014_423_000])

GYRO_DPS = GYRO_LSB * 0.0175
ACCEL_G = ACCEL_LSB * 0.122e-3
TIMES = {"t_us": T_NS // 1000, "t_ns": T_NS, "t_s": T_NS * 1e-9}
GYROS = {"": GYRO_LSB, "_dps": GYRO_DPS, "_rps": np.deg2rad(GYRO_DPS)}
ACCELS = {"": ACCEL_LSB, "_g": ACCEL_G, "_mps2": ACCEL_G * G}
TEMPS = {"temp": TEMP_LSB, "temp_c": 25 + TEMP_LSB / 256, None: None}


def text_of(time="t_us", gyro="", accel="", temp="temp", end="\n", extra=""):
    """A log of the four readings in the given units."""
    names = [time, *(f"g{axis}{gyro}" for axis in "xyz"), *(f"a{axis}{accel}" for axis in "xyz")] + ([temp] if temp else [])
    columns = [TIMES[time], *GYROS[gyro].T, *ACCELS[accel].T] + ([TEMPS[temp]] if temp else [])
    lines = [",".join(names) + extra]
    lines += [",".join(repr(value.item()) for value in row) + extra for row in zip(*columns, strict=True)]
    return end.join(lines) + end


def read(tmp_path, text, name="log0001.csv"):
    path = tmp_path / name
    data = text if isinstance(text, bytes) else text.encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return read_log(path, SENSOR)


def assert_the_four_readings(log, temp=True):
    np.testing.assert_array_equal(log.samples.t_ns, T_NS)
    np.testing.assert_allclose(log.samples.gyro, np.deg2rad(GYRO_DPS), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(log.samples.accel, ACCEL_G * G, rtol=1e-12, atol=1e-15)
    if temp:
        np.testing.assert_allclose(log.samples.temp_c, [25, 26, 24.5, 25.25])
    else:
        assert log.samples.temp_c is None


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


def test_registers_of_a_full_scale_that_the_sensor_has_not_are_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text_of())
    with pytest.raises(FormatError, match=r"gyro_fs_dps = 245 .*125, 250, 500"):
        read_log(path, Sensor("ASM330LHH", "", 208.0, 245.0, 4.0))


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


@pytest.mark.parametrize(
    ("cells", "names"),
    [
        ("0,1e308,0,0,0,1,20", "gy_dps is 1e+308"),
        ("-100001,0,0,0,0,1,20", "gx_dps is -100001, beyond any sensor"),
        ("0,0,0,0,0,10001,20", "az_g"),
        ("0,0,0,0,0,1,1e300", "temp_c"),
    ],
)
def test_what_no_sensor_measures_is_refused(tmp_path, cells, names):
    header = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"
    rows = [f"{i / 100},-99999,0,0,0,0,-9999,20" for i in range(5)]
    read(tmp_path, "\n".join([header, *rows]) + "\n")
    with pytest.raises(FormatError, match=f"line 4: {re.escape(names)}"):
        read(tmp_path, "\n".join([header, *rows[:2], f"0.02,{cells}", *rows[3:]]) + "\n")


@pytest.mark.parametrize("back_us", [2**31 + 1, 2**32 - 5000])
def test_a_time_beyond_the_counter_that_goes_back_is_refused(tmp_path, back_us):
    stamps = 2**40 + 4808 * np.arange(6) - back_us * (np.arange(6) > 2)
    with pytest.raises(FormatError, match="goes backward"):
        read(tmp_path, HEADER + "\n" + "".join(f"{t},1,2,3,4,5,6,7\n" for t in stamps))


def test_a_wrapped_counter_runs_on(tmp_path):
    stamps = (2**32 - 10_000 + 4808 * np.arange(6)) % 2**32
    log = read(tmp_path, HEADER + "\n" + "".join(f"{t},1,2,3,4,5,6,7\n" for t in stamps))
    assert set(np.diff(log.samples.t_ns)) == {4_808_000}
    assert any("wrapped 1x" in note for note in log.notes)


def test_a_repeated_stamp_is_left_out_and_said(tmp_path):
    lines = text_of().splitlines()
    log = read(tmp_path, "\n".join([*lines[:3], lines[2], *lines[3:]]) + "\n")
    assert_the_four_readings(log)
    assert any("1 rows repeat the stamp" in note for note in log.notes)


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


def row(text, number=3):
    """The four readings with another line in the place of the second one (line 3 of the file)."""
    lines = text_of().splitlines()
    lines[number - 1] = text
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("\n\n", "empty"),
        ("# only a comment\n", ""),
        (HEADER, "no samples"),
        (HEADER + "\n", "no samples"),
        ("\n".join(text_of().splitlines()[1:]), "no header"),
        ("some text\n1,2,3\n", "no header"),
        (text_of().replace("gz", "gq"), "gyroscope"),
        (text_of().replace("t_us", "time"), "no time column"),
        (text_of().replace("t_us", "t_s,t_us"), "time"),
        (text_of(gyro="_dps").replace("gx_dps", "gx_rps"), "gyroscope"),
        (text_of(gyro="_dps").replace("_dps", "_mdps"), "unknown unit in 'gx_mdps'"),
        (text_of(accel="_g").replace("_g", "_mg"), "unknown unit in 'ax_mg'"),
        (text_of().replace("temp", "temp,temp_c"), "two temperature columns"),
        (row("1004808,1,2,x,4,5,6,7"), "line 3: gz is 'x'"),
        (row("1004808,1,2,3,4,5"), "line 3: 6 columns, expected 8"),
        (row("1004808,1,2,3.5,4,5,6,7"), "line 3: gz is '3.5', expected a whole number"),
        (row("1004808,1,2,,4,5,6,7"), "line 3: gz is ''"),
        (row("1004808,1,2,32768,4,5,6,7"), "line 3: gz is 32768, no 16-bit register"),
        (row("1004808,1,2,3,-32769,5,6,7"), "line 3: ax is -32769, no 16-bit register"),
        (row("990000,1,2,3,4,5,6,7"), "line 3: t_us goes backward by 0.01 s"),
        (row("Boot v1.2 0x6B ok", 4), "line 4: 1 columns"),
        (row(f"{2**60},1,2,3,4,5,6,7"), f"line 3: t_us is {2**60}, which is no time of this era"),
        (row(f"-{2**60},1,2,3,4,5,6,7"), "which is no time of this era"),
        (row(f"{10**30},1,2,3,4,5,6,7"), "line 3: t_us is '10000000000000000000'…, a number too long"),
        (row("1004808,1,2," + "9" * 5000 + ",4,5,6,7"), "line 3: gz is '99999999999999999999'…, a number too long"),
        (row("1004808,1,1_000,3,4,5,6,7"), "line 3: gy is '1_000', expected a whole number"),
        (row("1004808,1,2,\u0663,4,5,6,7"), "line 3: gz is"),
        (row("1004808,1,2,3,4\x0c5,5,6,7"), "line 3: ax is '4\\x0c5'"),
        (text_of().replace(",", ";"), "line 1: separated by semicolons; expected commas"),
        (text_of().replace(",", "\t"), "line 1: separated by tabs; expected commas"),
        (text_of().upper(), "(is 'T_US' meant as 't_us'?)"),
        (text_of().replace("gx,gy,gz", "GX,GY,GZ"), "(is 'GX' meant as 'gx'?)"),
        (text_of(gyro="_dps").replace("gy_dps", "gy_DPS"), "unknown unit in 'gy_DPS'; known are gx, gx_dps"),
        (text_of().encode("utf-16"), "not a text log (UTF-16 or binary)"),
        (b"\x7fELF\0\0\0" * 40, "not a text log (UTF-16 or binary)"),
        (text_of("t_s").replace(repr(TIMES["t_s"][1].item()), "1e300"), "line 3: t_s is 1e+300, which is no time of this era"),
        (text_of(gyro="_dps", accel="_g", temp=None).replace("1004808", "1e300"), "line 3: t_us is '1e300', expected a whole number"),
        (text_of(gyro="_dps").replace("1004808", "1_004_808"), "line 3: t_us is '1_004_808', expected a whole number"),
        (text_of("t_s").replace(repr(TIMES["t_s"][1].item()), "1_0.04808"), "line 3: t_s is '1_0.04808', expected a number"),
    ],
)
def test_a_malformed_log_says_what_and_where(tmp_path, text, said):
    with pytest.raises(CalibrationError) as error:
        read(tmp_path, text)
    assert said in str(error.value)
    assert "log0001.csv" in str(error.value)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("column", ["gy_dps", "az_g", "temp_c", "t_s"])
def test_a_reading_that_is_no_number_is_refused(tmp_path, value, column):
    lines = text_of("t_s", "_dps", "_g", "temp_c").splitlines()
    cells = lines[3].split(",")
    cells[lines[0].split(",").index(column)] = value
    lines[3] = ",".join(cells)
    with pytest.raises(FormatError, match=f"line 4: {column} is"):
        read(tmp_path, "\n".join(lines) + "\n")


def test_line_numbers_count_comments_and_blank_lines(tmp_path):
    text = "# one\n\n" + HEADER + "\n1,1,2,3,4,5,6,7\n# five\n2,1,2,3,4,5,6,7\n3,oops,2,3,4,5,6,7\n4,1,2,3,4,5,6,7\n"
    with pytest.raises(FormatError, match="line 7: gx is 'oops'"):
        read(tmp_path, text)


def test_a_single_sample_is_no_recording(tmp_path):
    with pytest.raises(DataError, match="single sample"):
        read(tmp_path, HEADER + "\n1,1,2,3,4,5,6,7\n")


def test_text_that_calls_itself_gzip_is_refused(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_text(text_of())
    with pytest.raises(FormatError, match="not a gzip file"):
        read_log(path, SENSOR)


def test_bytes_that_are_no_text_are_refused(tmp_path):
    with pytest.raises(CalibrationError):
        read(tmp_path, bytes(range(256)) * 40)


# Folders


@pytest.fixture(scope="module")
def samples():
    return Table().rest(1).turn(90, (1, 0, 0), 1).rest(1).samples()


def test_a_folder_gives_its_logs_and_closure_runs_in_name_order(tmp_path, samples):
    for name in ("log0002.csv", "log0001.csv", "closure0001.csv", "notes.csv"):
        write_session(tmp_path, samples, name)
    (tmp_path / "log0003.csv.gz").write_bytes(gzip.compress((tmp_path / "log0001.csv").read_bytes()))
    session = read_session(tmp_path)
    assert [log.path.name for log in session.logs] == ["log0001.csv", "log0002.csv", "log0003.csv.gz"]
    assert [log.path.name for log in session.closures] == ["closure0001.csv"]
    assert session.attitudes is None
    for log in session.logs:
        np.testing.assert_array_equal(log.samples.t_ns, samples.t_ns)
        np.testing.assert_allclose(log.samples.gyro, samples.gyro, atol=1e-12)
        np.testing.assert_allclose(log.samples.accel, samples.accel, atol=1e-12)


def test_the_same_log_plain_and_compressed_would_count_twice(tmp_path, samples):
    write_session(tmp_path, samples)
    (tmp_path / "log0001.csv.gz").write_bytes(gzip.compress((tmp_path / "log0001.csv").read_bytes()))
    with pytest.raises(FormatError, match=r"log0001\.csv and log0001\.csv\.gz"):
        read_session(tmp_path)


def test_missing_folders_logs_and_settings_are_told_apart(tmp_path, samples):
    with pytest.raises(FormatError, match="not found"):
        read_session(tmp_path / "nowhere")
    with pytest.raises(FormatError, match=r"session\.toml"):
        read_session(tmp_path)
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    with pytest.raises(FormatError, match="no log"):
        read_session(tmp_path)
    with pytest.raises(FormatError, match="that is a file"):
        read_session(tmp_path / "session.toml")
    (tmp_path / "log.csv").mkdir()
    with pytest.raises(FormatError, match="cannot be read"):
        read_session(tmp_path)


def test_dial_readings_belong_to_the_stills_by_number(tmp_path, samples):
    write_session(tmp_path, samples, toml=SESSION_TOML + '[protocol]\nreference = "table"\n')
    with pytest.raises(FormatError, match=r"attitudes\.csv: not found"):
        read_session(tmp_path)
    (tmp_path / "attitudes.csv").write_text("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n2,90,-45,180\n")
    attitudes = read_session(tmp_path).attitudes
    np.testing.assert_allclose(np.rad2deg(attitudes), [[0, 0, 0], [np.nan] * 3, [90, -45, 180]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("still,roll,pitch,yaw\n0,0,0,0\n", "header must be"),
        ("still,roll_deg,pitch_deg,yaw_deg\n", "no dial readings"),
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,0\n", "line 2"),
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n0,1,1,1\n", "line 3"),
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,nan,0\n", "line 2"),
        ("still,roll_deg,pitch_deg,yaw_deg\n-1,0,0,0\n", "line 2"),
        ("still,roll_deg,pitch_deg,yaw_deg\nfirst,0,0,0\n", "line 2"),
        ("still,roll_deg,pitch_deg,yaw_deg\n# said\n\nfirst,0,0,0\n", "line 4"),
        ("still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n99999999999999,0,0,0\n", "line 3: still '99999999999999' is beyond 100000"),
        ('still,roll_deg,pitch_deg,yaw_deg\n0,"' + "1" * 200_000 + '",0,0\n', "line 2"),
    ],
)
def test_malformed_dial_readings_say_where(tmp_path, samples, text, said):
    write_session(tmp_path, samples)
    (tmp_path / "attitudes.csv").write_text(text)
    with pytest.raises(FormatError, match=said):
        read_session(tmp_path)


def test_dial_readings_that_cannot_be_read_as_text_are_refused(tmp_path, samples):
    write_session(tmp_path, samples)
    path = tmp_path / "attitudes.csv"
    path.write_bytes("still,roll_deg,pitch_deg,yaw_deg\n0,1°,0,0\n".encode("latin-1"))
    with pytest.raises(FormatError, match="not UTF-8"):
        read_session(tmp_path)
    path.unlink()
    path.mkdir()
    with pytest.raises(FormatError, match="cannot be read"):
        read_session(tmp_path)


def test_zeros_that_a_lost_power_left_at_the_end_are_left_out(tmp_path):
    rows = "".join(f"{4808 * i},1,2,3,4,5,6,7\n" for i in range(200))
    log = read(tmp_path, (HEADER + "\n" + rows).encode() + bytes(300))
    assert len(log.samples) == 200
    assert "cut off" in log.notes[0]
