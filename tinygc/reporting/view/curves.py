"""Rates, force and temperature over time, as the least and the greatest of short spans: as many as a screen has room for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.base.units import DEG, NS, STANDARD_GRAVITY_MPS2
from session.log.logfile import Log
from session.log.samples import Samples, start_times

#: spans of a whole session: what a file keeps, and what a wide view is drawn from
MOST = 20_000
#: of each column (gyro °/s, force g, temperature °C), decimals that are sent
DECIMALS = (3, 3, 3, 5, 5, 5, 3)


class Curves:
    """The logs of a session, one after the other; ``began_s`` (logs + 1,): where each begins."""

    def __init__(self, logs: Sequence[Log]):
        self._samples = [log.samples for log in logs]
        self.began_s = start_times(self._samples)
        self.size = max(1, -(-sum(map(len, self._samples)) // MOST))
        self._spans = [_spans(samples, 0, len(samples), self.size) for samples in self._samples]

    def between(self, from_s: float, to_s: float, count: int = MOST) -> list[dict[str, list]]:
        """Of each log that lies there: ``t`` (n,) s of the session, ``low`` and ``high`` (7, n), n at most about ``count``; single samples
        have no ``high``; a column that was not recorded is empty."""
        pieces = []
        for samples, spans, began_s in zip(self._samples, self._spans, self.began_s, strict=False):
            if to_s < began_s or from_s > began_s + samples.duration_s:
                continue
            ends_s = np.clip(np.array([from_s, to_s]) - began_s, -1.0, samples.duration_s + 1.0)
            ends_ns = samples.t_ns[0] + np.rint(ends_s / NS).astype(np.int64)
            first, last = map(int, np.searchsorted(samples.t_ns, ends_ns))
            start, stop = max(first - 1, 0), min(last + 1, len(samples))
            step = -(-(stop - start) // count)
            if step < self.size:
                t_s, low, high = _spans(samples, start, stop, step)
            else:
                low_row, high_row, width = start // self.size, -(-stop // self.size), step // self.size
                t_s, low, high = (each[low_row:high_row] for each in spans)
                rows = np.arange(0, len(t_s), width)
                t_s, low, high = t_s[rows], np.minimum.reduceat(low, rows), np.maximum.reduceat(high, rows)
            piece = {"t": (t_s + began_s).round(6).tolist(), "low": _columns(low)}
            pieces.append(piece if step == 1 else piece | {"high": _columns(high)})
        return pieces


def _spans(samples: Samples, start: int, stop: int, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (n,) s of the log, least and greatest (n, 7) of spans of ``size`` samples."""
    parts = []
    for first in range(start, stop, chunk := size * max(1, 500_000 // size)):  # part by part: a long log is never held as float64
        rows = slice(first, min(first + chunk, stop))
        temp = np.full((rows.stop - first, 1), np.nan) if samples.temp_c is None else samples.temp_c[rows][:, None]
        values = np.hstack([samples.gyro[rows] / DEG, samples.accel[rows] / STANDARD_GRAVITY_MPS2, temp])
        at = np.arange(0, len(values), size)
        t_s = (samples.t_ns[rows][at] - samples.t_ns[0]) * NS
        parts.append((t_s, np.minimum.reduceat(values, at), np.maximum.reduceat(values, at)))
    t_s, low, high = (np.concatenate(each) for each in zip(*parts, strict=True))
    return t_s, low, high


def _columns(values: np.ndarray) -> list[list[float]]:
    return [[] if np.isnan(column).any() else column.round(digits).tolist() for column, digits in zip(values.T, DECIMALS, strict=True)]
