"""The Allan deviation by a double loop, its degrees of freedom by the covariance of its differences, its coefficients on curves by hand."""

import numpy as np
import pytest

from tinygc.closure.floor import (
    FLICKER_FLOOR,
    AllanCurve,
    AllanSums,
    allan_curve,
    angle_random_walk,
    averaging_factors,
    bias_instability,
    curve_of,
)
from tinygc.reporting.html.sections.noise_at_rest import held_down

PERIOD_S, WALK = 0.01, 6e-5


def white(samples, seed=0):
    """Rates whose angle walks by WALK rad/sqrt(s)."""
    return np.random.default_rng(seed).standard_normal((samples, 3)) * WALK / np.sqrt(PERIOD_S)


def curve(deviation, tau_s, freedom):
    """A curve of three equal axes."""
    return AllanCurve(np.array(tau_s), np.repeat(np.array(deviation)[:, None], 3, axis=1), np.array(freedom, dtype=float), 1.0)


def test_it_is_half_the_mean_square_of_neighbouring_means_pooled_over_pieces():
    """The definition of the overlapping estimate, IEEE 952 C.1; what has less than four samples tells nothing."""
    pieces = [white(count, seed) + seed for seed, count in enumerate((40, 21, 3, 4))]
    found = allan_curve(pieces, PERIOD_S, per_octave=1)
    assert found.tau_s.tolist() == pytest.approx([0.01, 0.02, 0.04, 0.08])
    assert found.longest_s == pytest.approx(0.4)
    for m, deviation in zip((1, 2, 4, 8), found.deviation, strict=True):
        squares = []
        for piece in (pieces[0], pieces[1], pieces[3]):
            for k in range(len(piece) - 2 * m + 1):
                squares.append((piece[k + m : k + 2 * m].mean(axis=0) - piece[k : k + m].mean(axis=0)) ** 2)
        assert deviation == pytest.approx(np.sqrt(np.mean(squares, axis=0) / 2), rel=1e-12)


def test_freedom_by_hand():
    """NIST SP 1065, table 5, white rate noise: (3 (N - 1) / 2m - 2 (N - 2) / N) 4m^2 / (4m^2 + 5), N = 21 angles; pieces add up."""
    sums = AllanSums.of(np.zeros((20, 3)), (1, 2, 10, 11))
    assert sums.freedom == pytest.approx([(30 - 38 / 21) * 4 / 9, (15 - 38 / 21) * 16 / 21, (3 - 38 / 21) * 400 / 405, 0], rel=1e-12)
    assert sums.count.tolist() == [19, 17, 1, 0]
    assert AllanSums.of(np.zeros((19, 3)), (10,)).freedom.tolist() == [0]  # 20 angles have no difference over 20 steps
    two = allan_curve([white(20), white(20, 1)], PERIOD_S, per_octave=1)
    assert two.freedom == pytest.approx(2 * np.array([*sums.freedom[:2], (7.5 - 38 / 21) * 64 / 69]), rel=1e-12)
    assert two.relative_sigma == pytest.approx(1 / np.sqrt(2 * two.freedom))


@pytest.mark.parametrize(("share", "held"), [(0.969, True), (0.971, False), (1.2, False)])
def test_a_curve_is_held_down_where_it_begins_two_sigmas_below_its_white_noise(share, held):
    tau_s = 0.01 * 2.0 ** np.arange(8)  # read at 0.16 s, with a sigma of 1.5 %
    deviation = WALK / np.sqrt(tau_s) * np.array([share, *[1.0] * 7])
    assert held_down(curve(deviation, tau_s, [1e9] * 8)) == held


def test_averaging_times_with_less_than_five_degrees_of_freedom_are_left_out_but_for_the_first():
    def pooled(freedom):
        ones = np.ones((len(freedom), 3))
        sums = [AllanSums((1, 2, 3), ones, np.array([4, 2, 0]), share * np.array(freedom)) for share in (0.25, 0.75)]
        return curve_of(sums, 0.5, 7.0)

    assert pooled([5.0, 4.999, 5.0]).tau_s.tolist() == [0.5, 1.5]
    assert pooled([4.999, 5.0, 0]).tau_s.tolist() == [1.0]
    few = pooled([3.0, 2.0, 1.0])
    assert (few.tau_s.tolist(), few.longest_s) == ([0.5], 7.0)
    assert pooled([5.0, 5.0, 5.0]).deviation[:, 0] == pytest.approx(np.sqrt([2 / 16, 2 / 32, 2 / 18]))


def test_averaging_factors_are_equal_in_octaves_up_to_half():
    assert averaging_factors(16, 1) == (1, 2, 4, 8)
    assert averaging_factors(16, 4) == (1, 2, 3, 4, 5, 6, 7, 8)
    assert allan_curve([white(64)], PERIOD_S).tau_s == pytest.approx(PERIOD_S * np.array([1, 2, 3, 4, 5, 6, 7, 8, 10, 11, 13]))


@pytest.mark.parametrize(
    ("tau_s", "read"),
    [
        ([0.001, 0.1, 0.15, 0.26], 3),  # 0.2 s; nearest in the logarithm
        ([0.001, 0.1, 0.15, 0.27], 2),
        ([0.1, 0.2, 1.5, 2.5], 3),  # twenty samples of a slow sensor
        ([0.1, 0.2, 1.5, 2.8], 2),
    ],
)
def test_the_random_walk_is_read_at_a_fifth_of_a_second_or_twenty_samples(tau_s, read):
    found = angle_random_walk(curve([4.0, 3.0, 2.0, 1.0], tau_s, [50] * 4), 1)
    value = [4.0, 3.0, 2.0, 1.0][read] * np.sqrt(tau_s[read])
    assert (found.value, found.observed) == (pytest.approx(value, rel=1e-12), True)
    assert found.sigma == pytest.approx(value * np.hypot(0.1, 0.015), rel=1e-12)  # 50 degrees of freedom; the curve's bend


@pytest.mark.parametrize(
    ("deviation", "tau_s", "freedom", "observed"),
    [(1e-9, 0.1, 5.0, True), (1.0, 0.0999, 5.0, False), (1.0, 0.1, 4.999, False), (0.0, 0.1, 5.0, False)],
)
def test_a_random_walk_is_observed_from_a_tenth_of_a_second_and_five_degrees_of_freedom_on(deviation, tau_s, freedom, observed):
    assert angle_random_walk(curve([0.5, deviation], [0.004, tau_s], [9, freedom]), 0).observed is observed


def read_instability(variance, freedom=(1e4, 1e4, 400, 400, 400)):
    """Of variances at 0.01, 0.2, 0.4, 1 and 4 s; the random walk of the second is 1 rad/sqrt(s)."""
    return bias_instability(curve(np.sqrt(variance), [0.01, 0.2, 0.4, 1.0, 4.0], freedom), 2)


def test_the_floor_less_its_white_part_is_the_bias_instability():
    found = read_instability([100, 5.0, 2.5, 2.0, 1.5])
    value = np.sqrt(1.5 - 1 / 4) / 0.6643
    sigma = np.hypot(np.sqrt(2 / 400) * 1.5, 2 * WALK_SIGMA / 4)
    assert found.observed
    assert found.value == pytest.approx(value, rel=1e-12)
    assert found.sigma == pytest.approx(value * sigma / 1.25 / 2, rel=1e-12)
    assert pytest.approx(np.sqrt(2 * np.log(2) / np.pi), rel=1e-4) == FLICKER_FLOOR
    # The lowest is taken of those later than twice the time at which the walk is read, with twenty degrees of freedom.
    assert read_instability([100, 5.0, 0.1, 2.0, 1.5]).value == pytest.approx(value)
    assert read_instability([100, 5.0, 2.5, 40.0, 1.5], (1e4, 1e4, 400, 20, 19.99)).value == pytest.approx(np.sqrt(39) / 0.6643, rel=1e-12)
    assert not read_instability([100, 5.0, 2.5, 40.0, 1.5], (1e4, 1e4, 400, 20, 20)).observed


WALK_SIGMA = np.hypot(np.sqrt(0.5 / 1e4), 0.015)


def test_it_is_a_floor_from_half_of_its_variance_and_three_sigmas_on():
    """At 4 s the white part is 1/4: half of 1/2."""
    assert [read_instability([100, 5.0, 2.5, 2.0, lowest]).observed for lowest in (0.4999, 0.5001)] == [False, True]
    assert not bias_instability(curve([9.0, 2.0, 1.0], [0.01, 0.25, 2.0], [1e9] * 3), 0).observed  # exactly half
    # Three sigmas of a variance of 1 are its excess of 3/4 where sqrt(2 / freedom) is 1/4, but for the walk's share.
    limit = 2 / ((0.75 / 3) ** 2 - (2 * WALK_SIGMA / 4) ** 2)
    for step, observed in ((0.999, False), (1.001, True)):
        assert read_instability([100, 5.0, 2.5, 2.0, 1.0], (1e4, 1e4, 400, 400, limit * step)).observed is observed


@pytest.mark.parametrize(("lowest", "excess"), [(0.3, 0.05), (0.2, 0.0)])
def test_without_a_floor_the_limit_is_two_sigmas_above_the_least_excess(lowest, excess):
    found, sigma = read_instability([100, 5.0, 2.5, 0.9, lowest]), np.hypot(np.sqrt(2 / 400) * lowest, 2 * WALK_SIGMA / 4)
    assert (found.observed, np.isnan(found.value), np.isnan(found.sigma)) == (False, True, True)
    assert found.at_most == pytest.approx(np.sqrt(excess + 2 * sigma) / 0.6643, rel=1e-12)


@pytest.mark.parametrize(("longest_s", "told"), [(0.401, True), (0.4, False)])
def test_there_is_a_limit_beyond_twice_the_time_of_the_random_walk(longest_s, told):
    found = bias_instability(curve([1.0, 1.0, 1.0], [0.01, 0.2, longest_s], [50] * 3), 0)
    assert (found.observed, np.isnan([found.value, found.sigma]).all(), found.at_most > 0) == (False, True, told)


def test_what_is_too_short_is_refused():
    with pytest.raises(ValueError, match="four samples"):
        allan_curve([white(3)], PERIOD_S)
