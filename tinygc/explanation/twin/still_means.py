"""Means over the stills of one log, some stills at a time: all of them together would be another copy of the log."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from session.detect.stills import Still

#: rows of stills that are averaged at once
AT_ONCE = 1 << 16


class StillMeans:
    """Of stills of one log; counts (N,): readings that each row stands for, where that is not one."""

    def __init__(self, stills: list[Still], counts: np.ndarray | None):
        self._counts = counts
        self._rows = np.concatenate([np.arange(still.start, still.stop) for still in stills] or [np.zeros(0, dtype=int)])
        #: where each still begins among these rows, and where the last one ends
        self._edges = np.concatenate([[0], np.cumsum([still.stop - still.start for still in stills], dtype=int)])

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(Q, …) of samples (N, …)."""
        tail = (1,) * (values.ndim - 1)
        found = [np.zeros((0, *values.shape[1:]))]
        for part in self._parts():
            own, begin = self._rows[part[0] : part[-1]], part[:-1] - part[0]
            each, count = values[own], np.diff(part)
            if self._counts is not None:
                weight = self._counts[own]
                each, count = each * weight.reshape(-1, *tail), np.add.reduceat(weight, begin)
            found.append(np.add.reduceat(each, begin, axis=0) / count.reshape(-1, *tail))
        return np.concatenate(found)

    def _parts(self) -> list[np.ndarray]:
        """Edges of neighbouring stills, of ``AT_ONCE`` rows or so together."""
        stills = len(self._edges) - 1
        cuts = np.unique([*np.searchsorted(self._edges[:-1], np.arange(0, len(self._rows), AT_ONCE)), stills])
        return [self._edges[first : last + 1] for first, last in pairwise(cuts)]
