"""The effects of the catalogue that a recording may show, with the values of their scanned shapes."""

from __future__ import annotations

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.noise.twin import Twin

#: values over which a shape is scanned; it is refined between them.  More would make the work grow with the square of the session's length
#: (benchmarks/whole_process.py)
MOST_TIMES = 60


def candidates(twin: Twin) -> list[Effect]:
    """Candidate effects for this recording; an effect with a scanned shape gives one candidate for each value."""
    has_temp = all(np.isfinite(movement.temp_c).all() for movement in twin.movements)
    found = []
    for effect in catalogue().values():
        if effect.kind in ("register", "motion") or ("temperature" in effect.inputs and not has_temp):
            continue
        if effect.kind == "earth" and twin.problem.earth.source != "none":
            continue
        if effect.id == "reference.accelerometer" and twin.own_accelerometer:
            continue  # its nine parameters are those of these very stills
        found += effect.variants(scanned(twin, effect))
    return found


def scanned(twin: Twin, effect: Effect) -> np.ndarray:
    """(K,) trial values of an effect's scanned shape, SI: its own grid, or the middles of the turns."""
    if effect.scan is None or effect.scan.grid is None:
        # Middle of each turn except the first and the last, s of the session; a long session uses every n-th turn.
        times = [twin.movements[s.log].t_s[s.start] + s.duration_s / 2 for s in twin.segments][1:-1]
        return np.array(times[:: -(-len(times) // MOST_TIMES) or 1])
    return np.asarray(effect.scan.grid(twin.movements), dtype=float)
