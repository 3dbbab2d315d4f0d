"""Continuity of a stream and its step filter, reading by reading: each tolerance one step below and above, each wrap, each count."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from session.bench.continuity import Continuity, StepFilter
from session.bench.events import REGISTERS, Event, SampleChunk, StreamFormat

P = 1000  # us, the period of these streams


T0 = 5_000_000


def received(t_us, sequence=None):
    t_us = np.asarray(t_us, dtype=np.int64)
    registers = np.repeat((t_us % 2**32 % 30_000).astype(np.int16)[:, None], 7, axis=1)
    sequence = None if sequence is None else np.asarray(sequence, dtype=np.int64)
    return SampleChunk(t_us, registers, damaged=np.zeros(len(t_us), dtype=bool), sequence=sequence)


def told(out):
    """Times and periods of what counts, and troubles as (kind, count, t_us)."""
    good = [each for each in out if isinstance(each, SampleChunk)]
    t_us = [t for each in good for t in each.t_us.tolist()]
    for each in good:
        assert (each.registers[:, 0] == each.t_us % 2**32 % 30_000).all()
    return t_us, [p for each in good for p in each.periods.tolist()], [(e.kind, e.count, e.t_us) for e in out if isinstance(e, Event)]


def begun(count=20, text=False, period=P):
    """A stream of so many readings, numbers from 0, that have counted; the last at T0 + (count - 1) period."""
    stream = Continuity()
    n = np.arange(count)
    t_us, periods, troubles = told(stream.take(received(T0 + period * n, None if text else n)))
    assert t_us == (T0 + period * n[: count - text]).tolist()  # of text the last waits
    assert periods == [1] * (count - text)
    assert not troubles
    return stream


LAST = T0 + 19 * P  # of ``begun()``


@pytest.mark.parametrize("text", [False, True])
def test_three_readings_that_follow_each_other_begin_a_stream(text):
    stream = Continuity()
    assert stream.take(received([T0, T0 + P], None if text else [7, 8])) == []
    out = told(stream.take(received([T0 + 2 * P], None if text else [9])))
    assert out == ([T0, T0 + P, T0 + 2 * P][: 3 - text], [1] * (3 - text), [])
    assert stream.period_us == P
    assert told(stream.finish()) == ([T0 + 2 * P] * text, [1] * text, [])
    assert stream.period_us is None


@pytest.mark.parametrize(
    ("steps", "beyond", "text"),
    [
        ((1000, 1350), (1000, 1351), False), ((1350, 1000), (1351, 1000), False),
        ((1000, 1700), (1000, 1701), True), ((1700, 1000), (1701, 1000), True),
        ((50, 50), (49, 49), False), ((2_000_000,) * 2, (2_000_001,) * 2, False),
    ],
)  # fmt: skip
def test_a_beginning_is_steady_and_of_a_possible_rate(steps, beyond, text):
    for each, count in ((steps, 3 - text), (beyond, 0)):
        t_us = T0 + np.cumsum([0, *each])
        assert len(told(Continuity().take(received(t_us, None if text else [7, 8, 9])))[0]) == count


@pytest.mark.parametrize(("skip", "begins"), [(4096, True), (4097, False), (0, False), (65535, False)])
def test_at_most_4096_numbers_are_missing_in_a_beginning(skip, begins):
    out = told(Continuity().take(received(T0 + P * np.array([0, skip, skip + 1]), [7, (7 + skip) % 65536, (8 + skip) % 65536])))
    assert out == (([T0, T0 + skip * P, T0 + (skip + 1) * P], [1, skip, 1], [("lost", skip - 1, None)]) if begins else ([], [], out[2]))


def test_the_last_of_what_does_not_follow_may_be_the_first_that_counts():
    """A wrong first reading: it alone is left out; of two wrong ones neither stays."""
    stream = Continuity()
    out = told(stream.take(received([T0 - 777_777, T0, T0 + P, T0 + 2 * P], [90, 8, 9, 10])))
    assert out == ([T0, T0 + P, T0 + 2 * P], [1, 1, 1], [("implausible", 1, None)])
    stream = Continuity()
    out = told(stream.take(received([T0 - 3 * P, T0 - P // 2, T0, T0 + P, T0 + 2 * P], [6, 7, 8, 9, 10])))
    assert out == ([T0, T0 + P, T0 + 2 * P], [1, 1, 1], [("implausible", 1, None)] * 2)


def test_the_period_is_the_mean_over_numbers():
    stream = Continuity()
    out = told(stream.take(received([T0, T0 + 2400, T0 + 3500], [65535, 1, 2])))
    assert out[1] == [1, 2, 1]
    assert stream.period_us == pytest.approx(3500 / 3)


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize(("numbers", "most"), [(1, 355), (4096, 20_830)])
def test_a_step_may_err_by_a_third_of_a_period_and_half_a_per_cent(numbers, most, smooth):
    """(0.35 + 0.005 numbers) periods either way, among readings at once or one by one."""
    for off, counts in ((most, True), (most + 1, False), (-most, True), (-most - 1, False)):
        stream = begun(20 if smooth else 5)
        last, number = (LAST, 19) if smooth else (T0 + 4 * P, 4)
        # one late or early step by less than a whole period may fit another count of lost readings, unless numbers forbid it
        at = last + numbers * P + off
        t_us, periods, troubles = told(stream.take(received([at], [number + numbers])))
        if counts:
            assert (t_us, periods) == ([at], [numbers])
            assert troubles == ([("lost", numbers - 1, last)] if numbers > 1 else [])
        elif off < 0 and numbers > 1:
            assert t_us == [at]  # by one period less: one of the numbers was an info frame's
            assert periods == [numbers - 1]
        else:
            assert (t_us, troubles) == ([], [])


def test_a_reading_out_of_place_is_left_out_when_the_next_follows_the_one_before():
    stream = begun()
    out = told(stream.take(received([LAST + P + 400, LAST + 2 * P, LAST + 3 * P], [20, 21, 22])))
    assert out == ([LAST + 2 * P, LAST + 3 * P], [2, 1], [("implausible", 1, LAST), ("lost", 1, LAST)])


def test_the_same_number_or_time_again_counts_once():
    for count in (19, 20):  # readings that are checked at once, however those before them were
        last, number = T0 + (count - 1) * P, count - 1
        for step_us, step in ((0, 0), (P, 0), (0, 1), (P, 1000), (P, 1 + 2**15)):
            t_us, numbers = last + np.array([step_us, P, 2 * P]), number + np.array([step, 1, 2])
            assert told(begun(count).take(received(t_us, numbers))) == (t_us[1:].tolist(), [1, 1], [("implausible", 1, last)])
        for step_us in (0, -P):
            out = told(begun(count, text=True).take(received([last + step_us, last + P])))
            assert out == ([last], [1], [("implausible", 1, last)])


@pytest.mark.parametrize("modulus", [2**32, 2**40], ids=["text that wraps", "text that counts on"])
def test_number_and_clock_wrap(modulus):
    n = np.arange(200)
    t_us, stream = 2**32 - 100_500 + P * n, Continuity()
    assert told(stream.take(received(t_us % modulus)) + stream.finish()) == (t_us.tolist(), [1] * 200, [])
    assert told(Continuity().take(received(t_us % 2**32, (65_450 + n) % 65_536))) == (t_us.tolist(), [1] * 200, [])


def test_ten_minutes_of_silence_are_a_gap_and_more_are_a_restart():
    """600 000 periods: the number has wrapped nine times."""
    periods = 600_000
    out = told(begun().take(received([LAST + periods * P], [(19 + periods) % 65_536])))
    assert out == ([LAST + periods * P], [periods], [("lost", periods - 1, LAST)])
    n = periods + 1 + np.arange(3)
    out = told(begun().take(received(LAST + n * P, (19 + n) % 65_536)))
    assert out == ((LAST + n * P).tolist(), [1, 1, 1], [("reset", 1, LAST)])
    for count in (5, 20):  # one each fifth of a second: fewer than 4096 numbers are missing
        slow, last = 200_000, T0 + (count - 1) * 200_000
        for periods, counts in ((3000, True), (3001, False)):
            at, number = last + periods * slow, count - 1 + periods
            assert told(begun(count, period=slow).take(received([at], [number])))[0] == [at] * counts


def test_a_number_of_an_info_frame_is_no_sample_lost():
    stream = begun()
    stream.info(20)
    assert told(stream.take(received([LAST + P, LAST + 2 * P], [21, 22]))) == ([LAST + P, LAST + 2 * P], [1, 1], [])
    other = begun()
    other.info(20)  # a board with a counter of its own for them: the next sample has the same number
    assert told(other.take(received([LAST + P, LAST + 2 * P], [20, 21]))) == ([LAST + P, LAST + 2 * P], [1, 1], [])
    other.info(22)
    assert told(other.take(received([LAST + 4 * P], [23])))[2] == [("lost", 1, LAST + 2 * P)]  # its infos have no part in the numbers


@pytest.mark.parametrize(("step_us", "numbers", "count"), [(999_999, 1006, 1005), (1_000_000, 1007, 1005)])
def test_one_number_and_another_each_second_may_be_of_a_lost_info_frame(step_us, numbers, count):
    """Beyond the most samples that the clock allows, (0.35 + 0.005 count) periods more than it says."""
    at = LAST + step_us
    assert told(begun().take(received([at], [19 + numbers]))) == ([at], [count], [("lost", count - 1, LAST)])
    assert told(begun().take(received([at], [20 + numbers]))) == ([], [], [])


@pytest.mark.parametrize(
    ("gap_us", "numbers", "goes_on"),
    [(0, 5, False), (1, 4096, True), (2_000_000, 1, True), (2_000_001, 5, False), (1_000_000, 0, False), (1_000_000, 4097, False)],
)
def test_another_rate_is_no_restart_within_two_seconds_and_4096_numbers(gap_us, numbers, goes_on):
    t_us = LAST + gap_us + 2400 * np.arange(4)
    out = told(begun().take(received(t_us, 19 + numbers + np.arange(4))))
    lost = [("lost", numbers - 1, LAST)] * (numbers > 1)
    assert out == (t_us.tolist(), [numbers if goes_on else 1, 1, 1, 1], lost if goes_on else [("reset", 1, LAST)])


def test_a_restart_needs_three_readings_and_each_further_one_twice_as_many_until_64_have_counted():
    stream, last = begun(), LAST
    for k, needed in enumerate((3, 6, 12, 24, 48, 64, 64, 3)):
        t_us, numbers = 77 + P * np.arange(needed), 10_000 * (k % 6) + np.arange(needed)
        assert told(stream.take(received(t_us[:-1], numbers[:-1]))) == ([], [], [])
        counted, _, troubles = told(stream.take(received(t_us[-1:], numbers[-1:])))
        assert counted == t_us.tolist()
        assert troubles == [("reset", 1, last)]
        last = t_us[-1]


@pytest.mark.parametrize("count", [20, 5])
def test_a_line_may_err_by_seven_tenths_of_a_period(count):
    last = T0 + (count - 1) * P
    for off, counts in ((700, True), (701, False), (-700, True), (-701, False)):
        assert told(begun(count, text=True).take(received([last + P + off]))) == ([last] * counts, [1] * counts, [])


@pytest.mark.parametrize(("gap", "needed"), [(600_000_000, 3), (600_000_001, 8), (0, 8), (1, 3), (-(2**31), 8), (-(2**31) - 1, 8)])
def test_lines_may_be_silent_for_ten_minutes(gap, needed):
    """At another rate, so that none of them follows the line before: three are a gap, eight a restart."""
    stream, t_us = begun(text=True), LAST + gap + 5 * P * np.arange(9)
    assert told(stream.take(received(t_us[: needed - 1]))) == ([], [], [])
    out = told(stream.take(received(t_us[needed - 1 :])) + stream.finish())
    assert [kind for kind, _, _ in out[2]] == ["lost"] * (gap != 1) + ["reset"] * (needed == 8)
    assert out[0] == [LAST] * (gap == 1) + t_us.tolist()
    if gap > P and needed == 3:
        assert (out[1][0], out[2]) == (gap // P, [("lost", gap // P, LAST)])  # the line before the gap does not count


def test_the_period_is_measured_anew_at_16_32_64_and_so_on_up_to_1024_apart():
    """Stamps of which every third is late by 100 us; counted from the first reading on."""
    n = np.arange(3100)
    t_us = T0 + P * n + 100 * (n % 3 == 0)
    stream, at = Continuity(), []
    for k in n.tolist():
        before = stream.period_us
        stream.take(received(t_us[k : k + 1], [k]))
        if stream.period_us != before:
            at.append(k)
            assert stream.period_us == pytest.approx((t_us[k] - t_us[0]) / k, rel=1e-12)
    assert at == [2, 16, 32, 64, 128, 256, 512, 1024, 2048, 3072]
    whole = Continuity()
    whole.take(received(t_us, n))
    assert whole.period_us == stream.period_us


def test_the_last_sixteen_info_frames_are_known():
    """One more number may be of an info frame that was lost."""
    for count, counts in ((17, True), (18, False)):
        stream = begun()
        for k in range(count):
            stream.info(20 + k)
        assert told(stream.take(received([LAST + P], [20 + count]))) == ([LAST + P] * counts, [1] * counts, [])


def test_lines_lost_are_counted_from_the_clock_and_take_the_line_before_along():
    """Three new lines that follow each other show a gap of 5.4 periods: 5, and the doubted line."""
    stream = begun(text=True)
    t_us = LAST + 5400 + P * np.arange(3)
    out = told(stream.take(received(t_us)))
    assert out == (t_us[:2].tolist(), [5, 1], [("lost", 5, LAST)])
    assert told(stream.finish()) == (t_us[2:].tolist(), [1], [])


# The step filter.


BARS = REGISTERS.bars


def accepted(values, damaged=(), periods=None, dtype=np.int16, width=7):
    values = np.asarray(values)
    table = np.zeros((len(values), width), dtype=dtype)
    table[:, 2] = values
    hit = np.isin(np.arange(len(values)), damaged)
    periods = np.ones(len(values), np.int64) if periods is None else np.asarray(periods, np.int64)
    return SampleChunk(1000 * np.arange(len(values), dtype=np.int64), table, damaged=hit, periods=periods)


def passed(out):
    """Values that are passed on, and places of those that are not."""
    values = [v for each in out if isinstance(each, SampleChunk) for v in each.registers[:, 2].tolist()]
    assert all(each.count == 1 for each in out if isinstance(each, Event))
    return values, [each.t_us // 1000 for each in out if isinstance(each, Event)]


def in_parts(whole, cuts, form=REGISTERS):
    """All that a filter says of samples that are divided before these places."""
    step_filter, out = StepFilter(form), []
    for begin, end in pairwise([0, *cuts, len(whole.t_us)]):
        out += step_filter.take(whole.part(begin, end))
    return out + step_filter.finish()


BAR, DOUBT = int(BARS[2]), 1000


@pytest.mark.parametrize(
    ("spike", "behind", "gone"),
    [
        (BAR + 1, 0, True), (BAR, 0, False), (-BAR - 1, 0, True), (-BAR, 0, False),
        (BAR + 100, 100, False),  # back by more than the bar
        (385, 128, True), (384, 128, False),  # neighbours that differ by less than half of the smaller step
        (BAR + 1, -128, True), (BAR + 1, -129, False),
        (BAR + 1, 2 * BAR + 2, False),  # on and on in one direction
    ],
)  # fmt: skip
def test_a_step_out_and_back_beyond_the_bar_is_left_out_after_damage(spike, behind, gone):
    values = [0, 0, spike, behind, behind]
    expected = [v for k, v in enumerate(values) if not (gone and k == 2)], [2] * gone
    for cuts in ([], [3], [1, 2, 3, 4]):
        assert passed(in_parts(accepted(values, damaged=[0]), cuts)) == expected
    assert passed(StepFilter().take(accepted(values))) == (values, [])  # on a good wire it is a knock


@pytest.mark.parametrize(("periods", "bars"), [((2, 4), 3), ((4, 1), 4)])
def test_a_bar_is_for_one_period_and_grows_with_the_periods(periods, bars):
    """Of what steps out and back the mean of both; and the step out has its own: beyond it, or it is not looked at."""
    for spike, gone in ((bars * BAR + 1, True), (bars * BAR, False)):
        whole = accepted([0, 0, spike, 0, 0], damaged=[0], periods=[1, 1, *periods, 1])
        for cuts in ([], [3]):
            assert passed(in_parts(whole, cuts))[1] == [2] * gone


@pytest.mark.parametrize(("place", "gone"), [(300 + DOUBT - 1, True), (300 + DOUBT, False)])
@pytest.mark.parametrize("cuts", [[], [500, 700], [300 + DOUBT]])
def test_a_thousand_samples_are_doubted_from_the_damaged_one_on(place, gone, cuts):
    values = np.zeros(300 + DOUBT + 3, dtype=int)
    values[place] = 5 * BAR
    out = passed(in_parts(accepted(values, damaged=[300]), cuts))
    assert out == (np.delete(values, [place] * gone).tolist(), [place] * gone)


def test_damage_in_the_middle_doubts_what_follows_it_and_not_what_was_before():
    values = np.zeros(60, dtype=int)
    values[[10, 40]] = 5 * BAR
    assert passed(StepFilter().take(accepted(values, damaged=[30])))[1] == [40]
    again = StepFilter()
    assert passed(again.take(accepted(values, damaged=[30, 35])))[1] == [40]
    assert passed(again.take(accepted(values)))[1] == [10, 40]  # 970 more are doubted


def test_two_knocks_and_a_last_sample_that_jumps():
    step_filter = StepFilter()
    out = step_filter.take(accepted([0, 0, 5 * BAR, 5 * BAR, 0, 0, 5 * BAR], damaged=[0]))
    assert passed(out) == ([0, 0, 5 * BAR, 5 * BAR, 0, 0], [])  # two alike are a motion; the last waits
    assert passed(step_filter.finish()) == ([], [6])
    assert step_filter.finish() == []


def test_numbers_in_physical_units_are_filtered_as_numbers():
    form = StreamFormat(("t_s", "gx_dps", "gy_dps", "gz_dps", "ax_g", "ay_g", "az_g"))
    bar = float(form.bars[2])
    for spike, behind, gone in ((1.001, 0, True), (0.999, 0, False), (6, 1.999, True), (6, 2.001, False)):  # 2 is half of 6 - 2
        values = [0.0, 0.25 * bar, (0.25 + spike) * bar, (0.25 + behind) * bar, (0.25 + behind) * bar]
        for cuts in ([], [3]):
            out = in_parts(accepted(values, damaged=[0], dtype=np.float64, width=6), cuts, form)
            values_out, left = passed(out)
            assert left == [2] * gone
            np.testing.assert_array_equal(values_out, [v for k, v in enumerate(values) if not (gone and k == 2)])
            assert all(chunk.registers.dtype == np.float64 for chunk in out if isinstance(chunk, SampleChunk))


def test_a_batch_begins_behind_the_last_of_the_one_before():
    step_filter = StepFilter()
    step_filter.take(accepted([0, 3 * BAR]))
    assert passed(step_filter.take(accepted([0, 3 * BAR, 3 * BAR], damaged=[0])))[1] == [0]
    waiting = StepFilter()
    waiting.take(accepted([0, 0, 5 * BAR], damaged=[0]))
    assert passed(waiting.take(accepted([8 * BAR, 5 * BAR, 5 * BAR])))[1] == [0]
