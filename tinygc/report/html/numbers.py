"""Numbers as a person reads them: as many digits as are known, a true minus sign, thin spaces between thousands."""

from __future__ import annotations

from math import floor, isfinite, log10

import numpy as np

from session.common.units import DEG

NONE = "–"


def fixed(value: float, decimals: int) -> str:
    """With so many decimals."""
    if not isfinite(value):
        return NONE
    text = f"{value:,.{max(decimals, 0)}f}".replace(",", "\u202f").replace("-", "−")
    return text.removeprefix("−") if not any(digit in "123456789" for digit in text) else text


def significant(value: float, digits: int = 3) -> str:
    """With so many significant digits, never as a power of ten."""
    if not isfinite(value) or value == 0:
        return "0" if value == 0 else NONE
    return fixed(value, digits - 1 - floor(log10(abs(value)) + 1e-12))


def decimals_for(expanded: float) -> int:
    """Decimals that give an uncertainty two significant digits."""
    return 0 if not isfinite(expanded) or expanded <= 0 else max(0, 1 - floor(log10(expanded) + 1e-12))


def aligned_decimals(floor_deg: float) -> int:
    """Decimals for a column of closures in degrees: a digit beyond the floor's second."""
    return decimals_for(floor_deg) + 1


def degrees(angle_rad: float) -> str:
    """An angle in degrees, with its sign ``°``."""
    return f"{significant(angle_rad / DEG)}°"


def tilt_rms(angles: np.ndarray) -> float:
    """rad: root mean square tilt of error angles (S, 2 or 3)."""
    return float(np.sqrt(np.mean(np.sum(angles[:, :2] ** 2, axis=1))))


def probability(p: float) -> str:
    """``p = 0.31``, or a bound."""
    if not isfinite(p):
        return f"p {NONE}"
    if p < 1e-99:
        return "p < 10⁻⁹⁹"
    if p >= 1e-3:
        return f"p = {significant(p, 2)}"
    return f"p = {power_of_ten(p)}"


def power_of_ten(value: float) -> str:
    """``3 × 10⁻⁷``."""
    exponent = floor(log10(value))
    superscript = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{value / 10**exponent:.0f} × 10{superscript}"
