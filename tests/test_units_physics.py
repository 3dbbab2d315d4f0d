"""Units as people write them, and headings that say by themselves what their columns are."""

import pytest
from conftest import DEG

from session.io.headings import usual_columns
from session.io.units import G, parse_unit


@pytest.mark.parametrize(
    ("kind", "text", "si"),
    [
        *(("time", text, si) for text, si in (("25us", 25_000), ("0.5 ms", 500_000))),
        *(("gyro", text, DEG) for text in ("deg/s", "º/s", "ø/s", "Grad/s")),
        *(("gyro", text, 1.0) for text in ("rad s^-1", "rad·s⁻¹")),
        *(("gyro", text, si) for text, si in (("0.061 dps", 0.061 * DEG), ("rpm", 6 * DEG), ("lsb", None))),
        *(("accel", text, 1.0) for text in ("m/s/s", "m/s2", "m·s⁻²", "m/s**2")),
        ("accel", "g/2048", G / 2048),
    ],
)
def test_units(kind, text, si):
    assert parse_unit(kind, text).si == (None if si is None else pytest.approx(si))


@pytest.mark.parametrize(
    ("kind", "text"), [("time", "lsb"), ("time", "fortnight"), ("gyro", "g"), ("accel", "0g"), ("gyro", "dps/0"), ("time", "0.0001ns")]
)
def test_no_units(kind, text):
    assert parse_unit(kind, text) is None


@pytest.mark.parametrize(
    ("head", "gyro"),
    [
        ("t in s;Acc_x / m/s²;Acc_y / m/s²;Acc_z / m/s²;Gyr_x / °/s;Gyr_y / °/s;Gyr_z / °/s", (4, 5, 6)),
        ("Czas;Mag X [G];Mag Y [G];Mag Z [G];Przysp. X [g];Przysp. Y [g];Przysp. Z [g];V X [dps];V Y [dps];V Z [dps]", (7, 8, 9)),
        ("Zeit [ms];Rollrate [°/s];Nickrate [°/s];Gierrate [°/s];Beschl. X [g];Beschl. Y [g];Beschl. Z [g]", (1, 2, 3)),
        ("Zeit;Fuß X [g];Fuß Y [g];Fuß Z [g];Hand X [g];Hand Y [g];Hand Z [g];V X [dps];V Y [dps];V Z [dps]", (7, 8, 9)),
    ],
)
def test_columns_are_known_by_their_names_or_units(head, gyro):
    columns = usual_columns(head.split(";"), "log.csv")
    assert tuple(columns[f"g{axis}"][0] for axis in "xyz") == gyro
    assert ("ax" in columns) == ("Hand" not in head)  # of two accelerometers a person says which


@pytest.mark.parametrize(
    ("file", "letter"), [("Gyroscope.csv", "g"), ("imu_acc_2.json", "a"), ("rotation_vector.csv", ""), ("walk.csv", "")]
)
def test_a_files_name_says_whose_axes_it_holds(file, letter):
    assert set(usual_columns(("t", "x", "y", "z"), file)) == ({f"{letter}{axis}" for axis in "xyz"} if letter else set())
