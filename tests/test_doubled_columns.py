"""A column that is read and stands twice is refused in every dialect: nobody knows which of the two is meant."""

import re

import pytest
from conftest import SESSION_TOML
from dialect_logs import ACCEL, DIALECTS, EPOCH_NS, GYRO, SAMPLES, make, rows, same

import calibrate
from session.io.dialects import Answers
from session.io.errors import FormatError
from session.replay.convert import convert
from tinygc import read_session

OWN = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"
#: dialect -> a word of its header line, its delimiter, and names of columns that are read
READ = {
    "ST DataLog": ("Timestamp", " ", ["A_X", "G_Z"]),
    "x-IMU3": ("Gyroscope", ",", ["Timestamp (us)", "Gyroscope X (deg/s)", "Accelerometer Z (g)"]),
    "EuRoC": ("w_RS_S_x", ",", ["w_RS_S_x [rad s^-1]", "a_RS_S_z [m s^-2]"]),
    "OpenLog Artemis": ("rtcTime", ",", ["rtcTime", "aX", "gZ", "imu_degC"]),
    "PX4 sensor_combined": ("gyro_rad", ",", ["timestamp", "gyro_rad[0]", "accelerometer_m_s2[2]"]),
    "Betaflight blackbox": ("loopIteration", ",", ["time (us)", "gyroADC[0] (deg/s)", "accSmooth[2] (g)"]),
}


def own():
    return OWN + "\n" + rows(SAMPLES.t_ns // 1000, *GYRO["dps"].T, *ACCEL["g"].T, SAMPLES.temp_c)


def with_one_more(text, word, delimiter, name):
    """The same log with a last column of that name, which holds zeros."""
    lines = text.splitlines()
    head = next(i for i, line in enumerate(lines) if word in line)
    unit = re.search(rf"{re.escape(name)}( \[[^\]]*\])?", lines[head])[0]
    return (
        "\n".join(
            lines[:head]
            + [lines[head].rstrip(delimiter) + delimiter + unit]
            + [line.rstrip(delimiter) + delimiter + "0" for line in lines[head + 1 :]]
        )
        + "\n"
    )


@pytest.mark.parametrize(("dialect", "name"), [(dialect, name) for dialect, (_, _, names) in READ.items() for name in names])
def test_a_doubled_column_of_a_dialect_is_refused(dialect, name, tmp_path):
    word, delimiter, _ = READ[dialect]
    with pytest.raises(FormatError, match="stands 2 times; keep one") as caught:
        make(tmp_path, with_one_more(DIALECTS[dialect](), word, delimiter, name))
    assert "LOG.CSV line" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", OWN.split(","))
def test_a_doubled_column_of_our_own_is_refused_by_replay_and_by_a_session(name, tmp_path, capsys):
    text = with_one_more(own(), "t_us", ",", name)
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "session.toml").write_text(SESSION_TOML)
    (tmp_path / "s" / "log0001.csv").write_text(text)
    with pytest.raises(FormatError, match=rf"log0001\.csv line 1: the column {name} stands 2 times; keep one, or rename the other"):
        read_session(tmp_path / "s")
    assert calibrate.main(["fit", str(tmp_path / "s"), "--quiet"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    with pytest.raises(FormatError, match=f"the column {name} stands 2 times"):
        make(tmp_path, text)


def test_a_doubled_column_that_is_not_read_is_ignored_as_before(tmp_path):
    text = with_one_more(
        with_one_more(own().replace("temp_c\n", "temp_c,flag\n", 1).replace("\n", ",7\n").replace("flag,7", "flag"), "t_us", ",", "flag"),
        "t_us",
        ",",
        "flag",
    )
    same(make(tmp_path, text))


def test_columns_that_are_named_must_stand_once(tmp_path):
    path = tmp_path / "LOG.CSV"
    path.write_text("n,a,b,c,d,e,f,a\n" + rows(EPOCH_NS + SAMPLES.t_ns, *GYRO["dps"].T, *ACCEL["g"].T, GYRO["dps"][:, 0]))
    named = "t_ns=n,gx_dps=a,gy_dps=b,gz_dps=c,ax_g=d,ay_g=e,az_g=f"
    with pytest.raises(FormatError, match=r"LOG\.CSV: 'a' stands 2 times in the header; give --columns its number, from 1"):
        convert([path], tmp_path / "out", Answers(gyro_fs_dps=500.0, accel_fs_g=4.0, columns=named))
    same(convert([path], tmp_path / "by number", Answers(gyro_fs_dps=500.0, accel_fs_g=4.0, columns=named.replace("gx_dps=a", "gx_dps=2"))))


@pytest.mark.parametrize("name", ["temp_f", "temp_k", "temp_K"])
def test_a_temperature_that_says_another_unit_is_refused_and_not_dropped_silently(name, tmp_path):
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    (tmp_path / "log0001.csv").write_text(own().replace("temp_c", name, 1))
    with pytest.raises(FormatError, match=rf"'{name}': a temperature is in degC; convert it and call it temp_c"):
        read_session(tmp_path)
