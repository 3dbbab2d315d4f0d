"""Noise at rest of a fleet's units, where ``fit/noise.json`` lies in their session folders: a row of each, and the spread between units.

The figures are read from the folders when a page is made: they are of units, and no result of a session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.io.errors import CalibrationError
from session.io.texts import significant
from tinygc.annexes.lots.fleet_summary import IN_ORDER
from tinygc.annexes.lots.fleet_table import EACH, Table
from tinygc.noise.figures import FILE, NoiseFigures, read_figures
from tinygc.noise.measured import SHOWN, rms_of_axes
from tinygc.reporting.html.markup import Section, escape, table

TERMS = ("N", "B", "K")
#: units below which a spread says nothing; rows on a page
FEWEST, MOST_ROWS = 3, 100


@dataclass(frozen=True, eq=False)
class UnitNoise:
    """Figures of one unit: its serial number, or its folder where it has none."""

    name: str
    figures: NoiseFigures

    def value(self, name: str) -> tuple[float, float] | None:
        """Size of a term of the gyroscope, rms over the axes that show it, SI, and its relative sigma; None where none does."""
        return rms_of_axes(self.figures.gyro, name)


def unit_noises(opened: Table) -> list[UnitNoise]:
    """Return the last figures of each unit of an open table, in the order of recording; what cannot be read is passed over."""
    found: dict[str, UnitNoise] = {}
    for serial, folder in opened.each(f"SELECT ifnull(serial, ''), folder FROM {EACH} {IN_ORDER}"):
        path = Path(folder) / "fit" / FILE
        if not path.is_file():
            continue
        try:
            name = serial or Path(folder).name
            found[serial or folder] = UnitNoise(name, read_figures(path))
        except CalibrationError:  # fit of that session says it
            continue
    return list(found.values())


def spread_between(values: np.ndarray, relative: np.ndarray) -> float:
    """Relative spread of a size between units, from values (U,) and their relative sigmas (U,), without the measurement's share.

    The variance of ln of the values is that between units, and the mean square of their own sigmas.
    """
    return float(np.sqrt(max(np.var(np.log(values), ddof=1) - np.mean(relative**2), 0.0)))


def noise_section(units: Sequence[UnitNoise]) -> Section | None:
    """Return the section of a page; None where no unit has figures."""
    if not units:
        return None
    middle, spread, rows = ["median"], ["spread between units"], []
    for name in TERMS:
        known = [value for unit in units if (value := unit.value(name)) is not None]
        values, relative = np.array(known).reshape(-1, 2).T
        middle.append(significant(float(np.median(values)) / SHOWN["gyro"][name][1]) if known else "–")
        spread.append(f"{significant(100 * spread_between(values, relative), 2)} %" if len(known) >= FEWEST else "–")
    for unit in units[:MOST_ROWS]:
        rows.append((escape(unit.name), *(_cell(unit, name) for name in TERMS)))
    header = ("", *(f"{name}, {SHOWN['gyro'][name][0]}" for name in TERMS))
    words = "Gyroscopes at rest, rms of the axes that show a term ± one sigma. The spread is without the measurement's share."
    words += f" The first {MOST_ROWS} of {len(units)} units." if len(units) > MOST_ROWS else ""
    return Section("rest-noise", "Noise at rest", table(header, [middle, spread, *rows], words, marked=(0, 1)))


def _cell(unit: UnitNoise, name: str) -> str:
    si = SHOWN["gyro"][name][1]
    if (found := unit.value(name)) is not None:
        return f"{significant(found[0] / si)} ± {significant(found[0] * found[1] / si, 2)}"
    limit = float(unit.figures.gyro.at_most(name).max())
    return f"&lt; {significant(limit / si, 2)}" if np.isfinite(limit) else "–"
