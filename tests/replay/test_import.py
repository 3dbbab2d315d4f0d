"""``import``: what it asks and assumes, which rows it takes, clocks and units that it finds, options that would be ignored."""

import io
import json
import re
import zipfile

import numpy as np
import pytest
from conftest import DEG, Table
from dialect_logs import ACCEL, GYRO, HEAD, OWN, SAMPLES, T_US, TOLD, USUAL, inertial, make, of_program, rows, triads
from streams import frame_list, sent
from written_texts import TEXTS, sensor_logger

import tinygc
from session.base.errors import CalibrationError, DataError, FormatError
from session.base.options import records as records_of
from session.base.questions import QuestionsError
from session.base.units import TIME, G
from session.replay.forms import form_of
from session.replay.importing import import_log, kind_named
from session.replay.options import Answers
from tinygc import read_session
from tinygc.library.logs import FURTHER

GYR, ACC = "t_us,gx_dps,gy_dps,gz_dps\n" + rows(T_US, *GYRO["dps"].T), "t_us,ax_g,ay_g,az_g\n" + rows(T_US, *ACCEL["g"].T)


def samples_of(made):
    return read_session(made.folder).logs[0].samples


# What is asked, all at once, and what is assumed


@pytest.mark.parametrize(
    ("texts", "told", "options"),
    [
        ([of_program("Betaflight, blackbox_decode")], {}, ["--gyro-unit"]),  # gravity's length states the accelerometer's
        ([USUAL.replace("time_ms", "n").replace(",", ";")], {"gyro_fs_dps": None}, ["--time-unit", "--gyro-unit", "--accel-unit"]),
        ([GYR.replace("_dps", "").replace("t_us", "t"), ACC.replace("_g", "").replace("t_us", "t")], {}, ["--gyro-unit"]),
        (
            ["ms;a;b;c;d;e;f\n" + rows(T_US // 1000, *[T_US % 99] * 6, delimiter=";")],
            {"gyro_fs_dps": None, "accel_fs_g": None, "columns": "t_ms=1,gx=2,gy=3,gz=4,ax=5,ay=6,az=7"},
            ["--sensor NAME", "--gyro-fs DPS", "--accel-fs G"],
        ),
    ],
)
def test_all_that_a_log_does_not_say_is_asked_at_once(texts, told, options, tmp_path):
    with pytest.raises(QuestionsError) as asked:
        make(tmp_path, *texts, **told)
    assert sorted(question.option for question in asked.value.questions) == sorted(options)
    assert "\n" not in str(asked.value)
    assert all(each.option in str(asked.value).partition("; give ")[2] for each in asked.value.questions)


@pytest.mark.parametrize("at_end", [3, 4])
def test_a_full_scale_that_nobody_states_is_assumed_and_said_or_asked_where_readings_stand_at_its_end(at_end, tmp_path):
    gyro, told = GYRO["dps"].copy(), TOLD | {"gyro_fs_dps": None, "accel_fs_g": None}
    gyro[300 : 300 + at_end, 1] = 573.4375
    text = HEAD + rows(T_US / 1e3, *ACCEL["g"].T, *gyro.T)
    if at_end == 4:
        with pytest.raises(QuestionsError, match=r"its readings stand at 573\.44 dps for 4 rows; give --gyro-fs DPS"):
            make(tmp_path, text, **told)
        # Readings that come six times, and coarse ones at a peak, end no range.
        for number, values in enumerate((GYRO["dps"][np.arange(len(T_US)) // 6 * 6], np.rint(GYRO["dps"] / 5) * 5)):
            made = make(tmp_path, HEAD + rows(T_US / 1e3, *ACCEL["g"].T, *values.T), out=f"{number}", **told)
            assert any("full scale" in note and "is assumed" in note for note in made.notes)
        return
    made = make(tmp_path, text, **told)
    sensor = read_session(made.folder).config.sensor
    assert (sensor.gyro_fs_dps, sensor.accel_fs_g) == (1000, 2)
    assert sum("is assumed" in note for note in made.notes) == " ".join(made.took).count("(assumed)") == 2
    assert (made.folder / "session.toml").read_text().count("is assumed") == 2


def test_readings_beyond_a_full_scale_and_acceleration_without_gravity_are_said(tmp_path):
    far = {"gyro_unit": "4rad/s", "gyro_fs_dps": None}
    for told, says in (({"gyro_fs_dps": 20.0}, "more than --gyro-fs 20 holds"), (far, "more than any usual full scale")):
        with pytest.raises(DataError, match=says):
            make(tmp_path, USUAL, **TOLD | told)
    linear = "time_s,ax_mps2,ay_mps2,az_mps2,wx_rps,wy_rps,wz_rps\n" + rows(T_US / 1e6, *(0.05 * ACCEL["mps2"].T), *GYRO["rps"].T)
    with pytest.raises(DataError, match=r"shows 0\.0(?:50*|4[89]\d*) g where gravity belongs.*give the file with gravity"):
        make(tmp_path, linear)


# Which rows, and which reader


def test_rows_by_their_lines_and_rows_of_another_width_are_refused(tmp_path):
    head, *body = USUAL.splitlines()
    garbage = "\n".join([head, *(line if i < 540 else "~~~garbage~~~" for i, line in enumerate(body))]) + "\n"
    with pytest.raises(FormatError, match="line 542"):
        make(tmp_path, garbage, **TOLD)
    np.testing.assert_allclose(samples_of(make(tmp_path, garbage, lines="12-541", **TOLD)).gyro, SAMPLES.gyro[10:540], atol=1e-10)
    wide = [line if i < 540 else line.replace(",", ",7,", 1) for i, line in enumerate(body)]
    short = [f"25.0,{line}" if i != 540 else line for i, line in enumerate(body)]
    for text, says in (
        ("\n".join([head, *wide]), "line 542: 8 columns, expected 7"),
        ("\n".join([f"temp,{head}", *short]), "line 542: 7 columns"),
    ):
        with pytest.raises(FormatError, match=says):
            make(tmp_path, text + "\n", out="no", **TOLD)
    for wrong in ("", "5", "0-3", "9-2", "a-b", "-1-3"):
        with pytest.raises(FormatError, match="expected FIRST-LAST"):
            make(tmp_path, USUAL, lines=wrong, out="no")
    with pytest.raises(FormatError, match="goes backward"):  # rows from before, but not the log's end again
        make(tmp_path, "\n".join([head, *body, *body[300:360]]) + "\n", out="no", **TOLD)


def test_a_reader_may_be_forced_by_the_beginning_of_its_name(tmp_path):
    text = inertial()
    assert make(tmp_path, text, like="x-imu3").dialects == ("x-IMU3",)
    for like, says in (
        ("phyphox", "no header of phyphox"),
        ("nonsense", "--like is 'nonsense'"),
        ("columns by", "--like is 'columns by"),
    ):
        with pytest.raises(FormatError, match=says):
            make(tmp_path, text, like=like, out="b")
    names = {
        "sensorlog": "SensorLog",
        "physics toolbox": "Physics Toolbox",
        "ros1 bag": "ROS 1 bag",
        "columns by": "columns by their names",
    }
    assert {name: kind_named(name) for name in names} == names
    for name, says in (("", "expected one of"), ("!", "expected one of"), ("ROS", "which may be one of ROS")):
        with pytest.raises(FormatError, match=says):
            kind_named(name)


# Forms of text


def records():
    return [f"t: {t} ax: {i % 7}.5 ay: 0.25 az: 9.75 gx: {i % 5}.125 gy: 0.5 gz: 1.5" for i, t in enumerate(T_US)]


RECORD = {"gyro_unit": "dps", "accel_unit": "m/s2", "time_unit": "us"}
SIX = r"ax: (\S+) ay: (\S+) az: (\S+) gx: (\S+) gy: (\S+) gz: (\S+)"
THREE = [
    part for i, t in enumerate(T_US) for part in (f"time: {t}", f"acc x: {i % 7}.5 y: 0.25 z: 9.75", f"gyr x: {i % 5}.125 y: 0.5 z: 1.5")
]


@pytest.mark.parametrize(
    ("lines", "skipped"),
    [
        ([line.replace(".", ",") for line in records()], 0),
        ([re.sub(r"t: (\d+) ", r"I (\1) IMU: ", line) for line in records()], 0),
        ([re.sub(SIX, r"acc: x=\1 y=\2 z=\3 gyr: x=\4 y=\5 z=\6", line) for line in records()], 0),
        ([re.sub(SIX, r"Accel: \1, \2, \3 Gyro: \4, \5, \6", line) for line in records()], 0),
        ([re.sub(r"gz: (\S+)", r"gz: \1 degrees/s", re.sub(r"az: (\S+)", r"az: \1 m/s^2", line)) for line in records()], 0),
        ([records()[0][20:], *records()[1:]], 1),  # a capture that begins in mid line
        ([*records()[:50], "the battery is low", *records()[50:]], 0),
        (THREE, 0),
        (THREE[1:], 1),  # a record of several lines begins with its time wherever the capture does
    ],
    ids=["decimal commas", "a log's tag", "labels", "lists", "units", "mid line", "chatter", "three lines", "from the second"],
)
def test_names_and_numbers_as_people_print_them(lines, skipped, tmp_path):
    samples = samples_of(make(tmp_path, "\n".join(lines) + "\n", **RECORD))
    np.testing.assert_array_equal(samples.t_ns - samples.t_ns[0], (T_US[skipped:] - T_US[skipped]) * 1000)
    np.testing.assert_allclose(samples.gyro[:, 0] / DEG, [i % 5 + 0.125 for i in range(skipped, len(T_US))])
    np.testing.assert_allclose(samples.accel[:, 0], [i % 7 + 0.5 for i in range(skipped, len(T_US))])


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([*records()[:50], "ax:1 ay:2 az:3 gx:4 gy:5", *records()[50:]], "LOG.CSV line 5[12]"),
        ([*records()[:50], records()[50][12:], *records()[51:]], "LOG.CSV line 51"),
        ([*records()[:50], records()[50] + " gz: 0.5", *records()[51:]], "LOG.CSV line 51"),  # leaves no trace in the next
        ([*THREE[:180], *THREE[181:]], "line 18[123]"),
        ([f"IMU{i % 2}: {line}" for i, line in enumerate(records())], "lines of several sensors"),
        ([line.replace("gz: 1.5", f"gz: 1.5 {'dps' if i < 540 else 'rad/s'}") for i, line in enumerate(records())], "line 541"),
    ],
)
def test_a_torn_record_is_refused_by_its_line(lines, says, tmp_path):
    with pytest.raises(FormatError, match=says):
        make(tmp_path, "\n".join(lines) + "\n", **RECORD)


def test_packed_registers_json_and_checksums(tmp_path):
    words = ["0C00F9FF00100300000000FE"] * 20
    assert form_of(words, "st", "x")(words[:1]) == ["12,-7,4096,3,0,-512"]
    for packed, says in (
        (None, r"6 registers a line, packed in hexadecimal.*give --packed"),
        ("mpu", "but --packed mpu has 7"),
        ("middle:gx", "is 'middle:gx'"),
    ):
        with pytest.raises(FormatError, match=says):
            form_of(words, packed, "x")
    assert form_of(["1000,1,2,3,4,5,6,507f1f77bcf86cd799439011"] * 20, None, "x") is None  # a column of IDs is no burst
    raw = ["ms,gx,gy,gz,ax,ay,az", *(f"{1000 + 10 * i},{(i * 7) % 4096:04X},FFFE,0003,00A0,FF00,1000" for i in range(800))]
    assert form_of(raw, None, "x")(["1010,0007,FFFE,0003,00A0,FF00,1000"]) == ["1010,7,-2,3,160,-256,4096"]  # a decimal stamp stays decimal
    line = '{"t_ns": 1732600000123456789, "g": [1, 2, 3], "a": {"x": 0.10, "y": 1e-3, "z": 9}}'
    form = form_of([line] * 9, None, "x")
    assert (form.header, form([line])) == ("t_ns,g[0],g[1],g[2],a.x,a.y,a.z", ["1732600000123456789,1,2,3,0.10,1e-3,9"])
    lines = TEXTS["VectorNav, $VNYMR"].write(SAMPLES)[0][1].decode().splitlines(keepends=True)
    lines[70] = lines[70].replace("+1.0", "+1.1", 1)
    with pytest.raises(FormatError, match="line 71: its checksum is wrong"):
        make(tmp_path, "".join(lines), odr_hz=104.0)


# The clock: whatever it is called, and in a unit that something confirms

TRUE_HZ = 105.4
FEW = Table().rest(2).turn(200, (1, 2, 3), 4.0).rest(2).samples(odr_hz=TRUE_HZ)
UNITED = "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"


def log_of(samples, names="", *columns):
    values = [*columns, *np.round(samples.accel / G, 6).T, *np.round(samples.gyro / DEG, 5).T]
    return f"{names}{',' * bool(names)}{UNITED}\n" + "\n".join(",".join(map(str, row)) for row in zip(*values, strict=True)) + "\n"


def ticks(unit_s, samples=FEW):
    return np.rint(samples.t_s / unit_s).astype(int)


def test_a_clock_that_is_there_is_taken_and_said(tmp_path):
    """A declared rate is nominal, and does not take its place."""
    made = make(tmp_path, log_of(FEW, "sec,nsec", ticks(1e-9) // 10**9 + 1_700_000_000, ticks(1e-9) % 10**9), odr_hz=100.0)
    session = read_session(made.folder)
    assert session.logs[0].samples.duration_s == pytest.approx(FEW.duration_s, abs=2e-3)
    assert session.nominal_rate is None
    assert session.config.sensor.odr_hz == 100.0
    assert any("taken for the clock" in note for note in made.notes)


def test_gravitys_movement_tells_the_unit_of_a_slow_clock(tmp_path):
    moved = Table().tumble(3, seed=3, turn_s=5.0).samples(odr_hz=9.4)
    made = make(tmp_path, log_of(moved, "time", ticks(1e-3, moved)))
    assert made.took[-1].startswith("clock: time in ms (by gravity); 9.4")


@pytest.mark.parametrize(("name", "unit", "known"), [("dT [ms]", "ms", "by its name"), ("dt", "s", "by the sensors' rates")])
def test_intervals_are_added_up(name, unit, known, tmp_path):
    steps = np.diff(FEW.t_ns, prepend=FEW.t_ns[0] - 9_500_000) + np.random.default_rng(1).integers(-9000, 9000, len(FEW))
    made = make(tmp_path, log_of(FEW, name, steps / TIME[unit]))
    assert f"{name}, intervals that are added up, in {unit} ({known})" in made.took[-1]
    np.testing.assert_allclose(np.diff(samples_of(made).t_ns), steps[1:], atol=2)


def test_stamps_with_too_few_digits_or_a_rate_that_no_sensor_has_are_refused(tmp_path):
    with pytest.raises(tinygc.CalibrationError, match=r"too few digits.*write at least milliseconds"):
        make(tmp_path, log_of(FEW, "time_ms", (1.7e12 + FEW.t_s * 1e3).astype(np.float32).astype(int)))
    with pytest.raises(FormatError, match=r"read as ns, its stamps show 105400 Hz, and no sensor has.*--time-unit s, ms, us or ns"):
        make(tmp_path, log_of(FEW, "t_ns", ticks(1e-6)), time_unit="ns")


def test_the_rate_of_stamps_of_which_a_few_are_shared_is_that_of_the_samples(tmp_path):
    """As the session is read again: by the stamps as they are a pair's one long step would count as a single period."""
    t_us = np.maximum.accumulate(ticks(1e-6) + np.random.default_rng(0).normal(0, 0.2e6 / TRUE_HZ, len(FEW)).astype(int))
    t_us[30::100] = t_us[29::100][: len(t_us[30::100])]
    made = make(tmp_path, log_of(FEW, "t_us", t_us), gyro_unit="dps")
    assert read_session(made.folder).config.sensor.odr_hz == pytest.approx(TRUE_HZ, rel=1e-3)


def test_stamps_that_scatter_are_counted_along_where_it_is_asked_for(tmp_path):
    late_us = np.maximum.accumulate(FEW.t_s * 1e6 + np.abs(np.random.default_rng(8).normal(0, 1500, len(FEW))))
    path = tmp_path / "x.csv"
    path.write_text(log_of(FEW, "t_us", np.round(late_us).astype(int)))
    told = {"gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
    made = import_log([path], tmp_path / "even", Answers(**told, even=True))
    assert any("counted evenly, 105." in note for note in made.notes)
    session = read_session(made.folder)
    assert np.ptp(np.diff(session.logs[0].samples.t_ns)) < 1e4
    assert 0 < session.clock.sigma < 1e-3


# Files, archives, a port's bytes, several sensors


def archive(path, *members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, text in members:
            file.writestr(name, text)
    return path


def spoilt(path, first, stop):
    data = bytearray(path.read_bytes())
    data[first:stop] = bytes(stop - first)
    path.write_bytes(data)
    return path


OF_A_PORT = [
    ({"where": "id=0"}, "--where"),
    ({"like": "phyphox"}, "--like"),
    ({"lines": "1-5"}, "--lines"),
    ({"more": {"serial": "7"}}, "--serial"),
]


def of_features(**told):
    """Options that features add to an import."""
    return {"further": records_of(told, *FURTHER)}


TOGETHER = [
    ({**of_features(array_by="id"), "add": "log"}, "--add: of no use with --array-by; leave it out"),
    ({**of_features(array_by="id"), "serial": "7"}, "--serial: of no use with --array-by"),
    (of_features(array_by="time_ms"), "holds more than 16 values"),
    ({**of_features(turns="turns.csv"), "add": "log"}, "--add: of no use with --turns"),
    ({"add": "foo"}, "add is 'foo', expected log or closure"),
]
LOGGER = sensor_logger(SAMPLES)[0][1]
SOURCES = [
    (
        lambda at: archive(at / "a.zip", ("1/gyr.csv", GYR), ("1/acc.csv", ACC), ("2/gyr.csv", GYR)),
        {},
        r"it holds 1/gyr\.csv and 2/gyr\.csv",
    ),
    (lambda at: spoilt(archive(at / "a.zip", ("gyr.csv", GYR), method=zipfile.ZIP_LZMA), 200, 2000), {}, "a damaged zip archive"),
    (lambda at: spoilt(written(at / "a.zip", LOGGER), 200, 500), {}, "zip archive"),
    (lambda at: written(at / "a.zip", LOGGER[: len(LOGGER) // 2]), {}, "zip archive"),
    (lambda at: archive(at / "a.zip", ("../../evil.csv", "a,b\n1,2\n")), {}, "none of its 1 text files holds a gyroscope"),
    (lambda at: folder_of(at, acc=ACC, gyr=GYR.replace("_dps", "")), {}, "unit of the gyroscope"),
    (
        lambda at: folder_of(at, acc=ACC, gyr=GYR.replace("gz_dps", "gy_dps", 1)),
        {},
        r"no gyroscope in it; files were left out.*gyr\.csv line 1",
    ),
    (lambda at: written(at / "x.bin", GYR.encode()), {}, "no samples among"),  # with a board's own header it is a board's
    (lambda at: written(at / "x.bin", USUAL.encode()), {}, "unit of the gyroscope"),
    (lambda at: written(at / "x.csv", USUAL.encode()), {"topic": "imu"}, "a text log has no topics; leave --topic out"),
    (lambda at: written(at / "x.csv", USUAL.encode()), {"more": {"header": "t_us,gx"}}, "--header is of a port's bytes"),
    (lambda at: arrays_file(at / "x.npz"), {"like": "phyphox"}, "a log of NumPy, and --like is 'phyphox'"),
    (lambda at: arrays_file(at / "x.npz"), {"lines": "1-5"}, "--lines is of a text log"),
    *(
        (lambda at: written(at / "raw.bin", b"".join(frame_list(*sent(50)))), told, f"{option}: of no use with raw.bin")
        for told, option in OF_A_PORT
    ),
    *((lambda at: written(at / "x.csv", USUAL.encode()), {**TOLD, "more": more}, says) for more, says in TOGETHER),
]


def written(path, data):
    path.write_bytes(data)
    return path


def folder_of(at, **texts):
    for name, text in texts.items():
        written(at / f"{name}.csv", text.encode())
    return at


def arrays_file(path):
    buffer = io.BytesIO()
    np.savez(buffer, t_s=SAMPLES.t_ns * 1e-9, gyro_rps=SAMPLES.gyro[:], acc_mps2=SAMPLES.accel[:])
    return written(path, buffer.getvalue())


@pytest.mark.parametrize(("source", "told", "says"), SOURCES, ids=[f"{number} {says}"[:50] for number, (*_, says) in enumerate(SOURCES)])
def test_a_source_that_is_damaged_or_an_option_that_it_ignores_is_refused(source, told, says, tmp_path):
    told, at = dict(told), tmp_path / "at"
    at.mkdir()
    with pytest.raises(CalibrationError, match=says) as error:
        import_log([source(at)], tmp_path / "out", Answers(**{k: v for k, v in told.items() if k != "more"}), **told.get("more", {}))
    assert "\n" not in str(error.value)
    assert {path.name for path in tmp_path.iterdir()} == {"at"}


def test_other_endings_are_read_from_archives_tables_by_any_name_and_a_ports_bytes(tmp_path):
    path = archive(tmp_path / "a.zip", ("imu.jsonl", USUAL), ("__MACOSX/._imu.csv", "\0\1"))
    for number, source in enumerate((path, written(tmp_path / "x.bin", USUAL.encode()))):
        assert len(samples_of(import_log([source], tmp_path / f"{number}", Answers(**TOLD)))) == len(SAMPLES)
    t_us, registers = sent(500)
    raw = written(tmp_path / "raw.bin", b"".join(frame_list(t_us, registers)))
    program, sensors, _, clock = import_log([raw], tmp_path / "raw", Answers(gyro_fs_dps=500.0, accel_fs_g=4.0)).took
    assert program.startswith("raw.bin: a port's bytes")
    assert "gx, gy, gz registers (header), ±500 dps (session.toml)" in sensors
    assert clock.startswith(f"clock: t_us in us, the board's own; {1e6 / np.diff(t_us).mean():.4g} Hz for ")
    made = import_log([arrays_file(tmp_path / "y.npz")], tmp_path / "npz", Answers(like="numpy"))
    assert made.took[0] == "y.npz: NumPy, by --like"
    assert "gyro_rps[0] to gyro_rps[2] in rad/s (the file)" in made.took[1]


# From Python and from the command line


def test_python_reads_what_the_command_reads(tmp_path):
    path = written(tmp_path / "counted.csv", f"# calibrated=gyro\n{OWN}\n{rows(*triads('dps', 'g'))}".encode())
    columns = ",".join(f"{name}={name}" for name in OWN.split(","))
    told = {"odr_hz": 104.0, "gyro_fs_dps": 500.0, "accel_fs_g": 4.0, "sensor": "ASM330LHH", "columns": columns}
    read, made = tinygc.read_log(path, **told), tinygc.import_log(path, tmp_path / "s", **told)
    assert (read.counted, read.sensor, read.odr_hz, read.comments["calibrated"]) == (True, "ASM330LHH", 104.0, "gyro")
    ours, theirs = read.session(), made.session
    assert ours.config.sensor == theirs.config.sensor
    assert ours.nominal_rate == theirs.nominal_rate is not None
    np.testing.assert_allclose(read.gyro_rps, SAMPLES.gyro, atol=1e-10)
    with pytest.raises(tinygc.CalibrationError, match="from_arrays: no option 'foo'"):
        read.session(foo=1)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({}, r"the unit of the gyroscope; give gyro_unit= \(dps"),
        ({"gyro_units": "dps"}, r"did you mean gyro_unit\?"),
        ({"gyro_fs_dps": "500"}, "gyro_fs_dps is '500', expected a number above 0"),
        ({"gyro_fs_dps": float("nan")}, "gyro_fs_dps is nan, expected a number above 0"),
        ({"gyro_unit": 5}, "gyro_unit is 5, expected text, as 'dps'"),
        ({"columns": [5]}, r"columns is \[5\], expected a list of words"),
        ({"where": 5}, "where is 5, expected text, as 'id=0'"),
        ({"lines": (1, 5)}, r"lines is \(1, 5\), expected text, as '1-2991'"),
        ({**TOLD, "time_unit": "ns"}, "no sensor has less than"),
    ],
)
def test_an_answer_of_another_kind_is_refused_in_one_line(told, said, tmp_path):
    path = written(tmp_path / "sketch.csv", USUAL.encode())
    for call in (tinygc.read_log, lambda log, **all_: tinygc.import_log(log, tmp_path / "s", **all_)):
        with pytest.raises(tinygc.CalibrationError, match=said) as refused:
            call(path, **told)
        assert "\n" not in str(refused.value)
    assert not (tmp_path / "s").exists()


def test_the_command_lists_every_kind_names_the_folder_as_the_log_and_takes_columns_for_each_file(run, tmp_path, monkeypatch):
    assert run("import", "--list", "--json", tmp_path / "x.json")[0] == 0
    assert len(json.loads((tmp_path / "x.json").read_text())["readers"]) > 20
    for name, text in (
        ("flight_3", TEXTS["EuRoC"].write(SAMPLES)[0][1]),
        ("g", GYR.replace("t_us,gx_dps,gy_dps,gz_dps", "a,b,c,d").encode()),
    ):
        written(tmp_path / f"{name}.csv", text)
    written(tmp_path / "a.csv", ACC.replace("t_us,ax_g,ay_g,az_g", "u,v,w,x").encode())
    monkeypatch.chdir(tmp_path)
    assert run("import", "flight_3.csv")[0] == 0
    assert (tmp_path / "flight_3" / "session.toml").exists()
    gyro, accel = ("--columns", "t_us=a,gx_dps=b,gy_dps=c,gz_dps=d"), ("--columns", "t_us=u,ax_g=v,ay_g=w,az_g=x")
    assert run("import", "g.csv", "a.csv", "--out", "s", *gyro, *accel)[0] == 0
    np.testing.assert_allclose(read_session(tmp_path / "s").logs[0].samples.gyro, SAMPLES.gyro, atol=1e-10)
    code, _, said = run("import", "g.csv", "a.csv", "--out", "t", *gyro * 3)
    assert (code, "3 times for 2 files" in said) == (2, True)
