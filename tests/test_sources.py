"""Sources of variance, their effective degrees of freedom and the coverage factor."""

import numpy as np
import pytest
from scipy.stats import norm, t

from tinygc.estimation.sources import Source, coverage_factor, effective_freedom, total


def test_the_sum_is_that_of_the_parts():
    parts = [Source("one", "A", 4, np.diag([1.0, 2.0])), Source("other", "B", np.inf, np.array([[1.0, 0.5], [0.5, 3.0]]))]
    assert np.array_equal(total(parts), [[2.0, 0.5], [0.5, 5.0]])
    assert parts[1].variance(np.array([[1.0, 1.0]])) == pytest.approx([5.0])


def test_welch_satterthwaite_of_the_gum():
    """GUM G.4.2 note: relative 0.25, 0.57, 0.82 % with 9, 4, 14 degrees of freedom give 1.03 % with 19."""
    assert effective_freedom(np.array([0.25, 0.57, 0.82]) ** 2, [9, 4, 14]) == pytest.approx(19.0, abs=0.05)
    assert coverage_factor(19.0) == pytest.approx(2.09, abs=0.005)


def test_sizes_that_are_known_have_the_factor_of_a_normal_variable():
    assert effective_freedom([1.0, 3.0], [np.inf, np.inf]) == np.inf
    assert coverage_factor(np.inf) == pytest.approx(norm.ppf(0.975))
    assert effective_freedom([1.0, 1.0], [5, np.inf]) == pytest.approx(20.0)


def test_degrees_of_freedom_are_cut_to_a_whole_number():
    assert coverage_factor(5.9) == pytest.approx(t.ppf(0.975, 5))
    assert coverage_factor(0.3) == pytest.approx(t.ppf(0.975, 1))
    assert coverage_factor(9.0, 0.99) == pytest.approx(t.ppf(0.995, 9))
