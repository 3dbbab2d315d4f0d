"""Arrays as files: what is read, and the one line that says what is wrong with one that cannot be."""

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import calibrate
from benchmarks.public.__main__ import main as public
from session.annexes.arrays.recording import array_log_paths, read_array
from session.io.errors import DataError, FormatError
from session.io.names import is_array
from tinygc import CalibrationError, check, read_session
from tinygc.estimation.listing import list_sessions

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


def log(path: Path, begin_s: float = 0.0, value: float = 0.0) -> Path:
    """A log of a second at 100 Hz; value: its rate about x, dps."""
    text = "\n".join([HEADER, *(f"{begin_s + k / 100:.2f},{value},0,0,0,0,-1" for k in range(101)), ""])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


@pytest.fixture
def named(tmp_path: Path) -> Path:
    """An array of three units, whose logs name them: 0, 3 and 12, the last of them packed."""
    folder = tmp_path / "board"
    for which in ("log0001", "log0002", "closure0001"):
        for number, end in ((0, "csv"), (3, "csv"), (12, "csv.gz")):
            log(folder / f"{which}.unit{number}.{end}", 0.01 * number, float(number))
    (folder / "session.toml").write_text(TOML, encoding="utf-8")
    return folder


@pytest.fixture
def listed(tmp_path: Path) -> Path:
    """The same as a list of session folders, one of them beside the array's."""
    folder = tmp_path / "board"
    for name, value in (("imu0", 0.0), ("imu3", 3.0), ("../imu12", 12.0)):
        log(folder / name / "log0001.csv", 0.0, value)
        (folder / name / "session.toml").write_text(TOML.replace("board 7", f"chip {value:.0f}"), encoding="utf-8")
    return with_folders(folder, ["imu3", "../imu12", "imu0"])


def with_folders(folder: Path, names: list) -> Path:
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


def test_folders_are_an_array_in_the_order_of_their_numbers(listed):
    seen: list[str] = []
    array = read_array(listed, seen.append)
    assert array.numbers == (0, 3, 12)
    assert [unit.config.sensor.serial for unit in array.units] == ["chip 0", "chip 3", "chip 12"]
    assert seen == ["imu3/log0001.csv", "../imu12/log0001.csv", "imu0/log0001.csv"]


def test_folders_without_numbers_are_counted(listed):
    for name, other in (("imu0", "left"), ("imu3", "right")):
        shutil.move(listed / name, listed / other)
    array = read_array(with_folders(listed, ["right", "left"]))
    assert array.numbers == (0, 1)
    assert [unit.config.sensor.serial for unit in array.units] == ["chip 3", "chip 0"]


def test_a_unit_has_its_own_serial_number_and_accelerometer(named):
    more = '\n[[array.unit]]\nnumber = 3\nsensor.serial = "B-3"\naccelerometer.bias_mps2 = [0.1, 0, 0]\naccelerometer.sigma_mg = 2\n'
    (named / "session.toml").write_text(TOML + more, encoding="utf-8")
    first, other, last = (unit.config for unit in read_array(named).units)
    assert (first.sensor.serial, other.sensor.serial, last.sensor.serial) == ("board 7", "B-3", "board 7")
    assert other.accelerometer.bias_mps2.tolist() == [0.1, 0, 0]
    assert (other.accelerometer.source, first.accelerometer.source) == ("given", "none")
    assert other.sensor.odr_hz == 100


def test_a_turn_that_is_left_out_is_of_the_unit_that_the_row_names_else_of_the_first(named):
    rows = '\n[[exclude]]\nlog = "log0001.unit3.csv"\nat_s = 0.5\n\n[[exclude]]\nlog = "log0002.csv"\nat_s = 0.7\n'
    (named / "session.toml").write_text(TOML + rows, encoding="utf-8")
    left = [[(row.log, row.at_s) for row in unit.config.exclude] for unit in read_array(named).units]
    assert left == [[("log0002.unit0.csv", 0.7)], [("log0001.unit3.csv", 0.5)], []]


def test_a_key_that_nothing_reads_is_kept_for_the_first_look(named):
    (named / "session.toml").write_text(TOML + '\n[array]\nfolder = ["a"]\n[[array.unit]]\nnumber = 3\nserial = "x"\n', encoding="utf-8")
    first, other, _ = (unit.config.unknown for unit in read_array(named).units)
    assert first == (("array.folder", "array.folders"),)
    assert [key for key, _ in other] == ["array.unit.serial"]


def test_one_session_refuses_an_array(named):
    with pytest.raises(FormatError, match=r"an array of 3 units on one body, and no single session; `(python )?calibrate.py check "):
        read_session(named)


def test_an_array_refuses_one_session(named):
    for path in named.glob("*.unit*"):
        path.unlink()
    log(named / "log0001.csv")
    assert not is_array(named)
    assert len(read_session(named).logs) == 1
    with pytest.raises(FormatError, match="is no array"):
        read_array(named)


def spoilt(folder: Path, how: str) -> None:
    """One fault of an array by names."""
    if how == "missing":
        (folder / "log0002.unit3.csv").unlink()
    elif how == "closure":
        (folder / "closure0001.unit12.csv.gz").unlink()
    elif how == "both":
        log(folder / "log0001.unit3.csv.gz")
    elif how == "alone":
        log(folder / "log0003.csv")
    elif how == "zeros":
        log(folder / "log0003.unit03.csv")
    elif how == "one":
        for path in (*folder.glob("*.unit3.*"), *folder.glob("*.unit12.*")):
            path.unlink()
    elif how == "time":
        log(folder / "log0001.unit3.csv", 500.0)
    elif how == "turns":
        (folder / "turns.csv").write_text("turn,axis,angle_deg,sigma_deg\n1,x,90,0.1\n", encoding="utf-8")
    else:
        toml = TOML.replace("[site]", '[protocol]\nreference = "table"\n[site]') if how == "[protocol]" else TOML
        (folder / "session.toml").write_text(toml + "\n" + ("" if how == "[protocol]" else how), encoding="utf-8")


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("missing", r"log0002 lacks unit 3 of 0, 3, 12; every log needs a file of every unit: add log0002\.unit3\.csv"),
        ("closure", r"closure0001 lacks unit 12"),
        ("both", r"log0001\.unit3\.csv and log0001\.unit3\.csv\.gz; keep one"),
        ("alone", r"log0003\.csv names no unit next to units 0, 3, 12; expected log0003\.unit0\.csv"),
        ("zeros", r"log0003\.unit03\.csv: expected a unit's number from 0 to 9999 without leading zeros"),
        ("one", r"an array of one unit \(unit 0\); expected two or more"),
        ("time", r"units 0 and 3 have no time in common: log0001\.unit0\.csv is 0\.000 to 1\.000 s, log0001\.unit3\.csv 500\.000"),
        ("turns", r"turns\.csv is of one sensor's axes"),
        ("[protocol]", r'protocol\.reference is "table"; the reference of an array is "gravity"'),
        ("[[array.unit]]\nnumber = 3\n[[array.unit]]\nnumber = 3\n", r"number 3 is there twice"),
        ("[[array.unit]]\nnumber = 4\n", r"number 4 has no log; there are units 0, 3, 12"),
        ("[[array.unit]]\nnumber = true\n", r"array\.unit has number true"),
        ("[array]\nunit = 3\n", r"array\.unit is 3"),
        ("[[array.unit]]\nnumber = 3\nsensor = 3\n", r"array\.unit\.sensor of unit 3 is 3, expected a table"),
        ("[[array.unit]]\nnumber = 3\nsensor.odr_hz = 'x'\n", r'session\.toml \(unit 3\): sensor\.odr_hz is "x"'),
        ("[accelerometer]\nbias_mps2 = [0, 0, 0]\n", r"\[accelerometer\] is of one unit"),
        ('[[exclude]]\nlog = "log0001.unit9.csv"\nat_s = 1\n', r"exclude names log0001\.unit9\.csv; there are units 0, 3, 12"),
        ("[array]\nfolders = []\n", r"array\.folders is a list of 0, expected session folders"),
        ('[array]\nfolders = ["a", "b"]\n', r"lies next to session\.toml with \[array\] folders"),
    ],
)
def test_what_is_wrong_with_an_array_is_said_in_one_line(named, how, says):
    spoilt(named, how)
    with pytest.raises(CalibrationError, match=says) as raised:
        read_array(named)
    assert "\n" not in str(raised.value)
    findings = check(named)  # which never raises, but says the same
    assert [finding.level for finding in findings] == ["error"]
    assert str(raised.value) in findings[0].says


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["imu0", "imu4"], r'holds "imu4", which is not there'),
        (["imu0", "session.toml"], r"which is no folder"),
        (["imu0", "/tmp"], r"expected a folder inside this one, or next to it"),
        (["imu0", "../../etc"], r"expected a folder inside this one, or next to it"),
        (["imu0", ".."], r"expected a folder inside this one, or next to it"),
        (["imu0", "."], r"expected a folder inside this one, or next to it"),
        (["imu0", "../board"], r"which is this folder itself"),
        (["imu0", "imu0/"], r'holds "imu0" twice'),
        (["imu0", "imu3", "x/imu3"], r'holds "imu3" and "x/imu3", both unit 3 by their ends; rename one'),
        (["imu0"], r"an array of one unit"),
        (["imu0", 3], r"array\.folders is a list of 2"),
    ],
)
def test_a_folder_that_is_no_unit_is_said_in_one_line(listed, names, says):
    shutil.copytree(listed / "imu3", listed / "x" / "imu3")
    with pytest.raises(FormatError, match=says):
        read_array(with_folders(listed, names))


def test_a_folder_that_is_an_array_is_no_unit(listed, tmp_path):
    inner = tmp_path / "board" / "inner5"
    for number in (0, 1):
        log(inner / f"log0001.unit{number}.csv")
    (inner / "session.toml").write_text(TOML, encoding="utf-8")
    with pytest.raises(FormatError, match='"inner5", which is an array itself'):
        read_array(with_folders(listed, ["imu0", "inner5"]))


def test_units_with_other_numbers_of_logs_are_refused(listed):
    log(listed / "imu3" / "log0002.csv", 5.0)
    with pytest.raises(FormatError, match="unit 0 has 1 logs, unit 3 has 2"):
        read_array(listed)


def test_one_sensor_twice_is_no_array_of_two(named):
    for unit in (0, 3):
        rows = [f"{k / 100:.2f},{k % 7}.5,0,0,0,0,-1" for k in range(101)]
        (named / f"log0001.unit{unit}.csv").write_text("\n".join([HEADER, *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r"units 0 and 3 have the very same rates .* one sensor twice"):
        read_array(named)


def test_folders_of_unequal_logs_are_no_array_to_apply_a_model_to(listed):
    first = next(iter(array_log_paths(listed)["log0001"].values()))
    log(first.parent / "log0002.csv")
    with pytest.raises(FormatError, match="log0002 lacks unit"):
        array_log_paths(listed)


def test_mikov_as_an_array(shared, tmp_path, capsys):
    assert public(["mikov", str(shared / "mikov"), "--array", "--out", str(tmp_path)]) == 0
    array = read_array(tmp_path / "mikov")
    assert capsys.readouterr().out.strip() == str(tmp_path / "mikov")
    assert array.numbers == (0, 2, 4)
    for number, unit in zip(array.numbers, array.units, strict=True):
        alone = read_session(shared / "mikov" / f"imu{number}")
        assert np.array_equal(unit.logs[0].samples.gyro, alone.logs[0].samples.gyro)


@pytest.mark.broad
def test_check_and_list_take_an_array(shared, tmp_path, capsys):
    public(["mikov", str(shared / "mikov"), "--array", "--out", str(tmp_path)])
    capsys.readouterr()
    assert calibrate.main(["check", str(tmp_path / "mikov"), "--json", str(tmp_path / "check.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[0] for line in lines if line.startswith("unit ")] == ["unit 0", "unit 2", "unit 4"]
    found = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))["findings"]
    said = {finding["where"]: finding["description"] for finding in found if finding["what"] == "one body"}
    assert list(said) == ["unit 2", "unit 4"]
    assert "ppm slow" in said["unit 2"]
    assert calibrate.main(["list", str(tmp_path), "--json", str(tmp_path / "list.json")]) == 0
    assert "3 × MPU-9150" in capsys.readouterr().out
    (listed,) = json.loads((tmp_path / "list.json").read_text(encoding="utf-8"))["sessions"]
    assert (listed["units"], listed["logs"], listed["closures"], listed["problem"]) == (3, 1, 0, None)


def test_an_array_whose_logs_name_units_is_listed(named):
    (listed,) = list_sessions(named)
    assert (listed.units, listed.logs, listed.closures, listed.model, listed.problem) == (3, 2, 1, "MPU-9150", None)
