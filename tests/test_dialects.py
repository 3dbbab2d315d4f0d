"""Logs of other programs, written here from their documented headers, give the samples that our own format gives."""

import gzip

import numpy as np
import pytest
from conftest import DEG, Table, write_session

from session.dialects.convert import convert
from session.dialects.layout import Answers
from session.dialects.stamps import exact_ns
from session.dialects.units import parse_unit
from session.errors import CalibrationError, DataError, FormatError, StorageError
from session.folder import read_session
from session.units import G

FULL_SCALES = {"gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
SAMPLES = Table().tumble(2, rest_s=2.0).samples(odr_hz=104)
T_US = SAMPLES.t_ns // 1000
GYRO = {"dps": SAMPLES.gyro / DEG, "mdps": SAMPLES.gyro / DEG * 1e3, "rps": SAMPLES.gyro}
ACCEL = {"g": SAMPLES.accel / G, "mg": SAMPLES.accel / G * 1e3, "mps2": SAMPLES.accel}
TEMP = SAMPLES.temp_c
EPOCH_NS = 1_403_636_579_763_555_584


def rows(*columns, delimiter=",", end="\n"):
    """Text of rows; a column is a list of texts, or numbers written with 12 decimals."""
    texts = [c if isinstance(c[0], str) else [str(v) if isinstance(v, (int, np.integer)) else f"{v:.12f}" for v in c] for c in columns]
    return end.join(delimiter.join(row) for row in zip(*texts, strict=True)) + end


def triads(gyro, accel):
    return [*GYRO[gyro].T, *ACCEL[accel].T]


def clock(us, decimals=6):
    """hh:mm:ss.ss, a little before midnight at first."""
    seconds = (86_390 + us / 1e6) % 86_400
    return [f"{int(s // 3600):02d}:{int(s // 60 % 60):02d}:{s % 60:0{3 + decimals}.{decimals}f}" for s in seconds]


def inertial():
    gyro, accel = (
        ", ".join(f"{what} {axis} ({unit})" for axis in "XYZ") for what, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g"))
    )
    return f"Timestamp (us),{gyro},{accel}\n".replace(", ", ",") + rows(T_US, *triads("dps", "g"))


def px4():
    head = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
    head += "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt"
    some = ["4000"] * len(T_US)
    return head + "\n" + rows(T_US + 10**9, *GYRO["rps"].T, some, some, *ACCEL["mps2"].T, some)


def betaflight(gyro="deg/s", accel="g"):
    head = "loopIteration, time (us), axisP[0], axisP[1], axisP[2], "
    head += ", ".join(f"gyroADC[{i}] ({gyro})" if gyro else f"gyroADC[{i}]" for i in range(3)) + ", "
    head += ", ".join(f"accSmooth[{i}] ({accel})" if accel else f"accSmooth[{i}]" for i in range(3)) + ", motor[0]"
    none = ["0"] * len(T_US)
    return (
        head
        + "\n"
        + rows(range(len(T_US)), T_US, none, none, none, *triads("dps", {"": "g", "g": "g", "m/s/s": "mps2"}[accel]), none, delimiter=", ")
    )


EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)
ARTEMIS = "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,\n"
DATALOG = "Timestamp[ms] A_X [mg] A_Y [mg] A_Z [mg] G_X [mdps] G_Y [mdps] G_Z [mdps]\n"
NONE = ["0.00"] * len(T_US)
DIALECTS = {
    "ST DataLog": lambda: (
        "LSM6DSO ready\n" + DATALOG + rows([f"{t / 1000:.3f}" for t in T_US], *ACCEL["mg"].T, *GYRO["mdps"].T, delimiter=" ")
    ),
    "x-IMU3": inertial,
    "EuRoC": lambda: EUROC + rows(EPOCH_NS + SAMPLES.t_ns, *triads("rps", "mps2")),
    "OpenLog Artemis": lambda: (
        ARTEMIS
        + rows(["12/31/2023"] * len(T_US), clock(T_US), *ACCEL["mg"].T, *GYRO["dps"].T, NONE, NONE, NONE, TEMP, NONE, [""] * len(T_US))
    ),
    "PX4 sensor_combined": px4,
    "Betaflight blackbox": betaflight,
}


def make(tmp_path, *texts, name="LOG.CSV", out="session", **answers):
    paths = []
    for number, text in enumerate(texts):
        paths.append(tmp_path / (name if number == 0 else f"{number}{name}"))
        paths[-1].write_bytes(text if isinstance(text, bytes) else text.encode())
    return convert(paths, tmp_path / out, Answers(**{**FULL_SCALES, **answers}))


def same(made, gyro_atol=1e-8 * DEG, accel_atol=1e-8 * G, temp=False, exact_time=True):
    """The session that was made holds the samples of our own format."""
    session = read_session(made.folder)
    (log,) = session.logs
    assert not any(note for note in log.notes), log.notes
    assert len(log.samples) == len(SAMPLES)
    steps = log.samples.t_ns - log.samples.t_ns[0]
    if exact_time:
        np.testing.assert_array_equal(steps, SAMPLES.t_ns)
    np.testing.assert_allclose(log.samples.gyro, SAMPLES.gyro, rtol=1e-12, atol=gyro_atol)
    np.testing.assert_allclose(log.samples.accel, SAMPLES.accel, rtol=1e-12, atol=accel_atol)
    if temp:
        np.testing.assert_allclose(log.samples.temp_c, TEMP, atol=1e-8)
    return session


@pytest.mark.parametrize("name", DIALECTS)
def test_every_dialect_gives_the_samples_of_our_own_format(name, tmp_path):
    made = make(tmp_path, DIALECTS[name]())
    assert made.dialects == (name,)
    session = same(made, temp=name == "OpenLog Artemis")
    assert session.config.sensor.odr_hz == pytest.approx(104, rel=2e-3)
    assert any("calibrate.py check" in step for step in made.next)


def test_own_log_is_copied_byte_for_byte(tmp_path):
    folder = write_session(tmp_path / "own", SAMPLES)
    own = (folder / "log0001.csv").read_bytes()
    made = make(tmp_path, own)
    assert made.log.read_bytes() == own
    same(made)
    packed = make(tmp_path, gzip.compress(own), name="LOG.CSV.gz".lower(), out="packed")
    assert packed.log.name == "log0001.csv.gz"
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


def test_no_value_is_invented_in_a_gap_of_the_other_file(tmp_path):
    gyro, accel = hsdatalog()
    lines = accel.split("\n")
    made = make(tmp_path, gyro, "\n".join(lines[:300] + lines[340:]))
    assert len(read_session(made.folder).logs[0].samples) == len(SAMPLES) - 40


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
    with pytest.raises(FormatError, match="is 'GX' meant as 'gx'"):
        make(tmp_path, "t_us;GX;gy;gz;ax;ay;az;temp\n1;2;3;4;5;6;7;8\n")


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
    made = make(tmp_path, "time,a,b,c,d,e,f,g\n" + body, columns="t_us=time,gx=a,gy=b,gz=c,ax=d,ay=e,az=f,temp=g")
    same(made, temp=True)
    assert made.log.read_text().split("\n")[2].split(",")[1:] == body.split("\n")[0].split(",")[1:]


def test_no_stamps_at_all_asks_for_the_rate(tmp_path):
    text = "wx,wy,wz,ax,ay,az\n" + rows(*triads("dps", "g"))
    columns = "gx_dps=wx,gy_dps=wy,gz_dps=wz,ax_g=ax,ay_g=ay,az_g=az"
    with pytest.raises(FormatError, match="--odr"):
        make(tmp_path, text, columns=columns)
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
        (inertial(), {"gyro_fs_dps": None}, ("--gyro-fs",)),
        (inertial(), {"gyro_fs_dps": None, "accel_fs_g": None}, ("--gyro-fs", "--accel-fs")),
        (odd(), {}, ("--columns", "millis")),
        (odd(), {"columns": ODD_COLUMNS.replace("t_ms", "t")}, ("--time-unit",)),
        (odd(), {"columns": ODD_COLUMNS.replace("gz_dps=wz,", "")}, ("gz missing",)),
        (odd(), {"columns": ODD_COLUMNS.replace("wz", "wzz")}, ("wzz",)),
        (odd(), {"columns": ODD_COLUMNS.replace("dps", "rpm")}, ("rpm", "--gyro-unit")),
        (odd(), {"columns": "t_ms"}, ("--columns",)),
        (inertial(), {"gyro_axes": "x,x,z"}, ("--gyro-axes",)),
        (inertial().replace("deg/s", "rpm"), {}, ("rpm", "--gyro-unit")),
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
    ],
)
def test_units(kind, text, si):
    assert parse_unit(kind, text).si == (None if si is None else pytest.approx(si))


@pytest.mark.parametrize(
    ("kind", "text"), [("time", "lsb"), ("time", "fortnight"), ("gyro", "g"), ("accel", "0g"), ("gyro", "dps/0"), ("time", "0.1ns")]
)
def test_no_units(kind, text):
    assert parse_unit(kind, text) is None


# Time


def test_stamps_stay_exact(tmp_path):
    """Nanoseconds of an epoch, seconds of an epoch with nine decimals: a float64 would round both by some 100 ns."""
    ns = EPOCH_NS + np.arange(0, 2 * 10**9, 4_800_001)
    some = np.column_stack([np.zeros((len(ns), 5)), np.full(len(ns), -1.0)]).T
    euroc = make(tmp_path, EUROC + rows(ns, *some))
    seconds = [f"{t // 10**9}.{t % 10**9:09d}" for t in ns.tolist()]
    decimal = make(tmp_path, "Time,G_x [mdps],G_y [mdps],G_z [mdps],A_x [g],A_y [g],A_z [g]\n" + rows(seconds, *some), out="decimal")
    for made in (euroc, decimal):
        np.testing.assert_array_equal(read_session(made.folder).logs[0].samples.t_ns, ns)


def test_duplicate_and_irregular_stamps_are_ordinary(tmp_path):
    lines = inertial().split("\n")
    lines.insert(50, lines[50])
    made = make(tmp_path, "\n".join(lines[:100] + lines[103:]))
    log = read_session(made.folder).logs[0]
    assert len(log.samples) == len(SAMPLES) - 3
    assert any("repeat the stamp" in note for note in log.notes)


def test_coarse_stamps_are_counted_along(tmp_path):
    """A clock of 10 ms under 104 samples a second: the counted times are right to a fraction of the clock's step."""
    text = ARTEMIS + rows(["1/1/2024"] * len(T_US), clock(T_US, 2), *ACCEL["mg"].T, *GYRO["dps"].T, NONE, NONE, NONE, TEMP, NONE)
    made = make(tmp_path, text)
    (note,) = [note for note in made.notes if "share a stamp" in note]
    assert "counted" in note
    t_s = same(made, exact_time=False).logs[0].samples.t_s
    assert np.abs(t_s - SAMPLES.t_s).max() < 2e-3
    assert np.abs(np.diff(t_s) - 1 / 104).max() < 1e-5


def test_coarse_stamps_over_lost_samples_are_refused(tmp_path):
    keep = np.r_[0:300, 360 : len(T_US)]
    columns = [np.array(c)[keep].tolist() for c in (clock(T_US, 2), *map(list, ACCEL["mg"].T), *map(list, GYRO["dps"].T))]
    text = ARTEMIS + rows(["1/1/2024"] * len(keep), *columns, *[["0"] * len(keep)] * 5)
    with pytest.raises(DataError, match="--odr"):
        make(tmp_path, text)
    assert any("counted at 104" in note for note in make(tmp_path, text, odr_hz=104.0).notes)


def test_micros_come_round(tmp_path):
    wrapped = (T_US + 2**32 - 3_000_000) % 2**32
    text = inertial().split("\n", 1)[0] + "\n" + rows(wrapped, *triads("dps", "g"))
    made = make(tmp_path, text)
    assert any("came round 1x" in note for note in made.notes)
    same(made)


@pytest.mark.parametrize(("back_s", "start_ns"), [(3.0, EPOCH_NS), (3.9, EPOCH_NS), (4.0, 0), (3.0, 60 * 10**9)])
def test_nanoseconds_that_step_back_are_no_counter(back_s, start_ns, tmp_path):
    """A 32-bit counter of ns would come round every 4.3 s."""
    t_ns = start_ns + T_US * 1000
    t_ns[len(t_ns) // 2 :] -= round(back_s * 1e9)
    if start_ns == 0:
        t_ns += 10**9
    text = inertial().split("\n", 1)[0].replace("us", "ns") + "\n" + rows(t_ns, *triads("dps", "g"))
    with pytest.raises(FormatError, match="goes backward by"):
        make(tmp_path, text)


def test_a_counter_with_a_sign_comes_round(tmp_path):
    wrapped = (T_US + 2**31 - 3_000_000 + 2**31) % 2**32 - 2**31
    made = make(tmp_path, inertial().split("\n", 1)[0] + "\n" + rows(wrapped, *triads("dps", "g")))
    assert any("came round 1x" in note for note in made.notes)
    same(made)


@pytest.mark.parametrize("lost", [0.01, 0.05])
def test_lost_samples_leave_the_data_rate_as_it_is(lost, tmp_path):
    text = inertial().split("\n")
    kept = np.random.default_rng(1).random(len(text)) >= lost
    kept[:2] = True
    made = make(tmp_path, "\n".join(line for line, keep in zip(text, kept, strict=True) if keep) + "\n")
    assert read_session(made.folder).config.sensor.odr_hz == pytest.approx(104, rel=2e-4)


# Hostile


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: "", ("empty",)),
        (lambda text: "\n\n", ("empty",)),
        (lambda text: text.split("\n")[0] + "\n", ("no samples",)),
        (lambda text: "\0\1\2\3" * 100, ("not a text log",)),
        (lambda text: text.encode("utf-16"), ("not a text log",)),
        (lambda text: "hello\nworld\n", ("no header", "--columns")),
        (lambda text: "a,b,c\n1,2,3\n", ("no header", "'a,b,c'")),
        (lambda text: _line(text, 40, "1,2,3"), ("line 41", "3 columns")),
        (lambda text: _line(text, 40, "384615,x,0,0,0,0,0"), ("line 41", "Gyroscope X", "'x'")),
        (lambda text: _line(text, 40, "384615,,0,0,0,0,0"), ("line 41",)),
        (lambda text: _line(text, 40, "384615,nan,0,0,0,0,0"), ("line 41", "not finite")),
        (lambda text: _line(text, 40, "384615,1e999,0,0,0,0,0"), ("line 41", "not finite")),
        (lambda text: _line(text, 40, "384615,0,1e308,0,0,0,0"), ("LOG.CSV line 41", "Gyroscope Y", "1e+308", "unit")),
        (lambda text: _line(text, 40, "384615,0,0,0,0,0,-1e5"), ("LOG.CSV line 41", "Accelerometer Z", "10000 g")),
        (lambda text: _line(text, 40, "nan,0,0,0,0,0,0"), ("line 41", "Timestamp")),
        (lambda text: _line(text, 40, "9" * 40 + ",0,0,0,0,0,0"), ("line 41", "no era")),
        (lambda text: _line(text, 40, "1_000,0,0,0,0,0,0"), ("line 41",)),
        (lambda text: _line(text, 40, "5,0,0,0,0,0,0"), ("line 41", "backward")),
    ],
)
def test_bad_files_get_one_line(change, words, tmp_path):
    with pytest.raises(CalibrationError) as caught:
        make(tmp_path, change(inertial()))
    assert all(word in str(caught.value) for word in words), caught.value
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["LOG.CSV"]


def _line(text, number, line):
    lines = text.split("\n")
    return "\n".join([*lines[:number], line, *lines[number + 1 :]])


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", ",\n"),
        lambda text: text.rstrip("\n"),
        lambda text: "\n\n" + text.replace("\n", "\n\n"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: "x-IMU3 log,v1\nserial,0123\n\n" + text,
        lambda text: text + text.split("\n")[0] + "\n",
        lambda text: text + "384615,12.5",
        lambda text: '"' + text.split("\n")[0].replace(",", '","') + '"\n' + text.split("\n", 1)[1],
    ],
    ids=[
        "bom",
        "crlf",
        "trailing comma",
        "no last newline",
        "blank lines",
        "spaces",
        "semicolons",
        "tabs",
        "preamble",
        "header again",
        "torn",
        "quoted",
    ],
)
def test_ordinary_disorder_changes_nothing(change, tmp_path):
    same(make(tmp_path, change(inertial())))


def test_a_broken_gzip_gives_what_came_before(tmp_path):
    packed = gzip.compress(inertial().encode())
    made = make(tmp_path, packed[: len(packed) // 2], name="log.csv.gz")
    assert 100 < made.samples < len(SAMPLES)
    assert any("breaks off" in note for note in made.notes)
    with pytest.raises(FormatError, match="gzip"):
        make(tmp_path, b"no gzip", name="log.csv.gz", out="other")


def test_pieces_of_a_file_join_without_a_seam(tmp_path, monkeypatch):
    from session.dialects import lines

    monkeypatch.setattr(lines.Lines.take, "__defaults__", (1000,))
    monkeypatch.setattr(lines, "READ_BYTES", 100)
    for number, text in enumerate((inertial(), DIALECTS["OpenLog Artemis"]())):
        same(make(tmp_path, text, out=f"session{number}"))
    with pytest.raises(FormatError, match="line 401"):
        make(tmp_path, _line(inertial(), 400, "1,2,3"), out="bad")


# The folder


def test_an_existing_folder_is_not_written_over(tmp_path):
    made = make(tmp_path, inertial())
    before = made.log.read_bytes()
    with pytest.raises(FormatError, match="--add"):
        make(tmp_path, inertial())
    assert made.log.read_bytes() == before


def test_a_closure_run_is_added_to_its_session(tmp_path):
    made = make(tmp_path, inertial())
    more = convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add="closure")
    assert more.log.name == "closure0001.csv"
    session = read_session(made.folder)
    assert (len(session.logs), len(session.closures)) == (1, 1)
    assert convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add="log").log.name == "log0002.csv"
    with pytest.raises(FormatError, match="--gyro-fs"):
        convert([tmp_path / "LOG.CSV"], made.folder, Answers(gyro_fs_dps=2000.0), add="log")


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    import session.dialects.convert as module

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "_columns", full)
    with pytest.raises(StorageError, match=r"new/folder/session: No space.*choose another folder"):
        make(tmp_path, inertial(), out="new/folder/session")
    assert [path.name for path in tmp_path.iterdir()] == ["LOG.CSV"]


def test_a_full_disk_under_a_copied_log_is_not_the_logs_fault(tmp_path, monkeypatch):
    import session.dialects.convert as module

    def full(source, target):
        raise OSError(28, "No space left on device", str(source), None, str(target))

    own = (write_session(tmp_path / "own", SAMPLES) / "log0001.csv").read_bytes()
    monkeypatch.setattr(module.shutil, "copyfile", full)
    with pytest.raises(StorageError, match="session: No space") as said:
        make(tmp_path, own)
    assert "LOG.CSV" not in str(said.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["LOG.CSV", "own"]


def test_the_command_line_makes_a_session_that_fits(simulated, tmp_path, capsys):
    """A simulated session, written as a logger would, is replayed, and fits as the session itself."""
    import json

    import calibrate
    from session.logfile import read_log

    folder = simulated()
    sensor = read_session(folder).config.sensor
    samples = read_log(folder / "log0001.csv.gz", sensor).samples
    log = tmp_path / "sensor_combined_0.csv"
    names = ",".join([f"gyro_rad[{i}]" for i in range(3)] + [f"accelerometer_m_s2[{i}]" for i in range(3)])
    log.write_text(f"timestamp,{names}\n" + rows(samples.t_ns // 1000, *samples.gyro.T, *samples.accel.T))
    made, table = tmp_path / "made", tmp_path / "made.json"
    command = ["replay", str(log), "--out", str(made)]
    assert calibrate.main(command) == 2
    assert "--gyro-fs DPS --accel-fs G" in capsys.readouterr().err
    assert calibrate.main([*command, "--gyro-fs", "500", "--accel-fs", "4", "--json", str(table)]) == 0
    assert "next: calibrate.py check" in capsys.readouterr().out
    assert json.loads(table.read_text())["dialects"] == ["PX4 sensor_combined"]
    head, site = (made / "session.toml").read_text().split("# Fill in"), (folder / "session.toml").read_text()
    (made / "session.toml").write_text(head[0] + site[site.index("[accelerometer]") :])
    found = {}
    for where in (folder, made):
        result = tmp_path / "fit.json"
        fit = ["fit", str(where), "--methods", "least_squares", "--folds", "2", "--out", str(tmp_path / "fit"), "--quiet"]
        assert calibrate.main([*fit, "--json", str(result)]) == 0
        found[where] = json.loads(result.read_text())["methods"]["least_squares"]["train"]["tilt_rms_deg"]
    assert found[made] == pytest.approx(found[folder], rel=1e-6)


def test_no_damage_raises_anything_but_one_line(tmp_path):
    """Random damage to every dialect's file: a session, or one line and nothing left behind."""
    rng = np.random.default_rng(0)
    texts = [make_text()[:4000] for make_text in DIALECTS.values()]
    pieces = [
        "nan",
        "1e999",
        "1e999999",
        "-",
        "9" * 30,
        "\n",
        '"',
        "#",
        "0x1F",
        "1_0",
        ":",
        "12:99:aa",
        "[mg]",
        "(deg/s)",
        ",,",
        "%s",
        "\r",
        "\0",
        "é",
    ]
    outcomes = {"made": 0, "refused": 0}
    for trial in range(250):
        text = texts[rng.integers(len(texts))]
        for _ in range(rng.integers(1, 6)):
            at = int(rng.integers(len(text)))
            cut = int(rng.integers(0, 40)) if rng.random() < 0.5 else 0
            text = text[:at] + (pieces[rng.integers(len(pieces))] if rng.random() < 0.8 else "") + text[at + cut :]
        try:
            make(tmp_path, text, out=f"session{trial}", gyro_unit=[None, "lsb"][trial % 2])
            outcomes["made"] += 1
        except CalibrationError as error:
            outcomes["refused"] += len(str(error).splitlines()) == 1
            assert not (tmp_path / f"session{trial}").exists()
    assert min(outcomes.values()) > 10
    assert sum(outcomes.values()) == 250
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {"LOG.CSV"}


@pytest.mark.parametrize("text", ["nan", "inf", "1e999999", "1e400000", "", "1:2", "a:b:c", "::"])
def test_what_is_no_time(text):
    with pytest.raises(ValueError, match=r"no time|unpack|invalid"):
        exact_ns(text, 10**9)
