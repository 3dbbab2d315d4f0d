"""Arrays from their files on: what is read, what is refused in one line, what is simulated, and what an explanation says of a body."""

import gzip
import json
import shutil

import numpy as np
import pytest
from formats_page import strangers

import calibrate
import tinygc
from session.base.errors import FormatError
from session.base.records import plain
from tinygc import CalibrationError, SimulationOptions, check, read_session
from tinygc.features.arrays.feature import ArrayOptions, is_array
from tinygc.features.arrays.recording import read_array
from tinygc.features.arrays.simulation import simulate_array, write_array

TOML = """schema = "tinygc-session/1"

[sensor]
model = "MPU-9150"
serial = "board 7"
odr_hz = 100
gyro_fs_dps = 2000
accel_fs_g = 16

[site]
latitude_deg = 59.35

[notes]
operator = "Mara"
"""


HEADER = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"


def log(path, begin_s=0.0, value=0.0):
    """A log of a second at 100 Hz; value: its rate about x, dps."""
    text = "\n".join([HEADER, *(f"{begin_s + k / 100:.2f},{value},0,0,0,0,-1" for k in range(101)), ""])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


@pytest.fixture
def named(tmp_path):
    """An array of three units, whose logs name them: 0, 3 and 12, the last of them packed."""
    folder = tmp_path / "board"
    for which in ("log0001", "log0002", "closure0001"):
        for number, end in ((0, "csv"), (3, "csv"), (12, "csv.gz")):
            log(folder / f"{which}.unit{number}.{end}", 0.01 * number, float(number))
    (folder / "session.toml").write_text(TOML, encoding="utf-8")
    return folder


@pytest.fixture
def listed(tmp_path):
    """The same as a list of session folders, one of them beside the array's."""
    folder = tmp_path / "board"
    for name, value in (("imu0", 0.0), ("imu3", 3.0), ("../imu12", 12.0)):
        log(folder / name / "log0001.csv", 0.0, value)
        (folder / name / "session.toml").write_text(TOML.replace("board 7", f"chip {value:.0f}"), encoding="utf-8")
    return with_folders(folder, ["imu3", "../imu12", "imu0"])


def with_folders(folder, names):
    text = ", ".join(f'"{name}"' if isinstance(name, str) else str(name) for name in names)
    (folder / "session.toml").write_text(f'schema = "tinygc-session/1"\n[array]\nfolders = [{text}]\n', encoding="utf-8")
    return folder


def test_logs_that_name_their_units_are_an_array(named):
    array = read_array(named)
    assert is_array(named)
    assert array.numbers == (0, 3, 12)
    for number, unit in zip(array.numbers, array.units, strict=True):
        assert [each.path.name.split(".")[0] for each in unit.logs] == ["log0001", "log0002"]
        assert len(unit.closures) == 1
        samples = unit.logs[0].samples
        assert samples.t_ns[0] == number * 10_000_000  # the stamps stay as the unit's own clock gave them
        assert np.rad2deg(np.asarray(samples.gyro)[:, 0]) == pytest.approx(number)
        assert unit.config.notes == {"operator": "Mara"}
        assert unit.config.site.latitude_deg == 59.35


def test_folders_are_an_array_in_the_order_of_their_numbers_or_counted_where_they_have_none(listed):
    seen: list[str] = []
    array = read_array(listed, seen.append)
    assert array.numbers == (0, 3, 12)
    assert [unit.config.sensor.serial for unit in array.units] == ["chip 0", "chip 3", "chip 12"]
    assert seen == ["imu3/log0001.csv", "../imu12/log0001.csv", "imu0/log0001.csv"]
    for name, other in (("imu0", "left"), ("imu3", "right")):
        shutil.move(listed / name, listed / other)
    array = read_array(with_folders(listed, ["right", "left"]))
    assert array.numbers == (0, 1)
    assert [unit.config.sensor.serial for unit in array.units] == ["chip 3", "chip 0"]


def test_a_unit_has_a_serial_number_an_accelerometer_and_left_out_turns_of_its_own(named):
    """A turn that is left out is of the unit that its row names, else of the first; an unknown key is kept for the first look."""
    more = '\n[[array.unit]]\nnumber = 3\nserial = "x"\nsensor.serial = "B-3"\n'
    more += "accelerometer.bias_mps2 = [0.1, 0, 0]\naccelerometer.sigma_mg = 2\n"
    more += (
        '\n[[exclude]]\nlog = "log0001.unit3.csv"\nat_s = 0.5\n\n[[exclude]]\nlog = "log0002.csv"\nat_s = 0.7\n[array]\nfolder = ["a"]\n'
    )
    (named / "session.toml").write_text(TOML + more, encoding="utf-8")
    first, other, last = (unit.config for unit in read_array(named).units)
    assert [each.sensor.serial for each in (first, other, last)] == ["board 7", "B-3", "board 7"]
    assert other.accelerometer.bias_mps2.tolist() == [0.1, 0, 0]
    assert (other.accelerometer.source, first.accelerometer.source) == ("given", "none")
    assert other.sensor.odr_hz == 100
    left = [[(row.log, row.at_s) for row in each.exclude] for each in (first, other, last)]
    assert left == [[("log0002.unit0.csv", 0.7)], [("log0001.unit3.csv", 0.5)], []]
    assert first.unknown == (("array.folder", "array.folders"),)
    assert "array.unit.serial" in [key for key, _ in other.unknown]


def test_a_session_is_no_array_and_an_array_no_session(named):
    with pytest.raises(FormatError, match=r"an array of 3 units on one body, and no single session; `(python )?calibrate.py check "):
        read_session(named)
    for path in named.glob("*.unit*"):
        path.unlink()
    log(named / "log0001.csv")
    assert len(read_session(named).logs) == 1
    with pytest.raises(FormatError, match="is no array"):
        read_array(named)


def without(*patterns):
    def spoil(folder):
        for path in (path for pattern in patterns for path in folder.glob(pattern)):
            path.unlink()

    return spoil


def alike(folder):
    """Units 0 and 3 have the very same rates."""
    for unit in (0, 3):
        rows = [f"{k / 100:.2f},{k % 7}.5,0,0,0,0,-1" for k in range(101)]
        (folder / f"log0001.unit{unit}.csv").write_text("\n".join([HEADER, *rows, ""]), encoding="utf-8")


FAULTS = [
    (without("log0002.unit3.csv"), r"log0002 has no unit 3 of 0, 3, 12; every log needs a file of every unit: add log0002\.unit3\.csv"),
    (lambda at: log(at / "log0001.unit3.csv.gz"), r"log0001\.unit3\.csv and log0001\.unit3\.csv\.gz; keep one"),
    (lambda at: log(at / "log0003.csv"), r"log0003\.csv names no unit next to units 0, 3, 12; expected log0003\.unit0\.csv"),
    (lambda at: log(at / "log0003.unit03.csv"), r"log0003\.unit03\.csv: expected a unit's number from 0 to 9999 without leading zeros"),
    (without("*.unit3.*", "*.unit12.*"), r"an array of one unit \(unit 0\); expected two or more"),
    (lambda at: log(at / "log0001.unit3.csv", 500.0), r"units 0 and 3 have no time in common: log0001\.unit0\.csv is 0\.000 to 1\.000 s"),
    (lambda at: (at / "turns.csv").write_text("turn,axis,angle_deg,sigma_deg\n1,x,90,0.1\n"), r"turns\.csv is of one sensor's axes"),
    (alike, r"units 0 and 3 have the very same rates .* one sensor twice"),
    ('[protocol]\nreference = "table"\n', r'protocol\.reference is "table"; the reference of an array is "gravity"'),
    ("[[array.unit]]\nnumber = 3\n[[array.unit]]\nnumber = 3\n", r"number 3 is there twice"),
    ("[[array.unit]]\nnumber = 4\n", r"number 4 has no log; there are units 0, 3, 12"),
    ("[[array.unit]]\nnumber = 3\nsensor = 3\n", r"array\.unit\.sensor of unit 3 is 3, expected a table"),
    ("[[array.unit]]\nnumber = 3\nsensor.odr_hz = 'x'\n", r'session\.toml \(unit 3\): sensor\.odr_hz is "x"'),
    ("[accelerometer]\nbias_mps2 = [0, 0, 0]\n", r"\[accelerometer\] is of one unit"),
    ('[[exclude]]\nlog = "log0001.unit9.csv"\nat_s = 1\n', r"\[\[still\]\] names log0001\.unit9\.csv; there are units 0, 3, 12"),
    ("[array]\nfolders = []\n", r"array\.folders is a list of 0, expected session folders"),
    ('[array]\nfolders = ["a", "b"]\n', r"lies next to session\.toml with \[array\] folders"),
]


@pytest.mark.parametrize(("spoil", "says"), FAULTS, ids=[says[:20] for _, says in FAULTS])
def test_what_is_wrong_with_an_array_is_said_in_one_line(named, spoil, says):
    if callable(spoil):
        spoil(named)
    else:
        (named / "session.toml").write_text(TOML + spoil, encoding="utf-8")
    with pytest.raises(CalibrationError, match=says) as raised:
        read_array(named)
    assert "\n" not in str(raised.value)
    (finding,) = check(named)  # which never raises, but says the same
    assert finding.level == "error"
    assert str(raised.value) in finding.description


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["imu0", "imu4"], r'holds "imu4", which is not there'),
        (["imu0", "../board"], r"which is this folder itself"),
        (["imu0", "imu3", "x/imu3"], r'holds "imu3" and "x/imu3", both unit 3 by their ends; rename one'),
        (["imu0", "inner5"], r'"inner5", which is an array itself'),
        (["imu0", "two7"], r"unit 0 has 1 logs, unit 7 has 2"),
    ],
)
def test_a_folder_that_is_no_unit_is_said_in_one_line(listed, names, says):
    for other in ("x/imu3", "two7", "inner5"):
        shutil.copytree(listed / "imu3", listed / other)
    log(listed / "two7" / "log0002.csv", 5.0)
    for number in (0, 1):
        log(listed / "inner5" / f"log0001.unit{number}.csv")
    (listed / "inner5" / "log0001.csv").unlink()
    with pytest.raises(FormatError, match=says):
        read_array(with_folders(listed, names))


def test_an_array_is_listed(named):
    told = plain(tinygc.list_sessions(named)[0])
    assert [told[key] for key in ("units", "logs", "closures", "problem")] == [3, 2, 1, None]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("fit AT --physics auto", "--physics"),
        ("explain AT --noise some.json", "an array; leave it out, or give one unit a folder of its own"),
        ("history AT AT --compare", "an array of 3 units"),
        ("simulate --mounting-deg 3 --out AT/new", "--units"),
    ],
)
def test_what_makes_no_sense_of_an_array_is_refused_in_a_line(named, words, says, capsys):
    assert calibrate.main([*words.replace("AT", str(named)).split(), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert says in line


# Simulated arrays.


def test_the_command_writes_what_the_reader_reads_and_replaces_nothing_but_a_simulation(tmp_path, capsys):
    folder, table = tmp_path / "array", tmp_path / "x.json"
    words = f"simulate --units 2 --segments 1 --closure 12 --odr-hz 104 --out {folder} --json {table} --quiet".split()
    assert calibrate.main(words) == 0
    array = read_array(folder)
    assert array.numbers == (0, 1)
    assert all(len(unit.logs) == len(unit.closures) == 1 and not unit.config.unknown for unit in array.units)
    assert len({unit.config.sensor.serial for unit in array.units}) == 2
    for path in (folder / "truth.json", table):
        assert not strangers(json.loads(path.read_text(encoding="utf-8")))
    before = (folder / "log0001.unit1.csv.gz").read_bytes()
    assert calibrate.main([*words, "--force"]) == 0
    assert (folder / "log0001.unit1.csv.gz").read_bytes() == before
    assert calibrate.main(words) == 2
    (folder / "log0002.csv").write_text("mine")
    assert calibrate.main([*words, "--force"]) == 2
    assert "log0002.csv" in capsys.readouterr().err.splitlines()[-1]
    (folder / "log0002.csv").unlink()
    (folder / "session.toml").write_text('schema = "tinygc-session/1"\n')
    assert calibrate.main([*words, "--force"]) == 2
    assert "not replaced" in capsys.readouterr().err


# An explanation.


@pytest.mark.broad
def test_what_is_in_one_unit_is_said_of_it(tmp_path, capsys):
    """Unit 0's zero follows gravity, and the body is knocked."""
    matrix = np.array([[0.06, 0.0, 0.02], [0.0, -0.05, 0.0], [0.03, 0.0, 0.04]]) * np.radians(1) / 9.80665
    made = simulate_array(
        SimulationOptions(segments=8, closure_s=0, odr_hz=62.5, seed=8),
        ArrayOptions(units=2, knock_deg=1.0),
        distort={0: lambda t_s, rate, force, temp_c: rate + force @ matrix.T},
    )
    folder, out, table = write_array(made, tmp_path / "array"), tmp_path / "out", tmp_path / "x.json"
    assert calibrate.main(["explain", str(folder), "--out", str(out), "--json", str(table), "--strict"]) == 1
    assert "a knock, no false reading" in " ".join(capsys.readouterr().out.split())
    written = json.loads(table.read_text(encoding="utf-8"))
    assert written == json.loads((out / "array.json").read_text(encoding="utf-8"))
    assert not strangers(written)
    (gravity,) = (each for each in written["statements"] if each.get("id") == "gyro.g_sensitivity")
    assert (gravity["scope"], gravity["units"]) == ("differs", [0])
    np.testing.assert_allclose(gravity["by_unit"][0]["value"], 9.80665 * matrix.ravel(), atol=np.radians(5e-3))
    assert np.abs(gravity["by_unit"][1]["value"]).max() < np.radians(5e-3)
    for unit in written["units"]:
        assert not strangers(json.loads((out / unit["explained"]).read_text(encoding="utf-8")))
