"""Numbers that no sensor has are refused where they come in: in session.toml, in logs, in arrays; no warning of NumPy reaches a user."""

import numpy as np
import pytest
from conftest import SESSION_TOML, Table

import calibrate
import tinygc
from session.base.errors import DataError, FormatError
from session.base.units import DEG, G
from session.log.config import read_config

pytestmark = pytest.mark.filterwarnings("error")
SAMPLES = Table().tumble(3).samples(odr_hz=104)
TOML = SESSION_TOML.replace("208.0", "104.0")
COLUMNS = np.column_stack([SAMPLES.t_s, SAMPLES.gyro / DEG, SAMPLES.accel / G, SAMPLES.temp_c])


def accelerometer(matrix="[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", bias="[0, 0, 0]"):
    return f"{TOML}[accelerometer]\nmatrix = {matrix}\nbias_mps2 = {bias}\n"


@pytest.mark.parametrize(
    ("toml", "says"),
    [
        (accelerometer("[[1e308, 0, 0], [0, 1e-308, 0], [0, 0, 1]]"), "accelerometer.matrix[0][0] is 1e+308, expected a number within 100"),
        (accelerometer("[[-1, 0, 0], [0, -1, 0], [0, 0, -1]]"), "accelerometer.matrix is of determinant -1: it mirrors the axes"),
    ],
)
def test_a_session_toml_with_numbers_that_nobody_has_is_refused(toml, says, tmp_path):
    (tmp_path / "session.toml").write_text(toml)
    with pytest.raises(FormatError) as caught:
        read_config(tmp_path / "session.toml")
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("rows", "columns", "value", "says"),
    [
        (500, 1, 1e300, "gx_dps is 1e+300, beyond any sensor (100000 dps)"),
        (3, 7, 1e300, "temp_c is 1e+300, beyond any sensor (10000 degC)"),
        (-1, 0, 1e300, "t_s"),
        (slice(None), 1, 9.9e4, ""),
        (slice(None), slice(1, 4), 1e-320, ""),
        (slice(None), slice(4, 7), 0.0, ""),
    ],
)
def test_a_log_at_the_border_is_refused_in_one_line_without_a_warning(rows, columns, value, says, tmp_path, capsys):
    table = COLUMNS.copy()
    table[rows, columns] = value
    (tmp_path / "session.toml").write_text(TOML)
    text = "".join(",".join(repr(float(cell)) for cell in row) + "\n" for row in table)
    (tmp_path / "log0001.csv").write_text("t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c\n" + text)
    assert calibrate.main(["fit", str(tmp_path), "--methods", "raw,least_squares", "--quiet"]) == 2
    (line,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("calibrate:"))
    assert "log0001.csv" in line
    assert says in line
    calibrate.main(["check", str(tmp_path)])
    assert "Warning" not in "".join(capsys.readouterr())


def test_arrays_are_held_to_the_same_border_as_files():
    accel_mps2 = SAMPLES.accel.copy()
    accel_mps2[5, 0] = -1e300
    with pytest.raises(DataError, match=r"accel_mps2\[5, 0\] is -1e\+300 m/s\^2, beyond any sensor"):
        tinygc.Session.from_arrays(t_s=SAMPLES.t_s, gyro_rps=SAMPLES.gyro, accel_mps2=accel_mps2)
