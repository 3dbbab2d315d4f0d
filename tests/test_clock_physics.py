"""The true data rate and what is missing, from stamps that are incomplete, coarse, late or come round; samples counted along them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from session.base.errors import DataError
from session.log.stamps import (
    COUNTER,
    DAY_NS,
    PARTS,
    WINDOW,
    Unroll,
    _span_of_counter,
    along_line,
    bad_stamps,
    evenly,
    lasting_gaps,
    not_caught_up,
    pace_of,
    placed_between,
    written_once,
)
from session.replay.clock import exact_ns


def steps(*periods, period=10_000):
    return np.concatenate([[0], np.cumsum(np.rint(np.array(periods) * period))]).astype(np.int64) * 1000


def test_the_period_is_the_time_by_the_number_of_periods():
    """Repeated stamps are passed over; a lost sample, or a gap, counts with as many periods as it is long."""
    even = pace_of(np.insert(steps(*[1.0] * 50, 2.02, *[1.0] * 50, 7.06, *[1.0] * 20), 30, steps(*[1.0] * 30)[29]))
    assert (even.period_s, even.rate_hz, even.coarse) == (pytest.approx(1.2908 / 129), pytest.approx(12900 / 129.08), False)
    assert even.periods(np.array([0.01, 0.0149, 0.0151, 0.031])).tolist() == [1, 1, 2, 3]
    assert [even.missing(np.array(apart)) for apart in ([0.01, 0.02, 0.049], [0.004, 0.01])] == [5, 0]
    drifting = pace_of(steps(*np.linspace(0.98, 1.04, 101)))
    assert drifting.period_s == pytest.approx(0.01 * 1.01, rel=1e-6)
    assert pace_of(steps(1.0, 4.0)).period_s == pytest.approx(0.01)
    # At the steps near the median, a gap of 40.6 of them is 41 periods; at the pace that follows from that, 40.
    assert pace_of(steps(*[1.0] * 30, *[2.1] * 20, 40.6)).period_s == pytest.approx(1.126 / 110)


@pytest.mark.parametrize(
    ("late", "long", "lost", "coarse"),
    [(0.451, 2.0, 19, True), (0.451, 2.0, 20, False), (0.451, 3.0, 20, True), (0.449, 2.0, 0, False)],
)
def test_long_steps_that_late_stamps_explain_are_no_losses(late, long, lost, coarse):
    """Eight late stamps: eight steps that are 0.45 of a period short and as many that are long.  More of these must be by five sigmas of
    the difference, 5 sqrt(16) = 20; a gap is none of them.  A stamp that is less late is none."""
    apart = [*[1 + late, 1 - late] * 8, *[1.0] * 400, *[long] * lost]
    pace = pace_of(steps(*apart))
    assert pace.coarse == coarse
    if coarse:  # what is no gap is one period
        assert pace.period_s == pytest.approx(np.mean([step for step in apart if step <= 2.5]) * 0.01)


@pytest.mark.parametrize(("even", "periods"), [(106, 129), (107, 128)])
def test_a_long_step_that_is_caught_up_is_one_period_where_enough_samples_tell_it(even, periods):
    """Of 128 steps, and of one less, where it counts by its length."""
    apart = [*[1.451, 0.549] * 8, *[1.0] * even, 3.0, *[0.5] * 4]
    assert pace_of(steps(*apart)).period_s == pytest.approx(len(apart) * 0.01 / periods)


@pytest.mark.parametrize(
    ("longs", "shift", "gap", "coarse"),
    [
        ([6, 2, 5, 3, 5, 3, 5, 3, 4, 4], 0.0, 1.0, True),  # variance 1.4
        ([6, 2, 6, 2, 5, 3, 4, 4, 4, 4], 0.0, 1.0, False),  # 1.8, of less than 0.4 x 4
        ([4] * 4, 0.0, 9.0, True),
        ([4] * 3 + [3], 0.0, 1.0, False),  # fifteen, in less than four windows
        ([4] * 4, 0.5, 1.0, True),
        ([4] * 4, 0.45, 1.0, False),  # the clock is finer than half a period
    ],
)
def test_long_steps_that_come_evenly_are_those_of_a_coarse_clock(longs, shift, gap, coarse):
    """In windows of four long steps on average; a stamp that is not on the ticks shows how fine they are; a gap counts as one period."""
    apart = np.concatenate([[1.0] * (20 - count) + [2.0] * count for count in longs])
    apart[1:4] = 1.0 + shift, 1.0 - shift, gap
    assert pace_of(steps(*apart)).coarse == coarse


def test_a_coarse_pace_counts_what_is_no_gap_as_one_period():
    pace = replace(pace_of(steps(*[1.0] * 20)), coarse=True)
    assert_array_equal(pace.periods(np.array([0.004, 0.02, 0.02499, 0.0251, 0.04])), [1, 1, 1, 3, 4])


ODR_HZ = 209.56


def stamps(odr_hz, tick_ns, lost, late_s):
    """Stamps ns of a minute of an even clock in ticks, some of them lost, by chance or these, and how many were lost."""
    rng = np.random.default_rng(3)
    t_s = 0.0137 + np.arange(round(60 * odr_hz)) / odr_hz
    t_s += late_s * np.clip(rng.standard_normal(len(t_s)), -2, 2)
    kept = rng.random(len(t_s)) >= lost if isinstance(lost, float) else ~np.isin(np.arange(len(t_s)), lost)
    kept[[0, -1]] = True
    return (t_s[kept] * 1e9 // tick_ns).astype(np.int64) * tick_ns, int(np.count_nonzero(~kept))


def test_two_steps_of_which_neither_is_near_the_middle_have_the_pace_of_the_shorter():
    """Found by fuzzing a log of four rows: the mean of no steps, a warning of NumPy's, and a rate that is no number."""
    pace = pace_of(np.array([0, 9_600_000, 48_000_000]))
    assert (pace.period_s, pace.missing(np.array([0.0096, 0.0384]))) == (pytest.approx(0.0096), 3)


def test_stamps_that_stand_still_have_no_period():
    assert np.isnan(pace_of(np.zeros(5, dtype=np.int64)).period_s)


@pytest.mark.parametrize(
    ("odr_hz", "tick_ns", "lost", "late_s"),
    [
        (ODR_HZ, 1000, 0.1, 0.0),
        (ODR_HZ, 1000, [*range(100, 900), 5000], 0.0),
        (ODR_HZ, 1_000_000, 0.005, 0.0),  # the median step is 5 ms, and the period 4.77
        (417.0, 1_000_000, 0.0, 20e-6),  # steps of 1 and 2 ms at 833 Hz are all one period
        (950.0, 1_000_000, 0.0, 20e-6),
        (ODR_HZ, 1000, 0.0, 0.2 / ODR_HZ),
        (118.7, 1_000_000, 0.0, 0.0),  # steps of 8 and 9 ms, whose median says 125 Hz
    ],
)
def test_lost_late_and_coarse_stamps_change_neither_rate_nor_count(odr_hz, tick_ns, lost, late_s):
    t_ns, missing = stamps(odr_hz, tick_ns, lost, late_s)
    assert pace_of(t_ns).rate_hz == pytest.approx(odr_hz, rel=1e-3 if late_s else 1e-4)
    assert abs(pace_of(t_ns).missing(np.diff(t_ns) * 1e-9) - missing) <= 2 * (late_s > 1e-4)


@pytest.mark.parametrize(
    ("fall", "highest", "span"),
    [
        (2**16 - 10, 2**16 - 5, 2**16),
        (2**16 - 25, 2**16 - 5, 2**16),
        (2**16 - 26, 2**16 - 5, None),  # more than 2.5 steps are lost there
        (2**16, 2**16 - 5, None),
        (2**16 - 10, 2**16, None),  # beyond such a counter
        (30, 30, None),  # three rows a round
        (31, 31, None),
        (54, 60, 64),
    ],
)
def test_a_counter_falls_by_a_power_of_two_less_a_usual_step(fall, highest, span):
    assert _span_of_counter(fall, 10, 0, highest, 1) == span
    if span:
        assert _span_of_counter(fall, 10, -span / 2, highest - span / 2, 1) == span


@pytest.mark.parametrize("text", ["nan", "inf", "1e999999", "1e400000", "", "1:2", "a:b:c", "::"])
def test_what_is_no_time(text):
    with pytest.raises(ValueError, match=r"no time|unpack|invalid"):
        exact_ns(text, 10**9)


def test_bursts_are_counted_along_their_stamps():
    """The rate is the mean one; a stamp is late by the wait, so the least late of a burst is the time."""
    count = np.arange(3000)
    late_ns = np.rint((count // 7 * 7 + 6) / 104 * 1e9).astype(np.int64) - (6 - count % 7) * 100_000
    even, note, _ = evenly(late_ns, None, "x")
    assert "come in bursts" in note
    assert (np.diff(even).mean(), np.ptp(np.diff(even)) <= 1) == (pytest.approx(1e9 / 104, rel=2e-5), True)
    lacking = np.delete(late_ns, np.s_[1400:1442])  # whose stamps stay
    even, note, _ = evenly(lacking, None, "x")
    assert ("samples are missing" in note, even.tolist()) == (True, lacking.tolist())


def test_coarse_stamps_are_counted_along_their_changes():
    """Whole seconds, cut off: where a stamp changes it is right to a sample."""
    true_ns = np.round(np.arange(16_000) * (1e9 / 104.03)).astype(np.int64) + 370_000_000
    even, note, sigma_ppm = evenly(true_ns // 10**9 * 10**9, None, "x")
    assert "share a stamp" in note
    assert 1e9 / np.diff(even).mean() == pytest.approx(104.03, rel=1e-5)
    assert sigma_ppm == pytest.approx(1e6 / 12**0.5 / 16_000, rel=0.02)  # each change to a sample, in a pattern that hardly scatters


@pytest.mark.parametrize("lost", [10, 100])
def test_samples_that_whole_seconds_lack_are_missed(lost):
    true_ns = np.round(np.arange(12_000) * (1e9 / 105.1)).astype(np.int64)
    whole = np.delete(true_ns // 10**9 * 10**9, np.s_[5000 : 5000 + lost])
    with pytest.raises(DataError, match="samples are missing"):
        evenly(whole, None, "x")


def jittery(rate_hz=93.4, seconds=140, jitter_s=2e-3, seed=7):
    true_s = np.arange(round(seconds * rate_hz)) / rate_hz
    return true_s, np.rint((true_s + np.abs(np.random.default_rng(seed).normal(0, jitter_s, len(true_s)))) * 1e3).astype(np.int64) * 10**6


def test_lines_begin_anew_behind_a_gap_and_missing_samples_are_refused():
    true_s, stamps = jittery()
    kept = np.ones(len(stamps), dtype=bool)
    kept[5000:5400] = False
    even_ns, note, _ = along_line(stamps[kept], "x")
    assert ", 93.400 Hz ± " in note
    assert np.ptp(even_ns * 1e-9 - true_s[kept]) < 5e-4
    kept[8000] = False
    with pytest.raises(DataError, match=r"samples are missing near 85\.\d s, where no gap shows it"):
        along_line(stamps[kept], "x")
    slewed = np.cumsum(np.where((true_s > 50) & (true_s < 90), 1.02, 1.0)) / 93.4
    with pytest.raises(DataError, match="the rate changes"):
        along_line(np.rint(slewed * 1e9).astype(np.int64), "x")


@pytest.mark.parametrize(("rate_hz", "jitter_s"), [(93.4, 2e-3), (207.6, 5e-4)])
def test_samples_are_counted_along_stamps_that_scatter(rate_hz, jitter_s):
    """By numpy's line; the sigma of a slope by independent errors, of as many parts as tell it, is that of the line to a sixth."""
    true_s, stamps = jittery(rate_hz, jitter_s=jitter_s)
    (even_ns, note, sigma_ppm), count = along_line(stamps, "x"), np.arange(len(stamps))
    (slope, _), covariance = np.polyfit(count, (stamps - stamps[0]) * 1e-9, 1, cov=True)
    assert sigma_ppm == pytest.approx(np.sqrt(covariance[0, 0]) / slope * 1e6, rel=0.4)
    assert np.ptp(even_ns * 1e-9 - true_s) < 2e-4
    off_s = (stamps - even_ns) * 1e-9
    assert off_s.mean() == pytest.approx(0, abs=1e-9)
    assert note.startswith(f"stamps scatter by {off_s.std() * 1e3:.2g} ms rms: ")
    assert note.endswith(f", {1 / slope:.3f} Hz ± {sigma_ppm:.2g} ppm")
    apart = count - count.mean()
    parts = [part.sum() for part in np.array_split(apart * off_s, PARTS)]
    assert sigma_ppm == pytest.approx(np.linalg.norm(parts) / (apart @ apart) / slope * 1e6, rel=1e-4)


@pytest.mark.parametrize(("begins", "size"), [(0, 7), (120_000, 40), (120_000, 3)])
def test_a_counter_that_comes_round_is_carried_on_piece_after_piece(begins, size):
    """Of 17 bits, which nobody states, and of 32 bits of microseconds."""
    true = begins + 10_000 * np.arange(40)
    for span, unroll in ((2**17, Unroll(None, 1)), (COUNTER * 1000, Unroll(COUNTER * 1000, 1000))):
        stamps = true if span == 2**17 else true * 1000 + span - 200_000_000
        found = np.concatenate([unroll((stamps % span)[start : start + size]) for start in range(0, 40, size)])
        assert_array_equal(np.diff(found), np.diff(stamps))
        assert unroll.wraps == stamps[-1] // span - stamps[0] // span


@pytest.mark.parametrize(
    ("begins", "span", "falls"), [(0, DAY_NS, 1.0), (-DAY_NS // 2, DAY_NS, 1.0), (0, DAY_NS, 0.86), (10**18, DAY_NS, 1.0)]
)
def test_a_clock_comes_round_within_its_span_or_not_at_all(begins, span, falls):
    """Of a day, with the samples of up to an eighth of it missing; nanoseconds of an epoch are no clock of a day."""
    before = begins + span - 10**10 * np.arange(4, 0, -1)
    after = before[-1] - round(span * falls) + 10**10 * np.arange(1, 5)
    unroll = Unroll(DAY_NS, None)
    step = np.diff(unroll(np.concatenate([before, after])))[3]
    fall = after[0] - before[-1]
    counts = begins < 10**18 and (fall + span <= span / 8)
    assert (step, unroll.wraps) == (fall + span * counts, int(counts))


@pytest.mark.parametrize("rows", [40, 200])
def test_a_gap_lasts_and_is_as_long_as_what_it_lacks(rows):
    """More than one and a half periods, in a few rows by the steps and in many by the least late around."""
    middle = rows // 2
    for step, found in ((2.4, []), (2.6, [(middle - 1, pytest.approx(0.016))])):
        t_ns = 10**7 * np.arange(rows)
        t_ns[middle:] += round((step - 1) * 10**7)
        assert [*zip(*lasting_gaps(t_ns, 0.01), strict=True)] == found
    many = np.arange(10 * rows)
    two = 10**7 * (many + 2 * (many >= 5 * rows) + 4 * (many >= 9 * rows))
    assert [*zip(*lasting_gaps(two, 0.01), strict=True)] == [(5 * rows - 1, pytest.approx(0.02)), (9 * rows - 1, pytest.approx(0.04))]
    caught_up = 10**7 * np.arange(rows)
    caught_up[middle : middle + 3] = caught_up[middle + 3] - np.array([3, 2, 1])
    assert len(lasting_gaps(caught_up, 0.01)[0]) == (rows == 40)


@pytest.mark.parametrize("row", [0, 30, 78])
def test_a_long_step_is_not_caught_up_where_the_least_late_behind_it_are_later(row):
    """By more than three quarters of a period than the least late before it, up to the ends of a log."""
    t_ns, behind = 10**7 * np.arange(80), np.arange(80) > row
    for late, lost in ((0.74, False), (0.76, True)):
        assert not_caught_up(t_ns + round(late * 1e7) * behind, np.array([row]), 0.01).tolist() == [lost]
    for on_time in (row + 1, min(row + WINDOW, 79)):
        assert not_caught_up(t_ns + 10**8 * (behind & (np.arange(80) != on_time)), np.array([row]), 0.01).tolist() == [False]
    late_before = t_ns + 10**7 * ~behind
    late_before[row] -= 10**7
    assert not_caught_up(late_before + 10**7 * behind, np.array([row]), 0.01).tolist() == [True]


def test_single_bad_stamps():
    t_ns, at = 10 * np.arange(200), np.arange(200)
    for value in (0, 10**6):
        assert bad_stamps(np.where(np.isin(at, [70, 90]), value, t_ns)).tolist() == [70, 90]
        assert not len(bad_stamps(np.where(at == 70, t_ns[71 - 2 * (value == 0)], t_ns)))  # as one of its neighbours: beyond neither
    for apart, single in ((15, False), (16, True), (50, True), (51, False)):  # one and a half to five usual steps
        bad = t_ns + (at > 70) * (apart - 20)
        bad[70] = 0
        assert len(bad_stamps(bad)) == single
    swapped = t_ns[np.r_[:70, 71, 70, 72:200]]
    assert len(bad_stamps(swapped)) == len(bad_stamps(np.where((at >= 10) & (at < 190) & (at % 9 == 1), 10**6, t_ns))) == 0


def test_rows_that_repeat_and_rows_that_share_a_stamp():
    columns = [np.array([[1, 1], [1, 1], [2, 2], [2, 3], [4, 4]]), np.array([5, 5, 6, 6, 7])]
    assert written_once(np.array([0, 0, 1, 1, 2]), columns).tolist() == [True, False, True, True, True]
    late = np.array([0, 10, 20, 20, 40, 50, 60, 60, 60, 90, 100])
    assert_array_equal(placed_between(late), 10 * np.arange(11))
    lacking, two = np.array([0, 10, 20, 20, 60, 70, 80]), np.array([0, 10, 20, 20, 40, 40, 60, 70])
    for stays in (lacking, two):  # rows that are farther apart than so many take; stamps that are late one behind the other
        assert_array_equal(placed_between(stays), stays)
