"""Numbers as text: the decimals of any number, or a refusal."""

import numpy as np
import pytest

from session.io import numeric


def test_rows_are_the_decimals_of_any_number():
    times, values = np.array([0, 1234567890123456789, -5]), np.array([0.0, 12.3456789, -1e-7])
    assert numeric.decimal_rows([times, values], [0, 6]) == b"0,0.000000\n1234567890123456789,12.345679\n-5,0.000000\n"
    assert numeric.decimal_rows([times[:0]], [0]) == b""
    rng = np.random.default_rng(5)
    for decimals in (0, 4, 9):
        values = rng.normal(size=5000) * 10.0 ** rng.integers(-8, 4, 5000)
        read = np.array(numeric.decimal_rows([values], [decimals]).split(), dtype=float)
        assert np.abs(read - values).max() <= 0.51 * 10.0**-decimals
    for value in (np.nan, np.inf, 1e300):
        with pytest.raises(ValueError, match="cannot be written"):
            numeric.decimal_rows([np.array([1.0, value])], [3])
