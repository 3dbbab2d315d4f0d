"""The constants that are tried before they are sharpened: of functions by the quantity's own size in the recording, and of lags."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tinygc.discovery.grammar.functions import FUNCTIONS

#: s: from what a filter does to what a package remembers; neighbours differ by three
LAGS_S = (0.05, 0.15, 0.5, 1.5, 5.0, 15.0, 50.0)
#: of the quantity's largest size
FINE, COARSE = (0.01, 0.025, 0.06, 0.12, 0.25, 0.5, 0.75), (0.03, 0.12, 0.4)
#: rad of an angle turned: a turn, a half and a quarter of it
ANGLES = (np.pi / 2, np.pi, 2 * np.pi)
#: s: of a time constant since switch-on or since the last turn
DECAYS_S = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: Hz, of a clock or a line; closer than half of what a session tells apart they are sharpened
HIGHEST_HZ = 2.0
#: at most so many
MOST_PERIODS = 400


def constants_of(name: str, function: str, largest: Mapping[str, float], finely: bool) -> list[float | None]:
    """Constants of a function of a quantity that are tried, in the quantity's unit; ``[None]`` where it has none."""
    if FUNCTIONS[function].constant is None:
        return [None]
    size = largest[name]
    if name == "time" and function in ("wave", "clock"):
        lines = np.arange(1.0, min(HIGHEST_HZ * size, MOST_PERIODS / 2) + 0.25, 0.5)
        return [round_to(size / line) for line in lines]
    if name == "turned":
        return list(ANGLES)
    if name in ("time", "rest") and function == "decay":
        return [value for value in DECAYS_S if value < 2 * size]
    return [round_to(share * size) for share in (FINE if finely else COARSE)]


def round_to(value: float, digits: int = 4) -> float:
    """A constant that a person can read."""
    return float(f"{value:.{digits}g}")
