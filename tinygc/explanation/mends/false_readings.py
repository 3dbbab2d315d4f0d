"""False readings: some samples in a row that the sensor cannot have felt, between neighbours that agree across them.

Two kinds.  Rows that no noisy sensor gives: all channels at one value (0 or -1 of an interface that answered nothing), or the row before
once more, digit for digit.  And excursions of the gyro alone that begin and end in jumps: a cubic through the readings on either side
fits these as well as ever, and misses what lies between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.common.runs import runs_of
from session.detect import interpolation
from session.log.readings import replaced
from session.log.samples import Samples
from tinygc.explanation.mends import lost_samples
from tinygc.explanation.mends.parts import in_parts

LONGEST = 8  #: samples: what the cubic across them may span, twice its own readings on a side
SIDE = 4  #: samples on either side that carry the cubic: twice as many as it has coefficients
#: an excursion is false where it is beyond the cubic by this many times the readings' own scatter (three axes: once in 10^13)
BEYOND = 8.0
#: the cubic may miss the readings that carry it by this share of the excursion; one that does not come back is missed by half of it
#: (benchmarks/thresholds.py: double of it gives false names)
CAME_BACK = 0.12
#: an excursion is off the straight lines of both sides by this share of itself (benchmarks/thresholds.py: half of it gives
#: false names)
SHARE = 0.5
#: a cubic misses the readings that carry it by this many times their scatter at most, if nothing but noise is in them
#: (not critical: benchmarks/thresholds.py)
NOISE_MISSES = 2.5
#: standard deviation of a third difference of white noise
THIRD = np.sqrt(20.0)
#: a row that repeats says nothing where the noise is this small, in registers; with more, six channels repeat once in 10^5 rows, and
#: twice running once in 10^10
LEAST_NOISE_LSB = 2.0


@dataclass(frozen=True, eq=False)
class Glitches:
    """False readings: rows where each begins, samples, how many each lasts, and whether the accelerometer's are false, too."""

    rows: np.ndarray
    samples: np.ndarray
    accel: np.ndarray


def find_glitches(samples: Samples) -> Glitches | None:
    """All false readings; None where there are none, or so many that they are another thing."""
    found = [
        (row + first, count, accel) for first, own, part in in_parts(samples) for row, count, accel in _found_in(part) if row + first in own
    ]
    return _glitches(found) if found and len(found) <= lost_samples.PER_SECOND * samples.duration_s else None


def _found_in(samples: Samples) -> list[tuple[int, int, bool]]:
    impossible = _impossible(samples)
    if len(impossible) > lost_samples.PER_SECOND * samples.duration_s:
        return []
    cleaned = without_glitches(samples, _glitches(impossible))
    values = np.concatenate([cleaned.gyro, cleaned.accel], axis=1)
    size, scatter = lost_samples.third_differences(cleaned)
    high = np.flatnonzero(np.linalg.norm(size, axis=1) > lost_samples.JUMP)
    clusters = np.split(high, np.flatnonzero(np.diff(high) > LONGEST) + 1) if len(high) else []
    # Where samples are missing the readings step, and the stamps have said why.
    missing = lost_samples.open_gaps(cleaned)
    whole = [(int(c[0]), int(c[-1])) for c in clusters if not missing[max(c[0] + 1 - SIDE, 0) : c[-1] + 3 + SIDE].any()]
    excursions = [run for first, last in whole if (run := _excursion(values, scatter, first, last)) is not None]
    found = sorted({*impossible, *excursions})
    return [run for i, run in enumerate(found) if i == 0 or run[0] >= found[i - 1][0] + found[i - 1][1]]


def _glitches(runs: list[tuple[int, int, bool]]) -> Glitches:
    rows, counts, accel = np.array(runs, dtype=int).reshape(-1, 3).T
    return Glitches(rows, counts, accel.astype(bool))


def _impossible(samples: Samples) -> list[tuple[int, int, bool]]:
    """(first row, samples, True) of runs of rows that no sensor gives."""
    values = np.concatenate([samples.gyro, samples.accel], axis=1)
    lsb = np.array([lost_samples.lsb(column) for column in values.T])
    if not (lsb > 0).all():
        return []
    # Gravity has a length: a gyro may read nearly nothing in all axes, an accelerometer that is not falling never does.
    empty = (np.abs(np.rint(values / lsb)) <= 1).all(axis=1)
    same = np.zeros(len(values), dtype=bool)
    difference = np.diff(values, axis=0)
    if (np.median(np.abs(difference), axis=0) >= LEAST_NOISE_LSB * lsb).all():
        same[1:] = (difference == 0).all(axis=1)
    # One repetition happens by chance once in many sessions, and does no harm.
    return [*_runs(empty, 1), *_runs(same & ~empty, 2)]


def _runs(mask: np.ndarray, fewest: int) -> list[tuple[int, int, bool]]:
    """(first row, samples, True) of each run of at least ``fewest``, of those that are short enough and have neighbours."""
    starts, stops = runs_of(mask)
    runs = zip(starts.tolist(), (stops - starts).tolist(), strict=True)
    return [(first, count, True) for first, count in runs if fewest <= count <= LONGEST and SIDE <= first <= len(mask) - count - SIDE]


def _excursion(values: np.ndarray, scatter: np.ndarray, first: int, last: int) -> tuple[int, int, bool] | None:
    """(first row, samples, False) of what the cubic across a cluster of high third differences misses, if the gyro came back, alone."""
    start, stop = first + 1, last + 3
    if start < SIDE or stop + SIDE > len(values) or stop - start > LONGEST + 4:
        return None
    noise = scatter[first : last + 1].min(axis=0) / THIRD
    inside, beside = _cubic(values, start, stop)
    beyond = (values[start:stop] - inside) / noise
    missed = (np.concatenate([values[start - SIDE : start], values[stop : stop + SIDE]]) - beside) / noise
    away = np.linalg.norm(beyond[:, :3], axis=1)
    false = np.flatnonzero(away > max(BEYOND, 0.1 * away.max()))
    if not len(false) or np.linalg.norm(beyond[:, 3:], axis=1).max() > away.max():
        return None
    excursion = beyond[np.argmax(away), :3] / away.max()
    if _off_both_sides(values, start, stop, excursion / noise[:3]) < SHARE * away.max():
        return None  # a corner, as where a rate is clipped: each reading continues one side or the other
    count = int(false[-1] - false[0]) + 1
    came_back = np.linalg.norm(missed[:, :3], axis=1).max() < max(CAME_BACK * away.max(), NOISE_MISSES)
    return (start + int(false[0]), count, False) if came_back and count <= LONGEST else None


def _off_both_sides(values: np.ndarray, start: int, stop: int, along: np.ndarray) -> float:
    """The farthest that a gyro reading in start:stop is, ``along`` a direction (3,), from the straight lines of both sides.

    Along the excursion alone: a turn that bends about another axis leaves its straight lines, too.
    """
    off = []
    for at in (np.arange(start - SIDE, start), np.arange(stop, stop + SIDE)):
        line = np.polynomial.polynomial.polyfit(at - start, values[at, :3] @ along, 1)
        predicted = np.polynomial.polynomial.polyval(np.arange(stop - start), line)
        off.append(np.abs(values[start:stop, :3] @ along - predicted))
    return float(np.minimum(*off).max())


def _cubic(values: np.ndarray, start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
    """The cubic through ``SIDE`` rows on either side of start:stop, at the rows between and at those beside."""
    at = np.concatenate([np.arange(start - SIDE, start), np.arange(stop, stop + SIDE)])
    middle = (start + stop - 1) / 2
    fit = np.polynomial.polynomial.polyfit(at - middle, values[at], 3)
    between = np.polynomial.polynomial.polyval(np.arange(start, stop) - middle, fit).T
    return between, np.polynomial.polynomial.polyval(at - middle, fit).T


def without_glitches(samples: Samples, glitches: Glitches) -> Samples:
    """False readings replaced by what their neighbours say."""
    mended: dict[str, dict[int, np.ndarray]] = {"gyro": {}, "accel": {}}
    orders = {count: interpolation.best_order(samples, glitches.rows, count)[0] for count in set(glitches.samples.tolist())}
    for row, count, both in zip(glitches.rows.tolist(), glitches.samples.tolist(), glitches.accel, strict=True):
        for name in ("gyro", "accel") if both else ("gyro",):
            first = max(row - interpolation.SIDE, 0)
            near = np.array(getattr(samples, name)[first : row + count + interpolation.SIDE])
            for at in mended[name].keys() & set(range(first, first + len(near))):
                near[at - first] = mended[name][at]
            put_in = interpolation.across(near, row - 1 - first, row + count - first, count, orders[count])
            mended[name] |= dict(zip(range(row, row + count), put_in, strict=True))
    for name, by_row in mended.items():
        if by_row:
            rows = np.array(sorted(by_row))
            values = replaced(getattr(samples, name), rows, np.array([by_row[row] for row in rows.tolist()]))
            samples = replace(samples, **{name: values})
    return samples
