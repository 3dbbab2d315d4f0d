"""One recording twice in a folder: it would count as twice the evidence, and judge itself."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from session.checks.findings import Finding
from session.log.logfile import Log

#: samples that two recordings cannot have in common by chance: a sensor has noise
LEAST = 100


def check_copies(logs: tuple[Log, ...]) -> list[Finding]:
    """An error for each log or closure run whose readings are another's, whole or as far as the shorter one goes."""
    do = "remove one of them: a copy makes every sigma too small, and is held out of nothing"
    return [
        Finding("error", second.path.name, "copy", f"holds the same readings as {first.path.name}", do)
        for first, second in combinations(logs, 2)
        if _same(first.samples.gyro, second.samples.gyro)
    ]


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    count = min(len(one), len(other))
    if count < LEAST or np.ptp(one[:count], axis=0).max() == 0:
        return False
    return np.array_equal(one[:LEAST], other[:LEAST]) and np.array_equal(one[:count], other[:count])
