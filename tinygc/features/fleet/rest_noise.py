"""Noise at rest of a fleet's units, where ``fit/noise.json`` lies in their session folders: medians, and the spread between units.

The figures are read from the folders when a page is made: they are of units, and no result of a session.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError
from session.base.texts import significant
from tinygc.features.fleet.fleet_summary import IN_ORDER
from tinygc.features.fleet.fleet_table import EACH, Table
from tinygc.noise.figures import FILE, NoiseFigures, read_figures
from tinygc.noise.measured import SHOWN, rms_of_axes
from tinygc.reporting.html.markup import Section, table

TERMS = ("N", "B", "K")
#: units below which a spread says nothing
FEWEST = 3


def unit_noises(opened: Table) -> list[NoiseFigures]:
    """Return the last figures of each unit of an open table; what cannot be read is passed over."""
    found: dict[str, NoiseFigures] = {}
    for serial, folder in opened.each(f"SELECT ifnull(serial, ''), folder FROM {EACH} {IN_ORDER}"):
        path = Path(folder) / "fit" / FILE
        if not path.is_file():
            continue
        try:
            found[serial or folder] = read_figures(path)
        except CalibrationError:  # fit of that session says it
            continue
    return list(found.values())


def spread_between(values: np.ndarray, relative: np.ndarray) -> float:
    """Relative spread of a size between units, from values (U,) and their relative sigmas (U,), without the measurement's share.

    The variance of ln of the values is that between units, and the mean square of their own sigmas.
    """
    return float(np.sqrt(max(np.var(np.log(values), ddof=1) - np.mean(relative**2), 0.0)))


def noise_sections(units: Sequence[NoiseFigures]) -> list[Section]:
    """Return the section of a page; none where no unit has figures."""
    if not units:
        return []
    rows = []
    for name in TERMS:
        known = [value for unit in units if (value := rms_of_axes(unit.gyro, name)) is not None]
        values, relative = np.array(known).reshape(-1, 2).T
        unit, si = SHOWN["gyro"][name]
        middle = significant(float(np.median(values)) / si) if known else "–"
        spread = f"{significant(100 * spread_between(values, relative), 2)} %" if len(known) >= FEWEST else "–"
        rows.append((f"{name}, {unit}", str(len(known)), middle, spread))
    words = "Gyroscopes at rest, rms of the axes that show a term. The spread is without the measurement's share."
    return [Section("rest-noise", "Noise at rest", table(("", "units", "median", "spread between units"), rows, words))]
