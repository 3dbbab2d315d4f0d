"""Readings kept as they were written act as the float64 array that they stand for, to the last bit; helpers for arrays."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from session.base.numeric import held_for, new_readings, sigma_of, sigma_of_steps, smallest_step
from session.log.samples import PackedReadings, Packer, inserted, mapped, pick, pieces, replaced, times

RNG = np.random.default_rng(8)


def packer_of(*tables):
    packer = Packer()
    for table in tables:
        packer.add(table)
    return packer


def packed(*tables):
    return packer_of(*tables).readings(times(1.0), short=0)


def test_a_short_log_is_read_into_plain_arrays():
    table = RNG.normal(size=(5, 3))
    assert_array_equal(packer_of(table).readings(times(2.0)), 2 * table)
    assert isinstance(packer_of(table).readings(times(2.0)), np.ndarray)
    assert isinstance(packer_of(table).readings(times(2.0), short=4), PackedReadings)


@pytest.mark.parametrize(
    ("tables", "bytes_each"),
    [
        ([RNG.integers(-32768, 32768, (500, 3))], 2),
        ([np.round(RNG.normal(size=(500, 3)), 3)], 2),
        ([np.round(RNG.normal(size=(500, 3)), 1), np.round(RNG.normal(size=(500, 3)), 6)], 4),
        ([RNG.integers(-5, 5, (500, 3)), np.round(200 * RNG.normal(size=(500, 3)), 6)], 4),
        ([np.round(9.8 * RNG.normal(size=(500, 3)), 9)], 8),
        ([RNG.normal(size=(500, 3))], 8),
        ([np.round(RNG.normal(size=(500, 3)), 2), RNG.normal(size=(500, 3))], 8),
        ([RNG.integers(-9, 9, (5, 3)) * 100_000_000, np.round(RNG.normal(size=(5, 3)), 4)], 8),
    ],
    ids=["registers", "mdps", "more decimals later", "whole at first", "too long", "no decimals", "decimals at first", "too wide"],
)
def test_decimals_survive_in_as_few_bytes_as_hold_them(tables, bytes_each):
    found, true = packed(*tables), np.concatenate([np.asarray(table, dtype=float) for table in tables])
    assert_array_equal(np.asarray(found), true)
    assert found.nbytes == bytes_each * true.size
    assert found.shape == true.shape


def test_every_decimal_of_nine_digits_comes_back_as_it_is_read():
    """A quotient of two whole numbers is rounded once, as ``float`` of the text is."""
    texts = [f"{whole / 10**decimals:.{decimals}f}" for decimals in range(10) for whole in RNG.integers(-(2**31) + 1, 2**31, 300).tolist()]
    values = np.array([float(text) for text in texts]).reshape(10, 300, 1)
    for decimals in range(10):
        assert_array_equal(np.asarray(packed(values[decimals])), values[decimals])


INDICES = [
    slice(3, 90), slice(None), slice(50, 4), slice(None, None, 7), slice(-30, -3), 5, -1, -2, np.int64(7),
    np.array([4, 1, 99, 4]), np.array([[1, 2], [50, 98]]), RNG.random(100) > 0.5, (slice(10, 20), 1), (7, 2), (slice(None), slice(0, 2)),
    (RNG.random(100) > 0.5, 0),
]  # fmt: skip


@pytest.mark.parametrize("which", INDICES, ids=str)
@pytest.mark.parametrize("turned", [False, True], ids=["each axis by itself", "axes together"])
def test_rows_and_columns_are_those_of_the_array(which, turned):
    whole = RNG.integers(-3000, 3000, (100, 3))
    found, true = packed(whole).mapped(times(1.25e-3)), whole * 1.25e-3
    if turned:
        found, true = found.mapped(swapped), swapped(true)
    assert_array_equal(found[which], true[which])


def swapped(values):
    """An exact change of axes."""
    return values[..., [2, 0, 1]] * [1.0, -1.0, 2.0] + 0.5


def test_operators_and_functions_of_numpy_see_the_array():
    whole = RNG.integers(-3000, 3000, (100, 3))
    found, true = packed(whole).mapped(times(0.5)), whole * 0.5
    for work in (np.abs, np.median, lambda x: x / 3, lambda x: 1 - x, lambda x: x @ np.eye(3), lambda x: x.mean(axis=0), lambda x: x.T,
                 lambda x: np.diff(x, axis=0), lambda x: x == 5, lambda x: np.concatenate([x, x]), list, len):  # fmt: skip
        assert_array_equal(work(found), work(true))
    assert_array_equal(np.concatenate([part for _, part in pieces(found)]), true)
    assert_array_equal(np.asarray(pickle.loads(pickle.dumps(found))), true)


def test_rows_are_put_in_as_numpy_puts_them_in():
    whole = RNG.integers(-3000, 3000, (60, 3))
    found, true = packed(whole).mapped(times(0.1)), whole * 0.1
    for at in (np.array([0, 7, 7, 60]), np.array([3, 8]), np.array([9])):
        values = RNG.normal(size=(len(at), 3))
        found, true = inserted(found, at, values), inserted(true, at, values)
        assert_array_equal(np.asarray(found), true)
    rows = np.array([1, 8, 30])
    found, true = replaced(found, rows, np.ones((3, 3))), replaced(true, rows, np.ones((3, 3)))
    found, true = mapped(found, swapped), mapped(true, swapped)
    assert_array_equal(np.asarray(found), true)
    kept = RNG.random(len(true)) > 0.3
    assert_array_equal(np.asarray(pick(found, kept)), true[kept])


def test_a_column_is_converted_in_parts_to_the_same_numbers(monkeypatch):
    monkeypatch.setattr("session.log.samples.AT_ONCE", 400)
    whole = RNG.integers(-3000, 3000, (1000, 3)).astype(np.int16)
    found = packed(whole).mapped(times(0.5))
    assert_array_equal(np.asarray(found), whole * 0.5)
    assert_array_equal(found[:, 1], whole[:, 1] * 0.5)


def test_scatter_is_that_of_the_noise_and_wild_values_do_not_move_it():
    rng = np.random.default_rng(0)
    noise = rng.normal(0, [1.0, 2.0, 3.0], (40_000, 3))
    noise[::50] = 1e6
    assert sigma_of(noise) == pytest.approx([1, 2, 3], rel=0.04)
    assert sigma_of(noise[:, 0], axis=None) == sigma_of(noise)[0]
    ramp = np.linspace(0, 100, 40_000)[:, None]
    assert sigma_of_steps(ramp + rng.normal(0, [1.0, 2.0, 3.0], (40_000, 3))) == pytest.approx([1, 2, 3], rel=0.03)


def test_new_readings_are_rows_that_differ_in_any_axis():
    rows = np.repeat(np.arange(12.0).reshape(4, 3), [1, 3, 2, 1], axis=0)
    assert new_readings(rows).tolist() == [True, True, False, False, True, False, True]
    rows[2, 1] += 1
    assert new_readings(rows).tolist() == [True, True, True, True, True, False, True]
    assert new_readings(held([2] * 9000)).sum() == 9000


def held(rows_each):
    """Readings of three axes, each held for so many rows."""
    return np.repeat(np.arange(float(len(rows_each))), rows_each)[:, None] * np.ones(3)


@pytest.mark.parametrize(("rows_each", "median"), [([6] * 30, 6), ([1, 1, 9] * 10, 1)])
def test_a_reading_is_held_for_the_median_of_its_rows(rows_each, median):
    assert held_for(new_readings(held(rows_each))) == median
    assert held_for(np.ones(2, dtype=bool)) == 1


def test_the_smallest_step_is_beyond_rounding():
    assert smallest_step(np.array([1.0, 1.5, 1.5, 3.0])) == 0.5
    assert smallest_step(np.array([1000.0, 1000.0 + 5e-7, 1002.0])) == pytest.approx(2.0)
    assert smallest_step(np.ones(4)) == 0.0
