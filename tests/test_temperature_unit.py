"""A temperature column in another unit is noticed: by what a chip survives, by its scatter, by the steps of the sensor's register."""

from dataclasses import replace

import numpy as np
import pytest
from looks import look, of

from session.detect.check_stills import other_unit
from session.detect.first_look import check_session
from tinygc import read_session

pytestmark = pytest.mark.broad

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
        ("tenths of a degree", lambda temp_c: temp_c * 10),
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


IN_REGISTERS = [
    ("degC", np.rint),
    ("degC", lambda temp_c: np.rint(2 * temp_c) / 2),
    ("tenths of a degree", lambda temp_c: np.rint(10 * temp_c)),
    ("Fahrenheit", lambda temp_c: np.rint(1.8 * temp_c + 32)),
    ("kelvin", lambda temp_c: np.rint(temp_c + 273.15)),
]


def read_as_registers(good, numbers):
    """A session of registers whose column ``temp`` has those numbers."""
    log = good.logs[0]
    return replace(log, samples=replace(log.samples, temp_c=25 + np.rint(numbers) / 256))


@pytest.mark.parametrize("mean_c", AMBIENT_C)
@pytest.mark.parametrize(("unit", "column"), IN_REGISTERS, ids=["whole", "halves", "tenths", "Fahrenheit", "kelvin"])
def test_a_temperature_in_the_registers_column_is_told_by_its_quiet(good, mean_c, unit, column):
    """25 in a column ``temp`` is 25.1 degC, and every change is 256 times too small: nothing said so."""
    warming = simulated_temperature(good, mean_c) + np.linspace(0, 1.2, len(good.logs[0].samples))
    finding = of(look(good, log=read_as_registers(good, column(warming))), "temperature")
    assert finding.level == "note"
    assert f"as {unit} " in finding.says
    assert "does temp hold the register, as its name says?" in finding.do
    assert max(map(len, (finding.says, finding.do))) < 200


@pytest.mark.parametrize("mean_c", [0.0, *AMBIENT_C, 60.0])
@pytest.mark.parametrize("noise_lsb", [2.5, 20.0])
def test_a_register_scatters_and_is_left_in_peace(good, mean_c, noise_lsb):
    """2.5 LSB is the quietest of the recordings at hand."""
    noise = np.random.default_rng(0).normal(size=len(good.logs[0].samples)) * noise_lsb
    finding = of(look(good, log=read_as_registers(good, (mean_c - 25) * 256 + noise)), "temperature")
    assert finding.level == ("ok" if mean_c < 60 else "note")
    assert "single steps" not in finding.says


def test_a_coarse_register_moves_in_single_steps_by_nature(good):
    log = read_as_registers(good, np.rint(simulated_temperature(good, 25.0) + np.linspace(0, 1.2, len(good.logs[0].samples))))
    coarse = replace(good, config=replace(good.config, sensor=replace(good.config.sensor, model="BMI088")))  # 8 LSB per degC
    assert "single steps" in of(look(good, log=log), "temperature").says
    assert "single steps" not in of(look(coarse, log=log), "temperature").says


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
        assert "single steps" not in finding.says
