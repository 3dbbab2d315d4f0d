"""Forms in which people publish logs, a few lines each that we write: which columns are taken, what is asked, what is refused."""

import numpy as np
import pytest
from dialect_logs import ACCEL, GYRO, T_US, make, rows

from session.base.errors import CalibrationError
from session.base.units import DEG, G
from session.replay.headings import usual_columns
from tinygc import read_session

T_S, RATES, FORCES, OTHER = T_US * 1e-6, GYRO["rps"], ACCEL["mps2"], np.full((len(T_US), 3), 40.0)
BARE = ACCEL["mps2"] * 0.02


def refused(tmp_path, text, **told):
    with pytest.raises(CalibrationError) as caught:
        make(tmp_path, text, **told)
    return str(caught.value)


def check(made, rates=RATES, forces=FORCES):
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_allclose(samples.gyro, rates, atol=1e-6)
    np.testing.assert_allclose(samples.accel, forces, atol=1e-5)


@pytest.mark.parametrize(
    ("names", "gyro", "accel", "unit"),
    [
        ("Acc_X,Acc_Y,Acc_Z,Gyro_X,Gyro_Y,Gyro_Z,Force1,Force2,Force3,Letter", 3, 0, ""),
        ("acce_x,acce_y,acce_z,linacce_x,linacce_y,linacce_z,gyro_x,gyro_y,gyro_z,grav_x,grav_y,grav_z", 6, 0, ""),
        ("Record,Speed,GForceX,GForceY,GForceZ,Lap,GyroX,GyroY,GyroZ", 6, 2, "g"),
        ("n,accel_x,accel_y,accel_z,giro_x,giro_y,giro_z", 4, 1, ""),
        (
            "Linear Acceleration x,Linear Acceleration y,Linear Acceleration z,Acceleration x,Acceleration y,Acceleration z,wx,wy,wz",
            6,
            3,
            "",
        ),
    ],
)
def test_columns_of_other_quantities_are_no_second_sensor(names, gyro, accel, unit):
    columns = usual_columns(names.split(","), "log.csv")
    assert [columns[f"g{axis}"][0] for axis in "xyz"] == [gyro, gyro + 1, gyro + 2]
    assert [columns[f"a{axis}"][:2] for axis in "xyz"] == [(accel, unit), (accel + 1, unit), (accel + 2, unit)]


def test_of_a_telephone_gravity_and_what_it_leaves_are_no_accelerometer(tmp_path):
    """As AndroSensor writes everything that a telephone has."""
    kinds = {"ACCELEROMETER": FORCES, "GRAVITY": FORCES * 1.1, "LINEAR ACCELERATION": BARE, "GYROSCOPE": RATES}
    head = ",".join(f"{kind} {axis} ({'rad/s' if kind == 'GYROSCOPE' else 'm/s²'})" for kind in kinds for axis in "XYZ")
    made = make(
        tmp_path,
        f"{head},Time since start in ms ,YYYY-MO-DD\n" + rows(*(each for part in kinds.values() for each in part.T), T_S * 1e3, T_S),
    )
    assert made.dialects == ("AndroSensor",)
    check(made)


def test_a_dialect_that_explains_less_than_the_names_gives_way(tmp_path):
    """A temperature makes no x-IMU3, and wx no Physics Toolbox, whose rates are in rad/s."""
    for head in ("timestamp,temperature,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z", "time,n,ax,ay,az,wx,wy,wz"):
        made = make(
            tmp_path, f"{head}\n" + rows(T_S, 20 + T_S, *FORCES.T, *(RATES / DEG).T), out=head[:5], gyro_unit="dps", accel_unit="m/s2"
        )
        assert made.dialects == ("other",)
        check(made)


def test_a_row_without_any_reading_is_left_out(tmp_path):
    """As phyphox ends a table whose sensors stop one after the other."""
    head = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)",ax_mps2,ay_mps2,az_mps2'
    text = f"{head}\n" + rows(T_S, *RATES.T, *FORCES.T)
    made = make(tmp_path, text + '99.9,"","","",,,\n99.91,"","","",,,\n')
    assert any("rows without any reading: left out" in note for note in made.notes)
    check(made)
    assert "expected a number" in refused(tmp_path, text + '99.9,"",1,1,1,1,1\n99.91,1,1,1,1,1,1\n', out="b")


def test_the_rate_of_a_line_before_the_rows_is_taken_where_nothing_stamps_them(tmp_path):
    head = "// Start Time: 0\n// Sample rate: 100.0Hz\nCounter\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\n"
    text = head + rows(np.arange(len(T_US)), *FORCES.T, *RATES.T).replace(",", "\t")
    made = make(tmp_path, text, gyro_unit="rad/s", accel_unit="m/s2")
    assert any("no stamps: samples were counted at 100 Hz" in note for note in made.notes)
    check(made)


def test_a_date_before_names_and_numbers_is_the_clock(tmp_path):
    def line(t, w, f):
        of = [",".join(f"{axis}={x:.9f}" for axis, x in zip("XYZ", each, strict=True)) for each in (w, f)]
        return f"2026-10-04 16:{int(t) // 60:02d}:{t % 60:06.3f},EULER(deg): R=1.70,P=9.24,GYRO: {of[0]},ACCEL: {of[1]},ALT: 1.5m"

    made = make(tmp_path, "\n".join(map(line, T_S, RATES, FORCES)) + "\n", gyro_unit="rad/s", accel_unit="m/s2")
    assert "clock: monitor_time as a time of day" in made.took[-1]
    check(made)


def test_a_sensor_that_is_missing_is_named_before_a_unit_is_asked(tmp_path):
    for head, values, says in (("gyro_x,gyro_y,gyro_z", RATES, "no accelerometer"), ("acc_x,acc_y,acc_z", FORCES, "no gyroscope")):
        assert says in refused(tmp_path, f"t_ms,{head}\n" + rows(T_S * 1e3, *values.T))


def test_the_columns_to_edit_are_those_that_the_names_mean_or_that_fill_the_row(tmp_path):
    chest = ",".join(f"{kind}{axis}_{place}" for place in ("chest", "arm") for kind in ("Accel", "Gyro") for axis in "XYZ")
    two = rows(T_S * 1e3, *(FORCES / G).T, *RATES.T, *(FORCES / G).T, *RATES.T)
    assert "gx_UNIT=GyroX_chest," in (text := refused(tmp_path, f"Millis,{chest}\n{two}"))
    assert "ax_g=AccelX_chest," in text
    turned = np.array([[0.0, 0.0, -1.0]]) * G + 0.01 * np.array([[2.0, 1.0, 0.3]])  # its second to fourth column are as long
    flat = np.tile(turned, (len(T_US), 1))
    assert "ax_mps2=1,ay_mps2=2,az_mps2=3" in (text := refused(tmp_path, rows(*flat.T, *(RATES * 1e-4).T)))
    assert "gx_UNIT=4" in text
    assert "=qw" not in refused(tmp_path, "t,qw,qx,qy,qz\n" + rows(T_S, *np.tile([1.0, 0.0, 0.0, 0.0], (len(T_US), 1)).T))
