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


def p_entry(name: str, p_value: float, bound: bool = False) -> dict:
    """A p-value for JSON, with ``<name>_is_upper_bound`` where it is no more than that: smaller than any number, for readers that take
    logarithms, or taken from the bar of a detector."""
    return {name: max(p_value, SMALLEST_P), **({f"{name}_is_upper_bound": True} if bound or p_value < SMALLEST_P else {})}


def p_words(p_value: float, bound: bool = False) -> str:
    """``= 0.012``, ``< 0.012`` for a bound, or ``< 1e-99``."""
    return f"{'<' if bound else '='} {p_value:.2g}" if p_value > 1e-99 else "< 1e-99"
