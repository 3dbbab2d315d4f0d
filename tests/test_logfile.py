"""Logs of a session: every header that docs/formats.md allows gives the same physics, and each malformed log says what and where."""

import gzip

import numpy as np
import pytest
from conftest import SESSION_TOML
from dialect_logs import ACCEL_G, ACCELS, GYRO_DPS, GYROS, HEADER, SENSOR, TEMPS, TIMES, G, assert_the_four_readings, read, text_of

from session.base.errors import DataError, FormatError
from session.detect.first_look import first_look
from session.log.config import Sensor
from session.log.lines import PIECE_BYTES, Lines
from session.log.reader import Reader
from tinygc import CalibrationError, read_session

UNITS = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"
LINES = text_of().splitlines()


def joined(*lines):
    return "\n".join(lines) + "\n"


def row(text, number=3):
    """The four readings with another line in the place of the second one (line 3 of the file)."""
    return joined(*LINES[: number - 1], text, *LINES[number:])


def registers(count, period_us=4808):
    values = np.random.default_rng(0).integers(-3000, 3000, (count, 7))
    return [",".join(map(str, [period_us * i, *line])) for i, line in enumerate(values.tolist())]


# What is read


@pytest.mark.parametrize(
    ("time", "gyro", "accel", "temp"),
    [
        *zip(TIMES, GYROS, ACCELS, TEMPS, strict=True),
        *zip(TIMES, [*GYROS][::-1], ACCELS, [*TEMPS][::-1], strict=True),
        ("t_us", "_dps", "", "temp"),
    ],
)
def test_every_unit_gives_the_same_samples(tmp_path, time, gyro, accel, temp):
    log = read(tmp_path, text_of(time, gyro, accel, temp))
    assert_the_four_readings(log, temp is not None)
    assert (log.notes, log.raw) == ((), "" in (gyro, accel))


def shuffled():
    for i, line in enumerate(LINES):
        t, gx, gy, gz, ax, ay, az, temp = line.split(",")
        yield ",".join([ax, "note,more" if i == 0 else "text, no", temp, gz, gy, gx, az, ay, t, "crc" if i == 0 else "0x1f"])


#: text of a log that holds the four readings, and words of its one note
SAME = {
    "line ends": (text_of(end="\r\n"), ""),
    "a byte order mark and trailing commas": ("\ufeff" + text_of(extra=","), ""),
    "no last end": (text_of().rstrip("\n"), ""),
    "other columns, in any order": (joined(*shuffled()), ""),
    "a stamp that is repeated": (joined(*LINES[:3], LINES[2], *LINES[3:]), "1 rows repeat the row before"),
    "a last line that was cut off": (text_of() + "1019231,4", "line 6"),
    "in its last cell": (text_of() + "1019231,4,5,6,1,2,3,-", "cut off"),
    "in its stamp": (text_of() + "10", "cut off"),
}


@pytest.mark.parametrize("name", SAME)
def test_ordinary_disorder_does_no_harm(tmp_path, name):
    text, note = SAME[name]
    log = read(tmp_path, text, "log.csv.gz")
    assert_the_four_readings(log)
    assert len(log.notes) == bool(note)
    assert not note or note in log.notes[0]


def test_comments_are_kept_wherever_they_stand_and_however_many_there_are(tmp_path):
    lines = [*LINES[:3], "# odr_hz=211.4 serial=7", *LINES[3:]]
    log = read(tmp_path, "# a board\n\n# gyro_fs_dps=500 odr_hz=211.3\n" + joined(*lines))
    assert_the_four_readings(log)
    assert log.comments == {"gyro_fs_dps": "500", "odr_hz": "211.4", "serial": "7"}
    many = "".join(f"# line={number} of a long preamble that some board writes before anything else\n" for number in range(3000))
    assert read(tmp_path, many + text_of()).comments == {"line": "2999"}


def test_zeros_that_a_lost_power_left_at_the_end_are_left_out(tmp_path):
    log = read(tmp_path, joined(HEADER, *registers(200)).encode() + bytes(300))
    assert (len(log.samples), "cut off" in log.notes[0]) == (200, True)


def test_the_sensitivity_follows_the_full_scale(tmp_path):
    wide = read(tmp_path, text_of(), sensor=Sensor("ASM330LHH", "", 208.0, 2000.0, 16.0)).samples
    np.testing.assert_allclose(np.rad2deg(wide.gyro), 4 * GYRO_DPS)
    np.testing.assert_allclose(wide.accel, 4 * ACCEL_G * G)
    with pytest.raises(FormatError, match=r"gyro_fs_dps = 245 .*125, 250, 500"):
        read(tmp_path, text_of(), sensor=Sensor("ASM330LHH", "", 208.0, 245.0, 4.0))


@pytest.mark.parametrize(
    ("header", "stamps", "steps"),
    [
        (HEADER.replace("t_us", "t_ns"), [1_700_000_000_123_456_789 + i * 4_807_693 for i in range(5)], {4_807_693}),
        (HEADER, [(2**32 - 10_000 + 4808 * i) % 2**32 for i in range(6)], {4_808_000}),
        # A float64 has steps of 238 ns there.
        (UNITS, ["1699999999.999999999", "1700000000.000000001", "1700000000.000000003"], {2}),
        (UNITS, ["1.7e9", "1700000000.000000001", "1700000000.000000002"], {1}),
    ],
)
def test_stamps_of_a_running_clock_keep_every_nanosecond_and_a_counter_runs_on(tmp_path, header, stamps, steps):
    log = read(tmp_path, joined(header, *(f"{t},{','.join('1234567'[: header.count(',')])}" for t in stamps)))
    assert set(np.diff(log.samples.t_ns)) == steps
    assert len(log.notes) == (header == HEADER)  # came round 1x


def late(kind, t_us, rng):
    """Stamps of a sensor's samples (N,) us: rounded to 5 or 10 ms, of arrival, or, every 5 s, those of some rows that of their end."""
    if kind == "arrival":
        return np.maximum.accumulate(t_us + rng.exponential(4000, len(t_us)))
    if isinstance(kind, int):
        return np.rint(t_us / kind) * kind
    into = t_us % 5e6
    return np.where((into < kind * 1e6) & (t_us > 1e6), t_us - into + kind * 1e6, t_us)


@pytest.mark.parametrize(
    ("kind", "lost", "says"),
    [
        (10_000, 0, "counted along"),
        ("arrival", 0, "counted"),
        (0.4, 0, "counted"),
        (0.03, 0, "placed"),
        (5000, 12, "placed"),
        (10_000, 12, None),
    ],
)
def test_rows_that_share_a_stamp_keep_their_readings_and_get_their_times(tmp_path, kind, lost, says):
    """207.06 Hz: none is missing, though the stamps say 200; where some are, none is made up."""
    rng, t_us = np.random.default_rng(1), np.arange(12_000) * 1e6 / 207.06
    kept = np.delete(np.arange(len(t_us)), slice(5000, 5000 + lost))
    stamps = np.rint(late(kind, t_us, rng))[kept].astype(int)
    text = HEADER + "\n" + "".join(f"{t},{i % 999},{i % 998},3,4,5,6,7\n" for i, t in enumerate(stamps))
    if says is None:
        with pytest.raises(DataError, match=r"share a stamp.*samples are missing, or stamps come too late.* --odr HZ"):
            read(tmp_path, text)
        return
    log = read(tmp_path, text)
    off_us = (log.samples.t_ns - log.samples.t_ns[0]) / 1000 - (t_us - t_us[0])[kept]
    assert any(says in note for note in log.notes)
    assert np.abs(off_us).max() < (0.5 if lost else 0.15) * 1e6 / 207.06  # of stamps of 5 ms that stay: half of these
    assert lost or 1 / log.samples.period_s == pytest.approx(207.06, rel=1e-5)


# In pieces


def test_pieces_of_a_log_are_those_of_the_whole(tmp_path):
    """The same stamps, and the same readings to the bit, as ``apply`` reads it and as ``fit`` does."""
    strict = read(tmp_path, joined(HEADER, *registers(20_000))).samples
    reader = Reader(tmp_path / "log0001.csv")
    pieces = list(reader.pieces(size=5000))
    assert len(pieces) > 3
    whole = {name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("t_ns", "gyro", "accel")}
    np.testing.assert_array_equal(whole["t_ns"], strict.t_ns)
    np.testing.assert_array_equal(whole["gyro"] * reader.layout.gyro_si(SENSOR.register_units), strict.gyro)
    np.testing.assert_array_equal(whole["accel"] * reader.layout.accel_si(SENSOR.register_units), strict.accel)


def test_beyond_the_first_megabyte_lines_are_counted_and_a_counter_runs_on(tmp_path):
    """With comments and blank lines before it."""
    lines = registers(34_000)
    lines[100:100] = ["# a comment", "", "# another"]
    lines[32_000:32_002] = [f"{t_us},1,2,3,-4,5,-8192,0" for t_us in (120_000_000, 120_004_808)]
    with pytest.raises(FormatError, match=r"log0001\.csv line 32003: t_us goes backward"):
        read(tmp_path, joined("# gyro_fs_dps=500", HEADER, *lines))
    first = 2**32 - 40_000 * 4808
    log = read(tmp_path, joined(HEADER, *(f"{(first + 4808 * i) % 2**32},{i % 100},2,3,-4,5,-8192,0" for i in range(44_000))))
    np.testing.assert_array_equal(np.diff(log.samples.t_ns), 4808_000)
    packed = gzip.compress(joined(HEADER, *registers(20_000)).encode())
    (tmp_path / "log.csv.gz").write_bytes(packed[: len(packed) // 2])
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    (tmp_path / "log0001.csv").unlink()
    session = read_session(tmp_path)
    (log,) = session.logs
    assert 5_000 < len(log.samples) < 15_000
    (finding,) = [each for each in first_look(session, log, [], None) if "breaks off" in each.description]
    assert (finding.level, finding.do) == ("warning", "copy it again, whole: turns may be missing")


def packed(*texts):
    return b"".join(gzip.compress(text.encode()) for text in texts)


@pytest.mark.parametrize(
    ("data", "lines", "note"),
    [
        (packed("a\nb\n", "c\n"), ["a", "b", "c"], False),
        (packed("a\nb\n") + b"\0" * 512, ["a", "b"], False),
        (packed("a\nb\n", "c\n")[:-3], ["a", "b", "c"], True),
        (packed("a\nb\n") + b"junk", ["a", "b"], True),
        (packed("a\nb\n")[:-8] + b"\0" * 8, ["a", "b"], True),
        (b"a\nb\n", None, True),
    ],
    ids=["two members", "padded", "cut off", "junk behind", "wrong checksum", "text"],
)
def test_a_packed_file_is_read_as_far_as_it_is_sound(data, lines, note, tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(data)
    if lines is None:
        with pytest.raises(FormatError, match="not a gzip file"), Lines(path) as file:
            file.take()
        return
    with Lines(path) as file:
        assert [*file.take(), *file.take()] == lines
    assert bool(file.note) == note


def wandering():
    """(400, 7): three of a gyroscope about -20, three of an accelerometer, a thermometer at -3900."""
    slow = np.cumsum(np.random.default_rng(3).normal(size=(400, 7)) * 60, axis=0)
    return np.rint(slow + np.array([-20, 30, 5, -300, 100, 8192, -3900])).astype(int)


@pytest.mark.parametrize("size", [PIECE_BYTES, 40], ids=["one piece", "a row each"])
@pytest.mark.parametrize("columns", [slice(3, 6), slice(6, 7), slice(0, 7)])
def test_unsigned_registers_are_read_signed(tmp_path, columns, size):
    signed, path = wandering(), tmp_path / "log.csv"
    written = signed.copy()
    written[:, columns] %= 1 << 16
    path.write_text(joined(HEADER, *(",".join(map(str, (10_000 * i, *line))) for i, line in enumerate(written))))
    reader = Reader(path)
    read = np.concatenate([np.column_stack([piece.gyro, piece.accel, piece.temp]) for piece in reader.pieces(size)])
    np.testing.assert_array_equal(read, signed)
    assert "unsigned registers; 65535 is read as -1" in reader.notes[0]


@pytest.mark.parametrize("added", [np.full(400, 32768), 50_000 * (np.arange(400) % 50 == 9)], ids=["offset binary", "glitches"])
def test_other_numbers_beyond_sixteen_bits_are_refused(tmp_path, added):
    gyro, path = np.abs(wandering()[:, :3]) % 1000 + added[:, None], tmp_path / "log.csv"
    path.write_text(joined(HEADER[:-5], *(",".join(map(str, (10_000 * i, *line, 0, 0, 8192))) for i, line in enumerate(gyro))))
    with pytest.raises(FormatError, match="no 16-bit register value"):
        list(Reader(path).pieces())


# What is refused


def second(number, cell, time="t_us", **units):
    """A log whose second reading has another text in a column."""
    lines = text_of(time, **units).splitlines()
    cells = lines[2].split(",")
    cells[number] = cell
    return joined(*lines[:2], ",".join(cells), *lines[3:])


IN_UNITS = {"gyro": "_dps", "accel": "_g", "temp": "temp_c"}
REFUSED = [
    ("", "empty"),
    (HEADER, "no samples"),
    (joined(*LINES[1:]), "no header"),
    (text_of().replace("gz", "gq"), "gyroscope"),
    (text_of().replace("t_us", "time"), "no time column"),
    (text_of().replace("t_us", "t_s,t_us"), "time"),
    (text_of(gyro="_dps").replace("gx_dps", "gx_rps"), "gyroscope"),
    (text_of(gyro="_dps").replace("gy_dps", "gy_DPS"), "unknown unit in 'gy_DPS'; known are gx, gx_dps"),
    (text_of().replace("temp", "temp,temp_c"), "two temperature columns"),
    (text_of().replace("temp", "temp_f"), "'temp_f': a temperature is in degC; convert it and call it temp_c"),
    (text_of().replace("gz,", "gz,gz,", 1), "line 1: the column gz stands 2 times; keep one, or rename the other"),
    (text_of().replace(",", ";"), "line 1: separated by semicolons; expected commas"),
    (text_of().upper(), "(is 'T_US' meant as 't_us'?)"),
    (b"\x7fELF\0\0\0" * 40, "not a text log (UTF-16 or binary)"),
    (b"H Product:Blackbox flight data recorder\nI\0\1\n" * 40, "export it with Betaflight's blackbox_decode"),
    (row("Boot v1.2 0x6B ok", 4), "line 4: 1 columns"),
    (row('"1004808",1,2,3,4,5,6,7'), "line 3: t_us is '\"1004808\"', expected a whole number"),
    (
        joined("# one", "", HEADER, "", "1,1,2,3,4,5,6,7", "# five", "2,1,2,3,4,5,6,7", "3,oops,2,3,4,5,6,7", "4,1,2,3,4,5,6,7"),
        "line 8: gx is 'oops'",
    ),
    (second(3, "x"), "line 3: gz is 'x'"),
    (second(3, "3.5"), "line 3: gz is '3.5', expected a whole number"),
    (second(3, "32768"), "line 3: gz is 32768, no 16-bit register"),
    (second(3, "\u0663"), "line 3: gz is"),
    (second(4, "4\x0c5"), "line 3: ax is '4\\x0c5'"),
    (second(3, "9" * 5000), "line 3: gz is '99999999999999999999'…, a number too long"),
    (second(0, "990000"), "line 3: t_us goes backward by 0.01 s"),
    (second(0, str(2**60)), f"line 3: t_us is {2**60}, which is no time of this era"),
    (second(0, "1e300", **IN_UNITS), "line 3: t_us is '1e300', expected a whole number"),
    (second(0, "1e300", "t_s"), "line 3: t_s is 1e+300, which is no time of this era"),
    *(
        (second(number, "nan", "t_s", **IN_UNITS), f"line 3: {name} is")
        for number, name in ((0, "t_s"), (2, "gy_dps"), (6, "az_g"), (7, "temp_c"))
    ),
    # what no sensor measures
    (second(2, "1e308", **IN_UNITS), "line 3: gy_dps is 1e+308"),
    (second(7, "1e300", **IN_UNITS), "line 3: temp_c"),
    # beyond a counter of 32 bits
    *(
        (joined(HEADER, *(f"{2**40 + 4808 * i - back * (i > 2)},1,2,3,4,5,6,7" for i in range(6))), "goes backward")
        for back in (2**31 + 1, 2**32 - 5000)
    ),
    # another program's log: its units and axes were never asked for
    (text_of().replace(HEADER, "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),X (g),Y (g)"), "line 1: no header line but"),
    (
        joined("t_us,gx,gy,gz,ax,ay,az,imu", *(f"{5000 * (i // 2)},{i % 2},2,3,4,5,6,{i % 2}" for i in range(80))),
        "give --where imu=0 to import",
    ),
]


@pytest.mark.parametrize(("text", "said"), REFUSED, ids=[f"{number} {said}"[:60] for number, (_, said) in enumerate(REFUSED)])
def test_a_malformed_log_says_what_and_where(tmp_path, text, said):
    with pytest.raises(CalibrationError) as error:
        read(tmp_path, text)
    assert said in str(error.value)
    assert "log0001.csv" in str(error.value)
    assert "\n" not in str(error.value)
