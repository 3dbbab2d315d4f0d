"""What no row determines has no sigma: least squares and the inverse of an information, by problems that are solved on paper."""

import numpy as np
import pytest

from tinygc.inference.solve import BAR, inverse, solve

PLAIN = np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 2.0]])
#: the third number is seen only in its sum with the second
SUM = np.column_stack([PLAIN, PLAIN[:, 1]])


def test_a_determined_problem_is_least_squares():
    values = np.array([1.0, 2.0, 4.0])
    found = solve(PLAIN, values)
    covariance = np.array([[8.0, -2.0], [-2.0, 2.0]]) / 12  # of [[2, 2], [2, 8]]
    assert found.covariance == pytest.approx(covariance)
    assert found.value == pytest.approx(covariance @ PLAIN.T @ values)
    assert found.rank == 2
    assert not found.is_open.any()
    assert found.variance(np.array([1.0, 1.0])) == pytest.approx((8 - 4 + 2) / 12)
    assert inverse(PLAIN.T @ PLAIN) == pytest.approx(covariance)


def test_of_two_numbers_in_one_column_the_sum_alone_is_known():
    found = solve(SUM, np.array([1.0, 2.0, 4.0]))
    assert found.rank == 2
    assert found.is_open.tolist() == [False, True, True]
    assert np.isnan(found.value[1:]).all()
    assert np.diag(found.covariance).tolist() == [pytest.approx(8 / 12), np.inf, np.inf]
    assert found.variance(np.array([0.0, 1.0, 1.0])) == pytest.approx(2 / 12)
    assert found.variance(np.array([0.0, 1.0, 0.9])) == np.inf
    assert SUM @ found.shortest == pytest.approx(PLAIN @ solve(PLAIN, np.array([1.0, 2.0, 4.0])).value)
    assert np.diag(inverse(SUM.T @ SUM)).tolist() == [pytest.approx(8 / 12), np.inf, np.inf]


def test_a_column_of_zeros_is_not_determined_and_moves_nothing_else():
    design = np.column_stack([PLAIN, np.zeros(3)])
    for covariance in (solve(design).covariance, inverse(design.T @ design)):
        assert covariance[:2, :2] == pytest.approx(solve(PLAIN).covariance)
        assert covariance[2, 2] == np.inf
        assert np.isnan(covariance[2, :2]).all()


def test_fewer_rows_than_numbers():
    found = solve(np.array([[1.0, 1.0, 0.0]]), np.array([2.0]))
    assert found.shortest == pytest.approx([1.0, 1.0, 0.0])
    assert found.rank == 1
    assert found.is_open.all()
    assert found.variance(np.array([1.0, 1.0, 0.0])) == pytest.approx(1.0)


@pytest.mark.parametrize(("apart", "rank"), [(3 * BAR, 2), (BAR / 3, 1)])
def test_the_bar_is_on_columns_of_length_one(apart, rank):
    """Two columns that differ by an angle ``a`` have singular values √2 and √2 a, whatever their units are."""
    design = np.array([[1.0, np.cos(2 * apart)], [0.0, np.sin(2 * apart)]]) * [1e-6, 1e9]
    assert solve(design).rank == rank
    assert np.isfinite(np.diag(inverse(design.T @ design))).all() == (rank == 2)


def test_many_informations_at_once():
    both = np.stack([PLAIN.T @ PLAIN, np.array([[4.0, 0.0], [0.0, 0.0]])])
    found = inverse(both)
    assert found[0] == pytest.approx(solve(PLAIN).covariance)
    assert found[1, 0, 0] == pytest.approx(0.25)
    assert found[1, 1, 1] == np.inf


def test_several_right_sides():
    values = np.arange(6.0).reshape(3, 2)
    assert solve(PLAIN, values).value == pytest.approx(np.linalg.lstsq(PLAIN, values, rcond=None)[0])
