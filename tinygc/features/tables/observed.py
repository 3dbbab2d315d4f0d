"""What a session of a table observes: rests and turns, each with the sensor's means and the machine's word.

Everything that the table's errors are estimated from is in this record: a test draws one directly, a recording is reduced to one.  Rates
are readings in rad/s; a turn's are means over equal blocks, such that each block's product with its time is the rotation vector of its
readings. Specific force is in g of the site, with the pre-calibration of session.toml applied.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from session.base.errors import DataError
from session.base.numeric import running_sum
from session.base.units import DEG, NS
from session.log.samples import Samples
from tinygc.closure.problem import Problem
from tinygc.features.tables.machines.angles import AngleLog, on_its_clock
from tinygc.features.tables.machines.description import Description

#: s of a turn's blocks, at least: faster polls than this add noise of their stamps alone (benchmarks/table_errors.py)
SHORTEST_BLOCK_S = 0.04
#: rad that an axis turns at least, where it counts as turned; a stage's own jitter is less
TURNED_RAD = 0.5 * DEG
#: fewer rests or turns show nothing of a table
FEWEST_RESTS, FEWEST_TURNS = 4, 3
#: blocks of a turn, at most: a longer turn has longer blocks
MOST_BLOCKS = 120
#: an answer whose stamp differs from those of its neighbours by so many sigmas of the session was held up; answers among which it is
#: compared
HELD_UP, NEIGHBOURS = 5.0, 5
#: s: stamps of samples are no better
LEAST_JITTER_S = 1e-3
#: shares of a turn's fastest rate from which an answer shows how late it is, and from which how early
SHOWS_LATE, SHOWS_EARLY = 0.1, 0.5


@dataclass(frozen=True, eq=False)
class Observed:
    """Q rests and S turns between them, in the order of time.

    table; rest_s, rest_span_s (Q,): middle and length; force (Q, 3) g and rate (Q, 3) rad/s: means; temp_c (Q,) or NaN; stated (Q, K) rad.
    first, last (S,): the rests of each turn; turn_s (S,): its middle; block_s (S,): length of its blocks; blocks (S,): how many; rates
    (S, B, 3) rad/s, zero beyond the last; reported_edges (S, B + 1, K) rad: the machine's word at the edges, the last one repeated;
    answer_at (S, B + 1): place of each edge among the answers of its turn, 2.5 in the middle between the answers 2 and 3.
    gyro_walk (3,) rad/√s and accel_walk (3,) g √s: white noise of integral and mean; instability_rps; fs_rps; latitude_rad or None;
    accel_sigma_g: how far the accelerometer's calibration may be off; blind (S,) bool: turns whose inside is not looked at.
    """

    table: Description
    rest_s: np.ndarray
    rest_span_s: np.ndarray
    force: np.ndarray
    rate: np.ndarray
    temp_c: np.ndarray
    reported: np.ndarray
    first: np.ndarray
    last: np.ndarray
    turn_s: np.ndarray
    block_s: np.ndarray
    blocks: np.ndarray
    rates: np.ndarray
    reported_edges: np.ndarray
    gyro_walk: np.ndarray
    accel_walk: np.ndarray
    instability_rps: float
    fs_rps: float
    latitude_rad: float | None
    accel_sigma_g: float
    blind: np.ndarray
    answer_at: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """(S, B) bool: the blocks that a turn has."""
        return np.arange(self.rates.shape[1]) < self.blocks[:, None]

    @property
    def turned(self) -> np.ndarray:
        """(S, K) rad: what the machine reports that each axis turned."""
        return self.reported[self.last] - self.reported[self.first]

    @property
    def alone(self) -> np.ndarray:
        """(S,) number of the axis that turned alone, else -1."""
        moved = np.abs(self.turned) > TURNED_RAD
        return np.where(moved.sum(axis=1) == 1, np.argmax(moved, axis=1), -1)

    @property
    def senses(self) -> np.ndarray:
        """(Q, K): the sign of each axis' last motion before each rest, 0 before any."""
        found = np.zeros_like(self.reported)
        change = np.diff(self.reported, axis=0)
        for number, each in enumerate(change, start=1):
            found[number] = np.where(np.abs(each) > TURNED_RAD, np.sign(each), found[number - 1])
        return found


def observe(problem: Problem, table: Description, angles: Mapping[str, AngleLog]) -> Observed:
    """Reduce a recording; DataError where the machine's word does not cover enough rests and turns."""
    config = problem.session.config
    gravity = config.site.expected_gravity_mps2
    angles = {name: on_its_clock(word) for name, word in angles.items()}
    rests: list[tuple] = []
    rest_of: dict[int, int] = {}
    for log, (path, began) in enumerate(zip(problem.session.logs, problem.began_s, strict=False)):
        word = angles.get(path.path.name) or angles.get(path.path.name.removesuffix(".gz"))
        if word is None or log >= len(problem.logs):
            continue
        samples = problem.logs[log].samples
        for still in problem.logs[log].stills:
            # (N,) bool: the answers between two samples, while nothing moved
            during = (word.t_ns >= samples.t_ns[still.start]) & (word.t_ns <= samples.t_ns[still.stop - 1]) & ~word.moving
            if still.problem is None and during.any():
                rest_of[id(still)] = len(rests)
                reported = np.median(word.angles[during], axis=0)
                middle = began + still.start_s + still.duration_s / 2
                rests.append((middle, still.duration_s, still.accel_mean / gravity, still.gyro_mean, still.temp_c, reported))
    cut = []
    for segment in problem.used:
        if id(segment.first) not in rest_of or id(segment.last) not in rest_of:
            continue
        name = problem.session.logs[segment.log].path.name
        word = angles.get(name) or angles[name.removesuffix(".gz")]
        first, last = rest_of[id(segment.first)], rest_of[id(segment.last)]
        ends = rests[first][5], rests[last][5]
        zero = (rests[first][3] + rests[last][3]) / 2
        cut.append((first, last, segment.log, Turn(problem.logs[segment.log].samples, segment.start, segment.stop, zero, word, ends)))
    limit_s = held_up_from([turn.offset_s for *_, turn in cut])
    turns = [(first, last, log, *turn.blocks(limit_s)) for first, last, log, turn in cut]
    if len(rests) < FEWEST_RESTS or len(turns) < FEWEST_TURNS:
        raise DataError(
            f"{problem.session.name}: table.csv has angles for {len(rests)} rests and {len(turns)} turns, expected {FEWEST_RESTS} and "
            f"{FEWEST_TURNS} at least; does it name this session's logs?"
        )
    return _record(problem, table, rests, turns, gravity)


def _record(problem: Problem, table: Description, rests: list, turns: list, gravity: float) -> Observed:
    config, accelerometer = problem.session.config, problem.session.config.accelerometer
    middle, span, force, rate, temp_c, reported = (np.array(column, dtype=float) for column in zip(*rests, strict=True))
    *columns, rates, edges, answer_at = zip(*turns, strict=True)
    first, last, log, begin_s, block_s = map(np.array, columns)
    blocks = np.array(list(map(len, rates)))

    def padded(each: Sequence[np.ndarray], mode: Literal["constant", "edge"]) -> np.ndarray:
        most = max(map(len, each))
        return np.stack([np.pad(own, ((0, most - len(own)), *[(0, 0)] * (own.ndim - 1)), mode=mode) for own in each])

    walks = [log.noise for log in problem.logs if log.noise is not None]
    sigma_mg = 10.0 if accelerometer.source == "none" else accelerometer.sigma_mg or 2.0
    return Observed(
        table,
        middle,
        span,
        force,
        rate,
        temp_c,
        reported,
        first,
        last,
        np.asarray(problem.began_s)[log] + begin_s + blocks * block_s / 2,
        block_s,
        blocks,
        padded(rates, "constant"),
        padded(edges, "edge"),
        np.mean([noise.angle_random_walk for noise in walks], axis=0),
        np.mean([noise.accel for noise in walks], axis=0) / np.sqrt(2) / gravity,
        problem.instability.rps,
        config.sensor.gyro_fs_dps * DEG,
        None if config.site.latitude_deg is None else config.site.latitude_deg * DEG,
        1e-3 * sigma_mg,
        np.zeros(len(turns), dtype=bool),
        padded(answer_at, "edge"),
    )


class Turn:
    """One turn of a recording: samples start to stop, their mean (3,) rad/s in both rests, answers between them, and the reported angles
    (2, K) rad of the rests.

    poll_s (N,), reported (N, K): the answers; offset_s (N,): ``stamp_offsets``, NaN where several axes turn or none does.
    """

    def __init__(self, samples: Samples, start: int, stop: int, zero: np.ndarray, word: AngleLog, ends: tuple[np.ndarray, np.ndarray]):
        self._begin_s, self._ends = float(samples.t_s[start]), ends
        self._t_s = (samples.t_ns[start:stop] - samples.t_ns[start]) * NS
        gyro = np.asarray(samples.gyro[start:stop], dtype=float)
        within = (word.t_ns > samples.t_ns[start]) & (word.t_ns < samples.t_ns[stop - 1])
        self.poll_s, at = np.unique((word.t_ns[within] - samples.t_ns[start]) * NS, return_index=True)
        self.reported = word.angles[within][at]
        self._trapezoid = (gyro[1:] + gyro[:-1]) / 2 * np.diff(self._t_s)[:, None]
        self._angle = running_sum(self._trapezoid)
        turned = self._angle - zero * self._t_s[:, None]
        change, end = ends[1] - ends[0], turned[-1]
        moved = np.flatnonzero(np.abs(change) > TURNED_RAD)
        self.offset_s = np.full(len(self.poll_s), np.nan)
        if len(moved) == 1 and end.any():
            way = turned @ end / (end @ end) * abs(change[moved[0]])
            reported = (self.reported[:, moved[0]] - ends[0][moved[0]]) * np.sign(change[moved[0]])
            self.offset_s = stamp_offsets(self.poll_s, reported, self._t_s, way)

    def blocks(self, limit_s: float) -> tuple[float, float, np.ndarray, np.ndarray, np.ndarray]:
        """Begin and block length, s; rates (B, 3) of equal blocks; the machine's word (B + 1, K) at their edges, that of the rests at both
        ends, without answers that were held up by more than limit_s; place of the edges (B + 1,) among these answers."""
        t_s, angle, trapezoid = self._t_s, self._angle, self._trapezoid
        usual = float(np.median(np.diff(self.poll_s))) if len(self.poll_s) > 1 else t_s[-1]
        count = int(np.clip(t_s[-1] // max(usual, SHORTEST_BLOCK_S), 1, MOST_BLOCKS))
        edges = np.linspace(0.0, t_s[-1], count + 1)
        at_edges = np.stack([np.interp(edges, t_s, angle[:, axis]) for axis in range(3)], axis=1)
        # Within a block: the rotation vector to second order, with the coning of its samples (Bortz 1971).
        coning = running_sum(np.cross(angle[:-1], trapezoid) / 2)
        own = np.stack([np.interp(edges, t_s, coning[:, axis]) for axis in range(3)], axis=1)
        vectors = np.diff(at_edges, axis=0) + np.diff(own, axis=0) - np.cross(at_edges[:-1], np.diff(at_edges, axis=0)) / 2
        kept = ~(np.abs(self.offset_s) > limit_s)
        return self._begin_s, float(edges[1]), vectors / edges[1], *reported_at(edges, self.poll_s[kept], self.reported[kept], self._ends)


def reported_at(
    edges: np.ndarray, poll_s: np.ndarray, reported: np.ndarray, ends: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The machine's word (B + 1, K) at the edges of a turn, s, from its answers (N, K) at poll_s and from both rests; place of the edges
    (B + 1,) among the answers, where the rests count as such."""
    known_s = np.concatenate([edges[:1], poll_s, edges[-1:]])
    known = np.concatenate([ends[0][None], reported, ends[1][None]])
    return Akima1DInterpolator(known_s, known)(edges), np.interp(edges, known_s, np.arange(len(known_s)))


def stamp_offsets(poll_s: np.ndarray, reported: np.ndarray, t_s: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(N,) s: how much later the stamp of each answer is than the stamps of its neighbours, by an axis' way (M,) rad at t_s (M,), which
    grows; NaN where the axis hardly turns.

    stated (N,) rad: the way by the answers.  An error of the table is the same for the neighbours; a stamp that was held up is alone.
    """
    if len(poll_s) < NEIGHBOURS:
        return np.full(len(poll_s), np.nan)
    rate = np.abs(np.gradient(way, t_s))
    # Where the axis begins or stops, an answer seems less late than it is, and so earlier than its neighbours.
    both = np.stack([np.interp(at_s, t_s, rate) for at_s in (poll_s, poll_s - np.median(np.diff(poll_s)))])
    slowest, fastest = both.min(axis=0), both.max(axis=0)
    seen = np.flatnonzero(fastest > SHOWS_LATE * rate.max())
    found = np.full(len(poll_s), np.nan)
    if len(seen) >= NEIGHBOURS:
        late_s = (np.interp(poll_s, t_s, way) - reported)[seen] / fastest[seen]
        around = np.lib.stride_tricks.sliding_window_view(np.pad(late_s, NEIGHBOURS // 2, mode="reflect"), NEIGHBOURS)
        offset_s = late_s - np.median(around, axis=1)
        found[seen] = np.where((offset_s > 0) | (slowest[seen] > SHOWS_EARLY * rate.max()), offset_s, np.nan)
    return found


def held_up_from(offset_s: Sequence[np.ndarray]) -> float:
    """s from which a stamp counts as held up, of ``stamp_offsets`` of all turns: ``HELD_UP`` sigmas of the usual ones (Hampel 1974)."""
    offsets = np.concatenate([np.zeros(0), *offset_s])
    offsets = offsets[np.isfinite(offsets)]
    return HELD_UP * max(1.4826 * float(np.median(np.abs(offsets))), LEAST_JITTER_S) if len(offsets) else np.inf
