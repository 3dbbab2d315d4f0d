"""A temperature column in another unit is noticed: by what a chip survives, by its scatter, by the steps of the sensor's register."""

from dataclasses import replace

import numpy as np
import pytest
from looks import look, of

from session.checks.first_look import check_session
from session.checks.temperature import other_unit
from session.log.folder import read_session

AMBIENT_C = (15.0, 25.0, 38.0)


def simulated_temperature(good, mean_c):
    """As the simulated session has it, to the register, about another mean."""
    temp_c = good.logs[0].samples.temp_c
    return temp_c + np.round((mean_c - temp_c.mean()) * 256) / 256


@pytest.mark.parametrize("mean_c", AMBIENT_C)
@pytest.mark.parametrize(
    ("unit", "column"),
    [
        ("kelvin", lambda temp_c: temp_c + 273.15),
        ("hundredths of a degree", lambda temp_c: temp_c * 100),
        ("thousandths of a degree", lambda temp_c: temp_c * 1000),
    ],
)
def test_what_no_sensor_survives_is_named(good, mean_c, unit, column):
    finding = of(look(good, temp_c=column(simulated_temperature(good, mean_c))), "temperature")
    assert finding.level == "warning"
    assert f"in {unit}" in finding.do


@pytest.mark.parametrize("mean_c", AMBIENT_C)
def test_fahrenheit_is_told_by_the_steps_of_the_register(good, mean_c):
    finding = of(look(good, temp_c=simulated_temperature(good, mean_c) * 1.8 + 32), "temperature")
    assert finding.level == "warning"
    assert "its steps of 0.007031 are those of this sensor's register in Fahrenheit" in finding.says
    rounded = of(look(good, temp_c=np.round(simulated_temperature(good, mean_c) * 1.8 + 32, 1)), "temperature")
    assert rounded.level == "note"
    assert "which in Fahrenheit is" in rounded.says


@pytest.mark.parametrize("mean_c", AMBIENT_C)
def test_the_raw_register_is_told_by_its_scatter(good, mean_c):
    raw = np.rint((simulated_temperature(good, mean_c) - 25) * 256)
    finding = of(look(good, temp_c=raw), "temperature")
    assert finding.level == "warning"
    assert "temp" in finding.do
    assert "as this sensor's register" in finding.do


@pytest.mark.parametrize("mean_c", [-30.0, 0.0, *AMBIENT_C, 50.0])
def test_degrees_celsius_are_left_in_peace(good, mean_c):
    finding = of(look(good, temp_c=simulated_temperature(good, mean_c)), "temperature")
    assert finding.level == "ok"


def test_a_warm_chamber_is_asked_about_and_not_accused(good):
    finding = of(look(good, temp_c=simulated_temperature(good, 80.0)), "temperature")
    assert finding.level == "note"
    assert finding.do == "is the column in degC, as its name says?"
    assert other_unit(-35.0, 85.0, None) is None  # a chamber's whole range, in a rest log


def test_no_real_recordings_temperature_is_doubted(shared):
    names = [f"concealed/case0{i:02d}" for i in (1, 5, 11)] + ["xsens", "mikov/imu0"]
    found = [shared / name for name in names if (shared / name / "session.toml").exists()]
    if not found:
        pytest.skip("no recordings in ../shared")
    for folder in found:
        session = read_session(folder)
        session = replace(session, logs=session.logs[:1], closures=())
        (finding,) = (each for each in check_session(session) if each.what == "temperature")
        assert finding.level in ("ok", "note")
        assert "Fahrenheit" not in finding.says
