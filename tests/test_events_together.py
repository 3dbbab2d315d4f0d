"""Events of one turn are judged together: what neither mends alone, both do."""

import numpy as np
import pytest

from tinygc.explanation.data_repair import EVERY_CHOICE, chance_of_each, choices


def turn(shifts, measured, sigma=0.1, allowed=0.0):
    """A turn that misses by ``measured``, of which each event, mended, takes one of the shifts; allowed: what a gap may hide."""
    shifts = np.asarray(shifts, dtype=float)

    def value(choice):
        left = measured - shifts[sorted(choice)].sum(axis=0)
        variance = sigma**2 + len(choice) * allowed**2
        return float(-(left @ left) / variance / 2 - np.log(variance)), float(left @ left / sigma**2)

    return value


def best(likelihood):
    return set(max(likelihood, key=likelihood.__getitem__))


def test_two_that_cancel_in_part_are_both_found():
    """Mended alone, each leaves the turn further off than it is."""
    shifts = np.array([[3.0, 0.0], [-2.8, 0.5], [1.0, 4.0]])
    likelihood = choices(3, turn(shifts, shifts[:2].sum(axis=0)))
    assert best(likelihood) == {0, 1}
    np.testing.assert_allclose(chance_of_each(3, likelihood, 0.5), [1, 1, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("count", "true"),
    [*((EVERY_CHOICE, true) for true in ((), (2,), (0, 3, 5), "all")), *((EVERY_CHOICE + 4, true) for true in ((), (2,), "all"))],
)
def test_those_that_were_there_are_found_among_few_and_many(count, true):
    shifts = np.random.default_rng(count).normal(size=(count, 2)) * 3
    true = range(count) if true == "all" else true
    assert best(choices(count, turn(shifts, shifts[list(true)].sum(axis=0)))) == set(true)


def test_what_a_gap_may_hide_makes_nothing_of_what_is_missed_less_of_a_miss():
    """A wide gap is likelier than a miss of eight sigmas, but the turn misses more with it than without."""
    value = turn([[0.0, -0.5]], np.array([0.8, 0.0]), allowed=3.0)
    assert value(frozenset({0}))[0] > value(frozenset())[0]
    assert list(choices(1, value)) == [frozenset()]


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_what_closure_cannot_decide_has_the_share_of_the_others(share):
    likelihood = choices(2, lambda choice: (0.0, -float(len(choice))))
    assert len(likelihood) == 4
    np.testing.assert_allclose(chance_of_each(2, likelihood, share), share)
