"""Numbers that no sensor has are refused where they come in: in session.toml, in logs, in arrays; no warning of NumPy reaches a user."""

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, write_session
from models_in_use import LINEAR

import calibrate
import tinygc
from session.io.config import read_config
from session.io.errors import DataError, FormatError
from session.io.units import DEG, G
from tinygc import CalibrationError
from tinygc.deploy.calibration import Calibration

pytestmark = pytest.mark.filterwarnings("error")
SAMPLES = Table().tumble(9).samples(odr_hz=104)
TOML = SESSION_TOML.replace("208.0", "104.0")
COLUMNS = np.column_stack([SAMPLES.t_s, SAMPLES.gyro / DEG, SAMPLES.accel / G, SAMPLES.temp_c])


def accelerometer(matrix="[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", bias="[0, 0, 0]"):
    return f"{TOML}[accelerometer]\nmatrix = {matrix}\nbias_mps2 = {bias}\n"


@pytest.mark.parametrize(
    ("toml", "says"),
    [
        (accelerometer("[[1e308, 0, 0], [0, 1e-308, 0], [0, 0, 1]]"), "accelerometer.matrix[0][0] is 1e+308, expected a number within 100"),
        (accelerometer("[[1e308, 1e308, 1e308], [1e308, 1e308, 1e308], [1e308, 1e308, 1e308]]"), "accelerometer.matrix[0][0] is 1e+308"),
        (accelerometer("[[-1, 0, 0], [0, -1, 0], [0, 0, -1]]"), "accelerometer.matrix is of determinant -1: it mirrors the axes"),
        (accelerometer(bias="[1e308, 0, 0]"), "accelerometer.bias_mps2[0] is 1e+308, expected a number within 98066.5"),
        (accelerometer(bias="[nan, 0, 0]"), "accelerometer.bias_mps2[0] is NaN, which is not finite"),
        (
            TOML + "[truth]\nmounting = [[1e308, 0, 0], [0, 1, 0], [0, 0, 1]]\n",
            "truth.mounting[0][0] is 1e+308, expected a number within 10",
        ),
        (TOML.replace("104.0", "1e308"), "sensor.odr_hz is 1e+308, expected a number from 0.1 to 50000"),
    ],
)
def test_a_session_toml_with_numbers_that_nobody_has_is_refused_in_one_line(toml, says, tmp_path, capsys):
    write_session(tmp_path / "s", SAMPLES, toml=toml)
    with pytest.raises(FormatError) as caught:
        read_config(tmp_path / "s" / "session.toml")
    assert says in str(caught.value)
    assert calibrate.main(["fit", str(tmp_path / "s"), "--quiet"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def written(folder, columns, name="log0001.csv"):
    folder.mkdir()
    (folder / "session.toml").write_text(TOML)
    rows = "".join(",".join(repr(float(value)) for value in row) + "\n" for row in columns)
    (folder / name).write_text("t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c\n" + rows)
    return folder


def with_values(rows, column, value):
    columns = COLUMNS.copy()
    columns[rows, column] = value
    return columns


#: name -> the log, and what is said of it (nothing: it need not be refused, but nothing may break)
LOGS = {
    "rate": (with_values(500, 1, 1e300), "gx_dps is 1e+300, beyond any sensor (100000 dps)"),
    "force": (with_values(500, 4, 1e300), "ax_g is 1e+300, beyond any sensor (10000 g)"),
    "temperature": (with_values(3, 7, 1e300), "temp_c is 1e+300, beyond any sensor (10000 degC)"),
    "stamp": (with_values(-1, 0, 1e300), "t_s"),
    "far stamps": (with_values(-1, 0, 4.6e9), None),
    "the largest rates": (with_values(slice(None), 1, 9.9e4), None),
    "the largest forces": (with_values(slice(None), 4, 9.9e3), None),
    "denormal rates": (with_values(slice(None), slice(1, 4), 1e-320), None),
    "no force": (with_values(slice(None), slice(4, 7), 0.0), None),
    "denormal forces": (with_values(slice(None), slice(4, 7), 1e-320), None),
    "two rows": (COLUMNS[:2], None),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_at_the_border_is_refused_in_one_line_or_looked_at_without_a_warning(name, tmp_path, capsys):
    columns, says = LOGS[name]
    folder = written(tmp_path / "s", columns)
    refused = name != "far stamps"  # a gap, and the turns before it are as good as ever
    assert calibrate.main(["fit", str(folder), "--methods", "raw,least_squares", "--quiet"]) == (2 if refused else 0)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("calibrate:")]
    assert len(lines) == refused
    assert all("log0001.csv" in line and (says or "") in line for line in lines)
    calibrate.main(["check", str(folder)])
    assert "Warning" not in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"gyro_rps": 1e300}, r"gyro_rps\[5, 0\] is 1e\+300 rad/s, beyond any sensor"),
        ({"accel_mps2": -1e300}, r"accel_mps2\[5, 0\] is -1e\+300 m/s\^2, beyond any sensor"),
        ({"temp_c": 1e300}, r"temp_c\[5\] is 1e\+300 degC, beyond any sensor"),
    ],
)
def test_arrays_are_held_to_the_same_border_as_files(changes, says):
    arrays = {"gyro_rps": SAMPLES.gyro.copy(), "accel_mps2": SAMPLES.accel.copy(), "temp_c": SAMPLES.temp_c.copy()}
    for name, value in changes.items():
        arrays[name][(5, 0)[: arrays[name].ndim]] = value
    with pytest.raises(DataError, match=says):
        tinygc.Session.from_arrays(t_s=SAMPLES.t_s, **arrays)


@pytest.mark.parametrize("value", [1e300, -1e300, 2e3])
def test_a_model_in_use_refuses_what_no_sensor_measures(value):
    model = Calibration(LINEAR)
    raw = np.zeros((7, 3))
    raw[4, 2] = value
    with pytest.raises(CalibrationError, match=r"raw\[4\] is .* rad/s, beyond any sensor; is its unit right\?"):
        model(raw)
    with pytest.raises(CalibrationError, match="beyond any sensor"):
        model.live()(raw[4])
