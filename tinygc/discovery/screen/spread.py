"""Of a long session, the turns by which all forms are screened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.explanation.twin.twin import Twin

#: turns: screening grows with their square (benchmarks/discover_speed.py)
MOST_TURNS = 120
#: neighbours that are taken together, so that they share the stills between them
NEIGHBOURS = 10


@dataclass(frozen=True, eq=False)
class Part:
    """Numbers of segments and of stills, and where they are (n,) among the stacked channels."""

    segments: np.ndarray
    stills: np.ndarray
    rows: np.ndarray


def spread(twin: Twin) -> Part | None:
    """Groups of neighbouring turns, evenly over the session, with the stills beside them; None where there are few enough for all."""
    count, d, q = len(twin.segments), twin.batch.angles, len(twin.stills)
    if count <= MOST_TURNS:
        return None
    groups = MOST_TURNS // NEIGHBOURS
    first = np.round(np.linspace(0, count - NEIGHBOURS, groups)).astype(int)
    segments = np.unique(first[:, None] + np.arange(NEIGHBOURS))
    stills = np.unique(np.concatenate([twin.first[segments], twin.last[segments]]))
    stills = stills[stills >= 0]
    rows = [
        (segments[:, None] * d + np.arange(d)).ravel(),
        count * d + (stills[:, None] * 3 + np.arange(3)).ravel(),
        count * d + 3 * q + stills,
    ]
    return Part(segments, stills, np.concatenate(rows))
