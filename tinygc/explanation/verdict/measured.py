"""A measured number for a person: two digits of its standard deviation, and the value to the same digit; and a p-value that underflows."""

from __future__ import annotations

from math import isfinite

MOST_DECIMALS = 12
#: a double holds no p-value much below this; what is smaller is written as this, and said to be a bound
SMALLEST_P = 1e-300


def measured(value: float, std: float | None = None) -> str:
    """``0.000951 ± 0.000012``; five digits of a value whose std is not known, or nothing."""
    if std is None or not isfinite(std) or std <= 0 or not isfinite(value):
        return f"{value:.5g}"
    decimals = 1 - int(f"{std:.1e}".split("e")[1])
    if decimals > MOST_DECIMALS:
        return f"{value:.5g} ± {std:.2g}"
    if decimals < 0:  # both end in zeros
        return f"{round(value, decimals):.0f} ± {round(std, decimals):.0f}"
    return f"{value:.{decimals}f} ± {std:.{decimals}f}"


def p_entry(name: str, p_value: float) -> dict:
    """A p-value for JSON: itself under its name, or ``SMALLEST_P`` with ``<name>_is_upper_bound``, for readers that take logarithms."""
    return {name: p_value} if p_value >= SMALLEST_P else {name: SMALLEST_P, f"{name}_is_upper_bound": True}


def p_words(p_value: float) -> str:
    """``= 0.012``, or ``< 1e-99``."""
    return f"= {p_value:.2g}" if p_value > 1e-99 else "< 1e-99"
