"""How large each quantity is in a recording, and whether it varies enough to be asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.discovery.grammar.quantities import QUANTITIES, Quantity
from tinygc.effects import Movement
from tinygc.explanation.naming.unknown import LEAST_CHANGE_C

#: g^2: below this nothing but the accelerometer's own noise vibrates (a tenth of a per cent of g)
LEAST_VIBRATION_G2 = 1e-6
#: of the readings' step, from which on samples are equally far apart
EVEN = 1e-3


def largest_of(movements: Sequence[Movement]) -> dict[str, float]:
    """Quantity -> its largest size over all logs; 0 where it is missing, or varies too little."""
    even = all(np.ptp(np.diff(movement.t_s)) < EVEN * movement.dt_s + 1e-9 for movement in movements)
    return {name: _largest(quantity, movements) if even or not quantity.memory else 0.0 for name, quantity in QUANTITIES.items()}


def _largest(quantity: Quantity, movements: Sequence[Movement]) -> float:
    if "temperature" in quantity.inputs:
        temps = [movement.temp_c for movement in movements]
        if not all(np.isfinite(temp).all() for temp in temps) or np.ptp(np.concatenate(temps)) < LEAST_CHANGE_C:
            return 0.0
    values = np.concatenate([quantity.of(movement) for movement in movements])
    size = float(np.abs(values).max(initial=0.0))
    if quantity.name == "vibration" and size < LEAST_VIBRATION_G2:
        return 0.0
    return size if np.isfinite(size) and np.ptp(values, axis=0).max() > 0 else 0.0
