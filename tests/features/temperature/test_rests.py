"""Rest logs as files: block means, what was mended, knocks, the first look, the refusals."""

import gzip
import json
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import SESSION_TOML

from session.base.errors import DataError, FormatError
from session.detect.check_stills import check_rest
from session.log.config import Sensor
from session.log.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.log.rests import read_rest, rest_from_samples
from session.log.samples import Samples
from tinygc import SimulationOptions, read_session
from tinygc.features.temperature.feature import RestOptions
from tinygc.features.temperature.rest_simulation import simulate_rest, write_rest
from tinygc.simulation.simulator import unit_of

#: slow enough that a test of hours costs little
CHIP = SimpleNamespace(**vars(SimulationOptions()) | {"odr_hz": 13.0})


def rest_samples(**options):
    made, _ = simulate_rest(RestOptions(**{"cycles": 3.0, "cycle_s": 1800.0, **options}), CHIP, 0)
    gyro, accel = made.gyro * gyro_rps_per_lsb(CHIP.gyro_fs_dps), made.accel * accel_mps2_per_lsb(CHIP.accel_fs_g)
    return Samples(made.t_us * 1000, gyro, accel, RegisterUnits(DEFAULT, None, None).temperature_c(made.temp))


SENSOR = Sensor("ASM330LHH", "42", 13.0, 500.0, 4.0)
HEADER = "t_us,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2,temp_c"


def rest_file(folder, rows, name="rest0001.csv", header=HEADER):
    text = header + "\n" + "\n".join(",".join(f"{value:.10g}" for value in row) for row in rows) + "\n"
    path = folder / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return path


def table(seconds=60, rate_hz=13.0, seed=0):
    rng = np.random.default_rng(seed)
    t_us = np.rint(np.arange(0, seconds, 1 / rate_hz) * 1e6)
    gyro, accel = rng.normal(size=(len(t_us), 3)) * 1e-3, rng.normal(size=(len(t_us), 3)) * 1e-2 - [0, 0, 9.8]
    return np.column_stack([t_us, gyro, accel, 20 + t_us * 1e-6])


@pytest.mark.parametrize("name", ["rest0001.csv", "rest0001.csv.gz"])
def test_block_means_are_those_of_the_rows(tmp_path, name):
    rows, seen = table(), []
    log = read_rest(rest_file(tmp_path, np.insert(rows, 100, rows[99], axis=0), name), SENSOR, lambda samples: seen.append(len(samples)))
    block = (rows[:, 0] // 1e6).astype(int)
    for number in (0, 17, 59):
        mine = rows[block == number]
        k = int(np.flatnonzero(log.number == number)[0])
        np.testing.assert_allclose(log.gyro[k], mine[:, 1:4].mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(log.accel[k], mine[:, 4:7].mean(axis=0), atol=1e-8)
        np.testing.assert_allclose(log.accel_sd[k], mine[:, 4:7].std(axis=0, ddof=1), rtol=1e-5)
        assert log.temp_c[k] == pytest.approx(mine[:, 7].mean(), abs=1e-6)
    assert log.samples == len(rows) == sum(seen)  # a repeated row is left out
    assert "1 rows repeat the stamp" in log.notes[0]
    assert log.period_s == pytest.approx(1 / 13, rel=1e-4)


def test_a_gap_shows_in_the_numbers(tmp_path):
    rows = table()
    log = read_rest(rest_file(tmp_path, rows[(rows[:, 0] < 20e6) | (rows[:, 0] > 30e6)]), SENSOR)
    assert not set(range(21, 30)) & set(log.number.tolist())
    assert log.duration_s == pytest.approx(60, abs=1)


def test_too_short_a_log_is_refused_in_one_line(tmp_path):
    with pytest.raises(DataError, match=r"rest0001.csv: 9 samples, less than two blocks .* is sensor.odr_hz right"):
        read_rest(rest_file(tmp_path, table()[:9]), SENSOR)
    with pytest.raises(FormatError, match="a header but no samples"):
        read_rest(rest_file(tmp_path, []), SENSOR)


def test_a_log_without_temperature_is_read(tmp_path):
    log = read_rest(rest_file(tmp_path, table()[:, :7], header=HEADER.removesuffix(",temp_c")), SENSOR)
    assert not log.has_temperature
    assert [f.level for f in check_rest(log) if f.what == "temperature"] == ["warning"]


def test_a_folder_says_its_rest_logs_and_a_folder_of_them_alone_says_what_to_do(folder, tmp_path):
    rest_file(folder, table())
    assert [path.name for path in read_session(folder).rests] == ["rest0001.csv"]
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    rest_file(tmp_path, table())
    with pytest.raises(FormatError, match=r"rest logs alone.*session with turns"):
        read_session(tmp_path)


@pytest.mark.parametrize(
    ("column", "change", "says"),
    [
        (slice(4, 7), lambda v: v / 9.8, "gravity: 0.102 g at rest"),
        (7, lambda v: v + 273, "where no chip survives"),
        (0, None, "rest0001.csv.gz"),
    ],
)
def test_wrong_units_and_a_log_twice_stop_the_fit(tmp_path, run, column, change, says):
    rows = table()
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    if change is None:
        rest_file(tmp_path, rows, "rest0001.csv.gz")  # packed, and beside it unpacked
    else:
        rows[:, column] = change(rows[:, column])
    rest_file(tmp_path, rows)
    code, _, err = run("temperature", tmp_path)
    assert (code, says in err) == (2, True)


def test_a_sensor_that_is_put_down_otherwise_is_said():
    samples = rest_samples(cycles=0.5)
    tilted = samples.accel.copy()
    tilted[len(tilted) // 2 :] += [0.3, 0.0, 0.0]
    log = rest_from_samples(samples.with_accel(tilted))
    assert any(f.what == "attitude" and "tilts by" in f.description for f in check_rest(log))
    assert not any(f.what == "attitude" for f in check_rest(rest_from_samples(samples)))


def test_a_simulated_rest_is_of_the_unit_whose_sessions_have_its_seed(tmp_path):
    """At rest it reads what that unit reads, whatever the seed of its noise; without a unit's seed, the zero of the options."""
    steady = RestOptions(cycles=1.0, cycle_s=20.0, slope_dps_per_c=0.0, bend_dps_per_c2=0.0)
    for seed, unit_seed in ((1, 7), (2, 7), (1, -1)):
        options = SimulationOptions(odr_hz=62.5, seed=seed, unit_seed=unit_seed, bias_instability_dph=0.0)
        folder, unit = tmp_path / f"{seed}{unit_seed}", unit_of(options)
        log = read_rest(write_rest(steady, options, folder) / "rest0001.csv.gz", SENSOR)
        of_unit = -np.linalg.solve(unit.E, unit.B), unit.measured_force(np.array([0.0, 0.0, -9.80665]))
        zero, force = of_unit if unit_seed >= 0 else (np.deg2rad(steady.zero_dps), [0.0, 0.0, -9.80665])
        np.testing.assert_allclose(log.gyro.mean(axis=0), zero, atol=5e-5)
        np.testing.assert_allclose(log.accel.mean(axis=0), force, atol=2e-3)
        truth = json.loads((folder / "truth.json").read_text())["rest"]["zero_dps"]
        np.testing.assert_allclose(np.deg2rad(truth), zero, atol=1e-12)
