"""The constants that are tried before they are sharpened: of functions by the quantity's own size in the recording, and of lags.

Every grid has the same number of places whatever the recording, so that a form means the same, and costs the same bits, in all of them.
Neighbours differ by two or so: a true constant between them is near enough for the one beside it to be seen, and sharpening
(``screen``) ends at it.
"""

from __future__ import annotations

import numpy as np

#: of the quantity's largest size: thresholds, dead zones, limits; in products fewer
SHARES, FEW_SHARES = (0.01, 0.025, 0.05, 0.1, 0.2, 0.35, 0.55, 0.8), (0.03, 0.1, 0.3, 0.6)
#: likewise, of a step, of which a calibration leaves no more than what is near it: a step a fourth off is still half like it
STEPS = tuple((0.02 * 1.3 ** np.arange(15)).tolist())
#: likewise, of what fades: from a settling of seconds in a session of minutes to one that is hardly more than a slope
FADES, FEW_FADES = (0.001, 0.003, 0.008, 0.02, 0.05, 0.12, 0.3, 0.7, 1.6, 4.0), (0.008, 0.03, 0.1, 0.3, 1.0)
#: s: from what a filter does to what a package remembers; of what warms up slowly
LAGS_S = (0.05, 0.15, 0.5, 1.5, 5.0, 15.0, 50.0, 150.0)
SLOW_LAGS_S = (1.5, 5.0, 15.0, 50.0, 150.0, 500.0)
#: s: in products
FEW_LAGS_S, FEW_SLOW_LAGS_S = (0.15, 0.5, 1.5, 5.0, 15.0, 50.0), (5.0, 15.0, 50.0, 150.0)
#: cycles over twice the largest size, of a wave over a quantity with both signs
CYCLES, FEW_CYCLES = tuple(np.arange(1.0, 12.5, 0.5).tolist()), (1.0, 2.0, 4.0)
#: cycles over the session, of a line: closer than half of what it tells apart they are sharpened; of a square wave; in products
LINES = tuple(np.arange(0.5, 200.25, 0.5).tolist())
CLOCKS, FEW_LINES = LINES[1:40], LINES[:40]
#: times in a full turn
TIMES_A_TURN = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)
#: of a register, over the largest size: half a step more or less moves the last by no more
COUNTS = tuple(np.arange(2.0, 32.25, 0.5).tolist())

PERIODIC, FADING, STEPPED = ("wave", "clock"), ("decay", "signed_decay", "settle"), ("beyond", "signed_beyond", "above", "band", "latch")


def places(quantity: str, function: str, few: bool = False) -> tuple[float, ...]:
    """Of a function's constant, as ``constant_at`` takes them; few: in a product."""
    if quantity == "turned" and function in PERIODIC:
        return TIMES_A_TURN
    if quantity == "time" and function in PERIODIC:
        return FEW_LINES if few else CLOCKS if function == "clock" else LINES
    if function in PERIODIC:
        return FEW_CYCLES if few else CYCLES
    if function == "saw":
        return COUNTS
    if function in FADING:
        return FEW_FADES if few else FADES
    if function in STEPPED and not few:
        return STEPS
    return FEW_SHARES if few else SHARES


def constant_at(quantity: str, function: str, place: float, largest: float) -> float:
    """In the quantity's unit, of one whose largest size is given."""
    if quantity == "turned" and function in PERIODIC:
        return 2 * np.pi / place
    if function in PERIODIC:
        return _round((1.0 if quantity == "time" else 2.0) * largest / place)
    return _round(largest / place if function == "saw" else largest * place)


def lags_of(quantity: str, few: bool = False) -> tuple[float, ...]:
    """s, of a quantity that may be looked at behind a lag."""
    if quantity in ("temperature", "vibration", "temperature_rate"):
        return FEW_SLOW_LAGS_S if few else SLOW_LAGS_S
    return FEW_LAGS_S if few else LAGS_S


def _round(value: float) -> float:
    """To four digits: a constant that a person can read, which is to be sharpened."""
    return float(f"{value:.4g}")
