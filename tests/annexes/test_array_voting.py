"""The vote of an array, number by number: each limit one step below and above, each count, each mean and each sigma by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest, norm
from simulated_array import model_of, units

from session.detect.events import FULL_SCALE_ROUNDING
from session.io.units import DEG
from tinygc.annexes.arrays.model import Disagreement
from tinygc.annexes.arrays.voting import (
    BETWEEN_TWO,
    BLOCK,
    DEAD,
    DIFFERS,
    IN,
    REASONS,
    STUCK,
    Change,
    LiveArray,
    Means,
    Seen,
    Tables,
    VotingState,
    combine,
    look,
    means,
    settle,
)

#: the next number above 1, and the one below
ABOVE, BELOW = np.nextafter(1.0, 2.0), np.nextafter(1.0, 0.0)
MODELS = {count: model_of(units(count)) for count in (2, 3, 4)}


def tables(count=3, **changed) -> Tables:
    """Equal perfect units: unit variance of a sample, means over 16 samples; dead after 3, stuck after 5 and back after 4 samples."""
    eye = np.broadcast_to(np.eye(3), (count, 3, 3))
    ones = np.ones((count, 3))
    plain = Tables(
        eye, 0 * ones, eye / count, np.full(count, 1 / count), ones, 0 * ones, eye / count**2, np.zeros(3), np.full(count, np.inf),
        0.0, 0.0, 1 / 16, 3, 5, 4,
    )  # fmt: skip
    return replace(plain, **changed)


def live(table: Tables, vote: bool = True) -> LiveArray:
    found = LiveArray(MODELS[len(table.share)], vote=vote)
    found.tables = table
    return found


def readings(*units_x, seed: int = 0) -> np.ndarray:
    """(T, N, 3): values along x of each unit; y and z tell samples apart by 1e-9."""
    x = np.stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(each, dtype=float)) for each in units_x)), axis=1)
    raw = 1e-9 * np.random.default_rng(seed).normal(size=(*x.shape, 3))
    raw[..., 0] = x
    return raw


def start(count=3, **changed) -> VotingState:
    return replace(VotingState.start(count), **changed)


# Tables.


def two_by_hand(density, **options):
    """The model of two units with E = 1 and no mounting."""
    found = units(2, density=density, full_scale=250)
    found = [
        replace(u, place=replace(u.place, mounting=np.eye(3)), model=replace(u.model, E=np.eye(3)), bias_instability=None) for u in found
    ]
    return model_of(found, **options)


def test_tables_are_those_of_two_unequal_units_by_hand():
    """Densities 0.1 and 0.2 at 50 Hz: variances 0.25 and 1 a sample, weights 0.8 and 0.2, 0.2 of the combination."""
    model = replace(two_by_hand([0.1, 0.2]), rate_hz=50.0, disagreement=Disagreement(bias_rps=0.5, scale=0.03, delay_s=0.004))
    covariance, wander = np.diag([1e-4] * 9 + [0.01, 0.04, 0.09]), np.array([0.1, 0.2, 0.3])
    model = replace(model, units=tuple(replace(unit, bias_instability=wander, covariance=covariance) for unit in model.units))
    table = Tables.of(model)
    np.testing.assert_allclose(table.weights, np.array([0.8, 0.2])[:, None, None] * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(table.share, np.array([0.75, 0.2]) / 0.95)  # at most 1.5 times the median, 0.5
    np.testing.assert_allclose(table.spread, np.array([0.64 * 0.25, 0.04])[:, None, None] * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(table.noise, np.array([[0.25], [1.0]]) + np.pi / 2 * 0.2 * np.ones(3))
    B = np.array([unit.model.B for unit in model.units])
    at_rest = np.array([0.01, 0.04, 0.09]) + 1e-4 * np.square(B).sum(axis=1)[:, None]  # at rest, E turns a reading of -B
    np.testing.assert_allclose(table.fixed, 0.25 + wander**2 + at_rest)
    np.testing.assert_allclose(table.own, np.array([0.64, 0.04]) @ at_rest)
    assert table.scale2 == pytest.approx(9e-4)
    assert table.delay2 == pytest.approx(0.04)  # a fifth of a period, squared
    np.testing.assert_allclose(table.end, (1 - FULL_SCALE_ROUNDING) * 250 * DEG)
    np.testing.assert_array_equal(table.offset, B)
    np.testing.assert_array_equal(table.matrix, [np.eye(3)] * 2)


def test_where_no_parameters_covariance_is_known_the_sigma_is_of_noise_alone():
    model = model_of([replace(unit, covariance=None) for unit in units(2)])
    np.testing.assert_array_equal(Tables.of(model).own, np.zeros(3))


def test_units_parts_of_correlated_noise_add_up_to_that_of_the_combination():
    """Variances 0.5 and 2 of a sample, covariance 0.3: each part is larger by one factor."""
    model = two_by_hand([0.1, 0.2], correlation=np.kron(np.array([[1, 0.3], [0.3, 1]]), np.eye(3)))
    W = model.weights[:, 0, 0]
    alone, whole = W**2 * [0.5, 2.0], W @ [[0.5, 0.3], [0.3, 2.0]] @ W
    assert model.correlation is not None
    np.testing.assert_allclose(Tables.of(model).spread, (alone * whole / alone.sum())[:, None, None] * np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("rate_hz", "expected"),
    [
        (100, (1 / 50, 10, 50, 100)),
        (32, (1 / 16, 3, 16, 32)),
        (31, (1 / 16, 3, 16, 31)),
        (33, (2 / 33, 3, 16, 33)),
        (15, (1 / 16, 2, 8, 15)),
        (3, (1 / 16, 2, 4, 4)),
    ],
)
def test_times_become_whole_samples_with_a_least_number_of_each(rate_hz, expected):
    table = Tables.of(replace(MODELS[2], rate_hz=float(rate_hz)))
    assert (table.alpha, table.dead, table.stuck, table.hold) == pytest.approx(expected)


def test_a_running_mean_of_white_noise_has_the_stated_share_of_its_variance():
    """The sum of alpha^2 (1 - alpha)^2k."""
    for alpha in (1 / 16, 1 / 50):
        assert tables(alpha=alpha).share_of_noise == pytest.approx(np.sum((alpha * (1 - alpha) ** np.arange(2000)) ** 2))


# One sample: who is usable, the median, the allowance.


def test_six_sigmas_from_the_median_a_sample_is_used_and_beyond_it_is_not():
    raw = readings(0, 0, [6.0, 6.0 * ABOVE, -6.0, -6.0 * ABOVE])
    raw[..., 1:] = 0
    seen = look(tables(), start(), raw, True)
    np.testing.assert_array_equal(seen.used[:, 2], [True, False, True, False])
    assert seen.used[:, :2].all()
    assert seen.u[0, 2] == 36
    assert seen.usable.all()  # it is compared all the same
    assert look(tables(), start(), raw, False).used.all()
    assert look(tables(2), start(2), raw[:, 1:] * 4, True).used.all()  # of two nobody can say which one is off


def test_of_four_units_the_third_that_is_believed_and_usable_makes_a_vote():
    raw = readings(0, 0, 50, 0)
    assert not look(tables(4), start(4, why=np.array([IN, IN, IN, DEAD])), raw, True).used[0, 2]
    assert look(tables(4), start(4, why=np.array([DEAD, IN, IN, DIFFERS])), raw, True).used[0, 2]


def test_where_all_are_off_all_are_used():
    seen = look(tables(4), start(4), readings(-50, -50, 50, 50), True)
    assert seen.used.all()


def test_the_allowance_is_the_sum_of_noise_constants_scale_and_delay():
    """Median (3, 4, 0): 25; it had moved by (1, 2, 0) and moves by (2, 0, 0) after: the greater change, 5, counts, then 4."""
    table = tables(noise=np.full((3, 3), 2.0), fixed=np.full((3, 3), 3.0), scale2=0.1, delay2=0.2)
    raw = np.zeros((2, 3, 3))
    raw[0], raw[1] = [3.0, 4.0, 0.0], [5.0, 4.0, 0.0]
    raw[:, 2] += [0.5, -2.0, 1.0]
    seen = look(table, start(middle=np.array([2.0, 2.0, 0.0]), change2=0.5), raw, True)
    np.testing.assert_allclose(seen.middle, raw[:, 0])
    np.testing.assert_allclose(seen.change2, [5.0, 4.0])
    np.testing.assert_allclose(seen.allowed, [2.5 + 1.0, 4.1 + 1.0])
    np.testing.assert_allclose(seen.apart[:, 2], [[0.5, -2.0, 1.0]] * 2)
    np.testing.assert_allclose(seen.u[:, 2], 4.0 / np.array([5 + 3.5, 5 + 5.1]))  # the greatest of the axes
    assert look(table, start(middle=np.array([2.0, 2.0, 0.0]), change2=9.0), raw, True).allowed[0] == pytest.approx(2.5 + 1.8)


def test_calibration_is_matrix_and_offset_of_each_unit():
    matrix = np.stack([np.diag([1.0, 2.0, 3.0]), [[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]], np.eye(3)])
    offset = np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
    seen = look(tables(matrix=matrix, offset=offset), start(), np.array([[[1.0, 1, 1], [1, 2, 3], [1, 2, 3]]]), True)
    np.testing.assert_allclose(seen.calibrated[0], [[1.1, 2, 3], [2, -0.8, 3], [1, 2, 3.3]])


def test_at_its_end_and_beyond_a_reading_is_not_usable():
    raw = readings(0, 0, [2 * BELOW, 2.0, -2 * BELOW, -2.0, 3.0])
    seen = look(tables(end=np.array([9.0, 9.0, 2.0])), start(), raw, True)
    np.testing.assert_array_equal(seen.usable[:, 2], [True, False, True, False, False])
    np.testing.assert_array_equal(seen.used[:, 2], seen.usable[:, 2])
    np.testing.assert_array_equal(np.isnan(seen.u[:, 2]), ~seen.usable[:, 2])
    assert not seen.at_end.any()
    assert seen.missing.max() == 0


def test_where_all_read_their_end_those_that_are_believed_are_used_and_the_sigma_is_infinite():
    raw = readings([5.0, 0], [5.0, 0], [5.0, 0])
    seen = look(tables(end=np.full(3, 5.0)), start(why=np.array([IN, DEAD, IN])), raw, True)
    np.testing.assert_array_equal(seen.at_end, [True, False])
    np.testing.assert_array_equal(seen.used[0], [True, False, True])
    fused = live(tables(end=np.full(3, 5.0)))(raw)
    assert np.isinf(fused.sigma[0]).all()
    assert np.isfinite(fused.sigma[1]).all()
    np.testing.assert_allclose(fused.rate[0], [5.0, 0, 0], atol=1e-8)


def test_no_reading_of_any_unit_gives_none_and_keeps_the_median():
    raw = readings([1.0, np.nan, 4.0], [1.0, np.nan, 4.0], [1.0, np.nan, 4.0])
    seen = look(tables(), start(), raw, True)
    np.testing.assert_allclose(seen.middle[:, 0], [1, 1, 4])
    np.testing.assert_allclose(seen.change2, [0, 0, 9], atol=1e-6)  # the first has none before it
    assert not seen.at_end.any()
    assert not seen.used[1].any()
    assert np.isnan(live(tables())(raw).rate[1]).all()


def test_units_that_are_out_have_no_part_in_the_median_nor_in_the_rate_but_are_compared():
    state, raw = start(4, why=np.array([DIFFERS, IN, IN, IN])), readings(9, 1, 1, 2)
    seen = look(tables(4), state, raw, True)
    assert seen.middle[0, 0] == 1  # of all four, 1.5
    np.testing.assert_array_equal(seen.used[0], [False, True, True, True])
    assert seen.usable.all()
    assert seen.apart[0, 0, 0] == 8
    assert look(tables(4), state, raw, False).used.all()
    clipped = look(tables(4, end=np.array([99.0, 99, 99, 2])), state, raw, False)
    np.testing.assert_array_equal(clipped.used[0], [True, True, True, False])  # but not what reads its end


def test_samples_without_reading_and_with_the_same_one_are_counted_in_a_row():
    x = [1.0, 1.0, 1.0, 2.0, np.nan, np.nan, 2.0, 2.0, 7.0, 7.0]
    raw = readings(0, 0, x)
    raw[:, 2, 1:] = 0
    raw[2, 2, 1] = 1e-3  # another on one axis alone is another
    seen = look(tables(end=np.array([9.0, 9.0, 7.0])), start(missing=np.array([0, 0, 5]), same=np.array([2, 0, 3]), last=raw[0]), raw, True)
    np.testing.assert_array_equal(seen.same[:, 2], [4, 5, 0, 0, 0, 0, 0, 1, 0, 0])  # of one end of the range none is told
    np.testing.assert_array_equal(seen.missing[:, 2], [0, 0, 0, 0, 1, 2, 0, 0, 0, 0])
    np.testing.assert_array_equal(seen.same[:, 0], [3, *[0] * 9])
    nothing = look(tables(), start(missing=np.array([0, 0, 5])), readings(0, 0, [np.nan, np.nan]), True)
    np.testing.assert_array_equal(nothing.missing[:, 2], [6, 7])


def test_what_two_disagree_by_is_told_of_the_worse_one():
    raw = readings([1.0, 1.0], [4.0, np.nan])
    raw[0, 1, 1] = -7
    table, state = tables(2, share=np.array([0.75, 0.25])), start(2, disagree=True)
    seen = look(table, state, raw, True)
    np.testing.assert_allclose(seen.disagreement[0], np.abs(seen.apart[0]).max(axis=0))
    assert seen.disagreement[0, 1] > 3.5
    np.testing.assert_allclose(seen.disagreement[1], 0, atol=1e-8)  # one alone has nobody to disagree with
    assert look(table, state, raw, False).disagreement is None
    assert look(table, start(2), raw, True).disagreement is None


# False alarms.


def test_the_share_of_good_samples_that_is_set_aside_is_the_normal_distributions():
    """Of a unit three times as noisy as stated, beside two without noise: beyond two true sigmas on one of three axes at least."""
    draws, rng = 50_000, np.random.default_rng(1)
    raw = np.zeros((draws, 3, 3))
    raw[:, 2] = 3 * rng.normal(size=(draws, 3))
    expected = 1 - (1 - 2 * norm.sf(2.0)) ** 3
    assert (~look(tables(), start(), raw, True).used[:, 2]).mean() == pytest.approx(expected, abs=5 * np.sqrt(0.11 / draws))


def test_mean_difference_of_good_units_follows_the_normal_and_mean_square_its_mean():
    """500 noisy units beside 501 that agree: the median is zero; 150 samples are many times the memory of 16."""
    noisy, good, rng = 500, 501, np.random.default_rng(2)
    raw = np.zeros((150, noisy + good, 3))
    raw[:, :noisy, 0] = rng.normal(size=(150, noisy))
    table = tables(noisy + good)
    found = means(table, start(noisy + good), look(table, start(noisy + good), raw, True))
    last = found.mean[-1, :noisy, 0] / np.sqrt(table.share_of_noise)
    assert kstest(last, norm.cdf).pvalue > 1e-3
    mean, variance = 1.0, 2.0 * table.share_of_noise  # of a squared normal and its running mean
    assert found.square[-1, :noisy].mean() == pytest.approx(mean, abs=5 * np.sqrt(variance / noisy))
    assert found.square[-1, :noisy].var() == pytest.approx(variance, rel=0.25)
    assert np.mean(found.score[-1, :noisy] < chi2.isf(0.5, 1) / 36) < 0.5


# Running means.


def seen_of(apart, u=None, usable=None, allowed=0.0, **more) -> Seen:
    """What ``look`` would tell of differences (T, N, 3)."""
    apart = np.asarray(apart, dtype=float)
    T, N, _ = apart.shape
    whole, usable = np.zeros((T, N), dtype=int), np.ones((T, N), dtype=bool) if usable is None else np.asarray(usable)
    u = np.where(usable, np.square(apart).max(axis=2) if u is None else u, np.nan)
    plain = Seen(
        apart, apart, usable, usable, np.zeros(T, dtype=bool), np.zeros((T, 3)), np.zeros(T), apart, np.broadcast_to(allowed, T), u, whole,
        whole, None,
    )  # fmt: skip
    return replace(plain, **more)


def test_means_move_by_a_sixteenth_of_what_is_new_and_are_held_without_a_reading():
    apart = np.array([[[1.6, -3.2, 0.0]], [[np.nan] * 3], [[-1.6, 1.6, 4.8]]])
    usable = np.array([[True], [False], [True]])
    before = start(1, mean=np.array([[0.16, 0.0, 0.32]]), allowed=np.array([0.8]), square=np.array([1.6]))
    found = means(tables(1), before, seen_of(apart, [[3.2], [0], [1.6]], usable, allowed=[1.6, 9.0, 3.2]))
    np.testing.assert_allclose(found.mean[:2, 0], [[0.25, -0.2, 0.3]] * 2)
    np.testing.assert_allclose(found.mean[2, 0], [0.234375 - 0.1, -0.1875 + 0.1, 0.28125 + 0.3])
    np.testing.assert_allclose(found.allowed[:, 0], [0.85, 0.85, 0.796875 + 0.2])
    np.testing.assert_allclose(found.square[:, 0], [1.7, 1.7, 1.59375 + 0.1])
    silent = means(tables(1), before, seen_of(apart, usable=[[False]] * 3))
    np.testing.assert_array_equal(silent.mean, np.repeat(before.mean[None], 3, axis=0))
    np.testing.assert_array_equal(silent.square[:, 0], [1.6] * 3)


@pytest.mark.parametrize(("u", "square", "share"), [(36.0, 36.0, 1.0), (72.0, 36.0, 0.5), (3600.0, 36.0, 0.01), (0.0, 0.0, 1.0)])
def test_a_reading_beyond_the_limit_counts_as_the_limit_and_less_in_the_mean(u, square, share):
    found = means(tables(1), start(1), seen_of([[[16.0, -32.0, 0]]], [[u]]))
    assert found.square[0, 0] == square / 16
    np.testing.assert_allclose(found.mean[0, 0], share * np.array([1.0, -2.0, 0]))


def test_the_score_is_the_greater_of_mean_and_mean_square_over_their_limits():
    """Variance of the mean: noise / 31 + constants + allowance; six of its roots, and nine mean squares, are 1."""
    table = tables(1, noise=np.array([[31.0, 62.0, 93.0]]), fixed=np.array([[0.5, 1.0, 1.5]]))
    mean = np.array([[1.0, 3.0, 3.1]])
    held = seen_of([[[0.0, 0, 0]]], usable=[[False]])
    found = means(table, start(1, mean=mean, allowed=np.array([0.5]), square=np.array([0.6])), held)
    assert found.score[0, 0] == pytest.approx(9 / (2 + 1 + 0.5) / 36)
    found = means(table, start(1, mean=mean / 9, allowed=np.array([0.5]), square=np.array([0.9])), held)
    assert found.score[0, 0] == pytest.approx(0.1)


# Changes of a unit's status.


def scores(*rows) -> Means:
    """Running means with these scores (T, N)."""
    score = np.array(rows, dtype=float)
    return Means(np.zeros((*score.shape, 3)), np.zeros(score.shape), np.zeros(score.shape), score)


def settled(score, state=None, table=None, **seen):
    score = np.atleast_2d(np.asarray(score, dtype=float))
    T, N = score.shape
    apart = np.zeros((T, N, 3))
    return settle(table or tables(N), state or start(N), seen_of(apart, **seen), scores(*score))


def test_at_the_limit_a_unit_is_in_and_beyond_it_out():
    assert settled([0, 0, 1.0])[2] == []
    taken, behind, told = settled([[0, 0, 1.0], [0, 0, ABOVE], [0, 0, 0]])
    assert (taken, told) == (2, [Change(2, "out", DIFFERS)])
    np.testing.assert_array_equal(behind.why, [IN, IN, DIFFERS])
    assert not behind.disagree


def test_one_unit_at_a_time_is_voted_out_the_worst():
    assert settled([1.5, 0, 2.5, 0, 0])[2] == [Change(2, "out", DIFFERS)]


def test_it_takes_three_units_to_vote_one_out():
    usable = [[True, True, True, False]]
    assert settled([0, 0, 2, 0], usable=usable)[2] == [Change(2, "out", DIFFERS)]
    assert settled([0, 0, 2, 0], start(4, why=np.array([DEAD, IN, IN, IN])), usable=usable)[2] == [Change(None, "disagree", DIFFERS)]
    assert settled([0, 0, 2, 0], start(4, why=np.array([DEAD, DEAD, IN, IN])), usable=usable)[2] == []
    assert settled([0, 0, 2, 9], usable=usable)[2] == [Change(2, "out", DIFFERS)]  # what gives no reading is not blamed


@pytest.mark.parametrize(("same", "reason"), [(3, DIFFERS), (4, STUCK)])
def test_one_that_differs_with_four_readings_alike_is_stuck(same, reason):
    assert settled([0, 2, 0], same=np.array([[0, same, 0]]))[2] == [Change(1, "out", reason)]


@pytest.mark.parametrize(("what", "limit", "reason"), [("missing", 3, DEAD), ("same", 5, STUCK)])
def test_a_unit_is_dead_or_stuck_at_its_number_of_samples(what, limit, reason):
    counts = np.array([[0, n, 0] for n in range(1, limit + 1)])
    usable = np.ones(counts.shape, dtype=bool)
    usable[:, 1] = what == "same"
    assert settled(np.zeros((limit - 1, 3)), usable=usable[:-1], **{what: counts[:-1]})[2] == []
    taken, behind, told = settled(np.zeros(counts.shape), usable=usable, **{what: counts})
    assert (taken, told) == (limit, [Change(1, "out", reason)])
    np.testing.assert_array_equal(getattr(behind, what), [0, limit, 0])
    assert settled(np.zeros((1, 3)), behind, usable=usable[-1:], **{what: counts[-1:]})[2] == []  # told once


def test_one_fails_while_another_is_voted_out_and_a_third_is_back():
    missing = np.array([[0, 3, 0, 0, 0, 0]])
    state = start(6, why=np.array([IN, IN, IN, DIFFERS, IN, IN]), agreed=np.array([9, 9, 9, 3, 9, 9]))
    usable = missing == 0
    _, behind, told = settled([0, 7, 2, 0, 0, 0], state, missing=missing, usable=usable)
    assert told == [Change(1, "out", DEAD), Change(3, "in", IN), Change(2, "out", DIFFERS)]
    np.testing.assert_array_equal(behind.why, [IN, DEAD, DIFFERS, IN, IN, IN])
    np.testing.assert_array_equal(behind.agreed, [10, 0, 0, 0, 10, 10])


def test_a_stuck_unit_that_differs_is_told_once():
    _, behind, told = settled([0, 2, 0], same=np.array([[0, 5, 0]]))
    assert told == [Change(1, "out", STUCK)]
    assert behind.why[1] == STUCK


def test_it_is_back_after_its_number_of_samples_below_half_the_limit():
    out = start(why=np.array([IN, DIFFERS, IN]))
    rows = np.zeros((4, 3))
    rows[:, 1] = 0.5 * BELOW
    taken, behind, told = settled(rows, out)
    assert (taken, told) == (4, [Change(1, "in", IN)])
    assert not behind.why.any()
    assert settled(rows[:3], out)[2] == []
    rows[1, 1] = 0.5  # at half the limit it does not agree
    taken, behind, told = settled(rows, out)
    assert (taken, told) == (4, [])
    assert behind.agreed[1] == 2


def test_a_short_gap_does_not_begin_its_wait_again_but_a_long_one_does():
    out = start(why=np.array([IN, DIFFERS, IN]), agreed=np.array([0, 2, 0]))
    usable = np.array([[True, False, True]] * 4)
    missing = np.array([[0, n, 0] for n in (1, 2, 3, 4)])
    assert settled(np.zeros((2, 3)), out, usable=usable[:2], missing=missing[:2])[1].agreed[1] == 2
    assert settled(np.zeros((3, 3)), out, usable=usable[:3], missing=missing[:3])[1].agreed[1] == 0
    stuck = settled(np.zeros((2, 3)), out, same=np.array([[0, 4, 0], [0, 5, 0]]))[1]
    assert stuck.agreed[1] == 0


def test_two_that_differ_disagree_until_both_are_below_half():
    assert settled([0, 1.0])[2] == []
    taken, behind, told = settled([0, ABOVE])
    assert told == [Change(None, "disagree", DIFFERS)]
    assert behind.disagree
    assert not behind.why.any()
    assert settled([0.5, 0.4], behind)[2] == []
    taken, again, told = settled([[2.0, 2.0], [0.5 * BELOW, 0.4]], behind)
    assert (taken, told) == (2, [Change(None, "agree", DIFFERS)])
    assert not again.disagree
    # a third that is back ends it as well, and one that is out has no say
    three = start(3, disagree=True)
    assert settled([9.0, 9.0, 0.0], three)[2] == [Change(0, "out", DIFFERS), Change(None, "agree", DIFFERS)]
    assert settled([0, 0, 9.0], start(3, disagree=True, why=np.array([IN, IN, DIFFERS])))[2] == [Change(None, "agree", DIFFERS)]


def test_without_a_change_all_samples_are_taken_and_the_state_is_the_last_ones():
    seen = seen_of(np.zeros((3, 2, 3)), raw=np.arange(18.0).reshape(3, 2, 3), middle=np.arange(9.0).reshape(3, 3), change2=np.arange(3.0))
    running = scores(*np.zeros((3, 2)))
    running = replace(running, mean=running.mean + 1, allowed=running.allowed + 2, square=running.square + 3)
    taken, behind, told = settle(tables(2), start(2), seen, running)
    assert (taken, told) == (3, [])
    np.testing.assert_array_equal(behind.last, seen.raw[-1])
    np.testing.assert_array_equal(behind.middle, [6, 7, 8])
    assert behind.change2 == 2
    assert (behind.mean == 1).all()
    assert (behind.allowed == 2).all()
    assert (behind.square == 3).all()
    np.testing.assert_array_equal(behind.agreed, [3, 3])


# A change's size and bar.


def test_size_and_bar_of_a_slow_difference_are_of_its_worst_axis():
    table = tables(2, noise=np.array([[31.0, 31.0, 31.0], [31.0, 62.0, 31.0]]), fixed=np.full((2, 3), 0.5))
    running = Means(np.array([[[0, 0, 0], [9.0, -13.5, 0]]]), np.array([[0.0, 1.5]]), np.array([[0.0, 4.0]]), np.array([[0.0, 2.0]]))
    seen = seen_of(np.zeros((1, 2, 3)), allowed=0.25)
    # variances 3, 4, 3: squares over them 27, 45.6
    for unit in (1, None):
        size, bar = running.size(table, seen, unit, 0)
        assert (size, bar) == pytest.approx((13.5, 6 * 2.0))
    assert running.size(table, seen, 0, 0)[0] == 0


def test_size_and_bar_of_a_noisy_unit_are_roots_of_mean_squares():
    table = tables(1, noise=np.array([[1.0, 3.0, 2.0]]), fixed=np.array([[0.5, 0.75, 1.0]]))
    running = Means(np.full((1, 1, 3), 0.1), np.zeros((1, 1)), np.array([[16.0]]), np.array([[16 / 9]]))
    assert running.size(table, seen_of(np.zeros((1, 1, 3)), allowed=0.25), 0, 0) == pytest.approx((4 * 2.0, 3 * 2.0))


# The combination.


def test_the_rate_of_the_units_that_are_left_and_its_sigma():
    """Weights 0.5, 0.3, 0.2 and own variances: of the first and third, 5/7 and 2/7, whose parts add up to 0.29 / 0.49."""
    share = np.array([0.5, 0.3, 0.2])
    table = tables(weights=share[:, None, None] * np.eye(3), spread=(share**2)[:, None, None] * np.eye(3), own=np.array([0.0, 0.01, 0.04]))
    values = np.array([[[7.0, 0, 1], [99, 99, 99], [0, 7, 1]]] * 3)
    rate, sigma = combine(table, values, np.array([[True, False, True], [False, False, False], [False, False, True]]))
    np.testing.assert_allclose(rate[0], [5, 2, 1])
    np.testing.assert_allclose(sigma[0], np.sqrt(0.29 / 0.49 + table.own))
    assert np.isnan(rate[1]).all()
    assert np.isnan(sigma[1]).all()
    np.testing.assert_allclose(rate[2], [0, 7, 1])
    np.testing.assert_allclose(sigma[2], np.sqrt(1 + table.own))


def test_the_sigma_of_units_with_unlike_axes_is_that_of_drawn_noise():
    rng = np.random.default_rng(3)
    weights = np.array([0.5, 0.3, 0.2])[:, None, None] * np.eye(3) + 0.05 * rng.normal(size=(3, 3, 3))
    root = rng.normal(size=(3, 3, 3))
    table = tables(weights=weights, spread=weights @ root @ root.transpose(0, 2, 1) @ weights.transpose(0, 2, 1))
    draws = 100_000
    noise = np.einsum("nij,tnj->tni", root, rng.normal(size=(draws, 3, 3)))
    rate, sigma = combine(table, noise, np.broadcast_to([True, True, False], (draws, 3)))
    np.testing.assert_allclose(rate.std(axis=0), sigma[0], rtol=5 / np.sqrt(2 * draws))


# The stream.


def test_events_are_told_at_their_sample_with_reason_size_and_bar():
    """A step of 16 in one of three units: the mean passes 6 sqrt(1/31) at the second sample, 1 + 15/16."""
    stream = live(tables())
    x = np.where(np.arange(40) < 30, 0.0, 4.0)
    fused = stream(readings(0, 0, x))
    alpha, bar = 1 / 16, 6 * np.sqrt(1 / 31)
    mean = 4 * (1 - (1 - alpha) ** np.arange(1, 11))
    first = int(np.argmax(np.maximum(mean**2 / bar**2, (mean * 4) / 9) > 1))
    (event,) = fused.events
    assert (event.sample, event.unit, event.what, event.reason) == (30 + first, 2, "out", REASONS[DIFFERS])
    assert event.bar_rps == pytest.approx(bar if mean[first] > bar else 3.0)
    assert event.size_rps == pytest.approx(mean[first] if mean[first] > bar else np.sqrt(4 * mean[first]))
    assert fused.used[30 + first, 2]  # it is out from the next sample on
    assert not fused.used[31 + first :, 2].any()
    assert stream.out == {2: REASONS[DIFFERS]}
    assert stream.standing == {0: IN, 1: IN, 2: DIFFERS}
    later = stream(readings(0, 0, np.zeros(60)))
    (back,) = later.events
    assert (back.unit, back.what, back.reason) == (2, "in", "")
    assert np.isnan(back.size_rps)
    # score: the mean decays to the root of half the limit
    left = np.square(4 * (1 - (1 - alpha) ** 10) * (1 - alpha) ** np.arange(1, 61)) / bar**2
    assert back.sample == 40 + int(np.argmax(left < 0.5)) + 3
    assert stream.out == {}


def test_one_sample_at_a_time_is_the_same_as_all_at_once_across_blocks():
    rng = np.random.default_rng(4)
    raw = rng.normal(size=(300, 3, 3))
    raw[100:180, 1] += 8
    raw[200:205, 0] = np.nan
    whole, single = live(tables())(raw), live(tables())
    parts = [single(sample) for sample in raw]
    np.testing.assert_allclose(np.concatenate([part.rate for part in parts]), whole.rate, atol=1e-12)
    np.testing.assert_allclose(np.concatenate([part.sigma for part in parts]), whole.sigma, atol=1e-12)
    assert [(e.sample, e.unit, e.what) for part in parts for e in part.events] == [(e.sample, e.unit, e.what) for e in whole.events]
    assert len(whole.events) >= 4
    many = np.concatenate([np.tile(readings([0, 1], [0, 1], [0, 1]), (BLOCK, 1, 1)), raw])
    again = live(tables())(many)
    assert again.rate.shape == (2 * BLOCK + 300, 3)
    assert {e.unit for e in again.events} == {e.unit for e in whole.events}
    assert again.events[0].sample >= 2 * BLOCK + 100


def test_a_dead_unit_and_two_that_disagree_are_told_without_and_with_a_size():
    x = np.where(np.arange(12) < 6, 0.0, 8.0)
    fused = live(tables(2))(readings(0, x))
    (event,) = fused.events
    assert (event.unit, event.what, event.reason) == (None, "disagree", BETWEEN_TWO)
    assert event.size_rps > event.bar_rps > 0
    np.testing.assert_allclose(fused.sigma[event.sample + 1, 0], np.hypot(np.sqrt(0.5), 4.0))  # from their median, 4
    stream = live(tables())
    (dead,) = stream(readings(np.arange(6), np.arange(6), [0, 1, np.nan, np.nan, np.nan, np.nan])).events
    assert (dead.sample, dead.reason) == (4, REASONS[DEAD])
    assert np.isnan(dead.size_rps)
    assert live(tables())(readings(np.linspace(0, 0.1, 9), np.linspace(0, 0.1, 9), 0)).events == ()  # its y and z are not alike


def test_one_and_the_same_reading_is_told_at_its_number():
    raw = readings(np.linspace(0, 0.1, 9), np.linspace(0, 0.1, 9), 0)
    raw[:, 2] = 0.05
    (stuck,) = live(tables())(raw).events
    assert (stuck.sample, stuck.unit, stuck.reason) == (5, 2, REASONS[STUCK])
    assert stuck.size_rps < stuck.bar_rps


def test_without_a_vote_nobody_is_judged():
    stream = live(tables(), vote=False)
    fused = stream(readings(0, 0, np.full(50, 90.0)))
    assert fused.events == ()
    assert fused.used.all()
    np.testing.assert_allclose(fused.rate[:, 0], 30)
    np.testing.assert_allclose(fused.sigma, np.sqrt(1 / 3))


def test_no_samples_give_none():
    fused = live(tables())(np.zeros((0, 3, 3)))
    assert fused.rate.shape == (0, 3)
    assert fused.sigma.shape == (0, 3)
    assert fused.used.shape == (0, 3)
    assert fused.events == ()
