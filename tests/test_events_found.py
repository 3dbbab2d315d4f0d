"""Detectors of false readings, losses and clipping on arrays: each threshold one step below and above, each repair by hand."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, config

from session.detect import bridging
from session.detect.bridging import GAP
from session.io.logfile import Bridge, Log
from session.io.numeric import MEDIAN_SIGMAS
from session.io.samples import Samples
from tinygc import Session
from tinygc.explanation import faulty_readings
from tinygc.explanation.clipped_turns import find_ceiling, find_plateaus, has_corners, plateaus_of
from tinygc.explanation.faulty_readings import (
    FALSE,
    LOST,
    Glitches,
    Jumps,
    RegisterFault,
    away_from_blows,
    bridged,
    crossing,
    cubic_across,
    excursion_at,
    find_glitches,
    find_jumps,
    find_losses,
    impossible_rows,
    in_bridge,
    in_parts,
    local_scatter,
    off_both_sides,
    open_gaps,
    possible_losses,
    proposed,
    register_step,
    steps_at,
    third_differences,
    with_lost,
    without_glitches,
)

LSB = 17.5e-3 * DEG


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


# Jumps


def test_the_scatter_around_a_row_is_the_greatest_of_its_neighbourhoods_and_no_less_than_usual():
    """Neighbourhoods of 32 rows at least, or of a fifth of a second; the rows behind the last whole one have its scatter."""
    levels = np.array([1.0, 2.0, 9.0, 3.0, 4.0, 5.0, 1e-30])
    for step, period_s in ((32, 0.01), (40, 0.005)):
        values = np.repeat(levels, step)[: 7 * step - 5]  # six whole ones
        expected = np.repeat(np.maximum([2, 9, 9, 9, 5, 5], 3.5), step) / MEDIAN_SIGMAS
        found = local_scatter(values[:, None], period_s)[:, 0]
        np.testing.assert_allclose(found[: 6 * step], expected)
        np.testing.assert_allclose(found[6 * step :], 5 / MEDIAN_SIGMAS)
    for count, parts in ((5 * 32, True), (5 * 32 - 1, False)):
        found = local_scatter(np.repeat(levels[:5], 32)[:count, None], 0.01)[:, 0]
        assert (found[0] == found[-1]) != parts
    assert local_scatter(np.zeros((10, 1)), 0.01).max() == local_scatter(np.zeros((400, 1)), 0.01).max() == 1e-12


def test_third_differences_of_all_channels_after_the_filter_has_settled():
    samples = noisy(400)
    third = np.diff(np.hstack([samples.gyro, samples.accel]), 3, axis=0)
    size, scatter = third_differences(samples)
    assert not size[:10].any()
    np.testing.assert_allclose(size[10:] * scatter[10:], third[10:], atol=1e-12)
    np.testing.assert_allclose(scatter, local_scatter(np.abs(third), 0.01))


def pattern(*heights) -> tuple[np.ndarray, np.ndarray]:
    size = np.zeros((20, 6))
    size[8 : 8 + len(heights), 1] = heights
    return size, np.linalg.norm(size, axis=1)


@pytest.mark.parametrize(
    ("heights", "steps"),
    [
        ((10, -20, 10), [(10, 10.0)]),  # a step for good: 1, -2, 1
        ((10, -30, 30, -10), [(10, 10.0), (11, -10.0)]),  # one false sample: 1, -3, 3, -1
        ((10, -20, 0, 20, -10), [(10, 10.0), (12, -10.0)]),  # two of them
        ((0, -30, 30, 0), [(10, 15.0)]),  # a corner has no flanks
        ((10, -30, 22.6, -10), [(10, 10.0), (11, -22.6 / 3)]),
        ((10, -30, 22.4, -10), [(10, 15.0)]),  # the second peak has less than three quarters
        ((6.1, -30, 30, -6.1), [(10, 10.0), (11, -10.0)]),
        ((5.9, -30, 30, -10), [(10, 15.0)]),  # flanks of less than a fifth
        ((10, -30, 30, -5.9), [(10, 15.0)]),
        ((10, -30, -30, 10), [(10, 15.0)]),  # of the same sign
    ],
)
def test_a_peak_is_a_step_or_a_false_reading_of_one_sample_or_two(heights, steps):
    size, total = pattern(*heights)
    at = 8 + int(np.argmax(np.abs(heights)))
    found = steps_at(at, size, total)
    assert [row for row, _ in found] == [row for row, _ in steps]
    np.testing.assert_allclose([step for _, step in found], [[0, height, 0, 0, 0, 0] for _, height in steps])


def test_peaks_of_different_axes_are_no_false_reading():
    size, _ = pattern(10, -30, 0, 0)
    size[10:12, 2] = [30, -10]
    assert len(steps_at(9, size, np.linalg.norm(size, axis=1))) == 1


def test_a_peak_at_the_ends_of_a_log_is_a_step():
    size, total = pattern(10, -30, 30, -10)
    for cut, at, alone in ((slice(9, None), 0, True), (slice(8, None), 1, False), (slice(None, 11), 9, True), (slice(None, 12), 9, False)):
        assert (len(steps_at(at, size[cut], total[cut])) == 1) == alone


@pytest.mark.parametrize(("height", "found"), [(1.01, True), (0.99, False)])
def test_a_jump_is_twelve_times_the_scatter_of_all_channels_together(height, found):
    samples = noisy()
    _, scatter = third_differences(samples)
    gyro = samples.gyro.copy()
    gyro[500:502] = gyro[499]
    gyro[502:] = gyro[502:] - gyro[502] + gyro[499]
    gyro[500:506] = gyro[499]  # the same reading around the step
    gyro[496:500] = gyro[499]
    accel = samples.accel.copy()
    accel[496:506] = accel[496]
    gyro[502:, 0] += height * 6 * scatter[498, 0]
    jumps = find_jumps(replace(samples, gyro=gyro, accel=accel))
    assert (501 in jumps.rows) == found
    if found:
        np.testing.assert_allclose(jumps.size[jumps.rows == 501][0], [height * 6, 0, 0, 0, 0, 0], rtol=0.05)


@pytest.mark.parametrize("heights", [(1.0, 0.8), (0.8, 1.0)])
def test_two_jumps_three_rows_apart_are_two(heights):
    samples = noisy()
    gyro = samples.gyro.copy()
    gyro[500:, 0] += heights[0]
    gyro[503:, 0] += heights[1]
    assert find_jumps(replace(samples, gyro=gyro)).rows.tolist() == [499, 502]


def test_at_a_gap_that_the_stamps_show_there_is_no_jump():
    samples = noisy()
    gyro = samples.gyro.copy()
    gyro[500:] += 1.0
    stepped = replace(samples, gyro=gyro)
    assert find_jumps(stepped).rows.tolist() == [499]
    assert find_glitches(stepped) is None
    stamps = samples.t_ns + (np.arange(1000) >= 500) * 20_000_000
    late = replace(stepped, t_ns=stamps)
    assert open_gaps(late).nonzero()[0].tolist() == [499]
    assert find_jumps(late).rows.tolist() == []


def test_a_long_log_is_read_in_parts_that_overlap(monkeypatch):
    for name, value in (("LONG", 600), ("AT_ONCE", 200), ("BESIDE", 100)):
        monkeypatch.setattr(faulty_readings, name, value)
    samples = noisy(650)
    parts = [(first, own, len(part)) for first, own, part in in_parts(samples)]
    assert parts == [(0, range(200), 300), (100, range(200, 400), 400), (300, range(400, 600), 350), (500, range(600, 650), 150)]
    assert [len(part) for _, _, part in in_parts(noisy(600))] == [600]
    for count, found in ((3, True), (4, False)):  # of a part of 3.99 s, more than one a second
        spoilt = [values.copy() for values in (samples.gyro, samples.accel)]
        for values in spoilt:
            values[210 : 210 + 20 * count : 20] = 0.0
        assert (find_glitches(replace(samples, gyro=spoilt[0], accel=spoilt[1])) is not None) == found
    gyro = samples.gyro.copy()
    gyro[199:] += 1.0
    gyro[450:] -= 1.0
    gyro[[300, 520]] += 0.5
    stepped = replace(samples, gyro=gyro)
    rows, glitches = find_jumps(stepped).rows.tolist(), find_glitches(stepped)
    monkeypatch.setattr(faulty_readings, "LONG", 1000)
    assert rows == find_jumps(stepped).rows.tolist() == [198, 299, 300, 449, 519, 520]
    assert glitches.rows.tolist() == find_glitches(stepped).rows.tolist() == [300, 520]


@pytest.mark.parametrize("count", [1 << 20, (1 << 20) + 1])
def test_a_log_of_more_than_an_hour_is_long(count):
    class Log:
        period_s = 0.005
        __len__ = lambda self: count  # noqa: E731
        between = lambda self, start, stop: SimpleNamespace(rows=(start, stop))  # noqa: E731

    parts = [(first, own, getattr(part, "rows", None)) for first, own, part in in_parts(Log())]
    size, beside = 1 << 18, 1 << 12
    if count == 1 << 20:
        assert parts == [(0, range(count), None)]
    else:
        assert parts[1] == (size - beside, range(size, 2 * size), (size - beside, 2 * size + beside))
        assert parts[-1] == (4 * size - beside, range(4 * size, count), (4 * size - beside, count))


# Losses


def jumps_of(rows, accel=5.0, gyro=1.0) -> Jumps:
    size = np.tile([gyro, 0, 0, accel, 0, 0], (len(rows), 1)).astype(float)
    return Jumps(np.array(rows, dtype=int), size.reshape(-1, 6))


def test_a_loss_is_a_jump_alone_that_the_accelerometer_shows_too():
    assert find_losses(jumps_of([100, 108, 200, 209, 300]), 10.0).tolist() == [200, 209, 300]
    for accel, count in ((3.001, 2), (2.999, 0)):
        assert len(find_losses(jumps_of([100, 200], accel), 10.0)) == count
    for seconds, count in ((2.0, 2), (1.9, 0)):  # more than one per second has another cause
        assert len(find_losses(jumps_of([100, 200]), seconds)) == count
        assert len(possible_losses(jumps_of([100, 200]), seconds)) == count
    assert len(find_losses(jumps_of([]), 10.0)) == len(possible_losses(jumps_of([]), 10.0)) == 0


def test_a_possible_loss_is_the_greatest_jump_within_eight_rows():
    jumps = jumps_of([0, 100, 108, 200, 209, 300, 301])
    jumps.size[:, 3] = [1.0, 5.0, 6.0, 5.0, 6.0, 4.0, 4.0]
    assert possible_losses(jumps, 10.0).tolist() == [0, 108, 200, 209, 300, 301]


def test_no_loss_is_looked_for_within_a_fifth_of_a_second_of_a_blow():
    accel = np.tile([0.0, 0.0, 9.8], (200, 1))
    accel[100:] *= 3  # the greatest jump comes after row 99
    samples = samples_of(np.zeros((200, 3)), accel)
    assert samples.period_s == pytest.approx(0.01)
    rows = np.array([10, 78, 79, 99, 119, 120, 190])
    assert away_from_blows(samples, rows).tolist() == [10, 78, 120, 190]
    assert away_from_blows(samples_of(np.zeros((200, 3))), rows).tolist() == rows.tolist()


def test_the_step_of_a_register_is_the_smallest_between_readings():
    assert register_step(np.array([0.0, 3.0, 3.0, 5.0, 4.9999999999])) == pytest.approx(2.0)
    assert register_step(np.array([0.0, 2e-9, 0.0])) == pytest.approx(2e-9)
    assert register_step(np.array([0.0, 1e-10])) == register_step(np.ones(5)) == 0.0
    assert register_step(np.r_[np.arange(20_000) * 2.0, 39_999.0]) == 2.0  # of so many readings
    assert register_step(np.r_[np.arange(19_999) * 2.0, 39_997.0]) == 1.0


@pytest.mark.parametrize("temp", [True, False])
def test_lost_samples_are_put_in_on_the_polynomial_and_later_stamps_move(temp):
    """Of straight lines, exactly those that were lost, with a period between any two; what is read stays as it is."""
    t = np.arange(40.0)
    whole = samples_of(np.column_stack([t, -2 * t, 5 + t]), np.column_stack([3 * t, t, t]), temp=temp)
    kept = np.delete(np.arange(40), [10, 11, 12, 25, 26, 27])
    short = Samples(whole.t_ns[:34], whole.gyro[kept], whole.accel[kept], whole.temp_c[kept] if temp else None)
    back = with_lost(short, np.array([9, 21]), 3, np.array([1, 3]))
    for name in ("t_ns", "gyro", "accel") + (("temp_c",) if temp else ()):
        np.testing.assert_allclose(getattr(back, name), getattr(whole, name), atol=1e-9)
    assert (back.temp_c is None) == (not temp)
    same = with_lost(short, np.zeros(0, dtype=int), 3, 1)
    np.testing.assert_array_equal(same.gyro, short.gyro)
    bent = samples_of(np.column_stack([t**3, t**3, t**3]))  # each row with its own order
    cut = Samples(bent.t_ns[:34], bent.gyro[kept], bent.accel[kept], None)
    found = with_lost(cut, np.array([9, 21]), 3, np.array([1, 3])).gyro
    np.testing.assert_allclose(found[25:28], bent.gyro[25:28])
    assert np.abs(found[10:13] - bent.gyro[10:13]).max() > 1


# False readings


def at_rest(count=400, seed=1):
    """Samples that show no repetition: of some steps of noise in each channel."""
    return noisy(count, seed=seed)


@pytest.mark.parametrize(
    ("first", "count", "value", "found"),
    [(100, 1, 0, True), (100, 8, 0, True), (100, 9, 0, False), (4, 2, 0, True), (3, 2, 0, False), (394, 2, 0, True), (395, 2, 0, False),
     (100, 1, -1, True), (100, 1, 1, True), (100, 1, 2, False)],
)  # fmt: skip
def test_rows_at_zero_or_one_step_from_it_are_no_readings(first, count, value, found):
    """Up to eight, with four on either side."""
    samples = at_rest()
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[first : first + count] = value * LSB * np.ones(3) * np.where(np.arange(count) % 2, 0, 1)[:, None]
    accel[first : first + count] = value * 1.2e-3
    assert impossible_rows(replace(samples, gyro=gyro, accel=accel)) == ([(first, count, True)] if found else [])


@pytest.mark.parametrize(("again", "found"), [(1, []), (2, [(101, 2, True)]), (8, [(101, 8, True)]), (9, [])])
def test_a_row_that_repeats_twice_is_no_reading(again, found):
    samples = at_rest()
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[100 : 101 + again], accel[100 : 101 + again] = gyro[100], accel[100]
    assert impossible_rows(replace(samples, gyro=gyro, accel=accel)) == found
    quiet = gyro.copy()
    quiet[200:, 0] = np.where(np.arange(200) % 2, LSB, 0.0)  # half of the steps are of one register alone
    quiet[:, 0] = np.where(np.arange(400) % 2, LSB, 0.0)
    quiet[100 : 101 + again, 0] = quiet[100, 0]
    assert impossible_rows(replace(samples, gyro=quiet, accel=accel)) == []
    assert impossible_rows(replace(samples, gyro=gyro, accel=0 * accel)) == []


@pytest.mark.parametrize(("noise", "found"), [(2.0, True), (1.0, False)])
def test_repeated_rows_say_something_where_readings_usually_move_by_two_steps(noise, found):
    values = np.where(np.arange(400) % 2, noise, 0.0)
    values[200:] += 1.0
    table = np.tile(values[:, None], (1, 6)) + 100
    table[100:103] = table[100]
    assert impossible_rows(samples_of(table[:, :3], table[:, 3:])) == ([(101, 2, True)] if found else [])


def test_the_cubic_across_a_gap_is_that_of_four_readings_on_either_side():
    t = np.arange(30.0)
    values = np.column_stack([t**3 - 4 * t, 2 * t**2, 1 + 0 * t])
    spoilt = values.copy()
    spoilt[10:13] += 7.0
    spoilt[[5, 17]] += 3.0  # the fifth
    between, beside = cubic_across(spoilt, 10, 13)
    np.testing.assert_allclose(between, values[10:13], rtol=1e-9)
    np.testing.assert_allclose(beside, values[[6, 7, 8, 9, 13, 14, 15, 16]], rtol=1e-9)


def test_a_corner_continues_one_of_its_sides():
    t = np.arange(30.0)
    values = np.zeros((30, 3))
    values[:, 0] = np.maximum(t - 11, 0) * 2.0
    along = np.array([0.5, 0.0, 0.0])
    assert off_both_sides(values, 10, 14, along) == pytest.approx(0.0, abs=1e-9)
    values[12, 0] += 8.0
    values[12, 1] = 100.0  # another axis does not count
    assert off_both_sides(values, 10, 14, along) == pytest.approx(4.0)  # half of what it is above the right side
    values[:, 0] = 0.0
    values[11, 0] = -6.0
    assert off_both_sides(values, 10, 14, along) == pytest.approx(3.0)


def cluster(height, count=3, off=0.0, returns=1.0, accel=0.0, noise=1.0, axis=0, quiet=()):
    """Values (40, 6) with an excursion of ``count`` readings from row 20 on, and what is found of it at its third differences."""
    values = np.zeros((40, 6))
    values[20 : 20 + count, axis] = height
    values[20 + count :, axis] = (1 - returns) * height
    values[23 + count, axis] += off  # the last but one of the readings that carry the cubic
    values[20 : 20 + count, 3] = accel
    scatter = np.full((37, 6), noise * np.sqrt(20.0))
    scatter[list(quiet)] /= 2
    return excursion_at(values, scatter, 18, 20 + count - 1)


@pytest.mark.parametrize(
    ("known", "found"),
    [
        ({"height": 100.0}, (20, 3, False)),
        ({"height": 8.01}, (20, 3, False)),
        ({"height": 8.0}, None),
        ({"height": 100.0, "noise": 12.4}, (20, 3, False)),
        ({"height": 100.0, "noise": 12.7}, None),
        ({"height": 100.0, "accel": 99.0}, (20, 3, False)),
        ({"height": 100.0, "accel": 101.0}, None),
        ({"height": 100.0, "count": 8}, (20, 8, False)),
        ({"height": 100.0, "count": 9}, None),
        ({"height": 100.0, "returns": 0.0}, None),
        ({"height": 100.0, "returns": 0.68}, (20, 3, False)),
        ({"height": 100.0, "returns": 0.42}, None),
        ({"height": 100.0, "off": 18.1}, (20, 3, False)),
        ({"height": 100.0, "off": 18.2}, None),
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
        assert (excursion_at(one, scatter, row - 3, row) is not None) == found
    long = values.copy()
    long[20, 1] = 50.0
    for last, found in ((26, True), (27, False)):  # twelve rows from the first to the last
        assert (excursion_at(long, scatter, 16, last) is not None) == found
    weak = values.copy()
    weak[20:23, 1] = [50.0, 4.9, 50.0]  # a tenth of the greatest, or it ends there
    weak[24, 1] = 4.0
    assert excursion_at(weak, scatter, 18, 22)[1] == 3


def test_false_readings_are_found_where_they_are_whatever_their_kind():
    samples = noisy(2000, seed=3)
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[300:303] += 1.0
    gyro[700] -= 0.5
    gyro[900:902], accel[900:902] = 0, 0
    gyro[1200:1206], accel[1200:1206] = gyro[1199], accel[1199]
    spoilt = replace(samples, gyro=gyro, accel=accel)
    glitches = find_glitches(spoilt)
    assert list(zip(glitches.rows.tolist(), glitches.samples.tolist(), glitches.accel.tolist(), strict=True)) == [
        (300, 3, False), (700, 1, False), (900, 2, True), (1200, 6, True),
    ]  # fmt: skip
    mended = without_glitches(spoilt, glitches)
    np.testing.assert_array_equal(mended.gyro[[299, 303, 899, 902]], gyro[[299, 303, 899, 902]])
    np.testing.assert_array_equal(mended.accel[300:303], accel[300:303])
    assert np.abs(mended.gyro[[300, 700, 900, 1200]]).max() < 20 * LSB
    assert find_glitches(samples) is None
    many = samples.gyro.copy()
    rows = np.arange(100, 1900, 80)
    many[rows] += 1.0
    for seconds, found in ((len(rows), True), (len(rows) - 1, False)):  # one per second and no more
        stretched = replace(samples, gyro=many, t_ns=np.round(np.arange(2000) * 1e9 * seconds / 1999).astype(np.int64))
        assert (find_glitches(stretched) is not None) == found


def test_false_readings_are_replaced_by_the_polynomial_of_their_neighbours_of_which_some_may_be_mended(monkeypatch):
    """Of straight lines, exactly; the second run stands on what the first was replaced by."""
    t = np.arange(40.0)
    whole = samples_of(np.column_stack([t, -t, 2 * t]), np.column_stack([t, t, t]))
    gyro, accel = whole.gyro.copy(), whole.accel.copy()
    gyro[10:12] += 50
    gyro[14:17] -= 80
    accel[14:17] += 9
    monkeypatch.setattr(bridging, "best_order", lambda samples, rows, count: (1, 0.0))
    glitches = Glitches(np.array([10, 14]), np.array([2, 3]), np.array([False, True]))
    mended = without_glitches(replace(whole, gyro=gyro, accel=accel), glitches)
    assert np.abs(mended.gyro - whole.gyro)[10:12].max() > 1  # the readings behind it, which carry the line, are false
    np.testing.assert_allclose(mended.accel, whole.accel, atol=1e-9)
    apart = gyro.copy()
    apart[14:17] = whole.gyro[14:17]
    apart[16:19] -= 80
    glitches = Glitches(np.array([10, 16]), np.array([2, 3]), np.array([False, False]))
    np.testing.assert_allclose(without_glitches(replace(whole, gyro=apart), glitches).gyro, whole.gyro, atol=1e-9)
    single = whole.gyro.copy()
    single[20] += 9
    glitches = Glitches(np.array([20]), np.array([1]), np.array([False]))
    np.testing.assert_allclose(without_glitches(replace(whole, gyro=single), glitches).gyro, whole.gyro, atol=1e-9)
    first, second, both = (Glitches(np.array(rows), np.ones(len(rows), dtype=int), np.zeros(len(rows))) for rows in ([1], [4], [1, 4]))
    near = whole.gyro.copy()
    near[1] += 5
    assert np.abs(without_glitches(replace(whole, gyro=near), first).gyro[1] - whole.gyro[1]).max() < 2
    near[4] -= 5
    one = without_glitches(replace(whole, gyro=near), first)
    np.testing.assert_array_equal(without_glitches(replace(whole, gyro=near), both).gyro, without_glitches(one, second).gyro)


@pytest.mark.parametrize(("start", "rows"), [(501, [500]), (502, [500, 502])])
def test_an_excursion_that_begins_in_rows_that_are_no_readings_is_a_part_of_them(monkeypatch, start, rows):
    samples = noisy()
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    gyro[500:502], accel[500:502] = 0, 0
    gyro[502:504] += 1.0
    monkeypatch.setattr(faulty_readings, "excursion_at", lambda *_: (start, 3, False))
    assert find_glitches(replace(samples, gyro=gyro, accel=accel)).rows.tolist() == rows


@pytest.mark.parametrize(("gap", "found"), [(493, True), (494, False), (506, False), (507, True)])
def test_an_excursion_beside_a_gap_that_the_stamps_show_is_none(gap, found):
    """Third differences of a false row 500 are those from 497 to 500; four readings on either side carry the cubic."""
    samples = noisy()
    gyro = samples.gyro.copy()
    gyro[500] += 1.0
    late = replace(samples, gyro=gyro, t_ns=samples.t_ns + (np.arange(1000) > gap) * 20_000_000)
    assert (find_glitches(late) is not None) == found


# Of a session


def session_with(*logs: Samples, bridges=()) -> Session:
    files = tuple(Log(Path(f"log{i:04}.csv"), samples, bridges=tuple(bridges)) for i, samples in enumerate(logs))
    return Session(Path("made"), config(odr_hz=100.0), files, ())


@pytest.mark.parametrize(
    ("row", "samples", "inside"), [(92, 3, False), (93, 3, True), (94, 0, False), (95, 0, True), (107, 1, True), (108, 1, False)]
)
def test_an_event_at_a_bridged_gap_is_none(row, samples, inside):
    """Within four rows of what was put in: three rows from 100 on."""
    bridges = [Bridge(GAP, 100, 3, 1.0, np.zeros(3)), Bridge("clipped", 50, 3, 0.5, np.zeros(3))]
    session = session_with(noisy(400), bridges=bridges)
    assert in_bridge(session, RegisterFault(FALSE, 0, row, samples)) == inside
    assert not in_bridge(session, RegisterFault(FALSE, 0, 51, 1))


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


def strokes(level=200.0, heights=(1.0, 1.0, 1.0), flat=20, ramp=60, noise=0.0, lsb=True, seed=0, rest=100):
    """Trapezoids on the x axis, dps, between rests; each ramp falls to nothing in ``ramp`` readings."""
    parts = [np.zeros(rest)]
    for height in heights:
        up = np.linspace(0, height * level, ramp + 1)[1:-1]
        parts += [up, np.full(flat, height * level), up[::-1], np.zeros(rest)]
    x = np.concatenate(parts)
    gyro = np.random.default_rng(seed).normal(0, noise + 1e-3 * (not lsb), (len(x), 3))
    gyro[:, 0] += x
    return samples_of(np.rint(gyro / 17.5e-3) * LSB if lsb else gyro * DEG)


def test_a_plateau_of_the_registers_has_corners():
    values = np.zeros(100)
    values[40:50] = 54.5
    assert has_corners(values, 40, 50, 1.0)
    assert not has_corners(values, 40, 50, 1.01)
    assert not has_corners(np.minimum(values, 54.0), 40, 50, 1.0)
    values[30] = 1.0  # ten readings before
    assert not has_corners(values, 40, 50, 1.0)
    values[30], values[59] = 0.0, 1.0  # ten behind
    assert not has_corners(values, 40, 50, 1.0)
    values[59], values[58], values[60] = 0.0, 9.0, 9.0
    assert has_corners(values, 40, 50, 1.0)
    edge = np.full(12, 100.0)
    edge[0] = edge[-1] = 10.0
    assert has_corners(edge, 3, 9, 1.0)  # the log's ends stand for what lies beyond them
    for end in (0, -1):
        assert not has_corners(np.where(np.arange(12) == end % 12, 60.0, edge), 3, 9, 1.0)


def test_a_ceiling_is_a_level_that_is_kept_for_longer_than_noise_keeps_it():
    """With three steps of noise, for seven readings; above a twentieth of full scale; negative ones count as positive."""
    quiet = strokes(level=200.0, noise=0.05)
    noise_free = np.asarray(quiet.gyro)
    level = np.rint(200 / 17.5e-3) * LSB
    clipped = replace(quiet, gyro=np.clip(noise_free, -level + 2 * LSB, level - 2 * LSB))
    ceiling = find_ceiling(clipped, 500 * DEG)
    assert ceiling.level == pytest.approx(level - 2 * LSB)
    at = np.abs(clipped.gyro) >= level - 3.5 * LSB
    np.testing.assert_array_equal(ceiling.mask, at.any(axis=1))
    short = np.array(clipped.gyro)
    short[50:52, 1], short[55, 2] = 2 * LSB - level, level - 4 * LSB  # two readings at it on another axis, and one below
    np.testing.assert_array_equal(
        find_ceiling(replace(clipped, gyro=short), 500 * DEG).mask, at.any(axis=1) | np.isin(np.arange(len(at)), [50, 51])
    )
    short[60:62, 1] = level  # an axis that exceeds it has no ceiling there
    np.testing.assert_array_equal(find_ceiling(replace(clipped, gyro=short), 500 * DEG).mask, at.any(axis=1))
    assert find_ceiling(replace(clipped, gyro=-np.asarray(clipped.gyro)), 500 * DEG).level == pytest.approx(level - 2 * LSB)
    assert find_ceiling(quiet, 500 * DEG) is None or find_ceiling(quiet, 500 * DEG).level > level
    for share, found in ((19.9, True), (20.1, False)):
        assert (find_ceiling(clipped, share * (level - 2 * LSB)) is not None) == found
    assert find_ceiling(samples_of(np.zeros((50, 3))), 500 * DEG) is None


@pytest.mark.parametrize(
    ("known", "found"),
    [({}, 3), ({"ramp": 30}, 3), ({"level": 26.0}, 3), ({"level": 24.0}, 0), ({"ramp": 300}, 0)],
)
def test_a_stroke_has_a_flat_top_with_corners(known, found):
    """At least five readings here, and as far beyond its ends as it is long fallen by 18 times its band."""
    values = np.asarray(strokes(lsb=False, **known).gyro)[:, 0]
    tops = plateaus_of(values, 1e-3 * DEG, 25 * DEG, 5.0)
    assert len(tops) == found
    for level, start, stop in tops:
        assert level == pytest.approx(known.get("level", 200.0) * DEG, rel=1e-3)
        assert stop - start == pytest.approx(known.get("flat", 20), abs=2 * 0.012 * known.get("ramp", 60) + 2)


def top(values, noise=0.0, least=1.0, shortest=5.0):
    return [(start, stop) for _, start, stop in plateaus_of(np.asarray(values, dtype=float), noise, least, shortest)]


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
    return find_plateaus(samples_of(gyro * DEG), fs * DEG)


def test_clipped_strokes_have_one_height_that_none_exceeds():
    found = levels([100, 100.5, 99])
    assert found.level == pytest.approx(100 * DEG, rel=1e-3)
    assert np.flatnonzero(found.mask).tolist() == [*range(30, 50), *range(110, 130), *range(190, 210)]
    assert levels([100, 100]) is None
    assert levels([100, -100, 100]).level == pytest.approx(100 * DEG, rel=1e-3)
    assert levels([100, 100], axes=(0, 2)) is not None
    assert levels([100, 100, 97.9]) is None  # two of three alike, of which three are needed
    assert levels([100, 100, 100, 97.5, 102.5]) is not None  # three of five
    assert levels([100, 100, 100, 97.5, 102.5, 90]) is None
    for peak, passed in ((103.9, False), (104.1, True)):
        assert (levels([100, 100, 100, 100, peak]) is None) == passed
        assert (levels([-100, -100, -100, -100, -peak]) is None) == passed
    for fs, kept in ((1999.0, True), (2001.0, False)):
        assert (levels([100, 100, 100], fs=fs) is not None) == kept
    assert levels([100, 100, 100], hole=0.9).mask[30:50].all()
    masked = levels([100, 100, 100, 98.1])
    assert masked.mask[270:290].all()
    assert not levels([100, 100, 100, 97.9]).mask[270:290].any()
