"""What the terminal's page says: numbers to two digits of their std, words for signs, nothing where there is nothing."""

import pytest

from tinygc.explanation.verdict.measured import measured


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.00095123, 0.0000123, "0.000951 ± 0.000012"),
        (0.0000101, 0.0000004, "0.00001010 ± 0.00000040"),
        (-0.155034, 0.00628, "-0.1550 ± 0.0063"),
        (217.2071, 0.4344, "217.21 ± 0.43"),
        (60.17, 12.4, "60 ± 12"),
        (1234.0, 120.0, "1230 ± 120"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (9.5, 0.999, "9.5 ± 1.0"),
    ],
)
def test_a_value_ends_where_two_digits_of_its_std_end(value, std, text):
    assert measured(value, std) == text


@pytest.mark.parametrize("std", [None, 0.0, float("nan"), float("inf")])
def test_a_value_without_a_std_has_five_digits(std):
    assert measured(3.14159265, std) == "3.1416"
    assert measured(12.0, std) == "12"
