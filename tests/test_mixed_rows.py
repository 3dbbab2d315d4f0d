"""Logs that hold more than one sensor's rows: those that are meant are picked, and others are never read as the same sensor's."""

import numpy as np
import pytest
from conftest import SESSION_TOML, broad
from dialect_logs import ACCEL, GYRO, SAMPLES, T_US, TEMP, make, rows, same, triads

from session.io.errors import FormatError
from tinygc import read_session

pytestmark = pytest.mark.broad

FORMATS = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 129, 23, PARM, QNf, TimeUS,Name,Value
FMT, 131, 48, IMU, QBffffffIIfBB, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH
FMT, 132, 27, ATT, QccccCCCC, TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw
"""


def ardupilot(instances=1, parameters=700, attitudes=True):
    """A flight controller's text log: formats, parameters, then two kinds of rows in turn; a second sensor reads otherwise."""
    lines = [f"PARM, {i}, P{i}, {i}\n" for i in range(parameters)]
    for i, t in enumerate(T_US):
        for sensor in range(instances):
            values = [*(GYRO["rps"][i] * (1 - 2 * sensor)), *ACCEL["mps2"][i], 0, 0, TEMP[i], 1, 1]
            lines.append(f"IMU, {t}, {sensor}, {', '.join(f'{value:.12g}' for value in values)}\n")
        if attitudes:
            lines.append(f"ATT, {t}, 0, {i % 7}.5, 0, 1.5, 0, 2.5, 0.1, 0.2\n")
    return FORMATS + "".join(lines)


def test_the_rows_of_one_kind_are_picked_and_their_header_is_found(tmp_path):
    """Behind some hundred lines of parameters, by the line that describes the kind."""
    made = make(tmp_path, ardupilot(), rows="IMU", sensor="ICM-20948")
    same(made, temp=True)
    same(make(tmp_path, ardupilot(), out="unasked"), temp=True)  # the one kind that holds a gyroscope
    assert made.dialects == ("ArduPilot",)
    assert any(f"{700 + 1 + len(T_US)} rows of other kinds or sensors: left out" in note for note in made.notes)  # 1: the last format


@pytest.mark.broad
def test_one_sensor_of_two_is_picked(tmp_path):
    with pytest.raises(FormatError, match="the column 'I' holds 0, 1: rows of several sensors; give --where I=0"):
        make(tmp_path, ardupilot(2), rows="IMU", sensor="ICM-20948")
    same(make(tmp_path, ardupilot(2), rows="IMU", where="I=0", sensor="ICM-20948", out="first"))
    other = read_session(make(tmp_path, ardupilot(2), rows="IMU", where="I=1", sensor="ICM-20948", out="second").folder)
    np.testing.assert_allclose(other.logs[0].samples.gyro, -SAMPLES.gyro, atol=1e-10)


COLUMNS = "t_us=2,gx_rps=4,gy_rps=5,gz_rps=6,ax_mps2=7,ay_mps2=8,az_mps2=9"


@pytest.mark.parametrize(
    ("text", "answers", "advice"),
    [
        broad(ardupilot().replace("GyrX", "RateX"), {}, "rows of several kinds .*IMU.*ATT.*; give --rows IMU"),
        (ardupilot(parameters=0).replace("GyrX", "RateX"), {}, "give --rows IMU"),
        broad(ardupilot().replace("GyrX", "RateX"), {"columns": COLUMNS}, "rows of several kinds .*; give --rows"),
        (ardupilot(), {"rows": "GPS"}, "no row begins with 'GPS'"),
        (ardupilot(2), {"rows": "IMU", "where": "J=0"}, "no column 'J'"),
        broad(ardupilot(2), {"rows": "IMU", "where": "I"}, "expected NAME=VALUE"),
    ],
)
def test_a_log_of_several_kinds_is_refused_with_the_option(text, answers, advice, tmp_path):
    with pytest.raises(FormatError, match=advice):
        make(tmp_path, text, **answers)


def two_widths():
    """Rows of a sensor, and of eight numbers more, in turn."""
    narrow = rows(T_US, *triads("dps", "g")).splitlines()
    wide = rows(T_US, *[np.full(len(T_US), 0.5)] * 8).splitlines()
    return "\n".join(line for pair in zip(narrow, wide, strict=True) for line in pair) + "\n"


def test_rows_of_two_widths_are_told_apart(tmp_path):
    columns = "t_us=1,gx_dps=2,gy_dps=3,gz_dps=4,ax_g=5,ay_g=6,az_g=7"
    with pytest.raises(FormatError, match=r"rows of 7 and rows of 9 columns.*give --rows 7"):
        make(tmp_path, two_widths(), columns=columns)
    same(make(tmp_path, two_widths(), columns=columns, rows="7"))


def own_log(sensors=2):
    """A log of this project's own, as a session folder holds it, with the rows of several sensors."""
    signs = [1, -1, 0.5][:sensors]
    lines = [
        f"{t},{','.join(f'{value:.12g}' for value in [*(GYRO['dps'][i] * sign), *ACCEL['g'][i]])},{sensor}"
        for i, t in enumerate(T_US)
        for sensor, sign in enumerate(signs)
    ]
    return "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,imu\n" + "\n".join(lines) + "\n"


def test_a_sessions_own_log_says_its_rows_in_session_toml(tmp_path):
    (tmp_path / "log0001.csv").write_text(own_log())
    toml = tmp_path / "session.toml"
    toml.write_text(SESSION_TOML)
    with pytest.raises(FormatError, match=r'rows of several sensors; give sensor.where = "imu=0" in session.toml'):
        read_session(tmp_path)
    toml.write_text(SESSION_TOML.replace("[sensor]\n", '[sensor]\nwhere = "imu=1"\n'))
    samples = read_session(tmp_path).logs[0].samples
    np.testing.assert_allclose(samples.gyro, -SAMPLES.gyro, atol=1e-9)
    assert len(samples) == len(SAMPLES)


def test_another_sensor_far_behind_the_first_rows_is_found(tmp_path):
    head, *body = own_log(1).splitlines()
    late = "\n".join([head, *(line if i < 900 else line[:-1] + "1" for i, line in enumerate(body))]) + "\n"
    with pytest.raises(FormatError, match="rows of several sensors"):
        make(tmp_path, late)


def test_labels_in_the_first_column_are_no_kinds(tmp_path):
    labels = ["still" if i // 50 % 2 else "turn" for i in range(len(T_US))]
    text = "label,t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + rows(labels, T_US, *triads("dps", "g"))
    assert len(read_session(make(tmp_path, text).folder).logs[0].samples) == len(SAMPLES)


@pytest.mark.parametrize("name", ["id", "unit", "mode"])
def test_what_counts_or_stays_is_no_second_sensor(name, tmp_path):
    """A number for each row, one unit's own number, and a column of another name."""
    cells = {"id": range(len(T_US)), "unit": [3] * len(T_US), "mode": [i // 50 % 2 for i in range(len(T_US))]}[name]
    text = f"t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,{name}\n" + rows(T_US, *triads("dps", "g"), list(cells))
    assert len(read_session(make(tmp_path, text).folder).logs[0].samples) == len(SAMPLES)


@pytest.mark.broad
def test_apply_reads_the_rows_that_are_meant(tmp_path, folder, run):
    log = tmp_path / "flight.log"
    log.write_text(ardupilot(2))
    run("fit", folder, "--methods", "least_squares")
    code, _, said = run(
        "apply", folder / "fit" / "model_least_squares.json", log, "-o", tmp_path / "out.csv", "--rows", "IMU", "--where", "I=0"
    )
    assert code == 0, said
    assert len((tmp_path / "out.csv").read_text().splitlines()) == len(T_US) + 1
