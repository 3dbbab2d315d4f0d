"""Time itself: stamps that were counted, a column in another unit, a slow log; said, never passed as good."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import G, look, of, serious, with_sensor
from recorded_files import numbers

from session.detect.check_samples import check_dead
from session.detect.check_time import check_length, check_rate, check_warming, unit_factor
from session.io.dialects import Answers
from session.io.errors import FormatError
from session.io.samples import Samples
from session.replay.convert import convert
from tinygc import read_session

pytestmark = pytest.mark.broad


def text_of(samples, header="t_us", scale=1000, stamps=True, names=True):
    columns = ([samples.t_ns // scale] if stamps else []) + [*(samples.gyro / DEG).T, *(samples.accel / G).T]
    head = ([header] if stamps else []) + ["gx_dps", "gy_dps", "gz_dps", "ax_g", "ay_g", "az_g"]
    first = "%d" if stamps else "%.10g"
    row = ",".join([first, *["%.10g"] * (len(columns) - 1)])
    rows = "\n".join(row % values for values in zip(*columns, strict=True))
    return (",".join(head) + "\n" if names else "") + rows + "\n"


def make(tmp_path, text, **answers):
    path = tmp_path / "LOG.CSV"
    path.write_text(text)
    out = tmp_path / f"made{len(list(tmp_path.iterdir()))}"
    return convert([path], out, Answers(gyro_fs_dps=500, accel_fs_g=4, **answers))


@pytest.fixture(scope="module")
def good():
    """A clock of its own, 0.3 % fast."""
    samples = Table().tumble(14, seed=5).samples()
    return session_of(replace(samples, t_ns=np.rint(samples.t_ns / 1.003).astype(np.int64)))


def test_counted_stamps_measure_nothing(good, tmp_path):
    """Of a log that says so, and of one whose every step is the declared period to the last digit."""
    assert of(look(good), "sample rate").level == "ok"
    made = make(tmp_path, text_of(good.logs[0].samples, stamps=False), odr_hz=208.0)
    assert {len(row) for row in numbers(made.log)} == {8}  # time, six rates and forces, and the flag: a table that any program reads
    assert any("no stamps: samples were counted at 208 Hz" in note for note in made.notes)
    session = read_session(made.folder)
    exact = replace(good.logs[0].samples, t_ns=np.rint(np.arange(len(good.logs[0].samples)) * 1e9 / 208).astype(np.int64))
    looks = replace(good.logs[0], samples=exact)
    for log, level, words in ((session.logs[0], "warning", "nominal, not measured"), (looks, "note", "they look counted")):
        (finding,) = check_rate(log, session.config.sensor)
        assert finding.level == level
        assert words in finding.says
        assert "by the stamps" not in finding.says


@pytest.mark.parametrize("ppm", [-300, -10, 10, 300])
def test_a_clock_of_its_own_is_not_called_counted(good, ppm):
    """1000 s of a crystal's 10 ppm, in whole microseconds."""
    t_us = np.rint(np.arange(20_000) * 1e4 * (1 + ppm * 1e-6)).astype(np.int64)
    samples = Samples(t_us * 1000, np.zeros((20_000, 3)), np.zeros((20_000, 3)))
    (finding,) = check_rate(replace(good.logs[0], samples=samples), replace(good.config.sensor, odr_hz=100.0))
    assert finding.level == "ok"
    assert "Hz by the stamps, 100 Hz declared" in finding.says


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e-3, 1e-6])
def test_a_column_in_another_unit_is_named(good, factor):
    samples = good.logs[0].samples
    wrong = replace(samples, t_ns=np.rint(samples.t_ns / factor).astype(np.int64)) if factor < 1e6 else None
    if wrong is not None and (np.diff(wrong.t_ns) > 0).all():
        (finding, *_) = [finding for finding in look(good, t_ns=wrong.t_ns) if finding.what == "time unit"]
        assert finding.level == "error"
        assert f"{max(factor, 1 / factor):.0f} times too {'fast' if factor > 1 else 'slowly'}" in finding.says
    assert unit_factor(208.0 * factor * 1.03, 208.0) == factor
    assert unit_factor(208.0 * 4, 208.0) is None


@pytest.mark.broad
def test_replay_refuses_a_rate_that_no_sensor_has(good, tmp_path):
    text = text_of(good.logs[0].samples, header="t_ns", scale=1000)  # microseconds that are called ns
    with pytest.raises(FormatError, match=r"read as ns, its stamps say 208600 Hz, and no sensor has.*--time-unit s, ms, us or ns"):
        make(tmp_path, text)
    session = read_session(make(tmp_path, text, time_unit="us").folder)
    assert session.logs[0].samples.duration_s == pytest.approx(good.logs[0].samples.duration_s, rel=1e-6)


def test_ninety_degrees_in_four_seconds_are_said(good):
    """A sweep of 91 degC over 4000 s whose microseconds are read as nanoseconds."""
    count, rng = 8000, np.random.default_rng(3)
    temp_c = np.linspace(-20, 71, count) + rng.normal(0, 0.2, count)
    for seconds, said in ((4000.0, False), (4.0, True)):
        t_ns = np.rint(np.arange(count) * seconds / count * 1e9).astype(np.int64)
        samples = Samples(t_ns, rng.normal(0, 1e-3, (count, 3)), rng.normal(0, 0.01, (count, 3)), temp_c)
        findings = check_warming(replace(good.logs[0], samples=samples))
        assert bool(findings) == said
        if said:
            assert findings[0].what == "time unit"
            assert "within 3.5 s" in findings[0].says


def test_a_thermometer_s_noise_is_no_warming(good):
    rng = np.random.default_rng(4)
    samples = Samples(np.arange(400) * 5_000_000, np.zeros((400, 3)), np.zeros((400, 3)), 25 + rng.normal(0, 2.0, 400))
    assert check_warming(replace(good.logs[0], samples=samples)) == []


def test_a_log_shorter_than_a_segment_is_said(good):
    samples = good.logs[0].samples.between(0, 400)
    assert check_length(replace(good.logs[0], samples=samples), 5.0)[0].what == "time unit"
    assert check_length(good.logs[0], 5.0) == []


def coarse_slow(step_dps=0.06, seed=0):
    """600 s of rest at 2 Hz in coarse registers: neighbours are often equal."""
    rng = np.random.default_rng(seed)
    gyro = np.rint(rng.normal(0, 0.05, (1200, 3)) / step_dps) * step_dps * DEG
    accel = np.rint((rng.normal(0, 2e-4, (1200, 3)) + np.array([0, 0, -1])) / 1.2e-4) * 1.2e-4 * G
    return Samples(np.arange(1200) * 500_000_000, gyro, accel)


def test_two_equal_neighbours_at_2_hz_are_not_dead(good):
    for seed in range(20):
        assert check_dead(replace(good.logs[0], samples=coarse_slow(seed=seed))) == []


@pytest.mark.parametrize("axis", [0, 4])
def test_an_axis_that_dies_at_2_hz_is_found(good, axis):
    samples = coarse_slow(step_dps=0.01)
    six = np.concatenate([samples.gyro, samples.accel], axis=1)
    six[700:900, axis] = six[700, axis]
    (finding,) = check_dead(replace(good.logs[0], samples=replace(samples, gyro=six[:, :3], accel=six[:, 3:])))
    assert finding.level == "error"
    assert f"{('gx', 'gy', 'gz', 'ax', 'ay', 'az')[axis]} reads" in finding.says


def test_a_session_at_2_hz_is_read_checked_and_passes():
    samples = Table().tumble(14, rest_s=20.0, turn_s=10.0, seed=3).samples(odr_hz=2.0)
    session = with_sensor(session_of(samples, model="unknown"), odr_hz=2.0)
    assert serious(look(session)) == set()


@pytest.mark.broad
def test_a_log_without_a_header_is_asked_for_its_columns(good, tmp_path):
    samples = good.logs[0].samples
    with pytest.raises(FormatError, match=r"no header, 7 columns of numbers; name them by number, --columns t_UNIT=1,gx_UNIT=2,.*az_g=7"):
        make(tmp_path, text_of(samples, names=False))
    with pytest.raises(FormatError, match=r"no header, 6 columns of numbers.*gx_UNIT=1,.*and --odr HZ"):
        make(tmp_path, text_of(samples, names=False, stamps=False))
    with pytest.raises(FormatError, match=r"no time stamps\); give --odr HZ \(the true data rate\)"):
        make(tmp_path, text_of(samples, stamps=False))
    columns = "t_us=1,gx_dps=2,gy_dps=3,gz_dps=4,ax_g=5,ay_g=6,az_g=7"
    made = read_session(make(tmp_path, text_of(samples, names=False), columns=columns).folder).logs[0].samples
    np.testing.assert_allclose(made.gyro, samples.gyro, rtol=1e-8, atol=1e-9)
