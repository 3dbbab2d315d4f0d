"""Stamps, registers, temperature: gaps, jitter, clipping, axes that never move."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, broad, session_of
from looks import G, look, of, serious, with_sensor

from session.detect.stills import find_stills
from session.io.samples import Samples

# Stamps


@pytest.mark.parametrize(("declared", "level"), [(208.1, "ok"), (211.3, "note"), (200.0, "note"), (104.0, "error"), (416.0, "error")])
def test_the_true_rate_is_told_from_the_declared_one(good, declared, level):
    finding = of(look(with_sensor(good, odr_hz=declared)), "sample rate")
    assert finding.level == level
    assert "208.00 Hz by the stamps" in finding.says
    if level == "error":
        assert "the sensor has 208 Hz" in finding.do


def test_a_comment_that_contradicts_the_stamps_is_a_warning(good):
    good = with_sensor(good, odr_hz=208.1)
    for said, levels in (("208.3", ["ok"]), ("211.3", ["ok", "warning"]), ("unknown", ["ok"])):
        log = replace(good.logs[0], comments={"odr_hz": said})
        assert [finding.level for finding in look(good, log=log) if finding.what == "sample rate"] == levels


@pytest.mark.parametrize(("key", "said"), [("gyro_fs_dps", "1000"), ("accel_fs_g", "8")])
def test_a_comment_that_contradicts_the_full_scale_is_an_error(good, key, said):
    finding = of(look(good, log=replace(good.logs[0], comments={key: said})), "full scale")
    assert finding.level == "error"
    assert f"{key}={said}" in finding.says
    good_ones = {"gyro_fs_dps": "500", "accel_fs_g": "4.0", "serial": good.config.sensor.serial}
    assert serious(look(good, log=replace(good.logs[0], comments=good_ones))) == set()


def test_another_sensors_serial_is_a_warning(good):
    assert of(look(good, log=replace(good.logs[0], comments={"serial": "other"})), "serial").level == "warning"


def test_gaps_are_counted_with_what_they_lost(good):
    samples = good.logs[0].samples
    kept = np.ones(len(samples), bool)
    kept[1000:1010] = kept[5000:5100] = False
    part = Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])
    finding = of(look(good, log=replace(good.logs[0], samples=part)), "gaps")
    assert finding.level == "warning"
    assert finding.says.startswith("2 gaps, 110 samples lost, the longest 0.486 s, the first at 4.8 s")


@pytest.mark.parametrize("share", [0.0005, 0.05])
def test_samples_lost_singly_are_counted_and_are_neither_rate_nor_jitter(good, share):
    samples = good.logs[0].samples
    kept = np.random.default_rng(2).random(len(samples)) >= share
    kept[[0, -1]] = True
    part = Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])
    whole, findings = look(good), look(good, log=replace(good.logs[0], samples=part))
    assert of(findings, "sample rate").says == of(whole, "sample rate").says
    assert f"{np.count_nonzero(~kept)} samples lost" in of(findings, "gaps").says
    assert of(findings, "gaps").level == ("warning" if share > 0.001 else "note")
    assert of(findings, "jitter").level == "ok"


def test_stamps_made_on_arrival_are_told_by_what_they_cost(good):
    """A stamp moved by up to 2 ms misplaces rotation while the rate changes.  The number is what turns really are off by."""
    log = good.logs[0]
    jitter_ns = np.random.default_rng(1).uniform(-2e6, 2e6, size=len(log.samples)).astype(np.int64)
    finding = of(look(good, t_ns=log.samples.t_ns + jitter_ns), "jitter")
    said_deg, noise_deg = (float(word) for word in finding.says.replace(",", "").split() if word.startswith("0."))
    off = np.cumsum((log.samples.gyro[1:] + log.samples.gyro[:-1]) / 2 * np.diff(jitter_ns)[:, None] * 1e-9, axis=0) / DEG
    stills, _ = find_stills(log.samples)
    off_per_turn = np.diff(off[[still.middle for still in stills]], axis=0).std(axis=0).max()
    assert said_deg == pytest.approx(off_per_turn, rel=0.5)
    assert finding.level == ("warning" if said_deg > noise_deg else "ok")
    assert of(look(good, t_ns=log.samples.t_ns + jitter_ns // 100), "jitter").level == "ok"


def test_what_the_reader_mended_is_passed_on(good):
    log = replace(good.logs[0], notes=("line 7, the last, is cut off (2 columns, expected 8): left out",))
    finding = of(look(good, log=log), "reading")
    assert finding.level == "note"
    assert "cut off" in finding.says


# Registers


@pytest.mark.parametrize("lsb", [4000, broad(6000)])
def test_a_plateau_below_the_full_scale_is_clipping(good, lsb):
    samples = good.logs[0].samples
    level = lsb * 0.0175 * DEG
    gyro = samples.gyro.copy()
    gyro[:, 1] = np.clip(gyro[:, 1], -level, level)
    finding = of(look(good, gyro=gyro), "gyro clipping")
    assert finding.level == "warning"
    assert f"{lsb * 0.0175:g} dps" in finding.says
    assert "y stands at" in finding.says
    assert "x stands" not in finding.says


def quantised(session, step_g):
    """The session's force in whole steps of ``step_g``, coarser than its noise."""
    step = step_g * G
    return np.rint(session.logs[0].samples.accel / step) * step


def test_readings_that_repeat_at_rest_are_no_clipping(good):
    """A register of 30 mg stands still in each still, also where that is an axis's extreme."""
    accel = quantised(good, 30e-3)
    assert max(stop - start for stop, start in runs_at_extremes(accel)) > 200
    assert of(look(good, accel=accel), "accelerometer clipping").level == "ok"


def runs_at_extremes(values):
    for axis in values.T:
        for level in (axis.min(), axis.max()):
            edges = np.flatnonzero(np.diff(np.r_[False, axis == level, False].astype(int)))
            yield from zip(edges[1::2], edges[::2], strict=True)


@pytest.mark.parametrize(("level_g", "clips"), [(1.1, False), (1.5, True)])
def test_no_accelerometer_clips_below_gravity(good, level_g, clips):
    """Half a second at one level while the body turns: within gravity and a zero it is a rest, beyond it is a range that ends."""
    accel, rate_hz = good.logs[0].samples.accel.copy(), 1 / good.logs[0].samples.period_s
    turn = int(np.argmax(np.abs(good.logs[0].samples.gyro).max(axis=1)))
    accel[turn : turn + round(rate_hz / 2), 1] = level_g * G
    finding = of(look(good, accel=accel), "accelerometer clipping")
    assert (finding.level == "warning") == clips
    assert (f"y stands at {level_g:g} g" in finding.says) == clips


def test_a_single_reading_at_the_registers_end_is_clipping(good):
    gyro, accel = good.logs[0].samples.gyro.copy(), good.logs[0].samples.accel.copy()
    gyro[500, 2] = -32768 * 0.0175 * DEG
    accel[700, 0] = 32767 * 0.122e-3 * G
    findings = look(good, gyro=gyro, accel=accel)
    assert "z stands at -573.44 dps in 1 samples, first at 2.4 s" in of(findings, "gyro clipping").says
    assert of(findings, "accelerometer clipping").level == "warning"


def test_a_peak_beyond_the_full_scale_is_no_clipping():
    table = Table().tumble(14, seed=5).turn(800, (0, 1, 0), 3.0).rest(2)
    finding = of(look(session_of(table.samples())), "gyro clipping")
    assert finding.level == "note"
    assert "full scale 500 is passed" in finding.says


@pytest.mark.parametrize("seed", [0, *map(broad, range(1, 5))])
def test_the_peak_of_a_noisy_turn_is_no_plateau(seed):
    made = session_of(Table().tumble(14, seed=seed).samples(gyro_mdps=3.0, seed=seed))
    assert of(look(made), "gyro clipping").level == "ok"


@pytest.mark.parametrize(("sensor", "axis"), [("gyro", 0), ("gyro", 2), ("accel", 1)])
def test_an_axis_that_never_moves_is_named(good, sensor, axis):
    values = getattr(good.logs[0].samples, sensor).copy()
    values[:, axis] = values[0, axis]
    findings = look(good, **{sensor: values})
    finding = of(findings, {"gyro": "gyro stuck", "accel": "accelerometer stuck"}[sensor])
    assert finding.level == "error"
    assert finding.says.startswith("xyz"[axis])


def test_rows_that_repeat_are_told_with_the_true_rate(good):
    """A loop that reads twice as fast as the sensor measures."""
    samples = good.logs[0].samples
    twice = np.repeat(np.arange(len(samples)), 2)
    t_ns = np.round(np.arange(len(twice)) * 1e9 / 416).astype(np.int64)
    doubled = Samples(t_ns, samples.gyro[twice], samples.accel[twice], samples.temp_c[twice])
    session = with_sensor(good, odr_hz=416.0)
    finding = of(look(session, log=replace(good.logs[0], samples=doubled)), "repeats")
    assert finding.level == "warning"
    assert "50%" in finding.says
    assert "208 Hz" in finding.says


# Temperature


def test_temperature_missing_stuck_implausible_and_moving(good):
    count = len(good.logs[0].samples)
    for temp_c, level, said in (
        (None, "note", "not recorded"),
        (np.full(count, 25.0), "note", "stands at 25.00"),
        (np.linspace(6400, 6656, count), "warning", "the sensor works from -40 to 105"),
        (np.linspace(22, 33, count), "note", "the bias is likely to follow"),
        (np.linspace(24, 25, count), "ok", "degC"),
    ):
        finding = of(look(good, temp_c=temp_c), "temperature")
        assert finding.level == level
        assert said in finding.says


# Readings that come several times


def held(samples, gyro=1, accel=1):
    """The gyroscope's and the accelerometer's readings standing for so many rows."""
    rows = np.arange(len(samples))
    return {name: getattr(samples, name)[(rows // each * each).astype(int)] for name, each in (("gyro", gyro), ("accel", accel))}


@pytest.mark.parametrize(
    ("rows", "level", "says"),
    [
        ({"gyro": 6, "accel": 6}, "warning", "83% of the rows repeat all six readings"),
        ({"accel": 2}, "note", "each reading of the accelerometer stands for 2 rows: new ones come at 104 Hz, rows at 208"),
        ({"accel": 1.5}, "note", "the accelerometer stands for 1.5 rows: new ones come at 139 Hz, rows at 208"),
        ({"gyro": 3}, "warning", "each reading of the gyro stands for 3 rows: new ones come at 69 Hz, rows at 208"),
    ],
    ids=str,
)
def test_readings_that_repeat_are_no_clipping(good, rows, level, says):
    findings = look(good, **held(good.logs[0].samples, **rows))
    finding = of(findings, "repeats")
    assert (finding.level, says in finding.says) == (level, True)
    assert of(findings, "gyro clipping").level == "ok"
    assert of(findings, "accelerometer clipping").level == "ok"


def test_a_limit_is_found_among_readings_that_repeat(good):
    samples = good.logs[0].samples
    limit = 0.7 * np.abs(samples.gyro[:, 0]).max()
    clipped = replace(samples, gyro=np.clip(samples.gyro, -limit, limit))
    for rows in (1, 4):
        finding = of(look(good, **held(clipped, gyro=rows)), "gyro clipping")
        assert finding.level == "warning"
        assert f"x stands at {limit / DEG:.5g} dps" in finding.says or f"{limit / DEG:.5g} dps" in finding.says


def test_a_register_that_comes_round_is_an_error(good):
    """At ±60 dps: where the movement goes on a whole register further."""
    samples, end = good.logs[0].samples, 60 * DEG
    narrow = with_sensor(good, gyro_mdps_per_lsb=60e3 / 32768)
    assert not [finding for finding in look(narrow, gyro=np.clip(samples.gyro, -end, end)) if finding.what == "gyro wraps"]
    finding = of(look(narrow, gyro=(samples.gyro + end) % (2 * end) - end), "gyro wraps")
    assert finding.level == "error"
    assert "between two readings in" in finding.says
    assert "the register comes round at ±60 dps" in finding.says
    spike = samples.gyro.copy()
    spike[4000] = -end
    assert not [finding for finding in look(narrow, gyro=np.clip(spike, -end, end)) if finding.what == "gyro wraps"]


@pytest.mark.parametrize(
    ("three", "found"),
    [
        ((0.8, 0.9, -1.0), True),  # on to 1.0, which is -1.0
        ((0.8, 0.9, -0.91), True),  # within a tenth of the end from where it went
        ((0.8, 0.9, -0.89), False),
        ((0.1, 0.55, -1.0), True),  # a jump of 1.55
        ((-0.09, 0.46, -0.99), False),  # of 1.45
        ((-0.8, -0.9, 1.0), True),
    ],
)
def test_a_jump_is_a_wrap_where_the_movement_goes_on(good, three, found):
    end = 60 * DEG
    gyro = 0.1 * good.logs[0].samples.gyro
    gyro[4000:4003, 1] = np.array(three) * end * 32767 / 32768
    narrow = with_sensor(good, gyro_mdps_per_lsb=60e3 / 32768)
    wraps = [finding for finding in look(narrow, gyro=gyro) if finding.what == "gyro wraps"]
    assert bool(wraps) == found
