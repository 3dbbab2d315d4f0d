"""Any sensor: what registers mean, which sensor a name is, and that nothing is held against one that is not known."""

import importlib.util
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, ROOT, SESSION_TOML, Table, session_of
from looks import look, of, serious, with_sensor

from session.base.errors import FormatError
from session.bench.session_file import toml_text
from session.detect.events import accel_reach_g, gyro_reach_dps
from session.log.config import Sensor, read_config
from session.log.logfile import read_log
from session.log.registers import PROFILES, RegisterUnits, profile_of
from tinygc import read_session
from tinygc.deploy.embedded.program import Registers

G = 9.80665


#: from data sheets and drivers, by themselves: sensor, dps, LSB per dps, g, LSB per g, a register of temperature, and its degC
DATA_SHEETS = [
    ("ASM330LHH", 500, 1000 / 17.5, 4, 1000 / 0.122, 256, 26.0),
    ("ISM330DHCX", 4000, 1000 / 140, 16, 1000 / 0.488, -256, 24.0),
    ("LSM6DSL", 125, 1000 / 4.375, 2, 1000 / 0.061, 512, 27.0),
    ("LSM6DS3", 2000, 1000 / 70, 8, 1000 / 0.244, 16, 26.0),
    ("LSM9DS1", 245, 1000 / 8.75, 16, 1000 / 0.732, 32, 27.0),
    ("MPU-6050", 250, 131.0, 2, 16384.0, -521, 35.0),
    ("MPU-9150", 2000, 16.4, 16, 2048.0, 0, 36.53),
    ("MPU-6500", 500, 65.5, 4, 8192.0, 0, 21.0),
    ("MPU-9250", 1000, 32.8, 8, 4096.0, 333.87, 22.0),
    ("ICM-20948", 2000, 16.4, 16, 2048.0, 0, 21.0),
    ("ICM-42688", 15.625, 2097.2, 2, 16384.0, 132.48, 26.0),
    ("BMI088", 2000, 16.384, 24, 1365.3333, 496, 85.0),
    ("BMI270", 125, 262.144, 2, 16384.0, 512, 24.0),
    ("ADIS16448", 1000, 25.0, 18, 1200.0, 100, 38.386),
    ("generic", 300, 32768 / 300, 6, 32768 / 6, None, None),
]


@pytest.mark.parametrize(("model", "dps", "per_dps", "g", "per_g", "register", "temp_c"), DATA_SHEETS)
def test_registers_mean_what_the_data_sheet_says(model, dps, per_dps, g, per_g, register, temp_c):
    units = RegisterUnits(model, dps, g)
    assert units.gyro_rps * per_dps == pytest.approx(DEG, rel=1e-6)
    assert units.accel_mps2 * per_g == pytest.approx(G, rel=1e-6)
    if register is None:
        assert units.temperature_c(np.zeros(1)) is None
        return
    found = units.temperature_c(np.array([float(register)]))
    assert found == pytest.approx(temp_c, abs=3e-3)
    assert units.temperature_lsb(found, 1) == pytest.approx(register, abs=1e-9)


def spelt(name, rng):
    """A name as people write it."""
    parts = re.findall(r"[A-Za-z]+|[0-9]+", name)
    text = parts[0] + "".join(str(rng.choice(["", "-", "_", " ", "."])) + part for part in parts[1:])
    text = "".join(c.upper() if rng.random() < 0.5 else c.lower() for c in text)
    return str(rng.choice(["", "ST ", "my (", "IMU: "])) + text + str(rng.choice(["", ")", ", unit 2", " #3", "/A"]))


def test_a_name_is_found_however_it_is_written():
    rng = np.random.default_rng(11)
    for profile in PROFILES:
        if profile.name == "generic":
            continue
        for name in (profile.name, *profile.also):
            for _ in range(10):
                written = spelt(name, rng)
                assert profile_of(written) is profile, written


def test_names_are_unique_and_every_figure_has_its_source():
    names = [name.lower() for profile in PROFILES for name in (profile.name, *profile.also)]
    assert len(names) == len(set(names))
    for profile in PROFILES:
        assert profile.units
        for name, figure in profile.figures.items():
            assert figure.value > 0
            assert ("remembered" in figure.source) <= (not figure.read)
            assert profile.yardstick(name) == (figure.value if figure.read else None)


def write_registers(folder, model, samples=None):
    """A session in an MPU-9250's registers whose session.toml says ``model``."""
    samples = samples if samples is not None else Table().rest(2).samples(bias_dps=(0.5, -0.3, 0.6))
    folder.mkdir()
    units = RegisterUnits("MPU-9250", 500, 4)
    counts = np.column_stack([samples.gyro / units.gyro_rps, samples.accel / units.accel_mps2, np.zeros(len(samples))])
    rows = np.column_stack([samples.t_ns // 1000, np.rint(counts)]).astype(int)
    (folder / "log0001.csv").write_text("t_us,gx,gy,gz,ax,ay,az,temp\n" + "".join(",".join(map(str, row)) + "\n" for row in rows.tolist()))
    (folder / "session.toml").write_text(SESSION_TOML.replace('"ASM330LHH"', model))
    return folder


def test_registers_of_an_unknown_sensor_are_refused_in_one_line(tmp_path):
    with pytest.raises(FormatError, match=r'log0001.csv holds registers: sensor.model is "mpu925" \(is MPU-925[05] meant\?\)') as error:
        read_session(write_registers(tmp_path / "a", '"mpu925"'))
    assert "\n" not in str(error.value)
    assert "gyro_mdps_per_lsb" in str(error.value)
    with pytest.raises(FormatError, match="accel_fs_g = 4 is no BMI088 full scale"):
        read_session(write_registers(tmp_path / "b", '"BMI088"'))


def test_its_data_sheet_s_numbers_are_enough(tmp_path):
    own = "gyro_mdps_per_lsb = 15.267175572519085\naccel_mg_per_lsb = 0.1220703125\ntemp_lsb_per_c = 333.87\ntemp_at_zero_c = 21"
    given = read_session(write_registers(tmp_path / "given", f'"house brand"\n{own}'))
    known = read_session(write_registers(tmp_path / "known", '"mpu_9250"'))
    for one in ("gyro", "accel", "temp_c"):
        np.testing.assert_allclose(getattr(given.logs[0].samples, one), getattr(known.logs[0].samples, one), rtol=1e-14)
    assert given.config.unknown == ()
    again = tmp_path / "session.toml"
    again.write_text(toml_text(given.config))
    assert read_config(again).sensor == given.config.sensor


def test_the_page_has_the_tables_of_the_records():
    spec = importlib.util.spec_from_file_location("make_sensors", ROOT / "docs" / "make_sensors.py")
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    page = maker.PAGE.read_text(encoding="utf-8")
    assert maker.with_tables(page) == page
    assert all(f"| {profile.name}" in page for profile in PROFILES)


RANGES = [
    (profile.name, dps, g)
    for profile in PROFILES
    for dps in [*(profile.gyro or {777: 0})][:: max(1, len(profile.gyro or {0: 0}) - 1)]
    for g in [*(profile.accel or {5: 0})][-1:]
]


@pytest.mark.parametrize(("model", "dps", "g"), RANGES)
def test_a_log_of_registers_becomes_si_and_registers_again(model, dps, g, tmp_path):
    """Through the reader, with both ends of the register among the values, and back by the units: the very same counts."""
    rows = np.random.default_rng(7).integers(-32768, 32768, (50, 7))
    rows[:2] = [[32767] * 7, [-32768] * 7]
    path = tmp_path / "log0001.csv"
    path.write_text("t_us,gx,gy,gz,ax,ay,az,temp\n" + "".join(f"{1000 * i},{','.join(map(str, row))}\n" for i, row in enumerate(rows)))
    sensor = Sensor(model, "", 1000.0, dps, g)
    samples, units = read_log(path, sensor).samples, sensor.register_units
    np.testing.assert_array_equal(np.rint(samples.gyro / units.gyro_rps), rows[:, :3])
    np.testing.assert_array_equal(np.rint(samples.accel / units.accel_mps2), rows[:, 3:6])
    assert (samples.temp_c is None) == (units.thermometer is None)
    if samples.temp_c is not None:
        np.testing.assert_array_equal(np.rint(units.temperature_lsb(samples.temp_c, 50)), rows[:, 6])
    # The register ends where clipping is looked for, and never below 99.9 % of the full scale.
    assert gyro_reach_dps(sensor) == pytest.approx(samples.gyro.max() / DEG, rel=1e-12)
    assert accel_reach_g(sensor) == pytest.approx(samples.accel.max() / G, rel=1e-12)
    assert gyro_reach_dps(sensor) > 0.998 * dps


@pytest.mark.parametrize(
    ("text", "name"),
    [
        *((text, None) for text in ("", "unknown", "MPU-92500", "XMPU-9250", "MPU-6050 or MPU-9250", "a generic logger", "ISM330")),
        (" Generic ", "generic"),
        ("ST ASM330LHHTR, unit 2", "ASM330LHH"),
    ],
)
def test_what_names_no_sensor_or_two_is_none(text, name):
    found = profile_of(text)
    assert (found and found.name) == name


def test_an_unknown_sensor_is_held_against_nothing():
    """Neither noise, zero, temperature nor data rate of another: what is not known is said and not judged."""
    samples = Table().tumble(8, seed=5).samples(gyro_mdps=40.0, accel_ug=600.0, bias_dps=(8.0, -4.5, 0.1))
    session = session_of(replace(samples, temp_c=samples.temp_c + 90.0), model="QMI8658")
    findings = look(session)
    assert serious(findings) == set()
    for what in ("gyro noise", "accelerometer noise", "zero-rate level"):
        assert (of(findings, what).level, "not known" in of(findings, what).description) == ("note", True)
    assert "ASM330LHH" not in " ".join(f"{f.description} {f.do}" for f in findings)
    named = look(with_sensor(session, model="ASM330LHH"))
    assert {("gyro noise", "warning"), ("zero-rate level", "warning"), ("temperature", "warning")} <= serious(named)
    assert Sensor("BMI088", "", 200, 500, 6).typical("gyro_bias_instability_dph") is None  # remembered figures are no yardsticks
    assert Sensor("asm330lhh", "", 208, 500, 4).typical("gyro_bias_instability_dph") == ("ASM330LHH", 3.0)


def test_the_c_has_the_registers_that_the_reader_has():
    config = session_of(Table().rest(2.0).samples()).config
    for model in ("ASM330LHH", "MPU-6050"):
        mine = replace(config, sensor=Sensor(model, "", 200, 500, 4))
        registers = np.random.default_rng(1).integers(-20000, 20000, (40, 7)).astype(np.int16)
        inputs, units = Registers.of(mine).inputs(registers), mine.sensor.register_units
        np.testing.assert_allclose(inputs.rate, registers[:, :3] * units.gyro_rps, rtol=3e-7)
        np.testing.assert_allclose(inputs.temp_c, units.temperature_c(registers[:, 6].astype(float)), rtol=1e-6, atol=2e-5)
    assert Registers.of(replace(config, sensor=Sensor("generic", "", 200, 500, 4))) is None  # whose temperature nobody knows
