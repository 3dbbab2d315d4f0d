"""What ``scipy`` has as well, in NumPy alone: held against it."""

import numpy as np
import pytest
from scipy import stats

from tinygc.closure.uncertainty import chi_square_above, normal_above, signed_ranks_above
from tinygc.noise.whitening import Sparse


@pytest.mark.parametrize("freedom", [1, 2, 3, 10, 63, 64, 500, 2001])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 1.0, 2.0, 5.0, 50.0])
def test_chi_square(freedom, share):
    assert chi_square_above(share * freedom, freedom) == pytest.approx(stats.chi2.sf(share * freedom, freedom), rel=1e-10, abs=1e-300)


def test_no_probability_is_above_one():
    """A sum of twenty terms rounds."""
    assert max(chi_square_above(20 * share, 20) for share in np.geomspace(1e-12, 1, 400)) == 1.0


@pytest.mark.parametrize("sigmas", [-3.0, 0.0, 0.5, 3.0, 20.0])
def test_normal(sigmas):
    assert normal_above(sigmas) == pytest.approx(stats.norm.sf(sigmas), rel=1e-12)


@pytest.mark.parametrize("count", [1, 5, 12, 37, 50, 51, 200])
@pytest.mark.parametrize("shift", [-0.5, 0.0, 0.3, 2.0])
def test_signed_ranks(count, shift):
    differences = np.random.default_rng(count).normal(shift, 1, count)
    expected = stats.wilcoxon(differences, alternative="greater").pvalue
    assert signed_ranks_above(differences) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("count", [6, 12, 200])
def test_signed_ranks_with_ties_and_zeros(count):
    """Where scipy is exact with ties, up to 13, and where both are normal."""
    differences = np.round(np.random.default_rng(count).normal(0.3, 1, count), 1)
    differences[0] = 0.0
    assert signed_ranks_above(differences) == pytest.approx(stats.wilcoxon(differences, alternative="greater").pvalue, rel=1e-9)


def test_no_difference_at_all_is_no_sign_of_any():
    assert signed_ranks_above(np.zeros(7)) == 1.0


def test_a_sparse_matrix_is_the_dense_one():
    rng = np.random.default_rng(0)
    dense = np.where(rng.uniform(size=(30, 30)) < 0.1, rng.normal(size=(30, 30)), 0.0)
    some = rng.permutation(30)[:12]
    np.testing.assert_array_equal(Sparse.of(dense).dense(), dense)
    np.testing.assert_array_equal(Sparse.of(dense).block(some), dense[np.ix_(some, some)])
    np.testing.assert_array_equal(Sparse.of_diagonal(dense[0]).dense(), np.diag(dense[0]))
