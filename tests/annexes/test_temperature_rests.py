"""Fit of rest logs beside the zero: Allan deviation without temperature or knocks, and the noise over temperature, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from small_rests import small_rest, triangle

from session.io.errors import DataError
from session.io.samples import Samples
from tinygc.annexes.temperature.axis_fit import fit_axis, make_knots
from tinygc.annexes.temperature.rest_fit import (
    ShortTimes,
    fit_rests,
    long_times,
    noise_over_temperature,
    residual_blocks,
    whole_curve,
    zero_of_blocks,
)
from tinygc.annexes.temperature.sweeps import sweeps_of
from tinygc.closure.floor import AllanCurve, AllanSums, averaging_factors, curve_of

RATE_HZ = 8.0
#: averaging times up to two seconds, two an octave
FACTORS = averaging_factors(32, 2)


def samples(seed=0, count=4300, gap=None, rate_hz=RATE_HZ):
    rng = np.random.default_rng(seed)
    t_s = np.arange(count) / rate_hz
    t_s = np.where(t_s > gap, t_s + 1.0, t_s) if gap else t_s
    ramp = (t_s / 500)[:, None] * [10.0, -20, 30] + 5 * (t_s / 500)[:, None] ** 2
    return Samples(np.rint(t_s * 1e9).astype(np.int64), ramp + 0.1 * rng.normal(size=(count, 3)), np.zeros((count, 3)), None)


def less_parabola(rates):
    x = np.arange(len(rates))
    return rates - np.column_stack([np.polyval(np.polyfit(x, axis, 2), x) for axis in rates.T])


def test_short_times_are_pooled_over_chunks_less_their_parabolas():
    """Chunks of 2048 samples, cut at a gap; those that hold a block that was left out count for nothing."""
    whole, short = samples(gap=300.13), ShortTimes()
    short(whole)
    cut = int(np.flatnonzero(np.diff(whole.t_s) > 0.5)[0]) + 1
    pairs = [(0, 2048), (2048, cut), (cut, 4300)]
    chunks = [less_parabola(whole.gyro[a:b]) for a, b in pairs]
    log = small_rest(np.zeros(538), block_s=1.0)
    found = short.curve(log, np.zeros(538, dtype=bool))
    expected = curve_of([AllanSums.of(chunk, FACTORS) for chunk in chunks], 1 / RATE_HZ, 538.0)
    for name in ("tau_s", "deviation", "freedom"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-6)
    assert found.longest_s == 538
    # The first chunk ends at 255.9 s: block 255 is half in it and half in the next.
    for block, struck in ((254, [0]), (255, [0, 1]), (256, [1]), (300, [1]), (301, [2]), (537, [2])):
        kept = [AllanSums.of(chunk, FACTORS) for k, chunk in enumerate(chunks) if k not in struck]
        expected = curve_of(kept, 1 / RATE_HZ, 538.0)
        assert short.curve(log, np.arange(538) == block).deviation == pytest.approx(expected.deviation, rel=1e-6)
    assert short.curve(log, np.ones(538, dtype=bool)) is None


def test_a_chunk_holds_four_of_the_longest_averaging_time():
    factors, whole, short = averaging_factors(3200, 2), samples(count=7000, rate_hz=800.0), ShortTimes()
    short(whole)
    edge = 4 * factors[-1]
    expected = curve_of([AllanSums.of(less_parabola(part), factors) for part in np.split(whole.gyro, [edge])], 1 / 800, 9.0)
    found = short.curve(small_rest(np.zeros(9), block_s=1.0), np.zeros(9, dtype=bool))
    np.testing.assert_allclose(found.deviation, expected.deviation, rtol=1e-6)


def test_pieces_of_a_log_begin_where_they_are():
    """The moment of a chunk counts from the log's first sample, in every piece; a handful of samples tells nothing."""
    whole, log = samples(), small_rest(np.zeros(538), block_s=1.0)
    for stop, count in ((4060, 2), (4061, 3)):  # of a chunk of seven, or eight
        short = ShortTimes()
        for a, b in ((0, 5), (5, 2005), (2005, stop)):
            short(whole.between(a, b))
        pieces = [AllanSums.of(less_parabola(whole.gyro[a:b]), FACTORS) for a, b in ((5, 2005), (2005, 4053), (4053, 4061))[:count]]
        found = short.curve(log, np.zeros(538, dtype=bool))
        assert found.deviation == pytest.approx(curve_of(pieces, 1 / RATE_HZ, 538.0).deviation, rel=1e-9)
    late = short.curve(log, np.arange(538) > 260)
    assert late.deviation == pytest.approx(curve_of(pieces[:1], 1 / RATE_HZ, 538.0).deviation, rel=1e-6)


def test_long_times_are_pooled_over_pieces_without_gaps():
    number = np.concatenate([np.arange(20), np.arange(21, 24), np.arange(30, 46)])
    one, two = small_rest(np.zeros(39), number=number), small_rest(np.zeros(9))
    residual = np.random.default_rng(0).normal(size=(48, 3))
    factors = averaging_factors(20, 2)
    pieces = [AllanSums.of(part, factors) for part in (residual[:20], residual[23:39], residual[39:])]
    found, expected = long_times([one, two], residual), curve_of(pieces, 10.0, 200.0)
    assert found.tau_s == pytest.approx(expected.tau_s)
    assert found.deviation == pytest.approx(expected.deviation)
    assert found.longest_s == 200
    three, four = (small_rest(np.zeros(k)) for k in (3, 4))
    assert long_times([three], residual[:3]) is None
    assert long_times([four], residual[:4]) is not None


def test_the_whole_curve_is_the_short_times_and_then_the_long():
    short = AllanCurve(np.array([1.0, 2.0]), np.ones((2, 3)), np.ones(2), 5.0)
    long = AllanCurve(np.array([2.0, 4.0]), np.full((2, 3), 2.0), np.ones(2), 9.0)
    assert whole_curve([short], long).tau_s.tolist() == [1, 2, 4]
    assert whole_curve([short, long], None) is short
    assert whole_curve([], long) is long
    assert whole_curve([], None) is None


def test_noise_over_temperature_is_a_regression_of_the_scatter():
    """Half the relative slope of the variance; neighbours that are alike widen its sigma; eight bins of the range."""
    rng, temp = np.random.default_rng(1), np.linspace(10, 42, 200)
    sd = np.sqrt((1 + 0.02 * (temp - 26))[:, None] * rng.chisquare(30, (200, 3)) / 30)
    sd[:, 1] *= 1 + 0.3 * np.sin(np.arange(200) / 9)
    sd[:, 2] = 1 + 0.3 * np.sin(np.arange(200) / 9)  # neighbours are more alike than counts
    half = 120
    found = noise_over_temperature([small_rest(temp[:half], sd=sd[:half]), small_rest(temp[half:], sd=sd[half:])])
    for axis in range(3):
        level = sd[:, axis] ** 2 / np.mean(sd[:, axis] ** 2) / 2
        slope, level_at = np.polyfit(temp, level, 1)
        left = level - level_at - slope * temp
        alike = 1 + 2 * np.clip(np.mean(left[1:] * left[:-1]) / np.mean(left**2), 0, 0.95)
        assert found.per_c[axis] == pytest.approx(slope)
        assert found.sigma[axis] == pytest.approx(np.sqrt(np.mean(left**2) / (200 * np.var(temp)) * alike))
    where = np.minimum(np.floor((temp - 10) / 4).astype(int), 7)
    assert found.at_c == pytest.approx([temp[where == k].mean() for k in range(8)])
    assert found.rms == pytest.approx(np.array([np.sqrt(np.mean(sd[where == k] ** 2, axis=0)) for k in range(8)]))
    # A bin of fewer than ten blocks is left out.
    few = np.concatenate([temp, np.full(9, 80.0)])
    assert len(noise_over_temperature([small_rest(few)]).at_c) == 4
    assert len(noise_over_temperature([small_rest(np.append(few, 80.0))]).at_c) == 5
    for bare in (small_rest(np.linspace(10, 10.9, 50)), small_rest(temp, sd=np.zeros((200, 3))), small_rest(np.full(50, np.nan))):
        assert noise_over_temperature([bare]) is None
    assert noise_over_temperature([small_rest(np.linspace(10, 11.0, 100))]) is not None
    assert noise_over_temperature([small_rest(temp, sd=sd * [1, 0, 1])]) is None


def test_what_is_left_of_blocks_has_no_zero_in_any_log():
    temp = triangle(24, 12)
    logs = [small_rest(temp, np.arange(24.0)), small_rest(temp + 5, np.arange(24.0) ** 2)]
    knots = make_knots(logs, [each for k, log in enumerate(logs) for each in sweeps_of(log.temp_c, k)])
    flat = fit_axis(knots, np.concatenate([log.gyro[:, 0] for log in logs]), orders=(0,))
    assert zero_of_blocks(knots, flat).tolist() == [flat.terms[0]] * 48
    assert zero_of_blocks(make_knots([small_rest([np.nan] * 4)], []), flat).tolist() == [flat.terms[0]] * 4
    element = knots.element_c(15.0) - knots.reference_c
    for square in (0.0, 0.5):
        fit = replace(flat, terms=np.array([1.0, 2.0, square][: 2 + (square > 0)]), tau_s=15.0)
        assert zero_of_blocks(knots, fit) == pytest.approx(1 + 2 * element + square * element**2)
    left = np.concatenate([log.gyro[:, 1] for log in logs]) - zero_of_blocks(knots, fit)
    expected = np.concatenate([left[:24] - left[:24].mean(), left[24:] - left[24:].mean()])
    assert residual_blocks(knots, "gyro", 1, fit) == pytest.approx(expected)


def test_rest_logs_are_fitted_axis_by_axis_without_their_knocks():
    rng, temp = np.random.default_rng(2), triangle(48, 12)
    zero = np.array([0.5, -0.3, 0.6]) + np.outer(temp - 20, [0.03, 0, -0.02]) + 1e-3 * rng.normal(size=(48, 3))
    sd = np.where(np.arange(48)[:, None] == 30, 1.0, 1e-3) * (1 + 0.1 * rng.random((48, 3)))
    zero[30] += 0.2
    log = small_rest(temp, zero, sd=sd)
    found = fit_rests([(log, None)], orders=(0, 1))
    (kept,) = found.knots.logs
    assert set(range(48)) - set(kept.number) >= {30}
    assert [each.direction for each in found.sweeps] == [1, -1, 1, -1]
    assert [fit.order for fit in found.gyro] == [1, 0, 1]
    assert len(found.accel) == 3
    for axis, fit in enumerate(found.gyro):
        alone = fit_axis(found.knots, kept.gyro[:, axis], (0, 1))
        assert fit.terms.tolist() == alone.terms.tolist()
        force = fit_axis(found.knots, kept.accel[:, axis], (0, 1))
        assert found.accel[axis].terms.tolist() == force.terms.tolist()
    residual = np.column_stack([residual_blocks(found.knots, "gyro", axis, fit) for axis, fit in enumerate(found.gyro)])
    np.testing.assert_array_equal(found.allan.deviation, long_times([kept], residual).deviation)
    assert found.range_c == (kept.temp_c.min(), kept.temp_c.max())
    assert found.noise.per_c == pytest.approx(noise_over_temperature([kept]).per_c)
    bare = fit_rests([(replace(log, temp_c=np.full(48, np.nan)), None)], with_accel=False)
    assert [fit.order for fit in bare.gyro] == [0, 0, 0]
    assert (bare.noise, bare.accel) == (None, ())
    with pytest.raises(DataError, match=r"b.csv has no temperature, and other rest logs have"):
        fit_rests([(log, None), (small_rest([np.nan] * 48, name="b.csv"), None)])
