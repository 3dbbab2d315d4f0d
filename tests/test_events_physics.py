"""False readings, losses and clipping: found in the registers, tried by closure, and mended; each repair by hand."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG, Table, broad, config, session_of
from linear_twin import effect, linear_twin
from scipy import special, stats
from small_turns import PERFECT, TRUE, angles_by_scipy, small_turns, turned_ends

from session.detect import bridging
from session.io.logfile import Bridge, Log
from session.io.numeric import MEDIAN_SIGMAS
from session.io.samples import Samples
from tinygc import Session
from tinygc.closure.build import build_problem
from tinygc.effects import Reach
from tinygc.explanation import data_repair, faulty_readings
from tinygc.explanation.clipped_turns import (
    _find_plateaus,
    _plateaus_of,
    about_the_vertical,
    excess_of,
    find_ceiling,
    find_clipping,
)
from tinygc.explanation.data_repair import (
    _EVERY_CHOICE,
    ClosureTrial,
    Verdict,
    _chance_of_each,
    _common_count,
    _with_accepted,
    _with_gaps,
    choices,
    left_open,
    lowest,
    repair,
)
from tinygc.explanation.faulty_readings import (
    FALSE,
    LOST,
    Crossing,
    RegisterFault,
    _away_from_blows,
    _excursion_at,
    _impossible_rows,
    _in_bridge,
    _local_scatter,
    _possible_losses,
    _steps_at,
    bridged,
    crossing,
    find_glitches,
    find_jumps,
    find_losses,
    proposed,
    register_step,
    with_lost,
    without_glitches,
)
from tinygc.explanation.physics import lost_in
from tinygc.noise.components import TURN

LSB = 17.5e-3 * DEG
FS = 500 * DEG


def samples_of(gyro, accel=None, odr_hz=100.0, temp=True) -> Samples:
    gyro = np.asarray(gyro, dtype=float)
    accel = np.tile([0.0, 0.0, -9.8], (len(gyro), 1)) if accel is None else accel
    return Samples(np.arange(len(gyro)) * round(1e9 / odr_hz), gyro, accel, np.arange(len(gyro)) * 0.01 if temp else None)


def noisy(count=1000, odr_hz=100.0, seed=0, **known) -> Samples:
    """A still of noise of some steps of the registers."""
    rng = np.random.default_rng(seed)
    gyro = np.rint(rng.normal(0, 4, (count, 3))) * LSB
    accel = np.rint(np.add(rng.normal(0, 40, (count, 3)), [0, 0, 8000])) * 1.2e-3
    return samples_of(gyro, accel, odr_hz, **known)


def rows_in_turns(table: Table, samples: Samples, each: int, seed: int) -> np.ndarray:
    """Rows well inside the turns, ``each`` in every turn, at least a third of a second apart: where rate and gravity both change."""
    rng = np.random.default_rng(seed)
    stops, starts = [stop for _, stop in table.rests[:-1]], [start for start, _ in table.rests[1:]]
    times = []
    for stop, start in zip(stops, starts, strict=True):
        slots = stop + (start - stop) * (0.2 + 0.6 * np.arange(each) / each)
        times += (slots + rng.uniform(0, 0.6 * (start - stop) / each - 0.35, each)).tolist()
    return np.searchsorted(samples.t_s, np.array(times))


def with_losses(samples: Samples, rows: np.ndarray, count: int) -> Samples:
    """``count`` samples gone after each row, and the stamps closed up."""
    kept = np.ones(len(samples), dtype=bool)
    for row in rows:
        kept[row + 1 : row + 1 + count] = False
    return Samples(samples.t_ns[: kept.sum()], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])


def closed_up(rows: np.ndarray, count: int) -> np.ndarray:
    """The same rows, counted after the losses before them."""
    return rows - count * np.arange(len(rows))


def session_with(*logs: Samples, bridges=()) -> Session:
    files = tuple(Log(Path(f"log{i:04}.csv"), samples, bridges=tuple(bridges)) for i, samples in enumerate(logs))
    return Session(Path("made"), config(odr_hz=100.0), files, ())


# Jumps


def test_the_scatter_around_a_row_is_the_greatest_of_its_neighbourhoods_and_no_less_than_usual():
    """Neighbourhoods of 32 rows at least, or of a fifth of a second; the rows behind the last whole one have its scatter."""
    levels = np.array([1.0, 2.0, 9.0, 3.0, 4.0, 5.0, 1e-30])
    for step, period_s in ((32, 0.01), (40, 0.005)):
        values = np.repeat(levels, step)[: 7 * step - 5]  # six whole ones
        expected = np.repeat(np.maximum([2, 9, 9, 9, 5, 5], 3.5), step) / MEDIAN_SIGMAS
        found = _local_scatter(values[:, None], period_s)[:, 0]
        np.testing.assert_allclose(found[: 6 * step], expected)
        np.testing.assert_allclose(found[6 * step :], 5 / MEDIAN_SIGMAS)
    for count, parts in ((5 * 32, True), (5 * 32 - 1, False)):
        found = _local_scatter(np.repeat(levels[:5], 32)[:count, None], 0.01)[:, 0]
        assert (found[0] == found[-1]) != parts
    assert _local_scatter(np.zeros((10, 1)), 0.01).max() == _local_scatter(np.zeros((400, 1)), 0.01).max() == 1e-12


@pytest.mark.parametrize(
    ("heights", "steps"),
    [
        ((10, -20, 10), [(10, 10.0)]),  # a step for good: 1, -2, 1
        ((0, -30, 30, 0), [(10, 15.0)]),  # a corner has no flanks
        ((10, -30, 22.6, -10), [(10, 10.0), (11, -22.6 / 3)]),  # one false sample: 1, -3, 3, -1
        ((10, -30, 22.4, -10), [(10, 15.0)]),  # the second peak has less than three quarters
        ((6.1, -30, 30, -6.1), [(10, 10.0), (11, -10.0)]),
        ((5.9, -30, 30, -10), [(10, 15.0)]),  # flanks of less than a fifth
        ((10, -30, -30, 10), [(10, 15.0)]),  # of the same sign
    ],
)
def test_a_peak_is_a_step_or_a_false_reading_of_one_sample_or_two(heights, steps):
    size = np.zeros((20, 6))
    size[8 : 8 + len(heights), 1] = heights
    total, at = np.linalg.norm(size, axis=1), 8 + int(np.argmax(np.abs(heights)))
    found = _steps_at(at, size, total)
    assert [row for row, _ in found] == [row for row, _ in steps]
    np.testing.assert_allclose([step for _, step in found], [[0, height, 0, 0, 0, 0] for _, height in steps])
    if heights == (10, -30, 22.6, -10):  # at the ends of a log a peak is a step
        for cut, at, count in ((slice(9, None), 0, 1), (slice(8, None), 1, 2), (slice(None, 11), 9, 1), (slice(None, 12), 9, 2)):
            assert len(_steps_at(at, size[cut], total[cut])) == count


@pytest.mark.parametrize(("height", "found"), [(1.01, True), (0.99, False)])
def test_a_jump_is_twelve_times_the_scatter_of_all_channels_together(height, found):
    """Of third differences, which a step for good makes 1, -2, 1 times as high; and of all rows the filter has settled in."""
    samples = noisy()
    third = np.diff(np.hstack([samples.gyro, samples.accel]), 3, axis=0)
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[502:] += gyro[499] - gyro[502]
    gyro[496:506], accel[496:506] = gyro[499], accel[496]  # the same reading around the step
    gyro[502:, 0] += height * 6 * _local_scatter(np.abs(third), 0.01)[498, 0]
    gyro[3:, 1] += 1.0  # while it settles
    jumps = find_jumps(replace(samples, gyro=gyro, accel=accel))
    assert (501 in jumps.rows) == found
    assert jumps.rows.min(initial=501) > 10
    if found:
        np.testing.assert_allclose(jumps.size[jumps.rows == 501][0], [height * 6, 0, 0, 0, 0, 0], rtol=0.05)


def test_two_jumps_three_rows_apart_are_two_and_at_a_gap_that_the_stamps_show_there_is_none():
    samples = noisy()
    gyro = samples.gyro.copy()
    gyro[500:, 0] += 1.0
    stepped = replace(samples, gyro=gyro.copy())
    late = replace(stepped, t_ns=samples.t_ns + (np.arange(1000) >= 500) * 20_000_000)
    assert find_jumps(stepped).rows.tolist() == [499]
    assert find_jumps(late).rows.tolist() == []
    assert find_glitches(stepped) is None
    for second in (0.8, 1.25):
        gyro[503:, 0] += second
        assert find_jumps(replace(samples, gyro=gyro)).rows.tolist() == [499, 502]
        gyro[503:, 0] -= second


def test_a_long_log_is_read_in_parts_that_overlap(monkeypatch):
    for name, value in (("LONG", 600), ("AT_ONCE", 200), ("BESIDE", 100)):
        monkeypatch.setattr(faulty_readings, name, value)
    samples = noisy(650)
    gyro = samples.gyro.copy()
    gyro[199:] += 1.0
    gyro[450:] -= 1.0
    gyro[[300, 520]] += 0.5
    stepped = replace(samples, gyro=gyro)
    rows, glitches = find_jumps(stepped).rows.tolist(), find_glitches(stepped)
    monkeypatch.setattr(faulty_readings, "LONG", 1000)
    assert rows == find_jumps(stepped).rows.tolist() == [198, 299, 300, 449, 519, 520]
    assert glitches.rows.tolist() == find_glitches(stepped).rows.tolist() == [300, 520]


# Losses


def jumps_of(rows, accel=5.0):
    return SimpleNamespace(rows=np.array(rows, dtype=int), size=np.tile([1.0, 0, 0, accel, 0, 0], (len(rows), 1)))


def test_a_loss_is_a_jump_alone_that_the_accelerometer_shows_too():
    """A possible one is the greatest within eight rows; more than one per second has another cause."""
    jumps = jumps_of([0, 100, 108, 200, 209, 300, 301])
    jumps.size[:, 3] = [1.0, 5.0, 6.0, 5.0, 6.0, 4.0, 4.0]
    assert find_losses(jumps, 10.0).tolist() == [0, 200, 209]
    assert _possible_losses(jumps, 10.0).tolist() == [0, 108, 200, 209, 300, 301]
    for accel, count in ((3.001, 2), (2.999, 0)):
        assert len(find_losses(jumps_of([100, 200], accel), 10.0)) == count
    for seconds, count in ((2.0, 2), (1.9, 0)):
        assert len(find_losses(jumps_of([100, 200]), seconds)) == len(_possible_losses(jumps_of([100, 200]), seconds)) == count


def test_no_loss_is_looked_for_within_a_fifth_of_a_second_of_a_blow():
    accel = np.tile([0.0, 0.0, 9.8], (200, 1))
    accel[100:] *= 3  # the greatest jump comes after row 99
    rows = np.array([10, 78, 79, 99, 119, 120, 190])
    assert _away_from_blows(samples_of(np.zeros((200, 3)), accel), rows).tolist() == [10, 78, 120, 190]
    assert _away_from_blows(samples_of(np.zeros((200, 3))), rows).tolist() == rows.tolist()


def test_the_step_of_a_register_is_the_smallest_between_readings():
    assert register_step(np.array([0.0, 3.0, 3.0, 5.0, 4.9999999999])) == pytest.approx(2.0)
    assert register_step(np.array([0.0, 2e-9, 0.0])) == pytest.approx(2e-9)
    assert register_step(np.array([0.0, 1e-10])) == register_step(np.ones(5)) == 0.0
    assert register_step(np.r_[np.arange(20_000) * 2.0, 39_999.0]) == 2.0  # of so many readings
    assert register_step(np.r_[np.arange(19_999) * 2.0, 39_997.0]) == 1.0


def test_lost_samples_are_put_in_on_the_polynomial_and_later_stamps_move():
    """Of straight lines, exactly those that were lost, with a period between any two; each row with its own order."""
    t = np.arange(40.0)
    whole = samples_of(np.column_stack([t, -2 * t, 5 + t]), np.column_stack([3 * t, t, t]))
    kept = np.delete(np.arange(40), [10, 11, 12, 25, 26, 27])
    short = Samples(whole.t_ns[:34], whole.gyro[kept], whole.accel[kept], whole.temp_c[kept])
    back = with_lost(short, np.array([9, 21]), 3, np.array([1, 3]))
    for name in ("t_ns", "gyro", "accel", "temp_c"):
        np.testing.assert_allclose(getattr(back, name), getattr(whole, name), atol=1e-9)
    np.testing.assert_array_equal(with_lost(short, np.zeros(0, dtype=int), 3, 1).gyro, short.gyro)
    bent = np.column_stack([t**3, t**3, t**3])
    found = with_lost(Samples(whole.t_ns[:34], bent[kept], bent[kept], None), np.array([9, 21]), 3, np.array([1, 3]))
    np.testing.assert_allclose(found.gyro[25:28], bent[25:28])
    assert np.abs(found.gyro[10:13] - bent[10:13]).max() > 1
    assert found.temp_c is None


# False readings


@pytest.mark.parametrize(
    ("first", "count", "value", "found"),
    [(100, 8, 0, True), (100, 9, 0, False), (4, 2, 0, True), (3, 2, 0, False), (394, 2, 0, True), (395, 2, 0, False),
     (100, 1, -1, True), (100, 1, 1, True), (100, 1, 2, False)],
)  # fmt: skip
def test_rows_at_zero_or_one_step_from_it_are_no_readings(first, count, value, found):
    """Up to eight, with four on either side."""
    samples = noisy(400, seed=1)
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[first : first + count] = value * LSB * np.ones(3) * np.where(np.arange(count) % 2, 0, 1)[:, None]
    accel[first : first + count] = value * 1.2e-3
    assert _impossible_rows(replace(samples, gyro=gyro, accel=accel)) == ([(first, count, True)] if found else [])


@pytest.mark.parametrize(("again", "found"), [(1, []), (2, [(101, 2, True)]), (8, [(101, 8, True)]), (9, [])])
def test_a_row_that_repeats_twice_is_no_reading(again, found):
    samples = noisy(400, seed=1)
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[100 : 101 + again], accel[100 : 101 + again] = gyro[100], accel[100]
    assert _impossible_rows(replace(samples, gyro=gyro, accel=accel)) == found
    assert _impossible_rows(replace(samples, gyro=gyro, accel=0 * accel)) == []
    quiet = gyro.copy()
    quiet[:, 0] = np.where(np.arange(400) % 2, LSB, 0.0)
    quiet[100 : 101 + again, 0] = quiet[100, 0]
    assert _impossible_rows(replace(samples, gyro=quiet, accel=accel)) == []


def cluster(height, count=3, off=0.0, returns=1.0, accel=0.0, noise=1.0, axis=0, quiet=()):
    """Values (40, 6) with an excursion of ``count`` readings from row 20 on, and what is found of it at its third differences."""
    values = np.zeros((40, 6))
    values[20 : 20 + count, axis] = height
    values[20 + count :, axis] = (1 - returns) * height
    values[23 + count, axis] += off  # the last but one of the readings that carry the cubic
    values[20 : 20 + count, 3] = accel
    scatter = np.full((37, 6), noise * np.sqrt(20.0))
    scatter[list(quiet)] /= 2
    return _excursion_at(values, scatter, 18, 20 + count - 1)


@pytest.mark.parametrize(
    ("known", "found"),
    [
        ({"height": 8.01}, (20, 3, False)),
        ({"height": 8.0}, None),
        ({"height": 100.0, "noise": 12.7}, None),
        ({"height": 100.0, "accel": 101.0}, None),
        ({"height": 100.0, "count": 9}, None),
        ({"height": 100.0, "returns": 0.68}, (20, 3, False)),
        ({"height": 100.0, "returns": 0.42}, None),
        ({"height": 100.0, "off": 18.1}, (20, 3, False)),
        ({"height": 100.0, "off": 18.2, "axis": 2}, None),
        ({"height": 10.0, "noise": 1.3, "quiet": [17, 23]}, None),
        ({"height": 10.0, "noise": 1.3, "quiet": [18]}, (20, 3, False)),
        ({"height": 10.0, "noise": 1.3, "quiet": [22]}, (20, 3, False)),
        ({"height": 10.0, "off": 3.8}, (20, 3, False)),
        ({"height": 10.0, "off": 3.95}, None),
    ],
)
def test_an_excursion_is_eight_sigmas_of_the_gyro_alone_and_returns(known, found):
    """It may miss its supporting readings by an eighth of itself, or by two and a half sigmas of noise: of the least in its rows."""
    assert cluster(**known) == found


def test_an_excursion_needs_readings_on_either_side():
    values, scatter = np.zeros((40, 6)), np.full((37, 6), np.sqrt(20.0))
    for row, found in ((6, True), (5, False), (33, True), (34, False)):
        one = values.copy()
        one[row, 1] = 50.0
        assert (_excursion_at(one, scatter, row - 3, row) is not None) == found
    long = values.copy()
    long[20, 1] = 50.0
    for last, found in ((26, True), (27, False)):  # twelve rows from the first to the last
        assert (_excursion_at(long, scatter, 16, last) is not None) == found
    weak = values.copy()
    weak[20:23, 1] = [50.0, 4.9, 50.0]  # a tenth of the greatest, or it ends there
    weak[24, 1] = 4.0
    assert _excursion_at(weak, scatter, 18, 22)[1] == 3


def test_false_readings_are_found_where_they_are_whatever_their_kind_and_replaced():
    samples = noisy(2000, seed=3)
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[300:303] += 1.0
    gyro[700] -= 0.5
    gyro[900:902], accel[900:902] = 0, 0
    gyro[1200:1206], accel[1200:1206] = gyro[1199], accel[1199]
    spoilt = replace(samples, gyro=gyro, accel=accel)
    glitches = find_glitches(spoilt)
    found = list(zip(glitches.rows.tolist(), glitches.samples.tolist(), glitches.accel.tolist(), strict=True))
    assert found == [(300, 3, False), (700, 1, False), (900, 2, True), (1200, 6, True)]
    mended = without_glitches(spoilt, glitches)
    np.testing.assert_array_equal(mended.gyro[[299, 303, 899, 902]], gyro[[299, 303, 899, 902]])
    np.testing.assert_array_equal(mended.accel[300:303], accel[300:303])
    assert np.abs(mended.gyro[[300, 700, 900, 1200]]).max() < 20 * LSB
    assert find_glitches(samples) is None
    many = samples.gyro.copy()
    rows = np.arange(100, 1900, 80)
    many[rows] += 1.0
    for seconds, some in ((len(rows), True), (len(rows) - 1, False)):  # one per second and no more
        stretched = replace(samples, gyro=many, t_ns=np.round(np.arange(2000) * 1e9 * seconds / 1999).astype(np.int64))
        assert (find_glitches(stretched) is not None) == some


@pytest.mark.parametrize(("gap", "found"), [(493, True), (494, False), (506, False), (507, True)])
def test_an_excursion_beside_a_gap_that_the_stamps_show_is_none(gap, found):
    """Third differences of a false row 500 are those from 497 to 500; four readings on either side carry the cubic."""
    samples = noisy()
    gyro = samples.gyro.copy()
    gyro[500] += 1.0
    late = replace(samples, gyro=gyro, t_ns=samples.t_ns + (np.arange(1000) > gap) * 20_000_000)
    assert (find_glitches(late) is not None) == found


# Of a session


@pytest.mark.parametrize(
    ("row", "samples", "inside"), [(92, 3, False), (93, 3, True), (94, 0, False), (95, 0, True), (107, 1, True), (108, 1, False)]
)
def test_an_event_at_a_bridged_gap_is_none(row, samples, inside):
    """Within four rows of what was put in: three rows from 100 on."""
    bridges = [Bridge(bridging.GAP, 100, 3, 1.0, np.zeros(3)), Bridge("clipped", 50, 3, 0.5, np.zeros(3))]
    session = session_with(noisy(400), bridges=bridges)
    assert _in_bridge(session, RegisterFault(FALSE, 0, row, samples)) == inside
    assert not _in_bridge(session, RegisterFault(FALSE, 0, 51, 1))


def test_events_of_every_log_are_proposed_and_bridged_in_their_own():
    clean, spoilt = noisy(1000, seed=1), noisy(1000, seed=2)
    gyro, accel = spoilt.gyro.copy(), spoilt.accel.copy()
    gyro[400:402] += 1.0
    gyro[700:] += 0.5
    accel[700:] += 3.0
    spoilt = replace(spoilt, gyro=gyro, accel=accel)
    events = proposed(session_with(clean, spoilt))
    assert events == [RegisterFault(FALSE, 1, 400, 2, False), RegisterFault(LOST, 1, 699)]
    mended = bridged(session_with(clean, spoilt), events)
    np.testing.assert_array_equal(mended.logs[0].samples.gyro, clean.gyro)
    changed = np.flatnonzero((np.asarray(mended.logs[1].samples.gyro) != gyro).any(axis=1))
    assert changed.tolist() == [400, 401]
    for event, length, count in ((events[0], 9, 2), (events[1], 9, 9), (events[1], 0, 1)):
        found = crossing(spoilt, event, length)
        assert (found.order, found.missed_rad) == bridging.best_order(spoilt, np.array([event.row]), count)


def test_an_excursion_of_the_gyro_beside_a_blow_is_the_blows_but_a_row_that_no_sensor_outputs_is_false():
    spoilt = noisy(1000)
    gyro, accel = spoilt.gyro.copy(), spoilt.accel.copy()
    gyro[[400, 600]] += 1.0
    accel[[605]] *= 3
    gyro[[615]] = accel[[615]] = 0.0
    found = proposed(session_with(replace(spoilt, gyro=gyro, accel=accel)))
    assert [e for e in found if e.id == FALSE] == [RegisterFault(FALSE, 0, 400, 1, False), RegisterFault(FALSE, 0, 615, 1, True)]


# Clipping


def strokes(level=200.0, flat=20, ramp=60, rest=100):
    """Three trapezoids on the x axis, dps, between rests, in registers."""
    up = np.linspace(0, level, ramp + 1)[1:-1]
    x = np.concatenate([np.zeros(rest), *[up, np.full(flat, level), up[::-1], np.zeros(rest)] * 3])
    gyro = np.random.default_rng(0).normal(0, 0.05, (len(x), 3))
    gyro[:, 0] += x
    return samples_of(np.rint(gyro / 17.5e-3) * LSB)


def test_a_ceiling_is_a_level_that_is_kept_for_longer_than_noise_keeps_it():
    """With three steps of noise, for seven readings; above a twentieth of full scale; negative ones count as positive; with corners."""
    quiet = strokes()
    level = np.rint(200 / 17.5e-3) * LSB - 2 * LSB
    clipped = replace(quiet, gyro=np.clip(quiet.gyro, -level, level))
    ceiling = find_ceiling(clipped, FS)
    assert ceiling.level == pytest.approx(level)
    at = (np.abs(clipped.gyro) >= level - 1.5 * LSB).any(axis=1)
    np.testing.assert_array_equal(ceiling.mask, at)
    short = np.array(clipped.gyro)
    short[50:52, 1], short[55, 2] = -level, level - 2 * LSB  # two readings at it on another axis, and one below
    np.testing.assert_array_equal(find_ceiling(replace(clipped, gyro=short), FS).mask, at | np.isin(np.arange(len(at)), [50, 51]))
    short[60:62, 1] = level + 2 * LSB  # an axis that exceeds it has no ceiling there
    np.testing.assert_array_equal(find_ceiling(replace(clipped, gyro=short), FS).mask, at)
    assert find_ceiling(replace(clipped, gyro=-clipped.gyro), FS).level == pytest.approx(level)
    for share, found in ((19.9, True), (20.1, False)):
        assert (find_ceiling(clipped, share * level) is not None) == found
    assert find_ceiling(samples_of(np.zeros((50, 3))), FS) is None


def top(values, noise=0.0, least=1.0, shortest=5.0):
    return [(start, stop) for _, start, stop in _plateaus_of(np.asarray(values, dtype=float), noise, least, shortest)]


def test_a_flat_top_stays_within_its_band_for_nine_of_ten_readings_and_falls_beyond():
    flat = np.r_[np.zeros(30), np.full(20, 100.0), np.zeros(30)]
    assert top(flat) == [(30, 50)]
    assert top(flat, shortest=20.0) == [(30, 50)]
    assert top(flat, shortest=20.5) == []
    assert top(flat, least=99.9) == [(30, 50)]
    assert top(flat, least=100.0) == []
    for dip, kept in ((2, True), (3, False)):
        holed = flat.copy()
        holed[35 : 35 + dip] = 98.7  # out of 1.2 %
        assert (top(holed) == [(30, 50)]) == kept
    inside = flat.copy()
    inside[35:45] = 98.81
    assert top(inside) == [(30, 50)]
    for noise, kept in ((0.22, True), (0.21, False)):  # six of them
        wide = flat.copy()
        wide[35:45] = 98.7
        assert (top(wide, noise) == [(30, 50)]) == kept
    for beyond, kept in ((78.3, True), (78.5, False)):  # 18 times 1.2 below
        for at in (10, 69):
            near = flat.copy()
            near[at] = beyond
            assert (top(near) == [(30, 50)]) == kept
    two = np.r_[flat, 0.6 * flat, 0.49 * flat]
    assert top(two) == [(30, 50), (110, 130)]  # of strokes of half the greatest and more


def levels(tops, axes=(0,), fs=500.0, hole=1.0):
    count = 80 * len(tops)
    gyro = np.random.default_rng(0).normal(0, 1e-4, (count, 3))
    for axis in axes:
        gyro[:, axis] += np.concatenate([np.r_[np.zeros(30), np.full(20, height), np.zeros(30)] for height in tops])
    gyro[40] *= hole
    return _find_plateaus(samples_of(gyro * DEG), fs * DEG)


def test_clipped_strokes_have_one_height_that_none_exceeds():
    found = levels([100, 100.5, 99])
    assert found.level == pytest.approx(100 * DEG, rel=1e-3)
    assert np.flatnonzero(found.mask).tolist() == [*range(30, 50), *range(110, 130), *range(190, 210)]
    assert levels([100, -100, 100]).level == pytest.approx(100 * DEG, rel=1e-3)
    assert levels([100, 100], axes=(0, 2)) is not None
    for tops, found in (
        ([100, 100, 97.9], False),  # two of three alike, of which three are needed
        ([100, 100, 100, 97.5, 102.5], True),  # three of five
        ([100, 100, 100, 97.5, 102.5, 90], False),
        ([100, 100, 100, 100, 103.9], True),
        ([100, 100, 100, 100, 104.1], False),
    ):
        assert (levels(tops) is not None) == found
    for fs, kept in ((1999.0, True), (2001.0, False)):
        assert (levels([100, 100, 100], fs=fs) is not None) == kept
    assert levels([100, 100, 100, 98.1]).mask[270:290].all()
    assert not levels([100, 100, 100, 97.9]).mask[270:290].any()


# Several events of one turn


def turn(shifts, measured, sigma=0.1, allowed=0.0):
    """A turn that misses by ``measured``, of which each event, mended, takes one of the shifts; allowed: what a gap may hide."""
    shifts = np.asarray(shifts, dtype=float)

    def value(choice):
        left = measured - shifts[sorted(choice)].sum(axis=0)
        variance = sigma**2 + len(choice) * allowed**2
        return float(-(left @ left) / variance / 2 - np.log(variance)), float(left @ left / sigma**2)

    return value


def best(likelihood):
    return set(max(likelihood, key=likelihood.__getitem__))


@pytest.mark.parametrize(
    ("count", "true"),
    [
        *((_EVERY_CHOICE, true) for true in ((), (0, 3, 5), "all")),
        *((_EVERY_CHOICE + 4, true) for true in ((), (2,), tuple(range(1, 9)), "all")),
    ],
)
def test_those_that_were_there_are_found_among_few_and_many(count, true):
    shifts = np.random.default_rng(count).normal(size=(count, 2)) * 3
    true = range(count) if true == "all" else true
    seen = []
    value = turn(shifts, shifts[list(true)].sum(axis=0))
    assert best(choices(count, lambda choice: seen.append(choice) or value(choice))) == set(true)
    assert len(seen) == len(set(seen))
    assert (len(seen) == 2**count) == (count == 6)  # up to six, every combination is tried


def test_the_chance_of_an_event_is_the_share_of_the_choices_that_have_it():
    """Bayes' rule over three choices, with prior probability 0.3 of each event."""
    likelihood = {frozenset(): 1.0, frozenset({0}): 2.0, frozenset({0, 1}): 2.5}
    weights = np.exp([1.0, 2.0, 2.5]) * [0.7 * 0.7, 0.3 * 0.7, 0.3 * 0.3]
    expected = [weights[1:].sum() / weights.sum(), weights[2] / weights.sum()]
    for shift in (0.0, 5000.0):
        moved = {choice: value + shift for choice, value in likelihood.items()}
        np.testing.assert_allclose(_chance_of_each(2, moved, 0.3), expected)


@pytest.mark.parametrize("most", [0, 1, 16, 17, 50, 104])
def test_the_bottom_of_a_valley_is_found_wherever_it_is(most):
    for bottom in range(most + 1):
        tried = []
        assert lowest(lambda count, bottom=bottom, tried=tried: tried.append(count) or abs(count - bottom) ** 1.5, most) == bottom
        assert len(tried) == len(set(tried)) <= 17 + 2 * max(1, most // 16) + most % 16
        assert set(tried) <= set(range(most + 1))


# Closure with some events repaired


def trial(count=2, samples=24, sigma=0.01, noise=0.0) -> ClosureTrial:
    """Turns of one log, one behind the other, whose closure is scipy's; a second log holds what bridged readings would be."""
    batch = small_turns(count=count, samples=samples, noise_rad=noise)
    made = ClosureTrial.__new__(ClosureTrial)
    used = [SimpleNamespace(log=0, start=100 + 40 * i, stop=100 + 40 * i + samples, number=i + 1) for i in range(count)]
    rates = np.zeros((100 + 40 * count, 3))
    for segment, rate in zip(used, batch.rate, strict=True):
        rates[segment.start : segment.stop] = rate @ TRUE.E.T + TRUE.B
    made._bridged = [rates + 0.05]
    made.rates, made._batch, made._smeared, made._period_s = [rates.copy()], batch, 0, 0.2
    made._calm = SimpleNamespace(rows=lambda log, rows: rows)
    padded = lambda by_log: np.stack([by_log[0][s.start : s.stop] for s in used])  # noqa: E731
    made.twin = SimpleNamespace(problem=SimpleNamespace(used=used, logs=[SimpleNamespace(samples=None)]), segments=used, padded=padded)
    made.covariance = np.tile(sigma**2 * np.array([[1.0, 0.3], [0.3, 2.0]]), (count, 1, 1))
    return made


def closes(rate, dt, earth, batch, i) -> np.ndarray:
    """(2,) rad by scipy, of one turn with these calibrated rates."""
    one = batch.pick(slice(i, i + 1))
    one = type(one)(rate[None], dt[None], earth[None], one.start, one.end, False)
    chord = angles_by_scipy(one, PERFECT.vector)[0]
    size = np.linalg.norm(chord)
    return chord * 4 * np.arcsin(size / 4) / max(size, 1e-30)


@pytest.mark.parametrize("smeared", [0, 3])
def test_a_false_reading_is_replaced_by_the_bridged_rate_and_its_neighbours_where_an_effect_smears_it(smeared):
    made = trial()
    made._smeared = smeared
    event = RegisterFault(FALSE, 0, 149, 2)  # the tenth and eleventh readings of the second turn
    rate = made.rates[0][140:164].copy()
    rate[9 - smeared : 11 + smeared] += 0.05
    batch = made._batch
    expected = closes(rate, batch.dt[1], batch.earth[1], batch, 1)
    np.testing.assert_allclose(made.angles(1, [event], None, 0), expected, atol=1e-9)
    np.testing.assert_allclose(
        made.angles(1, [], None, 0), closes(made.rates[0][140:164], batch.dt[1], batch.earth[1], batch, 1), atol=1e-9
    )
    if smeared:  # and not beyond the turn
        rate = made.rates[0][140:164].copy()
        rate[:6] += 0.05
        at_start = made.angles(1, [RegisterFault(FALSE, 0, 141, 2)], None, 0)
        np.testing.assert_allclose(at_start, closes(rate, batch.dt[1], batch.earth[1], batch, 1), atol=1e-9)


def test_lost_samples_are_put_in_on_the_polynomial_with_the_median_period():
    """Two losses of three samples each, the later one first, and the padding of the first turn left out."""
    made = trial()
    batch = made._batch
    events = [RegisterFault(LOST, 0, 108), RegisterFault(LOST, 0, 114)]
    rate, dt, earth = made.rates[0][100:124], batch.dt[0], batch.earth[0]
    step = np.median(dt)
    for at in (15, 9):
        rows = np.r_[at - 4 : at, at : at + 4]
        places = np.r_[-4:0, 3:7]
        line = np.polynomial.polynomial.polyfit(places, rate[rows], 1)
        between = np.polynomial.polynomial.polyval(np.arange(3), line).T
        rate = np.insert(rate, at, between, axis=0)
        earth = np.insert(earth, at, np.tile(earth[at], (3, 1)), axis=0)
        dt = np.insert(dt, at, [step] * 3)
        step = np.median(dt)
    found = made.angles(0, events, lambda event: Crossing(1, 0.0), 3)
    np.testing.assert_allclose(found, closes(rate, dt, earth, batch, 0), atol=1e-9)


def test_the_likelihood_of_a_choice_is_normal_with_what_its_gaps_may_hide():
    """By hand for each choice of two events, beside another that is repaired in any case; a row that no sensor outputs adds 20.

    What a gap may hide excuses nothing: where the turn is as recorded hardly less likely, with the same covariance, that is all it gains.
    """
    made = trial()
    own = [RegisterFault(FALSE, 0, 106, 1), RegisterFault(FALSE, 0, 112, 2, True)]
    others = [RegisterFault(FALSE, 0, 118, 1)]
    made._bridged = [made.rates[0].copy()]
    made.rates[0][[106, 112, 113, 118]] += 0.3
    hides = {own[0]: 0.01, own[1]: 0.03, others[0]: 0.02}
    found = made.likelihoods(0, own, others, lambda event: Crossing(1, hides[event]), 0)
    misfit, expected = {}, {}

    def normal(repaired, hidden):
        C = made.covariance[0] + sum(hides[event] ** 2 for event in hidden) * np.eye(2)
        return stats.multivariate_normal(np.zeros(2), C).logpdf(made.angles(0, repaired, None, 0)) + np.log(2 * np.pi)

    for size in range(3):
        for some in combinations(range(2), size):
            mended = [*others, *(own[k] for k in some)]
            angles = made.angles(0, mended, None, 0)
            moved = normal(mended, mended) - normal(others, mended)
            gain = normal(mended, mended) - normal(others, others)
            expected[frozenset(some)] = normal(others, others) + (gain if moved > np.log(20) else min(gain, moved)) + 20 * (1 in some)
            misfit[frozenset(some)] = angles @ np.linalg.inv(made.covariance[0]) @ angles
    admissible = [c for c in expected if all(misfit[c] < misfit[c - {one}] for one in c)]
    assert found == pytest.approx({choice: expected[choice] for choice in admissible})
    assert len(found) > 1


@pytest.mark.parametrize(("row", "segment"), [(103, None), (104, 0), (119, 0), (120, None), (144, 1)])
def test_an_event_belongs_to_a_turn_with_four_readings_on_either_side(row, segment):
    made = trial()
    assert made.segment_of(RegisterFault(LOST, 0, row)) == segment
    assert made.segment_of(RegisterFault(LOST, 1, row)) is None


def shortened(made: ClosureTrial, lengths: dict[int, int]) -> list[RegisterFault]:
    """Take time out of turns, at a reading in the middle of each, as if so many samples were lost there."""
    events = []
    for i, count in lengths.items():
        dt = made._batch.dt
        dt[i, 11] -= count * made._period_s
        events.append(RegisterFault(LOST, 0, made.twin.problem.used[i].start + 11))
    return events


@pytest.mark.parametrize("count", [1, 2])
def test_the_number_lost_each_time_closes_most_turns_of_which_one_may_have_none(count):
    """Half a second at most: two samples of a fifth each; whichever of a turn's events it is at."""
    made = trial(count=4)
    events = shortened(made, dict.fromkeys(range(3), count))
    nowhere = RegisterFault(LOST, 0, made.twin.problem.used[3].start + 8)
    other = RegisterFault(LOST, 0, made.twin.problem.used[0].start + 6)
    assert made.lost_each_time([*events, nowhere]) == count
    assert made.lost_each_time([*events, nowhere, other]) == count
    assert made.lost_each_time([nowhere]) == 0
    assert made.lost_each_time([RegisterFault(LOST, 0, 5)]) == 0  # in a rest
    made._period_s /= 3
    assert made.lost_each_time(shortened(made, {})) == 0


def test_most_turns_decide_the_number_lost_and_not_the_one_that_closes_best():
    """Three of one sample, which miss by two and a half sigmas; the fourth, of two, closes to nothing."""
    made = trial(count=4)
    made._batch = turned_ends(made._batch, np.outer([1, 1, 1, 0], [0.025, 0.0, 0.0]))
    assert made.lost_each_time(shortened(made, {0: 1, 1: 1, 2: 1, 3: 2})) == 1


def test_a_turn_that_stays_open_is_repaired_by_rows_alone_that_no_sensor_outputs():
    """One step below and above the chi-square of its closure once repaired, with what the gap may hide."""
    made = trial()
    false, certain = RegisterFault(FALSE, 0, 106, 1), RegisterFault(FALSE, 0, 112, 2, True)
    made._bridged = [made.rates[0].copy()]
    made.rates[0][[106, 112, 113]] += 0.3
    cross = lambda event: Crossing(1, 0.01)  # noqa: E731
    angles = made.angles(0, [false], None, 0)
    left = angles @ np.linalg.solve(made.covariance[0] + 0.01**2 * np.eye(2), angles)
    for most, kept in ((1.01 * left, True), (0.99 * left, False)):
        assert (frozenset({0}) in made.likelihoods(0, [false, certain], [], cross, 0, most)) == kept
    assert set(made.likelihoods(0, [false, certain], [], cross, 0, 0.0)) == {frozenset(), frozenset({1})}
    assert made.likelihoods(0, [false], [], cross, 0) == made.likelihoods(0, [false], [], cross, 0, np.inf)


@pytest.mark.parametrize(("turns", "excess"), [(6, 25.0), (5, 1.0)])
def test_a_closed_turn_is_one_that_closes_as_those_without_an_event(turns, excess):
    """Noise of five sigmas in each of them, whose median counts, from five on: one turn of all has an event."""
    made = trial(count=turns)
    made.twin.batch = SimpleNamespace(angles=2)
    root = np.linalg.cholesky(made.covariance[0])
    usual = np.sqrt(stats.chi2.ppf(0.5, 2))
    sizes = np.r_[1e3, 1e2, 1e-2, 5 * usual, 5 * usual, 5 * usual][:turns]
    made.angles = lambda i, mended, cross, length: root @ [sizes[i], 0.0]
    assert made.closed_below([RegisterFault(FALSE, 0, 110, 1)], None) == pytest.approx(excess * stats.chi2.isf(0.01, 2))
    made.covariance = 1e6 * made.covariance
    assert made.closed_below([RegisterFault(FALSE, 0, 110, 1)], None) == pytest.approx(stats.chi2.isf(0.01, 2))


def likely(made, tables, name, events, others=(), length=0):
    """The verdict with given likelihoods of each turn's choices."""
    made.likelihoods = lambda i, own, others, cross, length, most: {frozenset(c): v for c, v in tables[i].items()}
    made.closed_below = lambda events, cross: np.inf
    made.lost_each_time, made.bridged_best = lambda events: length, lambda events, length: length
    samples = noisy(400)
    made.twin.problem.logs = [SimpleNamespace(samples=samples)]
    return made.test(name, events, list(others))


def test_two_turns_are_decided_with_the_share_that_they_have_together():
    """Passes by hand: chances with a share of one half, the share of these, and once more until no answer changes."""
    made = trial(count=3)
    events = [RegisterFault(FALSE, 0, row, 1) for row in (110, 150, 190, 5)]
    found = likely(made, {0: {(): 0.0, (0,): 6.0}, 1: {(): 0.0, (0,): 0.4}, 2: {(): 0.0, (0,): -3.0}}, FALSE, events)
    share, chance = 0.5, np.zeros(4)
    for _ in range(6):
        before = chance
        chance = np.array([special.expit(gain + special.logit(share)) for gain in (6.0, 0.4, -3.0, 0.0)])
        share = (chance.sum() + 0.5) / 5
        if ((before > 0.5) == (chance > 0.5)).all():
            break
    np.testing.assert_allclose(found.chance, chance, rtol=1e-9)
    assert found.accepted == [events[0], events[1], events[3]]  # the last, in a rest, is what most are
    assert found.log_ratio == pytest.approx(6.4)
    assert found.probability == pytest.approx(special.expit(6.4 - np.log(10.0 * 30)))
    assert (found.id, found.length) == (FALSE, 0)
    # The tilt of the turns concerned is told as recorded and with all repaired.
    for rms, mended in ((found.before_rad, [[], [], []]), (found.tried_rad, [[event] for event in events[:3]])):
        angles = [made.angles(i, own, None, 0) for i, own in enumerate(mended)]
        assert rms == pytest.approx(np.sqrt(np.mean(np.sum(np.square(angles), axis=1))))
    assert made.tilt_rms({}, None, 0) == 0.0


@pytest.mark.parametrize(("gain", "accepted"), [(np.log(300) + 0.01, True), (np.log(300) - 0.01, False)])
def test_events_of_a_kind_are_there_if_closure_outweighs_the_odds_of_any_effect(gain, accepted):
    """One in thirty, and ten scales."""
    event = RegisterFault(FALSE, 0, 110, 1)
    found = likely(trial(), {0: {(): 1.0, (0,): 1.0 + gain}}, FALSE, [event])
    assert found.accepted == [event] * accepted
    assert found.probability == pytest.approx(special.expit(gain - np.log(300)))
    assert found.chance[0] > 0.5
    none = likely(trial(), {0: {(): 1.0, (0,): -5.0}}, FALSE, [event])
    assert (none.accepted, none.probability, none.chance.tolist(), none.log_ratio) == ([], 0.0, [0.0], 0.0)


def test_lengths_that_were_tried_and_rows_that_no_sensor_outputs_count():
    """Of losses, as many lengths as half a second holds; each such row in a rest counts 20, and needs no closure."""
    lost = [RegisterFault(LOST, 0, 110)]
    found = likely(trial(), {0: {(): 0.0, (0,): 9.0}}, LOST, lost, length=2)
    assert (found.log_ratio, found.length) == (pytest.approx(9.0 - np.log(2)), 2)
    assert likely(trial(), {}, LOST, lost).probability == 0.0
    for certain, accepted in ((True, 2), (False, 0)):
        empty = likely(trial(), {}, FALSE, [RegisterFault(FALSE, 0, row, 1, certain) for row in (5, 7)])
        assert (empty.log_ratio, len(empty.accepted)) == (40.0 * certain, accepted)
    chances = np.array([0.51, 0.5])
    assert [Verdict(FALSE, ["a", "b"], chances, p, 0, 0.0, 0.0, 0.0).accepted for p in (0.51, 0.5)] == [["a"], []]


def test_the_common_count_of_losses_in_every_turn_is_that_of_the_best_linear_fit():
    """Also in the first and the last period of each turn; none at its end, and in no log."""
    used = [SimpleNamespace(log=0, start=100 * i, stop=100 * i + 24) for i in range(16)]
    session = SimpleNamespace(logs=[SimpleNamespace(samples=SimpleNamespace(period_s=0.1))])
    for place in (0, 10, 22):
        batch = small_turns(count=16, samples=24)
        batch.dt[:, place] -= 2 * 0.1
        floor = SimpleNamespace(sigma=np.full((16, 2), 1e-4))
        problem = SimpleNamespace(batch=batch, floor=floor, used=used, first=TRUE, session=session)
        assert _common_count(problem, [RegisterFault(LOST, 0, 100 * i + place) for i in range(16)]) == 2
    assert _common_count(problem, [RegisterFault(LOST, 0, 23), RegisterFault(LOST, 1, 10)]) == 0


def test_turns_that_miss_are_left_open_though_a_plain_fit_follows_them():
    """Four of sixteen ends are turned by a tenth of a radian all alike; nobody says which.  Without that no turn is, by an exact refit."""
    sigma = np.full((16, 2), 1e-4)
    for miss, expected in ((0.1, [2, 5, 9, 14]), (0.0, [])):
        by = np.zeros((16, 3))
        by[[2, 5, 9, 14]] = [miss, miss / 2, 0.0]
        batch = turned_ends(small_turns(count=16, noise_rad=1e-4), by)
        problem = SimpleNamespace(batch=batch, floor=SimpleNamespace(sigma=sigma), first=PERFECT, still_rates=None)
        assert np.flatnonzero(left_open(problem, np.ones(16, dtype=bool))).tolist() == expected
        assert np.flatnonzero(left_open(problem, np.arange(16) != 5)).tolist() == [i for i in expected if i != 5]


@pytest.mark.parametrize(("reach", "smeared"), [(True, 10), (False, 0)])
def test_a_turns_covariance_is_of_its_noise_and_of_the_physics_that_others_taught(reach, smeared):
    """Each noise component has the size that the physics' own fit gave it; undersampling is of the turns with false readings bridged."""
    a = effect("a", 2, **({"reach": Reach.around(samples=1)} if reach else {}))
    twin, calm = linear_twin(seed=1), linear_twin(seed=2)
    twin.spoil(a, [5.0, -4.0])
    evidence = twin.evidence()
    hypothesis = evidence.of((a,), evidence.nothing)
    hypothesis = SimpleNamespace(**{**vars(hypothesis), "noise": SimpleNamespace(size=lambda name: {TURN: 0.7}.get(name, 0.2))})
    for each in (twin, calm):
        each.batch_at = lambda state: "batch"
        each.movements = [SimpleNamespace(dt_s=0.1), SimpleNamespace(dt_s=0.2), SimpleNamespace(dt_s=0.9)]
    problem, quiet, given = SimpleNamespace(used=[1, 2]), SimpleNamespace(used=[3, 4]), []
    with (
        patch.object(data_repair, "Twin", lambda each: twin if each is problem else calm),
        patch.object(data_repair, "undersampling", lambda each: "calm" if each is calm else None),
        patch.object(data_repair, "first_noise", lambda twin, whiten, missed: given.append(missed) or twin.noise(whiten)),
    ):
        made = ClosureTrial(problem, hypothesis, quiet)
        quiet.used.append(5)
        ClosureTrial(problem, hypothesis, quiet)
    J = np.hstack([twin.calibration, twin.columns_of(a)])[: twin.sizes[0]]
    whole = (1 + 0.7**2) * np.eye(twin.sizes[0]) + J @ hypothesis.fit.covariance @ J.T
    np.testing.assert_allclose(made.covariance, [whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(8)], rtol=1e-6)
    assert (made._smeared, made._period_s, given) == (smeared, 0.2, ["calm", None])


# Clipping decided by closure


def test_clipped_turns_close_worse_than_the_others_by_the_model_of_the_others():
    """Twelve whole turns at least, else by the model of all; the others count as one at least."""
    batch, sigma = small_turns(count=16, noise_rad=1e-4), np.full((16, 2), 1e-4)
    by = np.zeros((16, 3))
    by[[3, 7]] = [0.03, 0.0, 0.0]
    segments = [SimpleNamespace(number=i + 1) for i in range(16)]
    problem = SimpleNamespace(batch=turned_ends(batch, by), floor=SimpleNamespace(sigma=sigma), first=PERFECT, used=segments)
    hit = np.isin(np.arange(16), [3, 7])

    def sizes(own):
        model = data_repair.fit_least_squares(problem.batch.pick(own), sigma[own], PERFECT).model
        return np.sqrt(np.mean((angles_by_scipy(problem.batch, model.vector) / sigma) ** 2, axis=1))

    size = sizes(~hit)
    assert np.median(size[~hit]) < 1
    assert excess_of(problem, [4, 8]) == pytest.approx(np.median(size[hit]), rel=1e-3)
    problem.floor.sigma = sigma / 10
    assert excess_of(problem, [4, 8]) == pytest.approx(np.median(size[hit]) / np.median(size[~hit]), rel=1e-3)
    many = [1, 2, 4, 8, 11]  # eleven are left
    assert excess_of(problem, many) == pytest.approx(np.median(10 * sizes(hit | ~hit)[np.subtract(many, 1)]), rel=1e-3)
    assert np.isnan(excess_of(problem, [99]))


# Whole sessions: rows and times go on from log to log.


@pytest.fixture(scope="module")
def two():
    """Two clean logs of eight turns each, and where in them the turns are."""
    tables = [Table().tumble(8, seed=seed) for seed in (11, 12)]
    return [(table.samples(seed=seed), table) for seed, table in enumerate(tables)]


def test_accepted_events_are_told_by_rows_and_seconds_of_all_logs_and_widen_the_floor(two):
    """Later times count what was put in before them, in their own log and in earlier ones; bridges behind a loss move with it."""
    (first, table), (second, other) = two
    at, there = rows_in_turns(table, first, 1, 6)[[1, 5]], rows_in_turns(other, second, 1, 6)[[2]]
    bridges = [Bridge("gap", int(at[0]) + shift, 2, 0.0, np.zeros(3)) for shift in (0, 1)]
    session = session_with(with_losses(first, at, 9), with_losses(second, there, 9), bridges=bridges)
    problem, count = build_problem(replace(session, config=config())), len(session.logs[0].samples)
    lost = [RegisterFault(LOST, log, int(row)) for log, row in ((0, at[0]), (0, at[1] - 9), (1, there[0]))]
    false = [RegisterFault(FALSE, log, row, samples) for log, row, samples in ((0, 30, 1), (1, 40, 2), (1, 50, 4), (0, 9, 1))]
    verdicts = [
        Verdict(FALSE, false, np.array([1.0, 1, 1, 0]), 0.9, 0, 0.0, 0.0, 6.0),
        Verdict(LOST, lost, np.ones(3), 0.9, 9, 0.0, 0.0, 12.0),
    ]
    again, gaps = _with_accepted(problem, verdicts, found := {}, chances := {})
    times = found[LOST][0].pop("at_s")
    assert found == {FALSE: ({"at": [30, count + 40, count + 50], "samples": 2}, {}), LOST: ({"length": 9}, {"length": 0.5})}
    np.testing.assert_allclose(times, [*first.t_s[at], first.duration_s + second.t_s[there[0]]], atol=0.002)
    assert chances == pytest.approx({FALSE: min(1, 4 * stats.chi2.sf(12.0, 3)), LOST: 3 * stats.chi2.sf(24.0, 3)})
    assert [each.row for each in again.session.logs[0].bridges] == [int(at[0]), int(at[0]) + 10]
    assert [(gap.log, gap.row) for gap in gaps] == [(0, at[0] + 1), (0, at[1] + 1), (1, there[0] + 1)]
    wider = _with_gaps(again, gaps).floor.own - again.floor.own
    inside = [sum(g.missed_rad**2 for g in gaps if g.log == s.log and s.start <= g.row < s.stop) for s in again.used]
    np.testing.assert_allclose(wider, np.multiply.outer(inside, np.eye(2)), atol=1e-18)
    assert max(inside) > 0
    assert _with_accepted(problem, [replace(verdicts[0], chance=np.zeros(4))], {}, chances) == (problem, [])


def test_losses_of_the_second_log_are_timed_after_the_first(two):
    """Of an eighth of a second, over which a rate bends: as one long step, 26 samples would close best.  A closure run is not mended."""
    (first, _), (second, table) = two
    rows = rows_in_turns(table, second, 1, 6)[::2]  # twelve turns without a loss: enough for a linear model of their own
    lossy = with_losses(second, rows, 25)
    mended = repair(build_problem(session_with(first, lossy)))
    assert list(mended.found) == [LOST]
    parameters, _ = mended.found[LOST]
    assert parameters["length"] == 25
    np.testing.assert_allclose(parameters["at_s"], first.duration_s + second.t_s[rows], atol=0.02)
    assert mended.verdicts[0].tried_rad < 0.1 * mended.verdicts[0].before_rad
    for samples, at in ((lossy, lossy.t_s[closed_up(rows, 25)]), (second, [])):
        np.testing.assert_allclose(lost_in(SimpleNamespace(samples=samples, rows=range(len(samples)))), at, atol=0.01)


def test_a_ceiling_in_one_log_leaves_the_other_logs_segments_alone(two):
    (first, _), (second, _) = two
    problem = build_problem(session_with(first, replace(second, gyro=np.clip(second.gyro, -70 * DEG, 70 * DEG))))
    found = find_clipping(problem)
    assert (found.borne_out, found.known_to, found.chance) == (True, pytest.approx(0.002 * found.level), pytest.approx(6 * 2 * 1e-4))
    assert found.excess == excess_of(problem, found.numbers) > 2
    mended = repair(problem)
    assert mended.found == {"gyro.saturation": ({"dps": pytest.approx(70, rel=2e-3)}, {"dps": pytest.approx(0.14, rel=0.01)})}
    assert [s.number for s in problem.used if s.number not in found.numbers] == [s.number for s in mended.problem.used]
    assert {s.log for s in problem.used if s.number in found.numbers} == {1}


def test_a_motor_turns_at_one_rate_and_is_not_clipped():
    """Its strokes are flat and alike, but its segments close.  The height of a stroke of two samples is one of its readings."""
    table = Table().rest(3)
    for number, axis in enumerate(((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)) * 2):
        table.steady(70, axis, 1.2 + 0.1 * number).rest(3)
    samples = table.samples()
    assert _find_plateaus(samples, FS).level == pytest.approx(70 * DEG, rel=0.03)
    problem = build_problem(session_of(samples))
    found = find_clipping(problem)
    assert (found.borne_out, found.known_to) == (False, pytest.approx(0.02 * found.level))
    assert "gyro.saturation" not in repair(problem).found
    assert _find_plateaus(Table().rest(4).steady(200, (1, 0, 0), 0.011).rest(4).samples(), FS) is None


def test_a_still_that_turns_about_the_vertical_is_rejected():
    """Gravity does not move in it: the gyro alone shows it, beside stills that agree; one that creeps is told beside it."""
    table, slow = Table().rest(2), []
    for number in range(12):
        table.turn(90 + 20 * (number % 3), np.random.default_rng(number).normal(size=3))
        if number == 5:
            start = table.duration_s
            _, attitude = table.truth(np.array([start]))
            table.steady(0.35, attitude[0].inv().apply([0, 0, 1]), 2.0)
            slow = [start, table.duration_s]
        else:
            table.rest(2)
    problem = build_problem(session_of(table.samples(gyro_mdps=1.0)))
    (moving,) = about_the_vertical(problem)
    still = problem.stills[moving]
    assert slow[0] - 0.5 < still.start_s < slow[1]


# What the body really did is not mended, what only the readings did is.


def knocked(really: bool):
    """Turns of which every fourth is knocked at 60 dps for three readings about an axis of its own, or reads as if; and the rows."""
    table, rng, moments = Table().rest(2 + 0.5 / 104), np.random.default_rng(4), []
    for number in range(16):
        table.turn(rng.uniform(50, 100), rng.normal(size=3), 156 / 104)
        if number % 4 == 0:
            moments.append((table.duration_s, rng.normal(size=3)))
            axis = moments[-1][1] / np.linalg.norm(moments[-1][1])
            table.steady(60 * really, axis, 2.5 / 104)
        table.turn(rng.uniform(50, 100), rng.normal(size=3), 156.5 / 104).rest(2)
    samples = table.samples(odr_hz=104.0)
    gyro, rows = samples.gyro.copy(), [int(np.ceil(moment * 104)) for moment, _ in moments]
    for row, (_, axis) in zip(rows, moments, strict=True):
        gyro[row : row + 3] += 60 * DEG * (not really) * axis / np.linalg.norm(axis)
    return build_problem(session_of(replace(samples, gyro=gyro), odr_hz=104.0)), rows


@pytest.mark.parametrize("really", [True, broad(False)])
def test_a_real_knock_is_not_mended_and_the_same_readings_without_one_are(really):
    """To the readings of the gyro, both are the same; gravity at the turn's end was turned by the one alone."""
    problem, rows = knocked(really)
    assert {(e.id, e.row) for e in proposed(problem.session)} == {(FALSE, row) for row in rows}  # the registers alone propose them
    mended = repair(problem)
    (verdict,) = mended.verdicts
    assert (verdict.tried_rad > 1.4 * verdict.before_rad) == really
    assert (verdict.before_rad > 1.4 * verdict.tried_rad) == (not really)
    if really:
        assert mended.found == {}
    else:
        assert (list(mended.found), mended.found[FALSE][0]["at"]) == ([FALSE], rows)
        assert mended.p_value[FALSE] < 1e-6
