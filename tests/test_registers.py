"""False readings, losses and ceilings in the registers: found where they are, not invented, repaired, and nothing else is touched."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, Table, config

from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc.explanation.mends import false_readings, interpolation, lost_samples
from tinygc.explanation.mends.ceilings import find_ceiling
from tinygc.explanation.mends.false_readings import find_glitches, without_glitches
from tinygc.explanation.mends.lost_samples import find_jumps, find_losses, with_lost
from tinygc.explanation.mends.mending import mend
from tinygc.problem.build import build_problem

RATES = (104.0, 208.0, 416.0, 833.0)
FS = 500 * DEG
GYRO_STD = 5e-3 * DEG  # per root hertz, as in Table.samples


def clean(odr_hz: float, seed: int, turns: int = 6) -> tuple[Samples, Table]:
    table = Table().tumble(turns, seed=seed)
    return table.samples(odr_hz=odr_hz, seed=seed), table


def noise_std(odr_hz: float) -> np.ndarray:
    """(6,) of a sample: white noise and the register's steps (500 dps, 4 g)."""
    gyro, accel = GYRO_STD * np.sqrt(odr_hz / 2), 60e-6 * 9.80665 * np.sqrt(odr_hz / 2)
    steps = np.array([17.5e-3 * DEG, 0.122e-3 * 9.80665]) / np.sqrt(12)
    return np.repeat(np.hypot([gyro, accel], steps), 3)


def rows_in_turns(table: Table, samples: Samples, each: int, seed: int) -> np.ndarray:
    """Rows well inside the turns, ``each`` in every turn, at least a third of a second apart: where rate and gravity both change."""
    rng = np.random.default_rng(seed)
    stops, starts = [stop for _, stop in table.rests[:-1]], [start for start, _ in table.rests[1:]]
    times = []
    for stop, start in zip(stops, starts, strict=True):
        slots = stop + (start - stop) * (0.2 + 0.6 * np.arange(each) / each)
        times += (slots + rng.uniform(0, 0.6 * (start - stop) / each - 0.35, each)).tolist()
    return np.searchsorted(samples.t_s, np.array(times))


def with_glitches(samples: Samples, rows: np.ndarray, lengths: np.ndarray, seed: int) -> Samples:
    """A constant false offset of 20 to 80 dps on a random axis or all of them."""
    rng, gyro = np.random.default_rng(seed), samples.gyro.copy()
    for row, length in zip(rows, lengths, strict=True):
        size = rng.uniform(20, 80, 3) * rng.choice([-1, 1], 3) * DEG
        size *= rng.choice([0, 1], 3, p=[0.5, 0.5]) if rng.random() < 0.5 else 1
        size[rng.integers(3)] = 40 * DEG
        gyro[row : row + length] += size
    return replace(samples, gyro=gyro)


def with_losses(samples: Samples, rows: np.ndarray, count: int) -> Samples:
    """``count`` samples gone after each row, and the stamps closed up."""
    kept = np.ones(len(samples), dtype=bool)
    for row in rows:
        kept[row + 1 : row + 1 + count] = False
    return Samples(samples.t_ns[: kept.sum()], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])


def closed_up(rows: np.ndarray, count: int) -> np.ndarray:
    """The same rows, counted after the losses before them."""
    return rows - count * np.arange(len(rows))


# Nothing is invented


@pytest.mark.parametrize("odr_hz", RATES)
def test_a_clean_movement_has_no_jumps_and_no_ceiling(odr_hz):
    for seed in range(12):
        samples, _ = clean(odr_hz, seed, turns=3)
        jumps = find_jumps(samples)
        assert len(jumps.rows) == 0, (seed, jumps.rows, jumps.size)
        assert find_glitches(samples) is None
        assert len(find_losses(jumps, samples.duration_s)) == 0
        assert find_ceiling(samples, FS) is None


@pytest.mark.parametrize("noise", [(1.0, 20.0), (20.0, 300.0)])
def test_nor_has_a_quieter_or_noisier_sensor(noise):
    for seed in range(8):
        samples = Table().tumble(3, seed=seed).samples(odr_hz=208, seed=seed, gyro_mdps=noise[0], accel_ug=noise[1])
        assert len(find_jumps(samples).rows) == 0
        assert find_ceiling(samples, FS) is None


@pytest.mark.parametrize("share", [0.005, 0.02, 0.05])
def test_samples_that_are_openly_missing_are_neither_losses_nor_false_readings(share):
    """A cable that drops single samples: the stamps say where, so no step there is a secret."""
    for seed in range(4):
        samples, _ = clean(208.0, seed)
        kept = np.random.default_rng(seed).random(len(samples)) > share
        some = Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])
        jumps = find_jumps(some)
        assert len(jumps.rows) == 0
        assert find_glitches(some) is None


def test_a_turn_that_starts_at_once_is_no_jump():
    """A short strong turn after a long rest: its neighbourhood's scatter is that of the rest until it begins."""
    samples = Table().rest(5).turn(90, (1, 2, 0), 0.6).rest(5).samples(odr_hz=208)
    assert len(find_jumps(samples).rows) == 0


def test_a_short_recording_has_no_jumps():
    samples = Table().rest(0.5).samples(odr_hz=104)
    assert len(find_jumps(samples).rows) == 0
    assert find_glitches(samples) is None


# False readings


@pytest.mark.slow
@pytest.mark.parametrize("odr_hz", RATES)
@pytest.mark.parametrize("length", [1, 2, 4, 8])
def test_false_readings_are_found_with_their_rows_and_lengths(odr_hz, length):
    for seed in range(3):
        samples, table = clean(odr_hz, seed)
        rows = rows_in_turns(table, samples, 2, seed)
        glitches = find_glitches(with_glitches(samples, rows, np.full(len(rows), length), seed))
        np.testing.assert_array_equal(glitches.rows, rows)
        np.testing.assert_array_equal(glitches.samples, length)


def test_false_readings_in_a_still_are_found_too():
    samples = Table().rest(8).turn(90, (1, 0, 0)).rest(8).samples(odr_hz=208)
    rows = np.array([300, 800, 1400, 2500])
    glitches = find_glitches(with_glitches(samples, rows, np.array([1, 3, 5, 2]), 0))
    np.testing.assert_array_equal(glitches.rows, rows)
    np.testing.assert_array_equal(glitches.samples, [1, 3, 5, 2])


@pytest.mark.parametrize("odr_hz", RATES)
def test_repaired_readings_are_within_noise_and_bending_of_the_true_ones(odr_hz):
    """A straight line over n samples of a rate w misses by at most w'' ((n + 1) dt)^2 / 8; noise of both ends comes on top."""
    samples, table = clean(odr_hz, 1)
    rows, length = rows_in_turns(table, samples, 2, 1), 4
    spoilt = with_glitches(samples, rows, np.full(len(rows), length), 1)
    repaired = without_glitches(spoilt, find_glitches(spoilt))
    true, _ = table.truth(samples.t_s)
    second = np.abs(np.gradient(np.gradient(true, axis=0), axis=0)).max() * odr_hz**2
    bias = np.array([0.5, -0.3, 0.6]) * DEG
    bent = second * ((length + 1) / odr_hz) ** 2 / 8
    touched = (rows[:, None] + np.arange(length)).ravel()
    assert np.abs(repaired.gyro - true - bias)[touched].max() < bent + 5 * GYRO_STD * np.sqrt(odr_hz / 2) + 0.5 * 17.5e-3 * DEG
    others = np.delete(np.arange(len(samples)), touched)
    np.testing.assert_array_equal(repaired.gyro[others], samples.gyro[others])
    for name in ("t_ns", "accel", "temp_c"):
        np.testing.assert_array_equal(getattr(repaired, name), getattr(samples, name))
    assert np.abs(spoilt.gyro - samples.gyro).max() > 10 * DEG  # the record that was given is not changed


def test_a_knock_that_the_accelerometer_feels_is_no_false_reading():
    samples = Table().rest(8).turn(90, (1, 0, 0)).rest(8).samples(odr_hz=208)
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[1000:1003] += 20 * DEG
    accel[1000:1003] += 30.0
    knocked = replace(samples, gyro=gyro, accel=accel)
    assert len(find_jumps(knocked).rows) == 2
    assert find_glitches(knocked) is None


def test_more_than_one_a_second_is_another_thing():
    samples = Table().rest(20).samples(odr_hz=208)
    rows = np.arange(100, 4000, 120)
    spoilt = with_glitches(samples, rows, np.full(len(rows), 2), 0)
    assert find_glitches(spoilt) is None


# Losses


@pytest.mark.parametrize("odr_hz", RATES)
@pytest.mark.parametrize("lost_s", [0.045, 0.06, 0.12])
def test_losses_are_found_at_their_rows(odr_hz, lost_s):
    """All whose step, which is twice as large in the third difference, stands well out of that difference's noise (root 20)."""
    count, found_all = round(lost_s * odr_hz), 0
    for seed in range(4):
        samples, table = clean(odr_hz, seed)
        rows = rows_in_turns(table, samples, 1, seed)
        spoilt = with_losses(samples, rows, count)
        found = set(find_losses(find_jumps(spoilt), spoilt.duration_s))
        assert found <= set(closed_up(rows, count))
        true, attitude = table.truth(samples.t_s)
        values = np.concatenate([true, attitude.inv().apply([0, 0, -9.7946])], axis=1)
        step = np.abs(values[rows + count + 1] - values[rows])
        size = np.linalg.norm(2 * step / (np.sqrt(20) * noise_std(odr_hz)), axis=1)
        clear = set(closed_up(rows, count)[size > 2 * lost_samples.JUMP])
        assert clear <= found
        found_all += len(clear)
    assert found_all >= 3


@pytest.mark.parametrize("odr_hz", RATES)
def test_what_was_lost_is_put_back(odr_hz):
    """Stamps as they were; readings on a cubic through four neighbours on either side: its own noise, and what it does not bend."""
    count = round(0.06 * odr_hz)
    samples, table = clean(odr_hz, 2)
    rows = rows_in_turns(table, samples, 1, 2)
    back = with_lost(with_losses(samples, rows, count), closed_up(rows, count), count, 3)
    assert len(back) == len(samples)
    np.testing.assert_allclose(back.t_ns, samples.t_ns, atol=500 * (count * len(rows) + 2))  # stamps are whole microseconds
    assert (np.diff(back.t_ns) > 0).all()
    lost = (rows[:, None] + 1 + np.arange(count)).ravel()
    others = np.delete(np.arange(len(samples)), lost)
    for name in ("gyro", "accel", "temp_c"):
        np.testing.assert_array_equal(getattr(back, name)[others], getattr(samples, name)[others])
    known = np.concatenate([np.arange(-4, 0), np.arange(count, count + 4)])
    gain = np.linalg.norm(np.vander(np.arange(count), 4) @ np.linalg.pinv(np.vander(known, 4)), axis=1).max()
    true, attitude = table.truth(samples.t_s)
    noise = noise_std(odr_hz)
    assert np.abs(back.gyro - true - np.array([0.5, -0.3, 0.6]) * DEG)[lost].max() < 0.05 * DEG + 4 * gain * noise[0]
    level = attitude.inv().apply([0, 0, -9.7946])
    assert np.abs(back.accel - level)[lost].max() < 0.005 + 4 * gain * noise[5]


def test_a_log_without_temperature_is_put_back_too():
    samples, table = clean(208.0, 0)
    rows = rows_in_turns(table, samples, 1, 0)
    bare = replace(with_losses(samples, rows, 9), temp_c=None)
    back = with_lost(bare, closed_up(rows, 9), 9, 3)
    assert back.temp_c is None
    assert len(back) == len(samples)


def test_putting_nothing_back_changes_nothing():
    samples, _ = clean(208.0, 0, turns=2)
    back = with_lost(samples, np.zeros(0, dtype=int), 5, 3)
    for name in ("t_ns", "gyro", "accel", "temp_c"):
        np.testing.assert_array_equal(getattr(back, name), getattr(samples, name))


def test_false_readings_are_no_losses():
    samples, table = clean(208.0, 3)
    rows = rows_in_turns(table, samples, 2, 3)
    spoilt = with_glitches(samples, rows, np.full(len(rows), 4), 3)
    assert len(find_losses(find_jumps(spoilt), spoilt.duration_s)) == 0


@pytest.mark.parametrize("odr_hz", [104.0, 208.0])
def test_corners_of_a_clipped_rate_are_no_losses(odr_hz):
    """They are jumps of the gyro alone: what was lost would be missing from the accelerometer as well."""
    table = Table().rest(2)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)):
        table.turn(170, axis, 0.8).rest(2)
    samples = table.samples(odr_hz=odr_hz)
    clipped = replace(samples, gyro=np.clip(samples.gyro, -200 * DEG, 200 * DEG))
    jumps = find_jumps(clipped)
    assert len(jumps.rows) >= 4
    assert len(find_losses(jumps, clipped.duration_s)) == 0
    assert find_glitches(clipped) is None


# Ceilings


@pytest.mark.parametrize("odr_hz", RATES)
@pytest.mark.parametrize("level_dps", [40.0, 55.0])
def test_a_level_that_is_never_passed_is_found(odr_hz, level_dps):
    for seed in range(3):
        samples, _ = clean(odr_hz, seed)
        level = np.rint(level_dps / 17.5e-3) * 17.5e-3 * DEG
        clipped = replace(samples, gyro=np.clip(samples.gyro, -level, level))
        ceiling = find_ceiling(clipped, FS)
        assert ceiling.level == pytest.approx(level, rel=1e-9)
        over = (np.abs(samples.gyro) > level).any(axis=1)
        assert ceiling.mask[over].mean() > 0.6  # of the axes and senses that stay there long enough
        assert not ceiling.mask[(np.abs(samples.gyro) < 0.98 * level).all(axis=1)].any()


# In whole sessions: rows and times go on from log to log


def session_of_logs(*logs: Samples) -> Session:
    return Session(Path("made"), config(), tuple(Log(Path(f"log{i:04}.csv"), samples) for i, samples in enumerate(logs)), ())


@pytest.fixture(scope="module")
def two():
    """Two clean logs of eight turns each, and where in them the turns are."""
    tables = [Table().tumble(8, seed=seed) for seed in (11, 12)]
    return [(table.samples(seed=seed), table) for seed, table in enumerate(tables)]


def test_a_clean_session_has_nothing_to_mend(two):
    problem = build_problem(session_of_logs(*(samples for samples, _ in two)))
    mended = mend(problem)
    assert mended.found == {}
    assert mended.problem is problem


def test_false_readings_of_the_second_log_are_counted_after_the_first(two):
    (first, _), (second, table) = two
    rows = rows_in_turns(table, second, 1, 5)
    spoilt = with_glitches(second, rows, np.full(len(rows), 3), 5)
    mended = mend(build_problem(session_of_logs(first, spoilt)))
    assert list(mended.found) == ["data.glitches"]
    parameters, _ = mended.found["data.glitches"]
    assert parameters == {"at": (rows + len(first)).tolist(), "samples": 3}
    log = mended.problem.session.logs
    np.testing.assert_array_equal(log[0].samples.gyro, first.gyro)
    assert np.abs(log[1].samples.gyro - second.gyro).max() < 0.5 * DEG


def test_losses_of_the_second_log_are_timed_after_the_first(two):
    (first, _), (second, table) = two
    rows = rows_in_turns(table, second, 1, 6)[::2]  # twelve turns without a loss: enough for a linear model of their own
    mended = mend(build_problem(session_of_logs(first, with_losses(second, rows, 9))))
    assert list(mended.found) == ["timing.dropped_samples"]
    parameters, _ = mended.found["timing.dropped_samples"]
    assert parameters["length"] == 9
    np.testing.assert_allclose(parameters["at_s"], first.duration_s + second.t_s[rows], atol=0.02)
    assert [len(log.samples) for log in mended.problem.session.logs] == [len(first), len(second)]


def test_a_ceiling_in_one_log_leaves_the_other_logs_segments_alone(two):
    (first, _), (second, _) = two
    clipped = replace(second, gyro=np.clip(second.gyro, -70 * DEG, 70 * DEG))
    problem = build_problem(session_of_logs(first, clipped))
    mended = mend(problem)
    assert list(mended.found) == ["gyro.saturation"]
    assert mended.found["gyro.saturation"][0]["dps"] == pytest.approx(70, rel=2e-3)
    assert [s.number for s in mended.problem.used if s.log == 0] == [s.number for s in problem.used if s.log == 0]
    left = [s for s in mended.problem.used if s.log == 1]
    samples = problem.logs[1].samples
    assert len(left) < 8
    assert all(np.abs(samples.gyro[s.start : s.stop]).max() < 70 * DEG for s in left)


def test_bars_are_said_once():
    """A glitch of the longest kind that is bridged, and one sample more, which is not taken for one."""
    samples = Table().rest(8).turn(90, (1, 0, 0)).rest(8).samples(odr_hz=208)
    for length, known in ((false_readings.LONGEST, True), (false_readings.LONGEST + 1, False)):
        spoilt = with_glitches(samples, np.array([900]), np.array([length]), 0)
        assert (find_glitches(spoilt) is not None) == known


def test_losses_in_every_turn_are_counted_without_a_whole_segment(two):
    """No segment is left from which to learn a linear model: each count is judged with its own."""
    (first, table), _ = two
    rows = rows_in_turns(table, first, 1, 6)
    mended = mend(build_problem(session_of_logs(with_losses(first, rows, 9))))
    assert mended.found["timing.dropped_samples"][0]["length"] == 9


def test_a_gap_is_crossed_as_well_as_this_movement_allows_and_the_floor_says_how_well(two):
    """The error that intact places promise is the error at the places that were taken away."""
    (first, table), _ = two
    rows, count = rows_in_turns(table, first, 1, 6), 9
    spoilt, at = with_losses(first, rows, count), closed_up(rows, count)
    order, promised = interpolation.best_order(spoilt, at, count)
    back = lost_samples.with_lost(spoilt, at, count, order)
    missed = [(back.gyro - first.gyro)[row + 1 : row + 1 + count].sum(axis=0) * first.period_s for row in rows]
    assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(promised, rel=0.5)


@pytest.mark.parametrize(("shaking_hz", "noise_dps", "expected"), [(5.0, 0.02, 5), (0.3, 0.5, 1)])
def test_a_rough_hand_asks_for_a_high_order_and_a_noisy_sensor_for_a_low_one(shaking_hz, noise_dps, expected):
    t = np.arange(8000) / 208
    gyro = 100 * DEG * np.sin(2 * np.pi * shaking_hz * t[:, None] + [0, 1, 2])
    gyro += noise_dps * DEG * np.random.default_rng(2).standard_normal(gyro.shape)
    samples = Samples((t * 1e9).astype(np.int64), gyro, np.zeros_like(gyro), None)
    order, missed_rad = interpolation.best_order(samples, np.array([4000]), 9)
    assert order == expected
    assert missed_rad > 0.9 * noise_dps * DEG * np.sqrt(9) / 208  # what was not read holds noise of its own
