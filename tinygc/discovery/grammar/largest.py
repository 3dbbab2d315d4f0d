"""How large each quantity is in a recording, and whether it varies enough to be asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.discovery.grammar.quantities import QUANTITIES, Quantity
from tinygc.effects import Movement

#: degC: at a data sheet's 0.005 dps/degC that is 2.5 mdps, a still's own noise
LEAST_CHANGE_C = 0.5
#: g^2: below this nothing but the accelerometer's own noise vibrates (a thousandth of g, of a part of 100 ug/rtHz at 100 Hz)
LEAST_VIBRATION_G2 = 1e-6


def largest_of(movements: Sequence[Movement]) -> dict[str, float]:
    """Quantity -> its largest finite size over all logs of two rows or more; 0 where it is missing in one, or varies too little.

    Readers refuse a reading that is no number, so a temperature is missing in a whole log or nowhere.  It is then not asked for, as
    ``candidates`` asks no effect of the catalogue; ``learnable`` says of it that no law would be found.
    """
    movements = [movement for movement in movements if len(movement.t_s) > 1]
    if not movements:
        return dict.fromkeys(QUANTITIES, 0.0)
    return {name: _largest(quantity, movements) for name, quantity in QUANTITIES.items()}


def _largest(quantity: Quantity, movements: Sequence[Movement]) -> float:
    if "temperature" in quantity.inputs:
        temps = np.concatenate([movement.temp_c for movement in movements])
        if not np.isfinite(temps).all() or np.ptp(temps) < LEAST_CHANGE_C:
            return 0.0
    values = np.concatenate([quantity.of(movement) for movement in movements])
    if not np.isfinite(values).all() or not np.ptp(values, axis=0).max(initial=0.0) > 0:
        return 0.0
    size = float(np.abs(values).max())
    return 0.0 if quantity.name == "vibration" and size < LEAST_VIBRATION_G2 else size
