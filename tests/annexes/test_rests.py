"""Rest logs as files: block means, what was mended, knocks, the first look, the refusals."""

import gzip
import json

import numpy as np
import pytest
from conftest import SESSION_TOML
from rest_logs import rest_log, rest_samples

from session.detect.check_stills import check_rest
from session.detect.events import knocked
from session.io.config import Sensor
from session.io.errors import DataError, FormatError
from session.io.rests import BlockMeans, read_rest, rest_from_samples
from tinygc import read_session

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
    rows = table()
    log = read_rest(rest_file(tmp_path, rows, name), SENSOR)
    block = (rows[:, 0] // 1e6).astype(int)
    for number in (0, 17, 59):
        mine = rows[block == number]
        k = int(np.flatnonzero(log.number == number)[0])
        np.testing.assert_allclose(log.gyro[k], mine[:, 1:4].mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(log.accel[k], mine[:, 4:7].mean(axis=0), atol=1e-8)
        np.testing.assert_allclose(log.accel_sd[k], mine[:, 4:7].std(axis=0, ddof=1), rtol=1e-5)
        assert log.temp_c[k] == pytest.approx(mine[:, 7].mean(), abs=1e-6)
    assert log.samples == len(rows)
    assert log.period_s == pytest.approx(1 / 13, rel=1e-4)


def test_pieces_give_the_same_means_as_the_whole():
    samples = rest_samples(cycles=0.2)
    whole, pieces = rest_from_samples(samples), BlockMeans(1.0)
    for start in range(0, len(samples), 37):
        pieces.add(samples.between(start, min(start + 37, len(samples))))
    parts = pieces.log(whole.path, samples.period_s)
    for name in ("number", "count", "temp_c", "gyro", "accel", "gyro_sd", "accel_sd"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-7, atol=1e-9)


def test_who_watches_sees_every_sample_once(tmp_path):
    rows, seen = table(), []
    rows = np.insert(rows, 100, rows[99], axis=0)
    log = read_rest(rest_file(tmp_path, rows), SENSOR, lambda samples: seen.append(len(samples)))
    assert sum(seen) == len(rows) - 1 == log.samples
    assert "1 rows repeat the stamp" in log.notes[0]


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
    with pytest.raises(FormatError, match=r"no log but rest logs.*calibrate\.py fit"):
        read_session(tmp_path)


def test_packed_and_unpacked_at_once_is_refused(tmp_path, run):
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    rest_file(tmp_path, table())
    rest_file(tmp_path, table(), "rest0001.csv.gz")
    code, _, err = run("fit", tmp_path)
    assert code == 2
    assert "holds rest0001.csv and rest0001.csv.gz" in err


def test_noise_that_grows_with_temperature_is_no_knock():
    assert knocked(rest_log(2, noise_per_c=0.012)).sum() == 0


def test_the_first_look(tmp_path, run):
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    rest_file(tmp_path, table())
    code, _, _ = run("check", tmp_path, "--json", tmp_path / "x.json")
    assert code == 0
    findings = json.loads((tmp_path / "x.json").read_text())["findings"]
    assert {f["what"]: f["level"] for f in findings} == {"gravity": "ok", "stillness": "ok", "attitude": "ok", "temperature": "ok"} or {
        f["what"] for f in findings
    } == {"gravity", "stillness", "temperature"}


def test_wrong_units_stop_the_fit(tmp_path, run):
    rows = table()
    rows[:, 4:7] /= 9.8  # g under a header of m/s^2
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    rest_file(tmp_path, rows)
    code, _, err = run("fit", tmp_path)
    assert code == 2
    assert "gravity: 0.102 g at rest" in err
    rows = table()
    rows[:, 7] += 273
    rest_file(tmp_path, rows)
    code, _, err = run("fit", tmp_path)
    assert code == 2
    assert "where no chip survives" in err


def test_a_sensor_that_is_put_down_otherwise_is_said():
    samples = rest_samples(cycles=0.5)
    tilted = samples.accel.copy()
    tilted[len(tilted) // 2 :] += [0.3, 0.0, 0.0]
    log = rest_from_samples(samples.with_accel(tilted))
    assert any(f.what == "attitude" and "tilts by" in f.says for f in check_rest(log))
    assert not any(f.what == "attitude" for f in check_rest(rest_from_samples(samples)))


def test_a_restless_log_is_no_rest_log():
    samples = rest_samples(cycles=1.0)
    rng = np.random.default_rng(0)
    gyro = samples.gyro.copy()
    shaken = rng.uniform(size=len(gyro)) < 0.3 * (np.arange(len(gyro)) % 200 < 90)
    gyro[shaken] += rng.normal(size=(shaken.sum(), 3)) * 0.2
    log = rest_from_samples(type(samples)(samples.t_ns, gyro, samples.accel, samples.temp_c))
    assert [f.level for f in check_rest(log) if f.what == "stillness"] == ["error"]
