"""A measured number for a person: two digits of its standard deviation, and the value to the same digit."""

from __future__ import annotations

from math import isfinite

MOST_DECIMALS = 12


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
