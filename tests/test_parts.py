"""Sequences of parts: the attitude carried from part to part, each with its own end reference."""

import numpy as np
import pytest
import torch
from conftest import broad
from test_training import MODEL, recording, rms

from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure import problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.estimation.network import train_second_order
from tinygc.models.linear import bias_only

ORDER = np.array([0, 1, 2, 3, 5, 6, 7, 8])


def test_which_part_goes_on_from_which():
    """Sequences of three, begun anew at every third number and after a gap."""
    before = problem.previous(ORDER, 3)
    assert before.tolist() == [-1, 0, 1, -1, -1, -1, 5, 6]
    assert problem.place(before).tolist() == [0, 1, 2, 0, 0, 0, 1, 2]
    assert (problem.previous(ORDER, 1) == -1).all()


def test_single_parts_are_segments():
    batch, _ = recording(0, count=8)
    alone = problem.residuals(batch, MODEL(batch.rate), np.full(8, -1))
    np.testing.assert_array_equal(alone, closure.segment_residuals(batch, MODEL(batch.rate)))


def test_carried_is_one_long_integration():
    """The end of the third part, from the start of the first; NumPy and torch."""
    batch, _ = recording(0, count=8)
    before = problem.previous(np.arange(8), 4)
    rate = MODEL(batch.rate) + 0.01
    turns = [closure.end_attitude(batch.pick([i]), rate[[i]])[0] for i in range(3)]
    long = batch.start[0]
    for i in range(3):
        long = rotation.multiply(long, rotation.multiply(rotation.conjugate(batch.start[i]), turns[i]))
    expected = closure.residual(long[None], batch.end[[2]], False)[0]
    np.testing.assert_allclose(problem.residuals(batch, rate, before)[2], expected, atol=1e-14)
    np.testing.assert_allclose(
        problem.residuals(batch, torch.as_tensor(rate), before).numpy(), problem.residuals(batch, rate, before), atol=1e-14
    )


def test_carried_errors_add_up_to_first_order():
    """What the second order's rows say of a small error of the bias."""
    batch, _ = recording(0, count=8)
    before, rate, small = problem.previous(np.arange(8), 4), MODEL(batch.rate), np.array([1e-6, -2e-6, 1e-6])
    turn = closure.sensitivity(batch, rate)[:, :, :2]
    design = problem.carried(turn.sum(axis=1), before)
    moved = 2 * (problem.residuals(batch, rate + small, before) - problem.residuals(batch, rate, before))
    np.testing.assert_allclose(moved, design @ small, atol=2e-2 * np.abs(moved).max())


@pytest.mark.parametrize("m", [broad(2), 8])
def test_training_on_sequences_finds_the_same_sensor(m):
    batch, sigma = recording(0)
    fresh, _ = recording(1, turns_seed=12)
    net = train_second_order(batch, sigma, before=problem.previous(np.arange(24), m)).net
    linear = fit_least_squares(batch, sigma, bias_only()).model
    assert rms(fresh, net) < 1.15 * rms(fresh, linear)
