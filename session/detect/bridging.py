"""Bridge short gaps and clipped readings: interpolation from the neighbours, with its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.base.numeric import rms_of, runs_of
from session.base.units import DEG, NS
from session.detect.events import register_end_dps
from session.log.config import Sensor
from session.log.logfile import Bridge
from session.log.samples import Samples, inserted, once, pieces, replaced
from session.log.stamps import not_caught_up

# What was not read, from its neighbours: a polynomial across the gap, of the order that crosses this recording's own movement best.
#
# A smooth movement asks for a high order, noise and long gaps for a low one.  Gaps of the same length where nothing is missing decide,
# and how uncertain the rotation over the gap is.

SIDE = 4  #: samples on either side that carry the polynomial: two more than the highest order has coefficients
ORDERS = (1, 3, 5)
#: share of the bend next to a gap from which on a place is like it, up to its inverse (not critical: benchmarks/thresholds.py)
AS_FAST = 0.5
FEWEST_TRIALS = 40  #: places: their rms is then known to 11 %
BEND_STEPS = 4  #: to an octave, in which bends are alike
#: places whose bend is looked up: those of a session of an hour; of a day every so many
MOST_PLACES = 1 << 20
MOST_TRIALS = 400  #: gaps that are tried where nothing is missing: their rms is then known to 4 %


def across(values: np.ndarray, before: int, after: int, count: int, order: int) -> np.ndarray:
    """``count`` readings (count, C) between rows ``before`` and ``after`` of values (N, C)."""
    rows = np.concatenate([np.arange(before - SIDE + 1, before + 1), np.arange(after, after + SIDE)])
    return _weights(count, order) @ values[np.clip(rows, 0, len(values) - 1)]


class Crossings:
    """How well gaps of ``count`` readings are crossed in one log where nothing is missing, at places that bend as it does next to a gap."""

    def __init__(self, gyro: np.ndarray, count: int, spoilt: np.ndarray):
        """gyro (N, 3); spoilt (N,) bool: rows that are no example."""
        self._gyro, self._count = gyro, count
        near = np.zeros(len(spoilt) + 1, dtype=np.int32)
        np.cumsum(spoilt, out=near[1:])
        wide = count + 2 * SIDE
        places = np.flatnonzero(near[wide:] == near[: max(len(near) - wide, 0)])
        places += SIDE
        places = places[:: max(1, -(-len(places) // MOST_PLACES))]
        bends = bend(gyro, places - 1, places + count)
        order = np.argsort(bends)
        self._places, self._bends = places[order], bends[order]
        self._known: dict[float, tuple[int, np.ndarray]] = {}

    def like(self, bent: float) -> tuple[int, np.ndarray]:
        """The order that crosses best where the rate bends by ``bent``, and the errors (K, count, 3) rad/s of K such crossings."""
        near = float(2 ** (np.round(BEND_STEPS * np.log2(max(bent, 1e-12))) / BEND_STEPS))  # many gaps bend alike
        if near not in self._known:
            self._known[near] = self._tried(near)
        return self._known[near]

    def _tried(self, bent: float) -> tuple[int, np.ndarray]:
        # Places, and by how much more the rate bends than at any of them.
        first, last = np.searchsorted(self._bends, [AS_FAST * bent, bent / AS_FAST])
        if last - first < FEWEST_TRIALS:  # the nearest in size, then
            middle = int(np.searchsorted(self._bends, bent))
            first = max(0, min(middle - FEWEST_TRIALS // 2, len(self._bends) - FEWEST_TRIALS))
            last = min(len(self._bends), first + FEWEST_TRIALS)
        chosen = slice(first, last, -(-(last - first) // MOST_TRIALS) or 1)
        places, factor = self._places[chosen], max(1.0, bent / self._bends[last - 1]) if last > first and self._bends[last - 1] > 0 else 1.0
        around = np.concatenate([np.arange(-SIDE, 0), np.arange(self._count, self._count + SIDE)])
        known, true = self._gyro[places[:, None] + around], self._gyro[places[:, None] + np.arange(self._count)]
        weights, sums = {order: _weights(self._count, order) for order in ORDERS}, true.sum(axis=1)
        missed = {order: np.mean((np.einsum("s,ksi->ki", own.sum(axis=0), known) - sums) ** 2) for order, own in weights.items()}
        order = min(missed, key=missed.__getitem__)
        return order, factor * (np.einsum("cs,ksi->kci", weights[order], known) - true)

    def __len__(self) -> int:
        return len(self._places)


def best_crossings(samples: Samples, rows: np.ndarray, counts: np.ndarray, length: int = 0) -> list[tuple[int, float]]:
    """The order that crosses each of E events best, and the rotation, rad rms per axis, that it misses: counts (E,) of false readings from
    rows (E,) on, or 0 where ``length`` readings are missing behind a row.  No event is an example, unless they leave too few."""
    last, lost = len(samples) - 1, counts == 0
    before, behind = np.clip([rows - 1 + lost, rows + counts + lost], 0, last)
    bends, spoilt = bend(samples.gyro, before, behind), np.zeros(len(samples), dtype=bool)
    for row, stop in zip(rows.tolist(), (rows + counts + 2 * lost).tolist(), strict=True):
        spoilt[row:stop] = True
    counts, crossings = np.where(lost, max(length, 1), counts), dict[int, Crossings]()
    for count in np.unique(counts).tolist():
        apart = Crossings(samples.gyro, count, spoilt)
        crossings[count] = apart if len(apart) >= FEWEST_TRIALS else Crossings(samples.gyro, count, np.zeros_like(spoilt))
    found = []
    for bent, count in zip(bends.tolist(), counts.tolist(), strict=True):
        order, errors = crossings[count].like(bent) if len(crossings[count]) else (3, np.zeros((1, 1, 3)))
        found.append((order, rms_of(errors.sum(axis=1)) * samples.period_s))
    return found


def bend(gyro: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(K,) rad/s: how much the slope of rates (N, 3) changes, per reading, between the last one before a gap and the first one after."""
    last = len(gyro) - 1
    slope_before = gyro[before] - gyro[np.maximum(before - 1, 0)]
    slope_after = gyro[np.minimum(after + 1, last)] - gyro[after]
    return np.linalg.norm(slope_after - slope_before, axis=-1)


def _weights(count: int, order: int) -> np.ndarray:
    """(count, 2 SIDE): of the neighbours' readings in each reading between, by least squares."""
    at = np.concatenate([np.arange(-SIDE, 0), np.arange(count, count + SIDE)])
    scale = count / 2 + SIDE
    middle = (count - 1) / 2
    known = np.polynomial.legendre.legvander((at - middle) / scale, order)
    return np.polynomial.legendre.legvander((np.arange(count) - middle) / scale, order) @ np.linalg.pinv(known)


# Gaps of a few readings, and readings at the register's end: put back from their neighbours, with how far off the rotation may be.
#
# A turn in which one to three readings are missing, or stood at the end of the register, is not lost: a movement is smooth.  What the
# neighbours predict is put in their place, by the polynomial that crosses this recording's own movement best where the rate bends as much,
# and the error of those crossings is its uncertainty: the segment is so much less certain (``tinygc/closure/problem.py``).

#: readings: more are a movement without data (benchmarks/real_logs.py)
MOST = 3
#: s on either side of a reading at the register's end: where there are more of them, on any axis, the movement is beyond the sensor
AROUND_S = 0.5
#: of a period: where later steps are shorter by as much as one is longer, the reading came late, and none is missing
LATE = 0.5
GAP, CLIPPED = "gap", "clipped"
#: sigmas of what the neighbours predict, beyond which a reading is nothing that they know of
UNLIKE = 5.0
#: readings, more than any bridge and less than 32 bits hold
FAR = 1e9


def bridged(samples: Samples, sensor: Sensor) -> tuple[Samples, tuple[Bridge, ...]]:
    """The log with its short gaps filled and its short peaks beyond the register's end estimated; and what was put in, in order of rows.

    Rows of the bridges are those of the filled samples.  Without any, the samples are returned as they are.
    """
    samples, gaps = filled(samples, *short_gaps(samples))
    samples, peaks = _with_peaks(samples, sensor, gaps)
    return samples, tuple(sorted((*gaps, *peaks), key=lambda bridge: bridge.row))


@once
def short_gaps(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Rows (G,) after which one to ``MOST`` readings are missing by the stamps, and how many (G,)."""
    if len(samples) < 2 * SIDE:
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    pace, steps = samples.pace, (np.diff(part) * NS for _, part in pieces(samples.t_ns, overlap=1))
    # A gap may last for years.
    counts = np.concatenate([np.minimum(pace.periods(part), FAR).astype(np.int32) for part in steps])
    counts -= np.int32(1)
    rows = np.flatnonzero((counts >= 1) & (counts <= MOST))
    if not len(rows):
        return rows, counts[rows].astype(int)
    # A reading that only came late has its time made up in the neighbouring steps.
    total = np.zeros(len(samples))
    np.divide(samples.dt_s, pace.period_s, out=total[1:])
    total[1:] -= np.maximum(counts, 0)
    total[1:] -= 1
    np.cumsum(total, out=total)
    over = total[np.minimum(rows + 1 + SIDE, len(samples) - 1)] - total[np.maximum(rows - SIDE, 0)]
    rows = rows[over > -LATE]
    rows = rows[not_caught_up(samples.t_ns, rows, pace.period_s)]
    return rows, counts[rows].astype(int)


def filled(samples: Samples, rows: np.ndarray, counts: np.ndarray) -> tuple[Samples, list[Bridge]]:
    """The log with so many readings (G,) put in behind rows (G,), between their stamps and the next, and what was put in."""
    if not len(rows):
        return samples, []
    spoilt = np.zeros(len(samples), dtype=bool)
    spoilt[rows] = spoilt[rows + 1] = True
    crossings = {count: Crossings(samples.gyro, count, spoilt) for count in np.unique(counts).tolist()}
    bends = bend(samples.gyro, rows, rows + 1)
    names = ["t_ns", "gyro", "accel"] + (["temp_c"] if samples.temp_c is not None else [])
    put_in: dict[str, list[np.ndarray]] = {name: [] for name in names}
    bridges, before = [], 0
    for row, count, bent in zip(rows.tolist(), counts.tolist(), bends.tolist(), strict=True):
        if len(crossings[count]) < FEWEST_TRIALS:  # too short a log to learn from: it stays a gap
            for name in names:
                put_in[name].append(getattr(samples, name)[:0])
            continue
        order, errors = crossings[count].like(bent)
        share = np.arange(1, count + 1) / (count + 1)
        put_in["t_ns"].append(samples.t_ns[row] + np.rint(share * (samples.t_ns[row + 1] - samples.t_ns[row])).astype(np.int64))
        put_in["gyro"].append(across(samples.gyro, row, row + 1, count, order))
        put_in["accel"].append(across(samples.accel, row, row + 1, count, 1))
        if samples.temp_c is not None:
            put_in["temp_c"].append(np.full(count, samples.temp_c[row]))
        sigma = np.sqrt(np.mean(errors.sum(axis=1) ** 2, axis=0)) * samples.period_s
        bridges.append(Bridge(GAP, row + 1 + before, count, samples.at_s(row), sigma))
        before += count
    at = np.repeat(rows + 1, [len(part) for part in put_in["t_ns"]])
    filled = {name: inserted(getattr(samples, name), at, np.concatenate(put_in[name])) for name in names}
    return Samples(filled["t_ns"], filled["gyro"], filled["accel"], filled.get("temp_c")), bridges


def _with_peaks(samples: Samples, sensor: Sensor, gaps: list[Bridge]) -> tuple[Samples, list[Bridge]]:
    end = register_end_dps(sensor, samples.gyro) * DEG
    at_end: np.ndarray = np.concatenate([np.greater_equal(np.abs(part), end) for _, part in pieces(samples.gyro)])
    if not at_end.any():
        return samples, []
    spoilt = np.asarray(at_end.any(axis=1))
    around = round(AROUND_S / samples.period_s)
    for gap in gaps:
        spoilt[gap.row : gap.row + gap.count] = True
    put_in: dict[int, np.ndarray] = {}
    bridges = []
    crossings: dict[int, Crossings] = {}
    for axis in range(3):
        starts, stops = runs_of(at_end[:, axis])
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
            count, near = stop - start, slice(max(start - SIDE, 0), stop + SIDE)
            crowd = at_end[max(start - around, 0) : stop + around].sum()
            if crowd > MOST or at_end[near, axis].sum() > count or start < SIDE or stop > len(samples) - SIDE:
                continue
            if count not in crossings:
                crossings[count] = Crossings(samples.gyro, count, spoilt)
            if len(crossings[count]) < FEWEST_TRIALS:
                continue
            order, errors = crossings[count].like(float(bend(samples.gyro, np.array([start - 1]), np.array([stop]))[0]))
            guess = across(samples.gyro, start - 1, stop, count, order)[:, axis]
            sign, spread = np.sign(samples.gyro[start, axis]), np.sqrt(np.mean(errors[:, :, axis] ** 2, axis=0))
            beyond, off = _beyond(sign * guess, spread, end)
            for row, value in zip(range(start, stop), (sign * beyond).tolist(), strict=True):
                put_in.setdefault(row, np.array(samples.gyro[row]))[axis] = value
            sigma = np.zeros(3)
            sigma[axis] = off.sum() * samples.period_s
            bridges.append(Bridge(CLIPPED, start, count, samples.at_s(start), sigma))
    if not bridges:
        return samples, []
    rows = np.array(sorted(put_in))
    return replace(samples, gyro=replaced(samples.gyro, rows, np.array([put_in[row] for row in rows.tolist()]))), bridges


def _beyond(guess: np.ndarray, spread: np.ndarray, end: float) -> tuple[np.ndarray, np.ndarray]:
    """What readings (K,) at the register's end may have been, and their sigmas: normal about what the neighbours predict, cut at the end.

    Where the neighbours predict far less than the end, it was a jolt, of which they know nothing: normal with a spread of what is lacking;
    or the reading is false, and they are right.  Nothing in the rates shows which: even odds.
    """
    lacking = np.maximum(end - guess, 0.0)
    wide = np.maximum(spread, lacking) + 1e-12
    at = (end - guess) / wide
    from scipy.special import log_ndtr  # hardly any log clips

    hazard = np.exp(-(at**2) / 2.0 - np.log(np.sqrt(2 * np.pi)) - log_ndtr(-at))
    beyond, off = guess + wide * hazard, wide * np.sqrt(np.maximum(1 + at * hazard - hazard**2, 1e-3))
    jolt = lacking > UNLIKE * spread
    half = (beyond - guess) / 2
    return np.where(jolt, guess + half, beyond), np.where(jolt, np.sqrt(off**2 / 2 + half**2), off)
