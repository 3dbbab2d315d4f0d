"""Foreign logs as they are: torn, quoted, packed, damaged."""

import gzip

import pytest
from dialect_logs import DIALECTS, SAMPLES, T_US, inertial, make, rows, same, triads

from session.io.errors import FormatError
from tinygc import CalibrationError

# Hostile


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: "", ("empty",)),
        (lambda text: "\n\n", ("empty",)),
        (lambda text: text.split("\n")[0] + "\n", ("no samples",)),
        (lambda text: "\0\1\2\3" * 100, ("not a text log",)),
        (lambda text: text.encode("utf-16-le"), ("not a text log",)),
        (lambda text: "hello\nworld\n", ("no header", "--columns")),
        (lambda text: "a,b,c\n1,2,3\n", ("no header", "'a,b,c'")),
        (lambda text: _line(text, 40, "1,2,3"), ("line 41", "3 columns")),
        (lambda text: _line(text, 40, "384615,x,0,0,0,0,0"), ("line 41", "Gyroscope X", "'x'")),
        (lambda text: _line(text, 40, "384615,,0,0,0,0,0"), ("line 41",)),
        (lambda text: _line(text, 40, "384615,nan,0,0,0,0,0"), ("line 41", "Gyroscope X", "expected a finite number")),
        (lambda text: _line(text, 40, "384615,1e999,0,0,0,0,0"), ("line 41", "is inf, expected a finite number")),
        (lambda text: _line(text, 40, "384615,0,1e308,0,0,0,0"), ("LOG.CSV line 41", "Gyroscope Y", "1e+308", "unit")),
        (lambda text: _line(text, 40, "384615,0,0,0,0,0,-1e5"), ("LOG.CSV line 41", "Accelerometer Z", "10000 g")),
        (lambda text: _line(text, 40, "nan,0,0,0,0,0,0"), ("line 41", "Timestamp")),
        (lambda text: _line(text, 40, "9" * 40 + ",0,0,0,0,0,0"), ("line 41", "Timestamp", "no time of this era")),
        (lambda text: _line(text, 40, "1_000,0,0,0,0,0,0"), ("line 41",)),
        (lambda text: _line(_line(text, 40, "5,0,0,0,0,0,0"), 41, "6,0,0,0,0,0,0"), ("line 41", "begins again at 5e-06 s: a restart")),
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


DISORDER = {
    "bom": lambda text: "\ufeff" + text,
    "crlf": lambda text: text.replace("\n", "\r\n"),
    "terminated": lambda text: text.replace("\n", "\0\n"),
    "terminated crlf": lambda text: text.replace("\n", "\0\r\n"),
    "trailing comma": lambda text: text.replace("\n", ",\n"),
    "no last newline": lambda text: text.rstrip("\n"),
    "blank lines": lambda text: "\n\n" + text.replace("\n", "\n\n"),
    "lines of blanks": lambda text: text.replace("\n", "\n  \n"),
    "empty rows of a spreadsheet": lambda text: text.replace("\n", "\n,,,,,,\n"),
    "utf-16": lambda text: text.encode("utf-16"),
    "utf-16, the other order": lambda text: b"\xfe\xff" + text.replace("\n", "\r\n").encode("utf-16-be"),
    "windows": lambda text: text.replace("deg/s", "°/s").encode("cp1252"),
    "spaces": lambda text: text.replace(",", " , "),
    "semicolons": lambda text: text.replace(",", ";"),
    "tabs": lambda text: text.replace(",", "\t"),
    "preamble": lambda text: "x-IMU3 log,v1\nserial,0123\n\n" + text,
    "header again": lambda text: text + text.split("\n")[0] + "\n",
    "torn": lambda text: text + "384615,12.5",
    "quoted": lambda text: '"' + text.split("\n")[0].replace(",", '","') + '"\n' + text.split("\n", 1)[1],
}


@pytest.mark.parametrize("name", DISORDER)
def test_ordinary_disorder_changes_nothing(name, tmp_path):
    same(make(tmp_path, DISORDER[name](inertial())))


def test_a_broken_gzip_gives_what_came_before(tmp_path):
    packed = gzip.compress(inertial().encode())
    made = make(tmp_path, packed[: len(packed) // 2], name="log.csv.gz")
    assert 100 < made.samples < len(SAMPLES)
    assert any("breaks off" in note for note in made.notes)
    with pytest.raises(FormatError, match="gzip"):
        make(tmp_path, b"no gzip", name="log.csv.gz", out="other")


def test_pieces_of_a_file_join_without_a_seam(tmp_path, monkeypatch):
    from session.io import lines

    monkeypatch.setattr(lines.Lines.take, "__defaults__", (1000,))
    monkeypatch.setattr(lines, "READ_BYTES", 100)
    for number, text in enumerate((inertial(), DIALECTS["OpenLog Artemis"]())):
        same(make(tmp_path, text, out=f"session{number}"))
    with pytest.raises(FormatError, match="line 401"):
        make(tmp_path, _line(inertial(), 400, "1,2,3"), out="bad")


# The folder


@pytest.mark.parametrize("place", [1, 6, 7])
def test_a_quotation_mark_that_is_not_closed_takes_no_lines_along(tmp_path, place):
    """Found by fuzzing: NumPy reads on to the next one, in a column that nobody needs without a word."""
    text = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,remark\n" + rows(T_US, *triads("dps", "g"), ["ok"] * len(T_US))
    lines = text.splitlines(keepends=True)
    for number in (40, 60):
        cells = lines[number].rstrip("\n").split(",")
        cells[place] = f'"{cells[place]}'
        lines[number] = ",".join(cells) + "\n"
    with pytest.raises(FormatError, match=r"line 41: a quotation mark that is not closed") as refused:
        make(tmp_path, "".join(lines))
    assert "\n" not in str(refused.value)
    closed = "".join(lines[:1]) + "".join(line.replace('"', "").replace(",ok", ',"o, k"') for line in lines[1:])
    same(make(tmp_path, closed, out="closed"))
