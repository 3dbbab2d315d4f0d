"""Numbers as text: the decimals of any number, or a refusal."""

import numpy as np
import pytest

from session.base import numeric


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


def test_formatted_rows_are_those_of_python():
    """Whole numbers, decimals, zeros of either sign, exponents, and blocks that hold what has more than nine decimals."""
    rng, count = np.random.default_rng(5), numeric.BLOCK + 50
    decimals = [np.round(rng.normal(size=count) * 10.0**-scale, places) for scale, places in ((0, 1), (-4, 3), (1, 4), (4, 7), (5, 9))]
    decimals[2][:40] = np.copysign(0.0, rng.normal(size=40))
    decimals[3][-1] = 1e-12
    decimals[4][:5] = 9.9e-5, 1e-4, -1e-9, -2.5, 1.23456e-4
    columns = [np.arange(count) - 3, np.ones(count, dtype=np.int8), np.rint(decimals[1]), *decimals, decimals[1] / 3]
    for formats in (["%d"] * 3 + ["%r"] * 5 + ["%.15g"], ["%d"] * 3 + ["%r"] * 5, ["%d"] * 3 + ["%r"] * 2, ["%d"] * 3 + ["%r"] * 3):
        used = columns[: len(formats)]
        rows = zip(*(column.tolist() for column in used), strict=True)
        assert b"".join(numeric.formatted_rows(used, formats)).decode() == "".join(",".join(formats) % row + "\n" for row in rows)
    for value in (np.nan, np.inf, 1e200, 2.0**31, 1e16):
        assert b"".join(numeric.formatted_rows([np.array([value])], ["%r"])).decode() == f"{value!r}\n"
