"""PackedReadings kept as they were written act as the float64 array that they stand for, to the last bit."""

import pickle

import numpy as np
import pytest

from session.io.config import Sensor
from session.io.errors import FormatError
from session.io.logfile import read_log
from session.io.samples import PackedReadings, Packer, inserted, mapped, pick, pieces, replaced, times

RNG = np.random.default_rng(8)
SENSOR = Sensor("ASM330LHH", "", 208.0, 500.0, 4.0)


def packed(*tables: np.ndarray) -> PackedReadings:
    packer = Packer()
    for table in tables:
        packer.add(table)
    return PackedReadings(*packer.packed())


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
    np.testing.assert_array_equal(np.asarray(found), true)
    assert found.nbytes == bytes_each * true.size
    assert found.shape == true.shape


def test_every_decimal_of_nine_digits_comes_back_as_it_is_read():
    """A quotient of two whole numbers is rounded once, as ``float`` of the text is."""
    texts = [f"{whole / 10**decimals:.{decimals}f}" for decimals in range(10) for whole in RNG.integers(-(2**31) + 1, 2**31, 300).tolist()]
    values = np.array([float(text) for text in texts]).reshape(10, 300, 1)
    for decimals in range(10):
        np.testing.assert_array_equal(np.asarray(packed(values[decimals])), values[decimals])


INDICES = [
    slice(3, 90), slice(None), slice(50, 4), slice(None, None, 7), slice(-30, -3), 5, -1, -2, np.int64(7),
    np.array([4, 1, 99, 4]), np.array([[1, 2], [50, 98]]), RNG.random(100) > 0.5, (slice(10, 20), 1), (7, 2), (slice(None), slice(0, 2)),
    (RNG.random(100) > 0.5, 0),
]  # fmt: skip


@pytest.mark.parametrize("which", INDICES, ids=str)
@pytest.mark.parametrize("put_in", [False, True], ids=["as written", "with rows put in"])
@pytest.mark.parametrize("turned", [False, True], ids=["each axis by itself", "axes together"])
def test_rows_and_columns_are_those_of_the_array(which, put_in, turned):
    whole = RNG.integers(-3000, 3000, (100, 3))
    found, true = packed(whole).mapped(times(1.25e-3)), whole * 1.25e-3
    if put_in:
        rows = np.array([0, 5, 51, 52, 99])
        found, true = found.replaced(rows, true[rows] + 7), true.copy()
        true[rows] += 7
    if turned:
        found, true = found.mapped(swapped), swapped(true)
    np.testing.assert_array_equal(found[which], true[which])


def swapped(values: np.ndarray) -> np.ndarray:
    """An exact change of axes."""
    return values[..., [2, 0, 1]] * [1.0, -1.0, 2.0] + 0.5


def test_operators_and_functions_of_numpy_see_the_array():
    whole = RNG.integers(-3000, 3000, (100, 3))
    found, true = packed(whole).mapped(times(0.5)), whole * 0.5
    for work in (np.abs, np.median, lambda x: x / 3, lambda x: 1 - x, lambda x: x @ np.eye(3), lambda x: x.mean(axis=0), lambda x: x.T,
                 lambda x: np.diff(x, axis=0), lambda x: x == 5, lambda x: np.concatenate([x, x]), list, len):  # fmt: skip
        np.testing.assert_array_equal(work(found), work(true))
    np.testing.assert_array_equal(np.concatenate([part for _, part in pieces(found)]), true)
    np.testing.assert_array_equal(np.asarray(pickle.loads(pickle.dumps(found))), true)


def test_rows_are_put_in_as_numpy_puts_them_in():
    whole = RNG.integers(-3000, 3000, (60, 3))
    found, true = packed(whole).mapped(times(0.1)), whole * 0.1
    for at in (np.array([0, 7, 7, 60]), np.array([3, 8]), np.array([9])):
        values = RNG.normal(size=(len(at), 3))
        found, true = inserted(found, at, values), inserted(true, at, values)
        np.testing.assert_array_equal(np.asarray(found), true)
    rows = np.array([1, 8, 30])
    found, true = replaced(found, rows, np.ones((3, 3))), replaced(true, rows, np.ones((3, 3)))
    found, true = mapped(found, swapped), mapped(true, swapped)
    np.testing.assert_array_equal(np.asarray(found), true)
    kept = RNG.random(len(true)) > 0.3
    np.testing.assert_array_equal(np.asarray(pick(found, kept)), true[kept])


def test_a_log_in_pieces_names_the_line_from_which_time_goes_back(tmp_path):
    """Beyond the first megabyte, with comments and blank lines before it."""
    lines = [f"{4808 * i},1,2,3,-4,5,-8192,{i % 7}" for i in range(60_000)]
    lines[100:100] = ["# a comment", "", "# another"]
    lines[50_000:50_002] = [f"{t_us},1,2,3,-4,5,-8192,0" for t_us in (120_000_000, 120_004_808)]
    path = tmp_path / "log0001.csv"
    path.write_text("\n".join(["# gyro_fs_dps=500", "t_us,gx,gy,gz,ax,ay,az,temp", *lines, ""]))
    assert path.stat().st_size > 1.5 * 2**20
    with pytest.raises(FormatError, match=r"log0001\.csv line 50003: t_us goes backward"):
        read_log(path, SENSOR)


def test_a_counter_that_wraps_in_a_later_piece_is_unrolled(tmp_path):
    first = 2**32 - 40_000 * 4808
    path = tmp_path / "log0001.csv"
    rows = "\n".join(f"{(first + 4808 * i) % 2**32},{i % 100},2,3,-4,5,-8192,0" for i in range(60_000))
    path.write_text(f"t_us,gx,gy,gz,ax,ay,az,temp\n{rows}\n")
    log = read_log(path, SENSOR)
    np.testing.assert_array_equal(np.diff(log.samples.t_ns), 4808_000)
    assert "came round 1x" in " ".join(log.notes)
