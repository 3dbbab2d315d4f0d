"""Decimation of a long log for the twin: turns at every sample, everything else as means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from session.base.units import DEG
from session.detect.segments import Segment
from session.detect.stills import Still
from session.log.samples import Samples
from tinygc.closure.problem import LEFT_OUT, Problem
from tinygc.effects import Conditions, Movement, movement_of

# Decimation of a long log for the twin: turns at every sample, the time between them as means over a second.
#
# Means lose nothing at rest, where the twin uses only an effect's mean over a still.  A day at 208 Hz has 18 million rows, of which the
# turns take some hundred thousand, and effects have dozens of columns.

#: rows above which a session is decimated: more than an hour at 208 Hz
LONG = 1_000_000
#: s over which rests are averaged, and s around a turn that stay unchanged: many times the memory of a filter or a lag
TOGETHER_S, MARGIN_S = 1.0, 0.5
#: rows processed at once, and s of margin on either side: many times the averaging time of temperature and vibration
AT_ONCE, AROUND_S = 1 << 18, 5.0


@dataclass(frozen=True, eq=False)
class ThinnedMovement(Movement):
    """A movement with unequally spaced rows; dt_s is that of the turns."""

    @property
    def acceleration(self) -> np.ndarray:
        """(N, 3) rad/s^2, by differences over the unequal spacing."""
        return np.gradient(self.rate, self.t_s, axis=0)


@dataclass(frozen=True, eq=False)
class Thinning:
    """Decimation of one log: row k of the thinned log is the mean of rows edges[k] <= i < edges[k + 1], edges (M + 1,)."""

    edges: np.ndarray

    @property
    def counts(self) -> np.ndarray:
        """(M,) number of rows averaged in each thinned row."""
        return np.diff(self.edges)

    def row(self, row: int) -> int:
        """The thinned row that contains a row of the log."""
        return int(np.searchsorted(self.edges, row, side="right")) - 1

    def parts(self) -> list[tuple[int, int]]:
        """Parts (first, last) of the thinned log, ``first <= k < last``, each of about ``AT_ONCE`` original rows."""
        cuts = [0]
        while cuts[-1] < len(self.edges) - 1:
            behind = int(np.searchsorted(self.edges, self.edges[cuts[-1]] + AT_ONCE, side="right")) - 1
            cuts.append(max(behind, cuts[-1] + 1))
        return list(pairwise(cuts))

    def means(self, values: np.ndarray) -> np.ndarray:
        """Average values (N, …) to (M, …)."""
        return np.concatenate([self._means(values[self.edges[a] : self.edges[b]], a, b) for a, b in self.parts()])

    def _means(self, values: np.ndarray, first: int, last: int) -> np.ndarray:
        sums = np.add.reduceat(values, self.edges[first:last] - self.edges[first], axis=0)
        return sums / self.counts[first:last].reshape(-1, *(1,) * (values.ndim - 1))

    def samples(self, samples: Samples) -> Samples:
        """The thinned log; its period is that of the readings."""
        since_ns = self.means((samples.t_ns - samples.t_ns[0]).astype(float))
        t_ns = samples.t_ns[0] + np.rint(since_ns).astype(np.int64)
        temp_c = None if samples.temp_c is None else self.means(samples.temp_c)
        found = Samples(t_ns, self.means(samples.gyro), self.means(samples.accel), temp_c)
        found.__dict__["period_s"] = samples.period_s
        return found

    def movement(self, samples: Samples, thinned: Samples, rate: np.ndarray, known: Conditions, began_s: float) -> Movement:
        """Movement of a log and its thinned version, with rates (M, 3); temperature and vibration come from all readings."""
        around, found = round(AROUND_S / samples.period_s), []
        for a, b in self.parts():
            first, last = int(self.edges[a]), int(self.edges[b])
            begin, end = max(first - around, 0), min(last + around, len(samples))
            part = samples.between(begin, end)
            part.__dict__["period_s"] = samples.period_s
            moved = movement_of(part, part.gyro, known)
            own = slice(first - begin, last - begin)
            found.append([self._means(values[own], a, b) for values in (moved.force_g, moved.temp_c, moved.vibration_g2)])
        force_g, temp_c, vibration_g2 = (np.concatenate(column) for column in zip(*found, strict=True))
        return ThinnedMovement(
            t_s=began_s + thinned.t_s,
            dt_s=samples.period_s,
            rate=rate,
            force_g=force_g,
            temp_c=temp_c,
            vibration_g2=vibration_g2,
            **vars(known),
        )


def thinned(problem: Problem) -> tuple[Problem, list[Thinning] | None]:
    """Thin the logs, stills and segments of a problem, and return it with the decimation of each log; a short problem, or one with another
    reference, is returned unchanged, with None."""
    if problem.session.reference is not None or sum(len(log.samples) for log in problem.logs) <= LONG:
        return problem, None
    thinnings, logs = [], []
    moved: dict[int, Still] = {}
    for number, log in enumerate(problem.logs):
        # Excluded turns count as well: a memory is then the same in a part of the session as in the whole.
        turns = [s for s in problem.segments if s.log == number and s.problem in (None, LEFT_OUT)]
        own = Thinning(_edges(log.samples, log.stills, turns))
        stills = [replace(still, start=own.row(still.start), stop=own.row(still.stop - 1) + 1) for still in log.stills]
        moved |= {id(before): after for before, after in zip(log.stills, stills, strict=True)}
        bridges = tuple(replace(bridge, row=own.row(bridge.row)) for bridge in log.bridges)
        logs.append(replace(log, samples=own.samples(log.samples), stills=stills, bridges=bridges))
        thinnings.append(own)

    def there(segment: Segment) -> Segment:
        own = thinnings[segment.log]
        first, last = (moved.get(id(still), still) for still in segment.stills)
        return replace(segment, first=first, last=last, start=own.row(segment.start), stop=own.row(segment.stop - 1) + 1)

    return problem.changed(logs=logs, segments=[there(segment) for segment in problem.segments]), thinnings


def movement_in(problem: Problem, seen: Problem, thinnings: list[Thinning] | None, number: int) -> Movement:
    """Movement of one log, as passed to effects; seen, thinnings: the result of ``thinned`` for the problem."""
    samples = seen.logs[number].samples
    rate, known, began_s = problem.first(samples.gyro), conditions(problem), float(problem.began_s[number])
    if thinnings is None:
        return movement_of(samples, rate, known, began_s)
    return thinnings[number].movement(problem.logs[number].samples, samples, rate, known, began_s)


def _edges(samples: Samples, stills: list[Still], segments: list[Segment]) -> np.ndarray:
    """Edges (M + 1,): every row of these segments, the ends of every still, and one row per second between."""
    count, margin = len(samples), round(MARGIN_S / samples.period_s)
    edge = np.zeros(count + 1, dtype=bool)
    edge[:: max(1, round(TOGETHER_S / samples.period_s))] = True
    for still in stills:
        edge[[still.start, still.stop]] = True
    for segment in segments:
        edge[max(segment.start - margin, 0) : segment.stop + margin + 1] = True
    edge[[0, 1, count - 1, count]] = True  # keep the first and last times
    return np.flatnonzero(edge)


# Means over the stills of one log, a few stills at a time, to avoid a copy of the whole log.

#: rows of stills that are averaged at once
MEANS_AT_ONCE = 1 << 16


class StillMeans:
    """Means over the stills of one log; counts (N,): readings averaged in each row, if more than one."""

    def __init__(self, stills: list[Still], counts: np.ndarray | None):
        self._counts = counts
        self._rows = np.concatenate([np.arange(still.start, still.stop) for still in stills] or [np.zeros(0, dtype=int)])
        #: the row at which each still begins, and the one at which the last ends
        self._edges = np.concatenate([[0], np.cumsum([still.stop - still.start for still in stills], dtype=int)])

    def __call__(self, values: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Average over the stills to (Q, …) what a function gives for the numbers (n,) of some rows: (n, …)."""
        found = []
        for part in self._parts() or [np.zeros(1, dtype=int)]:
            own, begin = self._rows[part[0] : part[-1]], part[:-1] - part[0]
            each, count = values(own), np.diff(part)
            tail = (1,) * (each.ndim - 1)
            if self._counts is not None:
                weight = self._counts[own]
                each, count = each * weight.reshape(-1, *tail), np.add.reduceat(weight, begin)
            found.append(np.add.reduceat(each, begin, axis=0) / count.reshape(-1, *tail))
        return np.concatenate(found)

    def _parts(self) -> list[np.ndarray]:
        """Edges of groups of neighbouring stills with about ``AT_ONCE`` rows each."""
        stills = len(self._edges) - 1
        cuts = np.unique([*np.searchsorted(self._edges[:-1], np.arange(0, len(self._rows), MEANS_AT_ONCE)), stills])
        return [self._edges[first : last + 1] for first, last in pairwise(cuts)]


def conditions(problem: Problem) -> Conditions:
    """Reference conditions of a session."""
    first = problem.logs[0].samples
    return Conditions(
        duration_s=float(problem.began_s[-1]),
        fs_rps=problem.session.config.sensor.gyro_fs_dps * DEG,
        first_temp_c=float("nan") if first.temp_c is None else float(first.temp_c[: max(1, round(1 / first.period_s))].mean()),
    )
