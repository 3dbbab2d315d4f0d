"""False readings and losses as the registers show them, each threshold and each repair by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, config
from numpy.testing import assert_allclose, assert_array_equal

from session.base.numeric import MEDIAN_SIGMAS
from session.detect import bridging
from session.log.logfile import Bridge, Log
from session.log.samples import Samples
from tinygc import Session
from tinygc.explanation import faulty_readings
from tinygc.explanation.faulty_readings import (
    FALSE,
    LOST,
    RegisterFault,
    _away_from_blows,
    _excursion_at,
    _impossible_rows,
    _in_bridge,
    _local_scatter,
    _possible_losses,
    _steps_at,
    crossings,
    find_glitches,
    find_jumps,
    find_losses,
    proposed,
    register_step,
    without_false_readings,
)

LSB = 17.5e-3 * DEG


def samples_of(gyro, accel=None):
    """At 100 Hz; level and at rest where no accelerometer is given."""
    accel = np.tile([0.0, 0.0, -9.8], (len(gyro), 1)) if accel is None else accel
    return Samples(np.arange(len(gyro)) * 10_000_000, gyro, accel, np.arange(len(gyro)) * 0.01)


def noisy(count=1000, seed=0):
    """A still of noise of some steps of the registers."""
    rng = np.random.default_rng(seed)
    gyro = np.rint(rng.normal(0, 4, (count, 3))) * LSB
    return samples_of(gyro, np.rint(np.add(rng.normal(0, 40, (count, 3)), [0, 0, 8000])) * 1.2e-3)


def session_with(*logs, bridges=()):
    files = tuple(Log(Path(f"log{i:04}.csv"), samples, bridges=tuple(bridges)) for i, samples in enumerate(logs))
    return Session(Path("made"), config(odr_hz=100.0), files, ())


# Jumps


def test_the_scatter_around_a_row_is_the_greatest_of_its_neighbourhoods_and_no_less_than_usual():
    """Neighbourhoods of 32 rows at least, or of a fifth of a second; the rows behind the last whole one have its scatter."""
    levels = np.array([1.0, 2.0, 9.0, 3.0, 4.0, 5.0, 1e-30])
    for step, period_s in ((32, 0.01), (40, 0.005)):
        values = np.repeat(levels, step)[: 7 * step - 5, None]  # six whole ones
        expected = np.r_[np.repeat(np.maximum([2, 9, 9, 9, 5, 5], 3.5), step), np.full(step - 5, 5)] / MEDIAN_SIGMAS
        assert_allclose(_local_scatter(values, period_s)[:, 0], expected)
    for count, parts in ((5 * 32, True), (5 * 32 - 1, False)):
        assert (np.ptp(_local_scatter(np.repeat(levels[:5], 32)[:count, None], 0.01)) > 0) == parts
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
    assert {row: step[1] for row, step in _steps_at(at, size, total)} == pytest.approx(dict(steps))
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
    rows, sizes = find_jumps(replace(samples, gyro=gyro, accel=accel))
    assert (501 in rows) == found
    assert rows.min(initial=501) > 10
    if found:
        assert_allclose(sizes[rows == 501][0], [height * 6, 0, 0, 0, 0, 0], rtol=0.05)


@pytest.mark.parametrize("second", [0.8, 1.25])
def test_two_jumps_three_rows_apart_are_two_and_at_a_gap_that_the_stamps_show_there_is_none(second):
    samples = noisy()
    gyro = samples.gyro + 1.0 * (np.arange(1000) >= 500)[:, None] * [1, 0, 0]
    stepped = replace(samples, gyro=gyro)
    late = replace(stepped, t_ns=samples.t_ns + (np.arange(1000) >= 500) * 20_000_000)
    assert (find_jumps(stepped).rows.tolist(), find_jumps(late).rows.tolist(), find_glitches(stepped)) == ([499], [], None)
    gyro[503:, 0] += second
    assert find_jumps(replace(samples, gyro=gyro)).rows.tolist() == [499, 502]


def test_a_long_log_is_read_in_parts_that_overlap(monkeypatch):
    for name, value in (("LONG", 600), ("AT_ONCE", 200), ("MARGIN", 100)):
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
    assert [each.row for each in glitches] == [each.row for each in find_glitches(stepped)] == [300, 520]


# Losses


def jumps_of(rows, accel=5.0):
    return np.array(rows, dtype=int), np.tile([1.0, 0, 0, accel, 0, 0], (len(rows), 1))


def test_a_loss_is_a_jump_alone_that_the_accelerometer_shows_too():
    """A possible one is the greatest within eight rows."""
    jumps = jumps_of([0, 100, 108, 200, 209, 300, 301])
    jumps[1][:, 3] = [1.0, 5.0, 6.0, 5.0, 6.0, 4.0, 4.0]
    assert find_losses(jumps, 10.0).tolist() == [0, 200, 209]
    assert _possible_losses(jumps, 10.0).tolist() == [0, 108, 200, 209, 300, 301]


@pytest.mark.parametrize(("accel", "seconds", "losses", "possible"), [(3.001, 2.0, 2, 2), (2.999, 2.0, 0, 2), (5.0, 1.9, 0, 0)])
def test_of_more_than_one_jump_a_second_or_of_the_gyro_alone_none_is_a_loss(accel, seconds, losses, possible):
    jumps = jumps_of([100, 200], accel)
    assert (len(find_losses(jumps, seconds)), len(_possible_losses(jumps, seconds))) == (losses, possible)


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
    for count, step in ((20_000, 2.0), (19_999, 1.0)):  # of so many readings
        assert register_step(np.r_[np.arange(count) * 2.0, 2.0 * count - 1]) == step


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
    gyro, accel, quiet = samples.gyro.copy(), samples.accel.copy(), samples.gyro.copy()
    quiet[:, 0] = np.where(np.arange(400) % 2, LSB, 0.0)
    for values in (gyro, accel, quiet):
        values[100 : 101 + again] = values[100]
    for one, other, expected in ((gyro, accel, found), (gyro, 0 * accel, []), (quiet, accel, [])):
        assert _impossible_rows(replace(samples, gyro=one, accel=other)) == expected


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


@pytest.mark.parametrize(("seconds", "some"), [(23, True), (22, False)])
def test_of_more_than_one_false_reading_a_second_none_is_false(seconds, some):
    samples = noisy(2000, seed=3)
    many = samples.gyro + 1.0 * np.isin(np.arange(2000), range(100, 1900, 80))[:, None]
    stretched = replace(samples, gyro=many, t_ns=np.round(np.arange(2000) * 1e9 * seconds / 1999).astype(np.int64))
    assert (find_glitches(stretched) is not None) == some
    assert find_glitches(samples) is None


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
    """An excursion of the gyro beside a blow is the blow's; rows that no sensor outputs are false, and in the accelerometer as well."""
    clean, spoilt = noisy(1000, seed=1), noisy(1000, seed=2)
    gyro, accel = spoilt.gyro.copy(), spoilt.accel.copy()
    gyro[[200, 400, 401]] += 1.0
    accel[205] *= 3
    gyro[215], accel[215] = 0.0, 0.0
    gyro[501:506], accel[501:506] = gyro[500], accel[500]
    gyro[700:] += 0.5
    accel[700:] += 3.0
    spoilt = replace(spoilt, gyro=gyro, accel=accel)
    session = session_with(clean, spoilt)
    *_, false, lost = events = proposed(session)
    assert [(e.id, e.log, e.row, e.samples, e.accel) for e in events] == [
        (FALSE, 1, 215, 1, True),
        (FALSE, 1, 400, 2, False),
        (FALSE, 1, 501, 5, True),
        (LOST, 1, 699, 0, False),
    ]
    first, second = (log.samples for log in without_false_readings(session, events).logs)
    assert_array_equal(first.gyro, clean.gyro)
    empty = [215, *range(501, 506)]
    for name, rows, noise in (("gyro", sorted([*empty, 400, 401]), 4 * LSB), ("accel", empty, 40 * 1.2e-3)):
        found, read = np.asarray(getattr(second, name)), getattr(spoilt, name)
        assert np.flatnonzero((found != read).any(axis=1)).tolist() == rows
        assert np.abs(found[rows] - read[300]).max() < 6 * noise
    logs, other = [clean, spoilt], RegisterFault(FALSE, 0, 50, 1)
    for length in (9, 0):
        expected = bridging.best_crossings(spoilt, np.array([501, 699]), np.array([5, 0]), length)
        assert crossings(logs, [false, lost, other], length) == {
            **dict(zip((false, lost), expected, strict=True)),
            other: bridging.best_crossings(clean, np.array([50]), np.array([1]))[0],
        }
