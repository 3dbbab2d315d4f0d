"""A log's temperatures as a body can have them: readings that failed are left out, and a column without a unit gets one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.base.numeric import smallest_step
from session.base.units import TEMPERATURE, Unit

#: degC: twice the step of the coarsest thermometers; a smaller excursion is left
_EXCURSION_C = 2.0
#: readings on either side of one that is examined; most that fail in a row: a body that warms and cools again takes more
AROUND, IN_A_ROW = 20, 5
#: interquartile ranges of the readings around, beyond their quartiles: 9 sigmas of white noise
_FENCE = 6.0
#: at once: of a register that is taken for degrees every reading jumps
_MOST_AT_ONCE = 1 << 15


def failed(temp_c: np.ndarray) -> np.ndarray:
    """(N,) bool: readings (N,) degC that failed.  They jump away from those around and back, which no body does.

    A reading that stands for several rows counts once.  A jump that does not return is a body's, or another's; so is what comes gradually.
    """
    out = np.zeros(len(temp_c), dtype=bool)
    jumps = np.abs(np.diff(temp_c)) > _EXCURSION_C
    if not jumps.any():
        return out
    changes = np.flatnonzero(np.diff(temp_c)) + 1
    held = int(np.diff(changes).min(initial=len(temp_c))) if len(changes) > 1 else 1
    edges = np.concatenate([[0], np.flatnonzero(jumps) + 1, [len(temp_c)]])
    short = np.diff(edges) <= IN_A_ROW * held
    starts, stops = edges[:-1][short], edges[1:][short]
    whole = min(2 * AROUND, (len(temp_c) - 1) // held)
    for at in range(0, len(starts), _MOST_AT_ONCE):
        begin, end = (part[at : at + _MOST_AT_ONCE] for part in (starts, stops))
        middle = (begin + end - 1) // 2
        first = np.clip(middle - AROUND * held, 0, len(temp_c) - 1 - whole * held)
        low, high = np.quantile(temp_c[first[:, None] + held * np.arange(whole + 1)], [0.25, 0.75], axis=1)
        beyond = np.maximum(low - temp_c[middle], temp_c[middle] - high) > _FENCE * (high - low) + _EXCURSION_C
        for start, stop in zip(begin[beyond].tolist(), end[beyond].tolist(), strict=True):
            out[start:stop] = True
    return out


class Sound:
    """Puts the last sound reading in the place of each that failed, piece by piece of one log, and counts them."""

    def __init__(self) -> None:
        self.count = 0
        self._low, self._high = np.inf, -np.inf

    def __call__(self, temp_c: np.ndarray | None, written: np.ndarray | None = None) -> np.ndarray | None:
        """Of readings (N,) degC; written: the same as the file has them, returned in their place."""
        if temp_c is None or not (out := failed(temp_c)).any() or out.all():
            return temp_c if written is None else written
        self.count += int(np.count_nonzero(out))
        self._low, self._high = min(self._low, float(temp_c[out].min())), max(self._high, float(temp_c[out].max()))
        sound = np.flatnonzero(~out)
        before = np.maximum(np.searchsorted(sound, np.arange(len(out)), side="right") - 1, 0)
        return (temp_c if written is None else written)[sound[before]]

    @property
    def notes(self) -> list[str]:
        """One line, where any failed."""
        ends = " to ".join(f"{value:g}" for value in dict.fromkeys((self._low, self._high)))
        many = "reading of the thermometer jumps" if self.count == 1 else "readings of the thermometer jump"
        return [f"{self.count} {many} away and back ({ends} °C), as no body does: left out"] if self.count else []


#: the step of a thermometer's readings, degC, and one of them
Grid = tuple[float, float]
NO_GRID: Grid = (0.0, 0.0)


def grid_with(grid: Grid, temp_c: np.ndarray | None) -> Grid:
    """The grid of readings so far, and of the next (N,) degC."""
    if temp_c is None or not len(temp_c) or not np.isfinite(temp_c).all():
        return grid
    return min(filter(None, (grid[0], smallest_step(temp_c))), default=0.0), float(temp_c[0])


#: degC: of a thermometer near people or in a chamber, as a log writes it in whole numbers
WHOLE_C = (-60.0, 150.0)


def degrees_by(cells: Sequence[str]) -> Unit | None:
    """degC, where the first cells of a column without a unit, in a log whose other columns state theirs, are whole degrees: they go
    from one number to the next, as a register of hundreds of counts a degree does not.  None where they are another's."""
    try:
        values = np.array([int(cell) for cell in cells], dtype=float)
    except ValueError:
        return None
    if not len(values) or not WHOLE_C[0] <= np.median(values) <= WHOLE_C[1]:
        return None
    return Unit(TEMPERATURE["degc"], "degc") if np.median(np.abs(np.diff(values, prepend=values[0]))) <= 1 else None
