"""A file with an Allan curve: columns and units as its header says, or as one is told; what is no curve is refused in one line."""

import numpy as np
import pytest

import tinygc
from session.io.errors import CalibrationError
from session.io.units import DEG, DEG_PER_HOUR, MG
from tinygc.annexes.noise import curve_file
from tinygc.annexes.noise.curve_file import read_curve

TAU = np.geomspace(0.1, 1000, 20)


def written(path, columns: int, header: str = "", delimiter: str = " "):
    rows = np.column_stack([TAU, *[(1 + column) / np.sqrt(TAU) for column in range(columns)]])
    np.savetxt(path, rows, header=header, delimiter=delimiter)
    return path


@pytest.mark.parametrize(
    ("columns", "header", "units", "si"),
    [
        (6, "tau_s, deviation of accelerometer x y z (m/s2), gyroscope x y z (deg/s)", None, {"accel": 1.0, "gyro": DEG}),
        (6, "tau [s] gx [deg/h] gy [deg/h] gz [deg/h] ax [ug] ay [ug] az [ug]", None, {"gyro": DEG_PER_HOUR, "accel": 1e-3 * MG}),
        (3, "tau x y z (rad/s)", None, {"gyro": 1.0}),
        (1, "", "deg/h", {"gyro": DEG_PER_HOUR}),
        (2, "", "mg,dps", {"accel": MG, "gyro": DEG}),
        (3, "tau x y z (rad/s)", "deg/s", {"gyro": DEG}),  # who says it knows better than the header
    ],
)
@pytest.mark.parametrize("delimiter", [" ", ", ", ";", "\t"])
def test_columns_and_units(columns, header, units, si, delimiter, tmp_path):
    curve = read_curve(written(tmp_path / "c.csv", columns, header, delimiter), units)
    assert list(curve.deviation) == list(si)
    assert curve.tau_s == pytest.approx(TAU)
    each = columns // len(si)
    for place, (kind, unit) in enumerate(si.items()):
        for axis in range(each):
            assert curve.deviation[kind][:, axis] == pytest.approx(unit * (1 + place * each + axis) / np.sqrt(TAU))


def test_a_header_of_names_alone_is_no_row(tmp_path):
    lines = ["tau (s),x (deg/s),y (deg/s),z (deg/s)", *(f"{tau},1,2,3" for tau in range(1, 8))]
    (tmp_path / "c.csv").write_text("\n".join(lines))
    assert read_curve(tmp_path / "c.csv").deviation["gyro"] == pytest.approx(np.tile(DEG * np.array([1, 2, 3]), (7, 1)))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 2\n2 2\n", "2 averaging times, expected 6"),
        ("\n".join(f"{tau} 1 1 1" for tau in range(1, 9)), "give --curve-units, such as --curve-units deg/s"),
        ("# (deg/s)\n" + "\n".join(f"{tau} 1 1 1 1" for tau in range(1, 9)), "5 columns, expected tau and"),
        ("# (deg/s)\n1 1\n2 1\n2 1\n3 1\n4 1\n5 1\n", "line 4: expected averaging times that increase"),
        ("# (deg/s)\n1 1\n2 -1\n", "line 3: expected averaging times that increase and deviations above 0"),
        ("# (deg/s)\n1 1\n2 nan\n", "line 3: expected"),
        ("# (deg/s)\n1 1\n2 1e300\n", "line 3: expected"),
        ("# (deg/s)\n1 1\n2 1 1\n", "line 3: 3 columns, and 2 before"),
        ("# (deg/s)\n1 1\nend\n", "line 3: 'end' is no row of numbers"),
        ("", "0 averaging times"),
        ("# (deg/s), (g)\n" + "\n".join(f"{tau} 1 1 1" for tau in range(1, 9)), "does not say one unit"),
    ],
)
def test_what_is_no_curve_is_refused(text, says, tmp_path):
    (tmp_path / "c.csv").write_text(text)
    with pytest.raises(CalibrationError, match=r"^c\.csv") as refused:
        read_curve(tmp_path / "c.csv")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("data", [bytes(range(256)) * 20, b"\xff\xfe1\x00", b"1e999 " * 9, b"# (deg/s)\n" + b"1 " * 100_000])
def test_any_bytes_are_refused_in_one_line(data, tmp_path):
    (tmp_path / "c.csv").write_bytes(data)
    with pytest.raises(CalibrationError, match=r"^[^\n]+$"):
        read_curve(tmp_path / "c.csv")


def test_units_that_are_none(tmp_path):
    with pytest.raises(CalibrationError, match="'furlong' is no unit of a deviation"):
        read_curve(written(tmp_path / "c.csv", 3), "furlong")


@pytest.fixture
def fitted(monkeypatch):
    """Fits nothing; keeps what it was given."""
    from noise_made import figures

    calls = []

    def fit(*arguments):
        calls.append(arguments)
        return list(figures().gyro.axes)[: arguments[1].shape[1]]

    monkeypatch.setattr(curve_file, "fit_curve", fit)
    return calls


def test_a_curve_is_fitted_sensor_by_sensor(fitted, tmp_path):
    path = written(tmp_path / "c.csv", 6, "accelerometer (m/s2), gyroscope (deg/s)")
    found = tinygc.estimate_noise(curve=path, duration_s=73_800, odr_hz=400, sensor="BMI055", serial="7")
    (tau_s, accel, duration_s), (_, gyro, _) = fitted
    assert duration_s == 73_800
    assert tau_s == pytest.approx(TAU)
    assert accel[:, 0] == pytest.approx(1 / np.sqrt(TAU))
    assert gyro[:, 0] == pytest.approx(4 * DEG / np.sqrt(TAU))
    assert (found.figures.sensor, found.figures.serial, found.figures.rate_hz) == ("BMI055", "7", 400)
    assert found.figures.rate_known
    assert not any("data rate" in each for each in found.remarks)
    guessed = tinygc.estimate_noise(curve=path, duration_s=73_800)
    assert "The data rate is not known: 1 over the shortest averaging time, 10 Hz, stands for it (--odr)." in guessed.remarks
    assert guessed.to_json()["rate_known"] is False
    assert found.allan["gyro"].deviation == pytest.approx(gyro)
    assert np.isnan(found.allan["gyro"].low).all()


def test_what_a_curve_does_not_say_is_assumed_and_said(fitted, tmp_path):
    found = tinygc.estimate_noise(curve=written(tmp_path / "c.csv", 1, "(deg/h)"))
    assert fitted[0][2:] == (10_000.0,)
    assert found.figures.accel is None
    assert any("--duration" in remark for remark in found.remarks)
    assert any("stands for all three" in remark for remark in found.remarks)
    for columns, header, more, says in (
        (3, "(deg/h)", {"duration_s": 100}, "a recording of 100 s cannot"),
        (3, "(mg)", {}, "holds no gyroscope"),
    ):
        with pytest.raises(CalibrationError, match=says):
            tinygc.estimate_noise(curve=written(tmp_path / "d.csv", columns, header), **more)


def test_the_published_curve_of_a_d455_is_read(shared):
    path = shared / "wild" / "d455_allan.csv"
    if not path.is_file():
        pytest.skip(f"no public recordings: {path} is not there")
    curve = read_curve(path)
    assert set(curve.deviation) == {"gyro", "accel"}
    at = np.argmin(np.abs(curve.tau_s - 1))
    # as its authors published them, read at 1 s: N of the mean axis
    assert np.mean(curve.deviation["gyro"][at]) == pytest.approx(1.0272e-4, rel=0.1)
    assert np.mean(curve.deviation["accel"][at]) == pytest.approx(1.038e-3, rel=0.2)
