"""Logs of other programs give the samples that were written into them, and what a log does not say is refused or asked for in one line."""

import gzip
import json
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from conftest import DEG, Table, write_session
from dialect_logs import EPOCH_NS, OWN, PLAIN, SAMPLES, T_US, TEMP, TOLD, USUAL, inertial, make, of_program, rows, same, table, triads
from written_texts import TEXTS

import calibrate
from session.base.errors import FormatError
from session.base.units import G
from session.replay.convert import convert
from session.replay.options import Answers
from tinygc import CalibrationError, read_session

FEW = Table().rest(1.2).turn(140, (1, 2, 0.5), 3.0).samples(odr_hz=104)
HALF, LATE = len(T_US) // 2, 530  # behind the rows by which a program is known


@pytest.mark.parametrize("name", TEXTS)
def test_the_samples_of_every_program_are_those_that_were_written(name, tmp_path, capsys):
    text = TEXTS[name]
    files = text.write(FEW)
    for called, data in files:
        (tmp_path / called).write_bytes(data)
    code = calibrate.main(["import", *(str(tmp_path / called) for called, _ in files), "--out", str(tmp_path / "made"), *text.options])
    assert code == 0, capsys.readouterr().err
    (log,) = read_session(tmp_path / "made").logs
    few = len(log.samples)
    assert few >= len(FEW) - 1
    np.testing.assert_allclose((log.samples.t_ns - log.samples.t_ns[0]) * 1e-9, FEW.t_ns[:few] * 1e-9, rtol=0, atol=text.exact_s)
    np.testing.assert_allclose(log.samples.gyro, FEW.gyro[:few], rtol=0, atol=0.51 * text.gyro_lsb)
    np.testing.assert_allclose(log.samples.accel, FEW.accel[:few], rtol=0, atol=0.51 * text.accel_lsb)
    took = capsys.readouterr().out.splitlines()[1:5]
    assert [line.split(":")[0].strip() for line in took[1:]] == ["gyroscope", "accelerometer", "clock"]


# The same samples in another form

ODD = "t_ms=millis,gx_dps=wx,gy_dps=wy,gz_dps=wz,ax_mps2=fwd,ay_mps2=right,az_mps2=-up,temp_c=celsius"
COUNTED = "t_us=1,gx_dps=2,gy_dps=3,gz_dps=4,ax_g=5,ay_g=6,az_g=7"


def odd(comma=False):
    gx, gy, gz, ax, ay, az = triads("dps", "mps2")
    text = rows([f"{t / 1000:.3f}" for t in T_US], gy, gx, gz, -az, ax, ay, TEMP, delimiter=";")
    return "millis;wy;wx;wz;up;fwd;right;celsius\n" + (text.replace(".", ",") if comma else text)


def hsdatalog(shift_us=0):
    """A gyroscope's file and an accelerometer's."""
    write = TEXTS["ST HSDatalog, two files"].write
    return write(SAMPLES)[0][1].decode(), write(replace(SAMPLES, t_ns=SAMPLES.t_ns + shift_us * 1000))[1][1].decode()


def ardupilot(instances=1):
    """A flight controller's text log: formats, parameters, then two kinds of rows in turn; a second sensor reads otherwise."""
    second = r"\g<0>IMU, \1, 1, 0.5, 0.5, 0.5, 1, 1, 9, 0, 0, 31.5, 1, 1\n" if instances == 2 else r"\g<0>"
    return re.sub(r"(?m)^IMU, (\d+), 0, .*\n", second, of_program("ArduPilot text"))


def two_widths():
    narrow, wide = rows(T_US, *triads("dps", "g")).splitlines(), rows(T_US, *[np.full(len(T_US), 0.5)] * 8).splitlines()
    return "\n".join(line for pair in zip(narrow, wide, strict=True) for line in pair) + "\n"


def in_turn():
    """Rows of two sensors in turn, of which the second reads 1 % more."""
    values = [[each * 1.01**unit for each in triads("dps", "g")] for unit in range(2)]
    both = (rows(T_US + unit * 300, ["AB"[unit]] * len(T_US), *values[unit]).splitlines(keepends=True) for unit in range(2))
    return f"t_us,rig,{OWN}\n" + "".join(line for pair in zip(*both, strict=True) for line in pair)


def with_column(name, cells, text=None):
    """The project's own columns and one more."""
    head, *body = (text or PLAIN).splitlines()
    return "\n".join([f"{head},{name}", *(f"{line},{cell}" for line, cell in zip(body, cells, strict=True))]) + "\n"


LABELS = ["still" if i // 50 % 2 else "turn" for i in range(len(T_US))]


def gz(text):
    return gzip.compress(text.encode())


READ = {
    "a byte order mark": ("\ufeff" + inertial(), {}),
    "lines that end in a zero byte": (inertial().replace("\n", "\0\r\n"), {}),
    "trailing commas": (inertial().replace("\n", ",\n"), {}),
    "empty rows of a spreadsheet": (inertial().replace("\n", "\n,,,,,,\n"), {}),
    "utf-16": (inertial().encode("utf-16"), {}),
    "utf-16, the other order": (b"\xfe\xff" + inertial().replace("\n", "\r\n").encode("utf-16-be"), {}),
    "windows": (inertial().replace("deg/s", "°/s").encode("cp1252"), {}),
    "spaces": (inertial().replace(",", " , "), {}),
    "preamble": ("rst:0x1 (POWERON)\nserial,0123\n\n" + inertial(), {}),
    "header again": (inertial() + inertial().split("\n")[0] + "\n", {}),
    "quoted": ('"' + inertial().split("\n")[0].replace(",", '","') + '"\n' + inertial().split("\n", 1)[1], {}),
    "quoted commas in a column that nobody needs": (with_column("remark", ['"o, k"'] * len(T_US)), {}),
    "named columns": (odd(), {"columns": ODD}),
    "decimal commas": (odd(comma=True), {"columns": ODD}),
    "columns by number": ("boot ok\n" + rows(T_US, *triads("dps", "g")), {"columns": COUNTED}),
    "the one kind that holds a gyroscope": (ardupilot(), {"sensor": "ICM-20948"}),
    "one sensor of two": (ardupilot(2), {"rows": "IMU", "where": "I=0", "sensor": "ICM-20948"}),
    "one sensor of two, by any column": (in_turn(), {"where": "rig=A"}),
    "rows of one width": (two_widths(), {"columns": COUNTED, "rows": "7"}),
    "labels that are no kinds": (f"label,t_us,{OWN}\n" + rows(LABELS, T_US, *triads("dps", "g")), {}),
    "a number for each row is no second sensor": (with_column("id", range(len(T_US))), {}),
    "nor is a bit that changes with each row": (with_column("tick", [i % 2 for i in range(len(T_US))]), {}),
    "a column twice that is not read": (with_column("flag", [0] * len(T_US), with_column("flag", [7] * len(T_US))), {}),
    "rows that were written twice": ("".join(line * (1 + (i % 10 == 5)) for i, line in enumerate(USUAL.splitlines(keepends=True))), TOLD),
    "an end that is repeated": (USUAL + "".join(USUAL.splitlines(keepends=True)[-60:]), TOLD),
    "micros that come round": (table((T_US + 2**32 - 3_000_000) % 2**32), {}),
    "a counter with a sign": (table((T_US + 2**31 - 3_000_000 + 2**31) % 2**32 - 2**31), {}),
    "21 bits": (table((T_US + 1_900_000) % 2**21), {}),
    "cycles of 64 MHz": (table((T_US * 64 + 12_345_678) % 2**24, "cycles"), {"time_unit": "15.625ns"}),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_the_same_samples_come_of_it(name, tmp_path):
    text, answers = READ[name]
    same(make(tmp_path, text, **answers))


def iso(hours, zone):
    """Stamps of a clock ``hours`` east of UTC, before and behind a moment."""
    for t_us in T_US.tolist():
        east = hours[int(t_us >= T_US[LATE])]
        moment = datetime(2026, 3, 29, 1, tzinfo=UTC) + timedelta(microseconds=t_us - int(T_US[LATE]), hours=east)
        yield moment.strftime("%Y-%m-%dT%H:%M:%S.%f") + (f"{east:+03d}:00" if zone else "")


@pytest.mark.parametrize("hours", [(1, 2), (-4, -5)])
def test_summer_time_begins_and_ends_unseen_where_there_is_a_zone_and_is_named_where_there_is_none(hours, tmp_path):
    same(make(tmp_path, table([*iso(hours, True)], "time")))
    way = "forward, as where summer time begins" if hours[1] > hours[0] else "back, as where summer time ends"
    with pytest.raises(FormatError, match=rf"line {LATE + 2}: time leaps 3600 s {way}; write the stamps in UTC.*--odr"):
        make(tmp_path, table([*iso(hours, False)], "time"), out="local")


# Our own, copied; and files of two sensors


def test_own_log_is_copied_byte_for_byte_and_says_its_full_scales_in_a_comment(tmp_path):
    own = (write_session(tmp_path / "own", SAMPLES) / "log0001.csv").read_text()
    said = "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=104.2 serial=7\n" + own
    made = make(tmp_path, said, gyro_fs_dps=None, accel_fs_g=None)
    assert made.log.read_text() == said
    sensor = same(made, temp=True).config.sensor
    assert (sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.odr_hz, sensor.serial) == (500, 4, 104.2, "7")
    assert "latitude_deg =" not in (made.folder / "session.toml").read_text()  # no value is suggested
    packed = make(tmp_path, gz(own), name="log.csv.gz", out="packed")
    assert packed.log.name == "log0001.csv.gz"
    same(packed)
    same(make(tmp_path, own.replace(",", ";"), out="spreadsheet"), temp=True)
    # Registers stay registers, whatever their columns are called.
    columns = "t_us=time,gx=a,gy=b,gz=c,ax=d,ay=e,az=f,temp=g"
    named = make(tmp_path, "time,a,b,c,d,e,f,g\n" + own.split("\n", 1)[1], columns=columns, sensor="asm330lhh", out="named")
    same(named, temp=True)
    assert named.log.read_text().split("\n")[1].split(",")[1:] == own.split("\n")[1].split(",")[1:]


def test_files_of_two_sensors_are_joined_on_time(tmp_path):
    for number, texts in enumerate((hsdatalog(), hsdatalog()[::-1])):
        made = make(tmp_path, *texts, out=f"{number}")
        assert made.dialects == ("ST HSDatalog",)
        same(made)
    temperature = "Timestamp (us),Temperature (degC)\n" + rows(T_US[::50], TEMP[::50])
    found = same(make(tmp_path, inertial(), temperature, out="temp")).logs[0].samples.temp_c
    np.testing.assert_allclose(found[::50], TEMP[::50], atol=1e-8)


def test_files_of_different_clocks_are_read_between_samples(tmp_path):
    """A straight line between samples is a value of the straight line; ends without neighbours are left out."""
    gyro_t, accel_t = np.arange(0, 10_000_000, 9_600), np.arange(1_000, 9_000_000, 4_800)
    gyro = "Time,G_x [mdps],G_y [mdps],G_z [mdps]\n" + rows([f"{x / 1e6:.6f}" for x in gyro_t], *np.ones((3, len(gyro_t))))
    accel = "Time,A_x [g],A_y [g],A_z [g]\n" + rows([f"{x / 1e6:.6f}" for x in accel_t], accel_t * 1e-7, accel_t * 0 - 0.5, accel_t * 0)
    made = make(tmp_path, gyro, accel)
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_allclose(samples.accel[:, 0] / G, samples.t_ns * 1e-10, atol=1e-8)
    assert samples.t_ns[0] == 9_600_000
    assert samples.t_ns[-1] <= accel_t[-1] * 1000
    assert any("read between" in note and "left out" in note for note in made.notes)


def test_decimal_commas_may_begin_after_many_whole_numbers_and_axes_are_turned_as_asked(tmp_path):
    """A board that reads zero until its filters have settled."""
    settling = "".join(f"{-12_000 + 1000 * i};0;0;0;0;0;1\n" for i in range(12))
    text = "t;a;b;c;d;e;f\n" + settling + rows(T_US, *triads("dps", "g"), delimiter=";").replace(".", ",")
    columns = "t_us=t,gx_dps=a,gy_dps=b,gz_dps=c,ax_g=d,ay_g=e,az_g=f"
    samples = read_session(make(tmp_path, text, columns=columns, gyro_axes="y,-x,z", accel_axes="-x,-y,-z").folder).logs[0].samples
    assert not samples.gyro[:12].any()
    np.testing.assert_allclose(samples.gyro[12:], SAMPLES.gyro[:, [1, 0, 2]] * [1, -1, 1], atol=1e-8 * DEG)
    np.testing.assert_allclose(samples.accel[12:], -SAMPLES.accel, atol=1e-8 * G)


@pytest.mark.parametrize("value", [0, 2**30])
def test_a_single_bad_stamp_is_named_and_taken_as_the_middle(value, tmp_path):
    bad = T_US.copy()
    bad[[70, 300]] = value
    made = make(tmp_path, table(bad))
    says = f"line 72: t_us is {value}, beyond both neighbours: taken as 673077"
    assert any(says in note and "1 more such" in note for note in made.notes)
    assert np.abs(read_session(made.folder).logs[0].samples.t_ns - SAMPLES.t_ns).max() <= 1000


def test_a_broken_gzip_gives_what_came_before_and_lost_samples_leave_the_rate(tmp_path):
    packed = gz(inertial())
    made = make(tmp_path, packed[: len(packed) // 2], name="log.csv.gz")
    assert 100 < made.samples < len(SAMPLES)
    assert any("breaks off" in note for note in made.notes)
    lines, kept = inertial().splitlines(keepends=True), np.random.default_rng(1).random(len(T_US) + 1) >= 0.05
    kept[:2] = True
    made = make(tmp_path, "".join(line for line, keep in zip(lines, kept, strict=True) if keep), out="lost")
    assert read_session(made.folder).config.sensor.odr_hz == pytest.approx(104, rel=2e-4)


def test_a_folder_is_not_written_over_and_logs_are_added(tmp_path):
    made = make(tmp_path, inertial())
    before = made.log.read_bytes()
    with pytest.raises(FormatError, match="--add"):
        make(tmp_path, inertial())
    assert made.log.read_bytes() == before
    for kind, name in (("closure", "closure0001.csv"), ("log", "log0002.csv")):
        assert convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add=kind).log.name == name
    assert "\n# log0002.csv: from LOG.CSV (" in (made.folder / "session.toml").read_text()
    with pytest.raises(FormatError, match="--gyro-fs"):
        convert([tmp_path / "LOG.CSV"], made.folder, Answers(gyro_fs_dps=2000.0), add="log")


# What is refused or asked for


def line(number, text, whole=None):
    lines = (whole or inertial()).split("\n")
    return "\n".join([*lines[:number], text, *lines[number + 1 :]])


def again(*words):
    """A board that starts again in the middle of its log."""
    body = rows(np.r_[T_US[:HALF] + 9_000_000, T_US[HALF:] - T_US[HALF] + 412], *triads("dps", "g")).splitlines(keepends=True)
    head = f"t_us,{OWN}\n"
    return head + "".join(body[:HALF]) + "".join(f"{word}\n" for word in words) + head + "".join(body[HALF:])


def swapped(first, second):
    stamps = T_US.copy()
    stamps[[first, second]] = stamps[[second, first]]
    return table(stamps)


def stepped(start_ns, back_s):
    t_ns = start_ns + T_US * 1000
    t_ns[HALF:] -= round(back_s * 1e9)
    return table(t_ns, "t_ns")


def doubled(text, name):
    """A last column of that name, which holds zeros."""
    head, *body = text.splitlines()
    return "\n".join([f"{head},{name}", *(f"{each},0" for each in body)]) + "\n"


OPEN = with_column("remark", ['"ok' if number in (39, 59) else "ok" for number in range(len(T_US))])
IN_JSON = "\n".join(json.dumps({"dev": "AB"[i % 2], "t": i, "gyro": [1, 2, 3], "accel": [0, 0, 9.5]}) for i in range(400))
REGISTERS = "t,a,b,c,d,e,f\n" + rows(T_US, *[T_US % 99] * 6)
UNITED = "gx_dps=wx,gy_dps=wy,gz_dps=wz,ax_g=ax,ay_g=ay,az_g=az"
ANGLES = f"t_us,dtheta_x_deg,dtheta_y_deg,dtheta_z_deg,ax_g,ay_g,az_g\n{rows(T_US, *triads('dps', 'g'))}"
NAMELESS = "give --columns t_UNIT=a,gx_UNIT=b,gy_UNIT=c,gz_UNIT=d,ax_mps2=e,ay_mps2=f,az_mps2=g"
HEADLESS = r"no header, 7 columns of numbers; name them by number, --columns t_UNIT=1,gx_UNIT=2,.*az_g=7"
REFUSED = [
    (inertial().split("\n")[0] + "\n", {}, "no samples"),
    ("\0\1\2\3" * 100, {}, "not a text log"),
    ("a,b,c\n1,2,3\n", {}, "no header.*'a,b,c'"),
    (b"no gzip", {"name": "log.csv.gz"}, "gzip"),
    (line(40, "1,2,3"), {}, "line 41.*3 columns"),
    (line(40, "384615,x,0,0,0,0,0"), {}, "line 41.*Gyroscope X.*'x'"),
    (line(40, "384615,nan,0,0,0,0,0"), {}, "line 41.*Gyroscope X.*expected a finite number"),
    (line(40, "384615,0,1e308,0,0,0,0"), {}, r"LOG.CSV line 41.*Gyroscope Y.*1e\+308.*unit"),
    (line(40, "9" * 40 + ",0,0,0,0,0,0"), {}, "line 41.*Timestamp.*no time of this era"),
    (line(41, "6,0,0,0,0,0,0", line(40, "5,0,0,0,0,0,0")), {}, "line 41.*begins again at 5e-06 s: a restart"),
    # Found by fuzzing: NumPy reads on to the next one, in a column that nobody needs without a word.
    (OPEN, {}, "line 41: a quotation mark that is not closed"),
    (line(40, odd().split("\n")[40].replace(".", ",", 1), odd()), {"columns": ODD}, "line 41"),
    (doubled(inertial(), "Accelerometer Z (g)"), {}, "stands 2 times; keep one"),
    # Sensors and kinds of rows
    (ardupilot(2), {"rows": "IMU"}, "the column 'I' holds 0, 1: rows of several sensors; give --where I=0"),
    (ardupilot().replace("GyrX", "RateX"), {}, "rows of several kinds .*IMU.*ATT.*; give --rows IMU"),
    (ardupilot(), {"rows": "GPS"}, "no row begins with 'GPS'"),
    (two_widths(), {"columns": COUNTED}, "rows of 7 and rows of 9 columns.*give --rows 7"),
    (in_turn(), {}, "the column 'rig' holds A, B in turn.*give --where rig=A"),
    (with_column("imu", [int(i > LATE) for i in range(len(T_US))]), {}, "rows of several sensors"),  # far behind the first rows
    (IN_JSON, {**TOLD, "time_unit": "ms"}, "the column 'dev' holds A, B.*give --where dev=A"),
    # Stamps
    (stepped(EPOCH_NS, 3.0), {}, "goes backward by"),  # a 32-bit counter of ns would come round every 4.3 s
    (swapped(70, 71), {}, r"line 73: t_us goes backward by .*; split the log there"),
    (again("ets Jul 29 2019 12:21:46", "", "rst:0x1 (POWERON)"), {}, rf"line {HALF + 2}: .* again at 0.000412 s.*two pieces: split"),
    ("wx,wy,wz,ax,ay,az\n" + rows(*triads("dps", "g")), {"columns": UNITED, "time_unit": "us"}, "--odr"),
    # What no file tells
    (odd(), {}, "--columns.*millis"),
    (odd(), {"columns": ODD.replace("t_ms", "t")}, "--time-unit"),
    (odd(), {"columns": ODD.replace("gz_dps=wz,", "")}, "gz missing"),
    (odd(), {"columns": ODD.replace("wz", "wzz")}, "wzz"),
    (odd(), {"columns": "t_ms"}, "--columns"),
    (rows(T_US, *triads("dps", "g")), {"columns": COUNTED.replace("=3", "=2")}, "takes the column .* for two things"),
    (inertial(), {"gyro_axes": "x,x,z"}, "--gyro-axes"),
    (inertial().replace("deg/s", "rph"), {}, "rph.*--gyro-unit"),
    (inertial().replace("Y (deg/s)", "Y (mdps)"), {}, "different units"),
    ("t_us;GXX;gy;gz;ax;ay;az\n1;2;3;4;5;6;7\n", {}, "is 'GXX' meant as 'gx'"),
    (REGISTERS, {"columns": "t_us=t,gx=a,gy=b,gz=c,ax=d,ay=e,az=f"}, "whose registers it holds; give --sensor NAME"),
    (ANGLES, {}, "'dtheta_x_deg' is the angle of each sample"),
    (rows(T_US, *triads("dps", "g")), {}, HEADLESS),
    ("a,b,c,d,e,f,g\n" + rows(T_US, *triads("dps", "mps2")), {}, NAMELESS),
    ('{"a": [1, 2', {}, "damaged JSON"),
    ("[" * 99_999, {}, "line 1: longer than"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "answers", "said"), REFUSED, ids=[f"{number} {said}"[:60] for number, (*_, said) in enumerate(REFUSED)])
def test_what_is_wrong_or_not_said_is_one_line(text, answers, said, tmp_path):
    with pytest.raises(CalibrationError) as caught:
        make(tmp_path, text, **answers)
    assert re.search(said, str(caught.value)), caught.value
    assert "\n" not in str(caught.value)
    assert len([*tmp_path.iterdir()]) == 1  # nothing is left behind


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (hsdatalog()[:1], "no accelerometer.*give its file"),
        (hsdatalog()[1:], "no gyroscope"),
        ((hsdatalog()[0], inertial()), "both hold a gyroscope"),
        ((hsdatalog()[0], hsdatalog(shift_us=3600 * 10**6)[1]), "share no time"),
    ],
)
def test_files_that_do_not_belong_together_are_refused(texts, said, tmp_path):
    with pytest.raises(CalibrationError, match=said):
        make(tmp_path, *texts)
    assert not (tmp_path / "session").exists()
