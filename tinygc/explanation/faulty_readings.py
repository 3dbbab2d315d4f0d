"""Detect false readings and lost samples in the registers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from session.base.numeric import runs_of, sigma_of
from session.detect import bridging
from session.detect.bridging import GAP
from session.detect.events import APART_S, find_impacts
from session.log.folder import Session
from session.log.samples import Samples, replaced

# A long log is read in parts: detectors need only a few tenths of a second around each reading, so a day need not be in memory.

#: rows above which a log is split, more than an hour at 208 Hz; rows of a part; rows of margin on either side, many times what any detector
#: needs around a reading
LONG, AT_ONCE, MARGIN = 1 << 20, 1 << 18, 1 << 12


def in_parts(samples: Samples) -> Iterator[tuple[int, range, Samples]]:
    """(first row of the part, its own rows of the log, its samples) of each part; a single part for up to ``LONG`` rows."""
    count = len(samples)
    if count <= LONG:
        yield 0, range(count), samples
        return
    for start in range(0, count, AT_ONCE):
        own = range(start, min(start + AT_ONCE, count))
        first = max(start - MARGIN, 0)
        part = samples.between(first, min(own.stop + MARGIN, count))
        part.__dict__["period_s"] = samples.period_s
        yield first, own, part


# Samples that were lost although the stamps are continuous.
#
# A hand moves smoothly, and the sensor's filter smooths it further: the third difference of the readings holds noise and little else. A
# jump exceeds that noise by its size.  A loss jumps once and permanently, in gyro and accelerometer together (a false reading jumps away
# and back: ``find_glitches``).  What is found can be repaired, so that the rest of the recording can still be explained.

#: third differences of this many times the local scatter (all six channels together) are a jump (not critical:
#: benchmarks/thresholds.py)
JUMP = 12.0
#: the two peaks of a short false reading are of similar size, and each has at least a third of itself, reversed, beyond it; a step's second
#: peak is half of its first, and a corner has nothing beyond: the thresholds lie between
SPIKE, FLANK = 0.75, 0.2
#: s: window of that scatter (not critical: benchmarks/thresholds.py), and settling time of a sensor's filter
NEIGHBOURHOOD_S, START_S = 0.2, 0.1
NEIGHBOURHOOD = 32  #: least samples of the window, so that the eleven third differences of the longest false reading are less than half
ALONE = 8  #: samples on either side of a loss without another, or without a greater jump: as long as the longest false reading
#: a loss shows in the accelerometer, too: the median over all is at least this (noise alone: 0.9); where a rate clips it does not
LOSS_IN_ACCEL = 3.0
#: losses and false readings are rare: more than one per second has another cause
PER_SECOND = 1.0


class Jumps(NamedTuple):
    """Steps between row i and i + 1 for each of rows (J,); size (J, 6) of each in every channel, signed, in units of the local scatter."""

    rows: np.ndarray
    size: np.ndarray


def find_jumps(samples: Samples) -> Jumps:
    """All steps within one sample period that a smooth movement cannot make."""
    rows, sizes = [np.zeros(0, dtype=int)], [np.zeros((0, 6))]
    for first, own, part in in_parts(samples):
        found, size = _jumps_of(part)
        mine = np.isin(found + first, own) if len(part) < len(samples) else np.ones(len(found), dtype=bool)
        rows.append(found[mine] + first)
        sizes.append(size[mine])
    return Jumps(np.concatenate(rows), np.concatenate(sizes))


def _jumps_of(samples: Samples) -> Jumps:
    size, _ = third_differences(samples)
    total = np.sqrt(np.sum(size**2, axis=1))
    high = np.flatnonzero(total > JUMP)
    # A step between rows k and k+1 is in the third differences k-2, k-1, k as 1, -2, 1.
    peaks = [i for i in high if total[i] >= total[max(i - 2, 0) : i + 3].max()]
    steps = dict(step for i in peaks for step in _steps_at(int(i), size, total))
    missing = open_gaps(samples)
    rows = [row for row in sorted(steps) if not missing[row]]
    return Jumps(np.array(rows, dtype=int), np.array([steps[row] for row in rows]).reshape(-1, 6))


def open_gaps(samples: Samples) -> np.ndarray:
    """(N - 1,) bool: whether the stamps show missing samples between a row and the next, so that no loss is hidden there."""
    return samples.pace.periods(samples.dt_s) > 1


def third_differences(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Third differences (N - 3, 6) of gyro and accelerometer in units of the local scatter, and that scatter (N - 3, 6)."""
    third = np.diff(np.concatenate([samples.gyro, samples.accel], axis=1), 3, axis=0)
    scatter = _local_scatter(np.abs(third), samples.period_s)
    size = third / scatter
    size[: round(START_S / samples.period_s)] = 0
    return size, scatter


def _steps_at(i: int, size: np.ndarray, total: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Row and size of each step in a peak: one, unless it matches one false sample, 1, -3, 3, -1, or two of them, 1, -2, 0, 2, -1.

    A corner of the rate, 0, -1, 1, 0, has no flanks.
    """
    for apart, factor in ((1, 3), (2, 2)):
        for away, back in ((i, i + apart), (i - apart, i)):
            if away < 1 or back + 2 > len(size) or min(total[away], total[back]) < SPIKE * total[i]:
                continue
            flanks = max(size[away - 1] @ size[away] / total[away] ** 2, size[back + 1] @ size[back] / total[back] ** 2)
            if size[away] @ size[back] < 0 and flanks < -FLANK:
                return [(away + 1, -size[away] / factor), (back + 1, -size[back] / factor)]
    return [(i + 1, -size[i] / 2)]


def _local_scatter(absolute: np.ndarray, period_s: float) -> np.ndarray:
    """Local scatter around each row, from medians, which a jump does not inflate and the start of a turn does not trigger."""
    step = max(round(NEIGHBOURHOOD_S / period_s), NEIGHBOURHOOD)
    count = len(absolute) // step
    if count < 5:
        return np.broadcast_to(np.maximum(sigma_of(absolute), 1e-12), absolute.shape)
    coarse = sigma_of(absolute[: count * step].reshape(count, step, -1), axis=1)
    coarse = np.maximum(maximum_filter1d(coarse, 3, axis=0), np.median(coarse, axis=0))
    return np.maximum(coarse, 1e-12)[np.minimum(np.arange(len(absolute)) // step, count - 1)]


def find_losses(jumps: Jumps, duration_s: float) -> np.ndarray:
    """Rows (L,) after which samples are missing, by the registers alone: permanent steps in gyro and accelerometer together."""
    rows, size = jumps
    alone = np.array([np.sum(np.abs(rows - row) <= ALONE) == 1 for row in rows], dtype=bool)
    rows, accel = rows[alone], np.linalg.norm(size[alone, 3:], axis=1)
    if not len(rows) or np.median(accel) < LOSS_IN_ACCEL or len(rows) > PER_SECOND * duration_s:
        return rows[:0]
    return rows


def _possible_losses(jumps: Jumps, duration_s: float) -> np.ndarray:
    """Rows (L,) after which samples may be missing, for closure to decide (``ClosureTrial``): the greatest permanent steps nearby."""
    rows, sizes = jumps
    if not len(rows):
        return rows
    size = np.zeros(int(rows.max()) + 1)
    size[rows] = np.linalg.norm(sizes, axis=1)
    rows = rows[size[rows] >= maximum_filter1d(size, 2 * ALONE + 1)[rows]]
    return rows if len(rows) <= PER_SECOND * duration_s else rows[:0]


def register_step(values: np.ndarray) -> float:
    """The smallest step between readings (N,); 0 if there is none."""
    distinct = np.unique(np.abs(np.diff(values[:20000])))
    return float(distinct[distinct > 1e-9][0]) if (distinct > 1e-9).any() else 0.0


def _away_from_blows(samples: Samples, rows: np.ndarray) -> np.ndarray:
    """Those of the rows (L,) that are more than ``APART_S`` from every impact.

    A blow jumps between two readings as a loss does, and what the gyro misses of it leaves the turn open as well: closure would take a loss
    for it.
    """
    blows, ring = np.array([each.row for each in find_impacts(samples)], dtype=int), round(APART_S / samples.period_s)
    return rows[np.all(np.abs(rows[:, None] - blows) > ring, axis=1)]


# False readings: consecutive samples that the sensor cannot have measured, between neighbours that agree across them.
#
# There are two kinds.  The first is rows that no noisy sensor outputs: all channels at one value (0 or -1 of an interface that did not
# answer), or an exact repetition of the row before.  The second is excursions of the gyro alone that begin and end in jumps: a cubic
# through the readings on either side fits these as well as usual, and misses the readings between.

LONGEST = 8  #: samples that the cubic may bridge: twice its supporting readings on a side
SIDE = 4  #: samples on either side that carry the cubic: twice as many as it has coefficients
#: an excursion is false if it deviates from the cubic by this many times the readings' scatter (three axes: once in 10^13)
BEYOND = 8.0
#: the cubic may miss its supporting readings by this share of the excursion; it misses those of an excursion that does not return by half
#: (not critical: benchmarks/thresholds.py)
CAME_BACK = 0.12
#: an excursion deviates from the straight lines of both sides by this share of itself (not critical:
#: benchmarks/thresholds.py)
SHARE = 0.5
#: with noise alone, a cubic misses its supporting readings by at most this many times their scatter (not critical:
#: benchmarks/thresholds.py)
NOISE_MISSES = 2.5
#: standard deviation of a third difference of white noise
THIRD = np.sqrt(20.0)
#: least noise, in registers, at which a repeated row is suspicious: six channels then repeat once in 10^5 rows, and twice in succession
#: once in 10^10
LEAST_NOISE_LSB = 2.0


class Glitch(NamedTuple):
    """False readings: first row; samples; accel: whether the accelerometer's readings are false, too."""

    row: int
    samples: int
    accel: bool


def find_glitches(samples: Samples) -> list[Glitch] | None:
    """All false readings; None if there are none, or so many that they have another cause."""
    found = [
        each._replace(row=each.row + first) for first, own, part in in_parts(samples) for each in _found_in(part) if each.row + first in own
    ]
    return found if found and len(found) <= PER_SECOND * samples.duration_s else None


def _found_in(samples: Samples) -> list[Glitch]:
    impossible = _impossible_rows(samples)
    if len(impossible) > PER_SECOND * samples.duration_s:
        return []
    cleaned = without_glitches(samples, impossible)
    values = np.concatenate([cleaned.gyro, cleaned.accel], axis=1)
    size, scatter = third_differences(cleaned)
    high = np.flatnonzero(np.linalg.norm(size, axis=1) > JUMP)
    clusters = np.split(high, np.flatnonzero(np.diff(high) > LONGEST) + 1) if len(high) else []
    # At a gap that the stamps show, a step of the readings is expected.
    missing = open_gaps(cleaned)
    whole = [(int(c[0]), int(c[-1])) for c in clusters if not missing[max(c[0] + 1 - SIDE, 0) : c[-1] + 3 + SIDE].any()]
    excursions = [run for first, last in whole if (run := _excursion_at(values, scatter, first, last)) is not None]
    found = sorted({*impossible, *excursions})
    return [run for i, run in enumerate(found) if i == 0 or run.row >= found[i - 1].row + found[i - 1].samples]


def _impossible_rows(samples: Samples) -> list[Glitch]:
    """Runs of rows that no sensor outputs."""
    values = np.concatenate([samples.gyro, samples.accel], axis=1)
    lsb = np.array([register_step(column) for column in values.T])
    if not (lsb > 0).all():
        return []
    # A gyro may read nearly zero in all axes; an accelerometer that is not in free fall never does.
    empty = (np.abs(np.rint(values / lsb)) <= 1).all(axis=1)
    same = np.zeros(len(values), dtype=bool)
    difference = np.diff(values, axis=0)
    if (np.median(np.abs(difference), axis=0) >= LEAST_NOISE_LSB * lsb).all():
        same[1:] = (difference == 0).all(axis=1)
    # A single repetition occurs by chance once in many sessions, and is harmless.
    return [*_runs(empty, 1), *_runs(same & ~empty, 2)]


def _runs(mask: np.ndarray, fewest: int) -> list[Glitch]:
    """Each run of at least ``fewest`` rows that is short enough and has neighbours."""
    starts, stops = runs_of(mask)
    runs = zip(starts.tolist(), (stops - starts).tolist(), strict=True)
    return [Glitch(first, count, True) for first, count in runs if fewest <= count <= LONGEST and SIDE <= first <= len(mask) - count - SIDE]


def _excursion_at(values: np.ndarray, scatter: np.ndarray, first: int, last: int) -> Glitch | None:
    """What the cubic across a cluster of high third differences misses, if only the gyro deviates, and returns."""
    start, stop = first + 1, last + 3
    if start < SIDE or stop + SIDE > len(values) or stop - start > LONGEST + 4:
        return None
    noise = scatter[first : last + 1].min(axis=0) / THIRD
    inside, outside = cubic_across(values, start, stop)
    beyond = (values[start:stop] - inside) / noise
    missed = (np.concatenate([values[start - SIDE : start], values[stop : stop + SIDE]]) - outside) / noise
    away = np.linalg.norm(beyond[:, :3], axis=1)
    false = np.flatnonzero(away > max(BEYOND, 0.1 * away.max()))
    if not len(false) or np.linalg.norm(beyond[:, 3:], axis=1).max() > away.max():
        return None
    excursion = beyond[np.argmax(away), :3] / away.max()
    if off_both_sides(values, start, stop, excursion / noise[:3]) < SHARE * away.max():
        return None  # a corner, as of clipping: each reading continues one of the sides
    count = int(false[-1] - false[0]) + 1
    came_back = np.linalg.norm(missed[:, :3], axis=1).max() < max(CAME_BACK * away.max(), NOISE_MISSES)
    return Glitch(start + int(false[0]), count, accel=False) if came_back and count <= LONGEST else None


def off_both_sides(values: np.ndarray, start: int, stop: int, along: np.ndarray) -> float:
    """The greatest deviation of a gyro reading in start:stop, ``along`` a direction (3,), from the straight lines of both sides.

    Only the excursion's direction counts: a turn that bends about another axis deviates from its straight lines, too.
    """
    off = []
    for at in (np.arange(start - SIDE, start), np.arange(stop, stop + SIDE)):
        line = np.polynomial.polynomial.polyfit(at - start, values[at, :3] @ along, 1)
        predicted = np.polynomial.polynomial.polyval(np.arange(stop - start), line)
        off.append(np.abs(values[start:stop, :3] @ along - predicted))
    return float(np.minimum(*off).max())


def cubic_across(values: np.ndarray, start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
    """The cubic through ``SIDE`` rows on either side of start:stop, evaluated at the rows between and at the supporting rows."""
    at = np.concatenate([np.arange(start - SIDE, start), np.arange(stop, stop + SIDE)])
    middle = (start + stop - 1) / 2
    fit = np.polynomial.polynomial.polyfit(at - middle, values[at], 3)
    between = np.polynomial.polynomial.polyval(np.arange(start, stop) - middle, fit).T
    return between, np.polynomial.polynomial.polyval(at - middle, fit).T


def without_glitches(samples: Samples, glitches: Sequence[Glitch]) -> Samples:
    """Replace false readings by interpolation from their neighbours."""
    repaired: dict[str, dict[int, np.ndarray]] = {"gyro": {}, "accel": {}}
    rows, counts = (np.array([getattr(each, name) for each in glitches], dtype=int) for name in ("row", "samples"))
    for (row, count, both), (order, _) in zip(glitches, bridging.best_crossings(samples, rows, counts), strict=True):
        for name in ("gyro", "accel") if both else ("gyro",):
            first = max(row - bridging.SIDE, 0)
            near = np.array(getattr(samples, name)[first : row + count + bridging.SIDE])
            for at in repaired[name].keys() & set(range(first, first + len(near))):
                near[at - first] = repaired[name][at]
            put_in = bridging.across(near, row - 1 - first, row + count - first, count, order)
            repaired[name] |= dict(zip(range(row, row + count), put_in, strict=True))
    for name, by_row in repaired.items():
        if by_row:
            rows = np.array(sorted(by_row))
            values = replaced(getattr(samples, name), rows, np.array([by_row[row] for row in rows.tolist()]))
            samples = replace(samples, **{name: values})
    return samples


# Proposed faults: times at which readings may be false, or samples missing.  Closure decides each.

FALSE, LOST = "data.glitches", "timing.dropped_samples"


@dataclass(frozen=True)
class RegisterFault:
    """A possible fault.  id, ``FALSE`` or ``LOST``; log; row of the first false reading, or after which samples may be missing; samples,
    the number of false ones; accel: whether the accelerometer's readings are false, too, as in rows that no sensor outputs."""

    id: str
    log: int
    row: int
    samples: int = 0
    accel: bool = False


def proposed(session: Session) -> list[RegisterFault]:
    """False readings of every log, then possible losses once these are bridged, both away from blows."""
    events: list[RegisterFault] = []
    for number, log in enumerate(session.logs):
        samples = log.samples
        calibrated = session.calibrated(log)
        if (glitches := find_glitches(samples)) is not None:
            own = set(_away_from_blows(calibrated, np.array([each.row for each in glitches])).tolist())
            # No sensor outputs an impossible row, near a blow or not; an excursion of the gyro may be the blow's.
            events += [RegisterFault(FALSE, number, row, count, accel) for row, count, accel in glitches if accel or row in own]
            samples = without_glitches(samples, glitches)
        samples = session.calibrated(replace(log, samples=samples))
        losses = _possible_losses(find_jumps(samples), samples.duration_s)
        events += [RegisterFault(LOST, number, row) for row in _away_from_blows(samples, losses).tolist()]
    return [event for event in events if not _in_bridge(session, event)]


def _in_bridge(session: Session, event: RegisterFault) -> bool:
    """Whether an event lies in a bridged gap, where the samples are interpolated and the stamps already show the loss."""
    first, last = event.row, event.row + max(event.samples, 1)
    bridges = session.logs[event.log].bridges
    gaps = [each for each in bridges if each.what == GAP]
    return any(first <= each.row + each.count + bridging.SIDE and last >= each.row - bridging.SIDE for each in gaps)


def without_false_readings(session: Session, events: list[RegisterFault]) -> Session:
    """The session with false readings interpolated from their neighbours; losses are unchanged."""
    logs = []
    for number, log in enumerate(session.logs):
        if mine := [Glitch(event.row, event.samples, event.accel) for event in events if event.id == FALSE and event.log == number]:
            log = replace(log, samples=without_glitches(log.samples, mine))
        logs.append(log)
    return replace(session, logs=tuple(logs))


class Crossing(NamedTuple):
    """How a gap is bridged: order of the polynomial, and its error in rotation, rad rms per axis."""

    order: int
    missed_rad: float


def crossings(logs: Sequence[Samples], events: Sequence[RegisterFault], length: int) -> dict[RegisterFault, Crossing]:
    """The best crossing of each event; length: samples lost each time, for a loss."""
    found: dict[RegisterFault, Crossing] = {}
    for number in {event.log for event in events}:
        own = [event for event in events if event.log == number]
        rows, counts = (np.array([getattr(event, name) for event in own], dtype=int) for name in ("row", "samples"))
        found |= dict(zip(own, (Crossing(*each) for each in bridging.best_crossings(logs[number], rows, counts, length)), strict=True))
    return found
