"""Helpers for arrays: edges of runs, a scatter from medians, where logs begin, fresh stamps."""

import numpy as np
import pytest

from session.io.numeric import runs_of, sigma_of, sigma_of_steps
from session.io.samples import Samples, start_times
from session.io.stamps import fresh
from session.io.units import NS_PER_S


@pytest.mark.parametrize(
    ("mask", "runs"),
    [("", []), ("000", []), ("111", [(0, 3)]), ("1", [(0, 1)]), ("0110", [(1, 3)]), ("1011001", [(0, 1), (2, 4), (6, 7)])],
)
def test_runs(mask, runs):
    assert list(zip(*(edges.tolist() for edges in runs_of(np.array([c == "1" for c in mask], dtype=bool))), strict=True)) == runs


def test_scatter_is_that_of_the_noise_and_wild_values_do_not_move_it():
    rng = np.random.default_rng(0)
    noise = rng.normal(0, [1.0, 2.0, 3.0], (40_000, 3))
    noise[::50] = 1e6
    assert sigma_of(noise) == pytest.approx([1, 2, 3], rel=0.04)
    assert sigma_of(noise[:, 0], axis=None) == sigma_of(noise)[0]
    ramp = np.linspace(0, 100, 40_000)[:, None]
    assert sigma_of_steps(ramp + rng.normal(0, [1.0, 2.0, 3.0], (40_000, 3))) == pytest.approx([1, 2, 3], rel=0.03)


def test_logs_lie_one_after_the_other():
    logs = [Samples(np.array(t) * NS_PER_S, np.zeros((2, 3)), np.zeros((2, 3))) for t in ([5, 7], [100, 103], [0, 4])]
    assert start_times(logs).tolist() == [0, 2, 5, 9]
    assert start_times([]).tolist() == [0]


def test_a_stamp_is_fresh_if_it_is_later():
    assert fresh(np.array([3, 3, 4, 4, 4, 9])).tolist() == [True, False, True, False, False, True]
    assert fresh(np.zeros(0, dtype=np.int64)).tolist() == []
