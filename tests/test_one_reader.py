"""``fit`` and ``apply`` read a log through the same reader; a session's own logs are held to the letter of docs/formats.md."""

import gzip

import numpy as np
import pytest
from conftest import broad

from session.io.config import Sensor
from session.io.dialects import Answers
from session.io.errors import FormatError
from session.io.lines import PIECE_BYTES, Lines
from session.io.logfile import read_log
from session.io.reader import Reader
from session.io.units import ACCEL, DEG, GYRO, STAMP_NS, TIME, G, endings

pytestmark = pytest.mark.broad

SENSOR = Sensor("ASM330LHH", "42", 208.0, 500.0, 4.0)
REGISTERS = "t_us,gx,gy,gz,ax,ay,az,temp"
UNITS = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"


def log(tmp_path, header, rows, name="log0001.csv"):
    path = tmp_path / name
    data = (header + "\n" + "".join(f"{row}\n" for row in rows)).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


def registers(count=3000):
    values = np.random.default_rng(0).integers(-3000, 3000, (count, 7))
    return [",".join(map(str, [4808 * i, *row])) for i, row in enumerate(values.tolist())]


@pytest.mark.parametrize("header", [REGISTERS, UNITS, broad(REGISTERS.replace("t_us", "t_ns")), broad(UNITS.replace("t_s", "t_us"))])
def test_a_log_of_ours_gives_apply_what_it_gives_fit(header, tmp_path):
    """The same stamps, and the same readings to the bit, whether it is read strictly and whole or in pieces."""
    scaled = "dps" in header
    rows = [",".join([row.split(",")[0], *(str(int(x) / 128) if scaled else x for x in row.split(",")[1 : header.count(",") + 1])])
            for row in registers(20_000)]  # fmt: skip
    path = log(tmp_path, header, rows)
    strict, reader = read_log(path, SENSOR).samples, Reader(path, Answers())
    pieces = list(reader.pieces(size=5000))
    assert len(pieces) > 3
    np.testing.assert_array_equal(np.concatenate([piece.t_ns for piece in pieces]), strict.t_ns)
    np.testing.assert_array_equal(
        np.concatenate([piece.gyro for piece in pieces]) * reader.layout.gyro_si(SENSOR.register_units), strict.gyro
    )
    np.testing.assert_array_equal(
        np.concatenate([piece.accel for piece in pieces]) * reader.layout.accel_si(SENSOR.register_units), strict.accel
    )


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),"
         "Accelerometer Z (g)", "no time column"),
        ("boot ok", "no header line"),
        (REGISTERS.replace(",", ";"), "separated by semicolons"),
    ],
)  # fmt: skip
def test_a_session_does_not_take_another_programs_log_for_its_own(header, said, tmp_path):
    """What ``import`` reads, a session's own folder refuses: its units and axes were never asked for."""
    with pytest.raises(FormatError, match=said):
        read_log(log(tmp_path, header, registers(20)), SENSOR)


@pytest.mark.parametrize("change", [lambda row: f'"{row.split(",")[0]}",' + row.split(",", 1)[1], lambda row: REGISTERS])
def test_quotes_and_a_header_that_comes_again_are_no_part_of_a_standard_log(change, tmp_path):
    rows = registers(20)
    rows[10] = change(rows[10])
    path = log(tmp_path, REGISTERS, rows)
    with pytest.raises(FormatError, match=r"line 12: t_us is .*expected a whole number"):
        read_log(path, SENSOR)
    assert sum(len(piece.gyro) for piece in Reader(path, Answers()).pieces()) in (19, 20)


@pytest.mark.parametrize("start", ["1700000000.123456789", "1699999999.999999999", "1.7e9"])
def test_seconds_of_a_running_clock_keep_every_nanosecond(start, tmp_path):
    """A float64 has steps of 238 ns there."""
    path = log(tmp_path, UNITS, [f"{start},1,2,3,0,0,1", "1700000001.000000001,1,2,3,0,0,1", "1700000001.000000002,1,2,3,0,0,1"])
    whole, _, part = start.partition(".")
    first = 1_700_000_000 * 10**9 if "e" in start else int(whole) * 10**9 + int(part)
    assert read_log(path, SENSOR).samples.t_ns.tolist() == [first, 1_700_000_001_000_000_001, 1_700_000_001_000_000_002]


def test_seconds_of_some_days_are_right_to_the_nanosecond():
    """Up to 2^50 ns the fast way, by a float64, gives what the decimal text says."""
    from session.io.numbers import CLOSE_NS, parse
    from session.io.standard import parse_header

    t_ns = np.random.default_rng(1).integers(-CLOSE_NS + 1, CLOSE_NS, 20_000)
    texts = [f"{'-' if t < 0 else ''}{abs(t) // 10**9}.{abs(t) % 10**9:09d}" for t in t_ns.tolist()]
    layout = parse_header(UNITS, "here")
    _, stamps = parse([f"{text},1,2,3,0,0,1" for text in texts], layout)
    assert stamps.tolist() == t_ns.tolist()


def test_a_log_may_begin_with_any_number_of_comments(tmp_path):
    comments = "".join(f"# line={number} of a long preamble that some board writes before anything else\n" for number in range(3000))
    path = log(tmp_path, comments + REGISTERS, registers(20))
    found = read_log(path, SENSOR)
    assert len(found.samples) == 20
    assert found.comments == {"line": "2999"}
    assert len(next(Reader(path, Answers()).pieces()).gyro) == 20


def packed(*texts):
    return b"".join(gzip.compress(text.encode()) for text in texts)


@pytest.mark.parametrize(
    ("data", "lines", "note"),
    [
        (packed("a\nb\n", "c\n"), ["a", "b", "c"], False),
        (packed("a\nb\n") + b"\0" * 512, ["a", "b"], False),
        (packed("a\nb\n", "c\n")[:-3], ["a", "b", "c"], True),
        (packed("a\nb\n") + b"junk", ["a", "b"], True),
        (packed("a\nb\n")[:-8] + b"\0" * 8, None, True),
    ],
    ids=["two members", "padded", "cut off", "junk behind", "wrong checksum"],
)
def test_a_packed_file_is_read_as_far_as_it_is_sound(data, lines, note, tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(data)
    with Lines(path) as file:
        if lines is None:
            with pytest.raises(FormatError, match="not a gzip file, or a damaged one"):
                file.take()
            return
        taken = [*file.take(), *file.take()]
    assert taken == lines
    assert bool(file.note) == note


def test_registers_of_a_dialect_are_registers(tmp_path):
    path = log(tmp_path, "t,a,b,c,d,e,f", ["1,2,3,4,5,6,7", "2,2,3,40000,5,6,7"])
    reader = Reader(path, Answers(columns="t_ms=t,gx=a,gy=b,gz=c,ax=d,ay=e,az=f"))
    with pytest.raises(FormatError, match="line 3: c is 40000, no 16-bit register value"):
        list(reader.pieces())


def wandering(count=400):
    """(N, 7): three of a gyroscope about -20, three of an accelerometer, a thermometer at -3900."""
    rng = np.random.default_rng(3)
    slow = np.cumsum(rng.normal(size=(count, 7)) * 60, axis=0)
    return np.rint(slow + np.array([-20, 30, 5, -300, 100, 8192, -3900])).astype(int)


@pytest.mark.parametrize("size", [PIECE_BYTES, 1000, 40], ids=["one piece", "pieces", "a row each"])
@pytest.mark.parametrize("columns", [slice(0, 3), slice(3, 6), slice(6, 7), slice(0, 7)])
def test_unsigned_registers_are_read_signed(tmp_path, columns, size):
    signed = wandering()
    written = signed.copy()
    written[:, columns] %= 1 << 16
    lines = [",".join(map(str, (10_000 * i, *row))) for i, row in enumerate(written)]
    path = log(tmp_path, "t_us,gx,gy,gz,ax,ay,az,temp", lines)
    reader = Reader(path, None)
    pieces = list(reader.pieces(size))
    read = np.concatenate([np.column_stack([piece.gyro, piece.accel, piece.temp]) for piece in pieces])
    assert np.array_equal(read, signed)
    assert "unsigned registers; 65535 is read as -1" in reader.notes[0]
    assert len(reader.notes) == (3 if columns == slice(0, 7) else 1)


OTHERS = {
    "offset binary": np.full(400, 32768),
    "glitches": 50_000 * (np.arange(400) % 50 == 9),
    "a glitch": 60_000 * (np.arange(400) == 99),
}


@pytest.mark.parametrize("added", OTHERS.values(), ids=OTHERS)
def test_other_numbers_beyond_sixteen_bits_are_refused(tmp_path, added):
    gyro = np.abs(wandering()[:, :3]) % 1000 + added[:, None]
    lines = [",".join(map(str, (10_000 * i, *row, 0, 0, 8192))) for i, row in enumerate(gyro)]
    with pytest.raises(FormatError, match="no 16-bit register value"):
        list(Reader(log(tmp_path, "t_us,gx,gy,gz,ax,ay,az", lines), None).pieces())


def test_one_table_of_units():
    assert STAMP_NS == {"t_ns": 1, "t_us": 1000, "t_s": 10**9}
    assert {ending: unit.si for ending, unit in endings("gyro").items()} == {"": None, "_dps": DEG, "_rps": 1.0}
    assert {ending: unit.si for ending, unit in endings("accel").items()} == {"": None, "_g": G, "_mps2": 1.0}
    assert {ending: unit.si for ending, unit in endings("temp").items()} == {"": None, "_c": 1.0}
    assert (GYRO["mdps"] * 1000, ACCEL["mg"] * 1000, TIME["ms"]) == (pytest.approx(DEG), pytest.approx(G), 10**6)
