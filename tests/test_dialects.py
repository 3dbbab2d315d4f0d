"""Logs of other programs, written here from their documented headers, give the samples that our own format gives."""

import gzip

import numpy as np
import pytest
from conftest import DEG, write_session
from dialect_logs import ACCEL, GYRO, SAMPLES, T_US, TEMP, betaflight, inertial, make, rows, same, triads

from session.io.errors import FormatError
from session.io.units import G, parse_unit
from session.replay import convert
from tinygc import CalibrationError, read_session


def test_own_log_is_copied_byte_for_byte(tmp_path):
    folder = write_session(tmp_path / "own", SAMPLES)
    own = (folder / "log0001.csv").read_bytes()
    made = make(tmp_path, own)
    assert made.log.read_bytes() == own
    same(made)
    packed = make(tmp_path, gzip.compress(own), name="LOG.CSV.gz".lower(), out="packed")
    assert packed.log.name == "log0001.csv.gz"
    # Nothing is ordered that is not needed, and no value is suggested.
    assert [step.split()[:-1][-1] for step in convert._next(made.folder, ())[:2]] == ["check", "fit"]
    assert convert._next(made.folder, ())[2].startswith("optional: site.latitude_deg in")
    assert "latitude_deg =" not in (made.folder / "session.toml").read_text()
    same(packed)


def test_own_log_says_its_full_scales_in_a_comment(tmp_path):
    folder = write_session(tmp_path / "own", SAMPLES)
    text = "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=104.2 serial=7\n" + (folder / "log0001.csv").read_text()
    made = make(tmp_path, text, gyro_fs_dps=None, accel_fs_g=None)
    sensor = same(made).config.sensor
    assert (sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.odr_hz, sensor.serial) == (500, 4, 104.2, "7")


def test_own_log_behind_boot_chatter(tmp_path):
    folder = write_session(tmp_path / "own", SAMPLES)
    made = make(tmp_path, "rst:0x1 (POWERON)\nversion,1.3\n\n" + (folder / "log0001.csv").read_text())
    same(made, temp=True)
    assert "t_us,gx,gy,gz,ax,ay,az,temp" in made.log.read_text()  # registers stay registers


# Two files


def hsdatalog(shift_us=0, every=1):
    time = [f"{t / 1e6:14.6f}" for t in T_US]
    gyro = "Time,G_x [mdps],G_y [mdps],G_z [mdps]\n" + rows(time, *GYRO["mdps"].T)
    time = [f"{(t + shift_us) / 1e6:14.6f}" for t in T_US][::every]
    return gyro, "Time,A_x [g],A_y [g],A_z [g]\n" + rows(time, *ACCEL["g"][::every].T)


def test_hsdatalog_joins_two_files_on_time(tmp_path):
    made = make(tmp_path, *hsdatalog())
    assert made.dialects == ("ST HSDatalog",)
    same(made)
    assert not any("between" in note for note in made.notes)
    same(make(tmp_path, *reversed(hsdatalog()), out="reversed"))


def test_files_of_different_clocks_are_read_between_samples(tmp_path):
    """A straight line between samples is a value of the straight line; ends without neighbours are left out."""
    time = lambda t: [f"{x / 1e6:.6f}" for x in t]  # noqa: E731
    gyro_t, accel_t = np.arange(0, 10_000_000, 9_600), np.arange(1_000, 9_000_000, 4_800)
    ramp = accel_t / 1e6
    gyro = "Time,G_x [mdps],G_y [mdps],G_z [mdps]\n" + rows(time(gyro_t), *np.ones((3, len(gyro_t))))
    accel = "Time,A_x [g],A_y [g],A_z [g]\n" + rows(time(accel_t), ramp * 0.1, ramp * 0 - 0.5, ramp * 0)
    made = make(tmp_path, gyro, accel)
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_allclose(samples.accel[:, 0] / G, samples.t_ns * 1e-9 * 0.1, atol=1e-8)
    assert samples.t_ns[0] == 9_600_000
    assert samples.t_ns[-1] <= accel_t[-1] * 1000
    assert any("read between" in note and "left out" in note for note in made.notes)


def test_ximu3_temperature_is_a_file_of_its_own(tmp_path):
    temperature = "Timestamp (us),Temperature (degC)\n" + rows(T_US[::50], TEMP[::50])
    made = make(tmp_path, inertial(), temperature)
    found = same(made).logs[0].samples.temp_c
    np.testing.assert_allclose(found[::50], TEMP[::50], atol=1e-8)


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        ((hsdatalog()[0],), ("no accelerometer", "give its file")),
        ((hsdatalog()[1],), ("no gyroscope",)),
        ((hsdatalog()[0], inertial()), ("both hold a gyroscope",)),
        ((hsdatalog()[0], hsdatalog(shift_us=3600 * 10**6)[1]), ("share no time",)),
    ],
)
def test_files_that_do_not_belong_together(texts, words, tmp_path):
    with pytest.raises(CalibrationError) as caught:
        make(tmp_path, *texts)
    assert all(word in str(caught.value) for word in words), caught.value
    assert not (tmp_path / "session").exists()


# Anything else, through --columns

ODD = "millis;wy;wx;wz;up;fwd;right;celsius\n"
ODD_COLUMNS = "t_ms=millis,gx_dps=wx,gy_dps=wy,gz_dps=wz,ax_mps2=fwd,ay_mps2=right,az_mps2=-up,temp_c=celsius"


def odd(delimiter=";", comma=False):
    gx, gy, gz, ax, ay, az = triads("dps", "mps2")
    text = rows([f"{t / 1000:.3f}" for t in T_US], gy, gx, gz, -az, ax, ay, TEMP, delimiter=delimiter)
    return ODD.replace(";", delimiter) + (text.replace(".", ",") if comma else text)


@pytest.mark.parametrize(("delimiter", "comma"), [(";", False), (";", True), ("\t", False), (",", False)])
def test_columns_name_what_no_table_knows(delimiter, comma, tmp_path):
    same(make(tmp_path, odd(delimiter, comma), columns=ODD_COLUMNS), temp=True)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_may_begin_after_many_whole_numbers(delimiter, tmp_path):
    """A board that reads zero until its filters have settled."""
    settling = "".join(delimiter.join([str(-12_000 + 1000 * i), "0", "0", "0", "0", "0", "1"]) + "\n" for i in range(12))
    text = delimiter.join("tabcdef") + "\n" + settling + rows(T_US, *triads("dps", "g"), delimiter=delimiter).replace(".", ",")
    made = make(tmp_path, text, columns="t_us=t,gx_dps=a,gy_dps=b,gz_dps=c,ax_g=d,ay_g=e,az_g=f")
    samples = read_session(made.folder).logs[0].samples
    assert not samples.gyro[:12].any()
    np.testing.assert_allclose(samples.gyro[12:], SAMPLES.gyro, atol=1e-8 * DEG)
    np.testing.assert_allclose(samples.accel[12:], SAMPLES.accel, atol=1e-8 * G)


def test_a_comma_among_points_is_no_decimal_comma(tmp_path):
    lines = odd().split("\n")
    cells = lines[40].split(";")
    lines[40] = ";".join([*cells[:2], "1,234", *cells[3:]])
    with pytest.raises(FormatError, match=r"line 41.*'1,234'"):
        make(tmp_path, "\n".join(lines), columns=ODD_COLUMNS)


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_own_log_from_a_spreadsheet(delimiter, tmp_path):
    own = (write_session(tmp_path / "own", SAMPLES) / "log0001.csv").read_text()
    same(make(tmp_path, own.replace(",", delimiter)))


def test_own_header_with_semicolons_that_is_not_whole_says_what_it_lacks(tmp_path):
    with pytest.raises(FormatError, match="is 'GXX' meant as 'gx'"):
        make(tmp_path, "t_us;GXX;gy;gz;ax;ay;az;temp\n1;2;3;4;5;6;7;8\n")
    with pytest.raises(FormatError, match="does not say the unit of the gyroscope and the unit of the accelerometer"):
        make(tmp_path, "t_us;GX;gy;gz;ax;ay;az;temp\n1;2;3;4;5;6;7;8\n2;2;3;4;5;6;7;8\n")


def test_columns_by_number_without_a_header(tmp_path):
    text = "boot ok\n" + rows(T_US // 25, *triads("dps", "g"))
    counted = "t_25us=1,gx_dps=2,gy_dps=3,gz_dps=4,ax_g=5,ay_g=6,az_g=7"
    made = make(tmp_path, text, columns=counted)
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_array_equal(samples.t_ns, T_US // 25 * 25_000)
    np.testing.assert_allclose(samples.gyro, SAMPLES.gyro, atol=1e-10)


def test_registers_through_columns_stay_registers(tmp_path):
    folder = write_session(tmp_path / "own", SAMPLES)
    body = (folder / "log0001.csv").read_text().split("\n", 1)[1]
    text, columns = "time,a,b,c,d,e,f,g\n" + body, "t_us=time,gx=a,gy=b,gz=c,ax=d,ay=e,az=f,temp=g"
    with pytest.raises(FormatError, match="does not say whose registers it holds; give --sensor NAME"):
        make(tmp_path, text, columns=columns)
    made = make(tmp_path, text, columns=columns, sensor="asm330lhh")
    same(made, temp=True)
    assert made.log.read_text().split("\n")[1].split(",")[1:] == body.split("\n")[0].split(",")[1:]


def test_no_stamps_at_all_asks_for_the_rate(tmp_path):
    text = "wx,wy,wz,ax,ay,az\n" + rows(*triads("dps", "g"))
    columns = "gx_dps=wx,gy_dps=wy,gz_dps=wz,ax_g=ax,ay_g=ay,az_g=az"
    for unit in (None, "us"):  # a unit of stamps that are not there stamps nothing
        with pytest.raises(FormatError, match="--odr"):
            make(tmp_path, text, columns=columns, time_unit=unit)
    samples = read_session(make(tmp_path, text, columns=columns, odr_hz=104.0).folder).logs[0].samples
    assert np.abs(samples.t_ns - np.arange(len(samples)) * 1e9 / 104).max() <= 500


def test_axes_are_turned_as_asked(tmp_path):
    made = make(tmp_path, inertial(), gyro_axes="y,-x,z", accel_axes="-x,-y,-z")
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_allclose(samples.gyro, SAMPLES.gyro[:, [1, 0, 2]] * [1, -1, 1], atol=1e-10)
    np.testing.assert_allclose(samples.accel, -SAMPLES.accel, atol=1e-7)


def test_the_first_look_speaks_where_axes_are_wrong(tmp_path):
    """No file tells its axes: the check against gravity does."""
    made = make(tmp_path, inertial(), gyro_axes="y,x,z")
    (axes,) = [finding for finding in made.findings if finding.what == "axes"]
    assert axes.level == "error"
    assert "exchanged" in axes.says
    assert len(made.next) == 1  # look first; a fit would refuse


# What is asked


@pytest.mark.parametrize(
    ("text", "answers", "options"),
    [
        (betaflight(""), {}, ("--gyro-unit",)),
        (betaflight(accel=""), {}, ("--accel-unit",)),
        (betaflight("", ""), {}, ("--gyro-unit", "--accel-unit")),
        (odd(), {}, ("--columns", "millis")),
        (odd(), {"columns": ODD_COLUMNS.replace("t_ms", "t")}, ("--time-unit",)),
        (odd(), {"columns": ODD_COLUMNS.replace("gz_dps=wz,", "")}, ("gz missing",)),
        (odd(), {"columns": ODD_COLUMNS.replace("wz", "wzz")}, ("wzz",)),
        (odd(), {"columns": ODD_COLUMNS.replace("dps", "rph")}, ("rph", "--gyro-unit")),
        (odd(), {"columns": "t_ms"}, ("--columns",)),
        (inertial(), {"gyro_axes": "x,x,z"}, ("--gyro-axes",)),
        (inertial().replace("deg/s", "rph"), {}, ("rph", "--gyro-unit")),
        (inertial().replace("Y (deg/s)", "Y (mdps)"), {}, ("different units",)),
    ],
)
def test_what_no_file_tells_is_asked_by_option(text, answers, options, tmp_path):
    with pytest.raises(FormatError) as caught:
        make(tmp_path, text, **answers)
    assert all(option in str(caught.value) for option in options), caught.value
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["LOG.CSV"]  # nothing is left behind


def test_answers_settle_it(tmp_path):
    same(make(tmp_path, betaflight("", "m/s/s"), gyro_unit="dps"))
    scaled = betaflight("", "m/s/s")
    made = make(tmp_path, scaled, gyro_unit="0.5dps", out="half")
    np.testing.assert_allclose(read_session(made.folder).logs[0].samples.gyro, SAMPLES.gyro / 2, atol=1e-10)


@pytest.mark.parametrize(
    ("kind", "text", "si"),
    [
        ("time", "25us", 25_000),
        ("time", "0.5 ms", 500_000),
        ("gyro", "deg/s", DEG),
        ("gyro", "rad s^-1", 1.0),
        ("gyro", "0.061 dps", 0.061 * DEG),
        ("accel", "g/2048", G / 2048),
        ("accel", "m/s/s", 1.0),
        ("accel", "m/s2", 1.0),
        ("gyro", "lsb", None),
        ("gyro", "rpm", 6 * DEG),
        ("gyro", "º/s", DEG),
        ("gyro", "ø/s", DEG),
        ("gyro", "Grad/s", DEG),
        ("gyro", "rad·s⁻¹", 1.0),
        ("accel", "m·s⁻²", 1.0),
        ("accel", "m/s**2", 1.0),
    ],
)
def test_units(kind, text, si):
    assert parse_unit(kind, text).si == (None if si is None else pytest.approx(si))


@pytest.mark.parametrize(
    ("kind", "text"), [("time", "lsb"), ("time", "fortnight"), ("gyro", "g"), ("accel", "0g"), ("gyro", "dps/0"), ("time", "0.0001ns")]
)
def test_no_units(kind, text):
    assert parse_unit(kind, text) is None
