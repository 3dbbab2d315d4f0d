"""Numbers as text: the decimals of any number, or a refusal."""

import numpy as np
import pytest

from session.io import numeric

RNG = np.random.default_rng(5)


def test_rows_are_the_decimals_of_the_numbers():
    times = np.array([0, 7, 1234567890123456789, -5])
    values = np.array([0.0, -0.125, 12.3456789, -1e-7])
    text = numeric.decimal_rows([times, values], [0, 6]).decode()
    assert text == "0,0.000000\n7,-0.125000\n1234567890123456789,12.345679\n-5,0.000000\n"
    assert numeric.decimal_rows([times[:0]], [0]) == b""


def test_rows_agree_with_python_for_any_number():
    for decimals in (0, 1, 4, 9):
        values = RNG.normal(size=20_000) * 10.0 ** RNG.integers(-8, 4, 20_000)
        lines = numeric.decimal_rows([values, values[::-1]], [decimals, decimals]).decode().splitlines()
        read = np.array([line.split(",") for line in lines], dtype=float)
        assert np.abs(read[:, 0] - values).max() <= 0.51 * 10.0**-decimals
        np.testing.assert_array_equal(read[::-1, 1], read[:, 0])


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_is_no_decimal_is_refused(value):
    with pytest.raises(ValueError, match="cannot be written"):
        numeric.decimal_rows([np.array([1.0, value])], [3])
