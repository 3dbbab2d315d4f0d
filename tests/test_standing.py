"""The table of standings: its limits, its test of a difference, and its words."""

import numpy as np
import pytest

from tinygc.explanation.standing import Standing, Statement, homogeneity_p, standing_of, upper_limit


def test_a_size_that_is_not_zero_has_evidence_for_it():
    assert standing_of(0.049) is Standing.FOR
    assert standing_of(0.051) is Standing.UNDECIDED


def test_a_size_that_is_not_the_claimed_one_counts_against_the_claim_whether_or_not_it_is_zero():
    assert standing_of(0.9, p_claimed=0.049) is Standing.AGAINST
    assert standing_of(1e-9, p_claimed=0.049) is Standing.AGAINST
    assert standing_of(0.9, p_claimed=0.051) is Standing.UNDECIDED


def test_absence_needs_a_limit_below_what_matters():
    assert standing_of(0.5, upper=0.0499, matters=0.05) is Standing.BOUNDED
    assert standing_of(0.5, upper=0.05, matters=0.05) is Standing.UNDECIDED
    assert standing_of(0.01, upper=0.01, matters=0.05) is Standing.FOR  # small, and there


def test_the_upper_limit_excludes_larger_sizes_in_95_of_100_cases():
    rng = np.random.default_rng(3)
    size, sigma = 2.0, 0.5
    limits = np.array([upper_limit(x, sigma) for x in size + sigma * rng.standard_normal(20_000)])
    assert np.mean(limits > size) == pytest.approx(0.95, abs=0.005)
    assert upper_limit(-2.0, 0.5) == upper_limit(2.0, 0.5) == pytest.approx(2 + 1.6449 * 0.5, abs=1e-4)


def test_equal_sizes_are_pooled_with_their_weights():
    p, pooled, covariance = homogeneity_p(np.array([[1.0], [2.0]]), np.array([[[1.0]], [[4.0]]]))
    assert pooled[0] == pytest.approx(1.2)  # (1/1 + 2/4) / (1/1 + 1/4)
    assert covariance[0, 0] == pytest.approx(0.8)
    assert p == pytest.approx(0.6547, abs=1e-4)  # chi-square 1/5 of 1: (0.2)^2 / 1 + (0.8)^2 / 4 = 0.2


def test_the_test_of_equality_is_uniform_where_sizes_are_equal():
    rng = np.random.default_rng(5)
    root = np.array([[1.0, 0.0], [0.8, 0.5]])
    covariances = np.array([k * root @ root.T for k in (1.0, 4.0, 0.25)])
    drawn = [
        homogeneity_p(np.array([3.0, -2.0]) + [np.sqrt(k) * root @ rng.standard_normal(2) for k in (1.0, 4.0, 0.25)], covariances)[0]
        for _ in range(4000)
    ]
    assert np.mean(np.array(drawn) < 0.05) == pytest.approx(0.05, abs=0.011)  # three sigmas
    assert np.mean(np.array(drawn) < 0.5) == pytest.approx(0.5, abs=0.024)


def test_one_estimate_differs_from_nothing():
    assert homogeneity_p(np.array([[7.0]]), np.array([[[1.0]]]))[0] == 1.0


def test_no_words_state_absence_without_a_limit():
    of = lambda standing: Statement("common part", standing, "chi-square", 0.2, "0.01 ± 0.02°", "0.04°", "0.1°").words  # noqa: E731
    assert of(Standing.FOR) == "common part: 0.01 ± 0.02° (chi-square, p = 0.2)"
    assert of(Standing.AGAINST) == "common part: 0.01 ± 0.02°, not 0.1° (chi-square, p = 0.2)"
    assert of(Standing.BOUNDED) == "common part: below 0.04° with 95 % (chi-square, p = 0.2)"
    assert of(Standing.UNDECIDED).startswith("common part: undecided; 0.01 ± 0.02°; more than 0.04° is excluded with 95 %")
