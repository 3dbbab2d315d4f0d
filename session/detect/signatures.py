"""Faults of hardware and firmware, each known by its signature: what a bus, a register, a gate or a filter leaves in the readings.

Where one explains what other checks would state of a log, it is stated alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from session.base.errors import FormatError
from session.base.numeric import held_for, new_readings, running_sum, sigma_of
from session.base.texts import significant
from session.base.units import DEG, MDPS, G
from session.detect.axes import agreement
from session.detect.events import FULL_SCALE_ROUNDING, gyro_reach_dps
from session.detect.findings import Finding, axes_text, xyz_text
from session.detect.rounding import lsb_of, rounding_variance
from session.detect.stills import Blocks, block_moments, measure, quiet_runs
from session.log.config import Sensor
from session.log.logfile import Log
from session.log.registers import PROFILES
from session.log.samples import Samples
from session.log.sensors import REGISTER_MAX

#: readings of a log that are looked at for what shows in every part of it
MOST = 1 << 18
SENSORS = ("gyro", "accelerometer")
FEW, EXCHANGED, WRAPS, DEAD_BAND = "few values", "byte order", "gyro wraps", "dead band"
RANGE, FILTER, HIGH_PASS, TRACKED, _NEW_ZERO = "gyro range", "gyro filter", "high-pass", "tracked zero", "new zero"
#: findings that explain stills, turns and noise that are wrong or missing
CAUSES = (FEW, EXCHANGED, WRAPS, DEAD_BAND, RANGE, HIGH_PASS)


def explains_others(findings: Iterable[Finding]) -> bool:
    """Whether one of them is the cause of what else a log does not show."""
    return any(finding.level == "error" and finding.what in CAUSES for finding in findings)


def check_signatures(log: Log, sensor: Sensor, at_rest: bool = True) -> list[Finding]:
    """The first of these faults that a log shows; at_rest: whether it is one of turns from rest to rest, with an accelerometer."""
    for look in (_check_values, _check_bytes, _check_wraps, _check_dead_band):
        if found := look(log, sensor):
            return found
    rests = _rests(log.samples) if at_rest else None
    checks = (_check_change, _check_high_pass, _check_tracked, _check_new_zero)
    return [] if rests is None else next(filter(None, (check(log.path.name, rests) for check in checks)), [])


# A bus that answers a few values whatever the sensor does.

#: values of three axes, and readings that hold no other; a coarse register has more while the body turns
FEW_VALUES, LEAST_READINGS = 6, 200
#: the body moves where the other sensor's readings span this over the middle four fifths of so many rows, or the few values do: dps, g
MOVES = (10.0 * DEG, 0.5 * G)


def _check_values(log: Log, sensor: Sensor) -> list[Finding]:
    if not (count := min(len(log.samples), MOST) // LEAST_READINGS):
        return []
    gyro, accel = (np.asarray(part[: count * LEAST_READINGS]).reshape(count, -1, 3) for part in (log.samples.gyro, log.samples.accel))
    findings = []
    for which, (own, other, unit, word) in enumerate(((gyro, accel, DEG, "dps"), (accel, gyro, G, "g"))):
        ordered = np.sort(own.reshape(count, -1), axis=1)
        few = (ordered[:, 1:] != ordered[:, :-1]).sum(axis=1) < FEW_VALUES
        values = np.unique(own[few]) if few.any() else np.zeros(0)
        if not 0 < len(values) <= FEW_VALUES or not np.ptp(own[few], axis=1).any():  # one value is stuck or dead, another finding
            continue
        moved = other[few].reshape(1, -1, 3) if few.all() else other[few]  # from rest to rest, where it never answers
        span = np.ptp(np.quantile(moved, (0.1, 0.9), axis=1), axis=0).max()
        if max(span / MOVES[1 - which], np.ptp(values) / MOVES[which]) < 1:
            continue
        read = ", ".join(f"{value / unit + 0.0:.4g}" for value in values)
        first = f", the first at {log.samples.at_s(int(np.argmax(few)) * LEAST_READINGS):.0f} s"
        part = "" if few.all() else f" in {few.mean():.0%} of the log{first}"
        text = f"the {SENSORS[which]} reads {len(values)} values only{part}, {read} {word}, while the body moves"
        do = "the bus answers, and the sensor does not: look at the wiring, the address, the register map and the supply"
        findings.append(Finding("error", log.path.name, FEW, text, do))
    return findings


# The two bytes of a register exchanged: what was the low byte's noise jumps by multiples of 256.

#: times smoother that readings are with their bytes the other way: 256 where they are exchanged, 1/256 where they are not;
#: any bar far from both serves
SMOOTHER = 4.0
#: of a register's step, that readings are off whole numbers of it where they are no registers
WHOLE_WITHIN = 0.05


def _check_bytes(log: Log, sensor: Sensor) -> list[Finding]:
    texts, most = [], 0.0
    for which, values in enumerate((log.samples.gyro, log.samples.accel)):
        try:
            units = sensor.register_units
            step = units.accel_mps2 if which else units.gyro_rps
        except FormatError:
            continue
        registers = np.asarray(values[:MOST]) / step
        if len(registers) < LEAST_READINGS or np.abs(registers - np.rint(registers)).max() > WHOLE_WITHIN:
            continue
        smoother = np.array([_smoother_exchanged(column) for column in np.rint(registers).astype(np.int64).T])
        if (exchanged := smoother > SMOOTHER).any():
            texts.append(f"{SENSORS[which]} ({axes_text(exchanged)})")
            most = max(most, float(smoother.max()))
    if not texts:
        return []
    text = f"{' and '.join(texts)}: with the two bytes of each register exchanged, neighbours differ up to {most:.0f} times less"
    do = "read high and low byte the other way round (big or little endian) where the log is written"
    return [Finding("error", log.path.name, EXCHANGED, text, do)]


def _smoother_exchanged(registers: np.ndarray) -> float:
    """How many times smoother registers (N,) are with their bytes exchanged; both have to vary, as of no left-justified 8 bits."""
    if np.abs(registers).max() > 1 << 15 or len(np.unique(registers & 0xFF)) <= 2:
        return 0.0
    other = (registers & 0xFF) << 8 | registers >> 8 & 0xFF
    as_read, exchanged = (np.abs((np.diff(each) + (1 << 15)) % (1 << 16) - (1 << 15)).mean() for each in (registers, other))
    return float(as_read / exchanged) if exchanged else 0.0


# Rates that come round at the register's end: the sign changes from one reading to the next, and a whole register on the movement goes on.

#: of the register's end: a jump from one side to the other; how far the reading behind it, a whole register on, is from where it went
ACROSS, GOES_ON = 1.5, 0.1
#: of the step through the end, that the step before it is at least: a table that reverses at once makes none
TOWARDS = 0.25
#: rad/s: where the registers of known sensors end
ENDS = sorted({REGISTER_MAX * mdps * MDPS for profile in PROFILES if profile.gyro for mdps in profile.gyro.values()})


def _check_wraps(log: Log, sensor: Sensor) -> list[Finding]:
    samples = log.samples
    peak = max(float(np.abs(samples.gyro[:, axis]).max()) for axis in range(3))
    # Of a sensor that is not known, or is another than is stated, the log's greatest reading is just below an end; it comes round and back.
    others = [(end, 2) for end in ENDS if (1 - GOES_ON) * end < peak < (1 + FULL_SCALE_ROUNDING) * end]
    for end, least in ((gyro_reach_dps(sensor) * DEG, 1), *others):
        places = [_comes_round(samples.gyro[:, axis], end) for axis in range(3)] if np.isfinite(end) else []
        if sum(map(len, places)) < least:
            continue
        texts = []
        for axis, rows in enumerate(places):
            if len(rows):
                jump = " to ".join(f"{samples.gyro[row, axis] / DEG:.4g}" for row in (rows[0], rows[0] + 1))
                first = f"{len(rows)} places, first at {samples.at_s(int(rows[0])):.1f} s"
                texts.append(f"{'xyz'[axis]} jumps from {jump} dps between two readings in {first}")
        text = f"{'; '.join(texts)}: the register comes round at ±{end / DEG:.4g} dps"
        return [Finding("error", log.path.name, WRAPS, text, "choose a larger full scale, or turn slower")]
    return []


def _comes_round(values: np.ndarray, end: float) -> np.ndarray:
    """Rows of readings (N,) behind which they come round at the register's end, where most do that jump so far."""
    rows = np.flatnonzero(np.abs(np.diff(values)) > ACROSS * end)
    rows = rows[rows > 0]
    before, through = (np.sign(values[rows]) * step for step in (values[rows] - values[rows - 1], values[rows + 1] - values[rows]))
    through = through + 2 * end
    found = (np.abs(through - before) < GOES_ON * end) & (before > TOWARDS * through)
    return rows[found & (2 * np.count_nonzero(found) > len(rows))]


# A dead band: rates within it are logged as one value, or not at all; those beyond are complete, or begin at zero.

#: chance that readings of any density leave such a gap where none is
BY_CHANCE = 1e-4
#: crossings of the gap in one step; share of the readings within the band; of those beyond, on the rarer side
CROSSINGS, LEAST_WITHIN, LEAST_SIDE = 10, 0.05, 0.1
#: of the gap: what the next gaps beyond it are smaller by.  Those of a register, or of few rates of a table, are as wide
#: (test_a_coarse_register_is_no_dead_band)
NEXT_GAP = 1 / 3
#: rad/s, far below any register's step: equal decimals in other units differ by less
RESOLVED = 1e-6 * DEG
#: of the band, that is empty: what noise behind the band leaves
MOST_OF_IT = 0.5
#: widest of such gaps that are looked at
WIDEST = 50


def _check_dead_band(log: Log, sensor: Sensor) -> list[Finding]:
    gyro = np.asarray(log.samples.gyro[:MOST])
    gyro = gyro[new_readings(gyro) | (gyro == gyro[0]).all(axis=1)] if held_for(new_readings(gyro)) > 1 else gyro
    if len(gyro) < LEAST_READINGS:
        return []
    centres = np.array([_centre(column) for column in gyro.T])
    bands = [_gap(column - centre) for column, centre in zip(gyro.T, centres, strict=True)]
    found = np.array([band is not None for band in bands])
    if found.any():
        here = [band for band in bands if band is not None]
        edges = ", ".join(f"{significant(band.beyond / DEG, 2)}" for band in here)
        text = f"{_stands(found, centres, max(band.share for band in here))}, and no reading lies between that and ±{edges} dps: a gate"
    elif (norm := _gap(np.linalg.norm(gyro - centres, axis=1), sided=False)) is not None and norm.within == 0:
        stands, least = _stands(np.ones(3, dtype=bool), centres, norm.share), significant(norm.beyond / DEG, 2)
        text = f"{stands}, and all others beyond {least} dps together: a gate"
    else:
        return []
    do = "switch off what does that where the log is written: with it the zero at rest is lost, and the slow part of every turn"
    return [Finding("error", log.path.name, DEAD_BAND, text, do)]


def _stands(axes: np.ndarray, centres: np.ndarray, share: float) -> str:
    values = ", ".join(dict.fromkeys(f"{round(centre / DEG, 2) + 0.0:g}" for centre in centres[axes]))
    return f"{axes_text(axes)} stand{'' if np.count_nonzero(axes) > 1 else 's'} at {values} dps in {share:.0%} of the rows"


def _centre(values: np.ndarray) -> float:
    """Where the readings (N,) are densest: the middle of the narrowest span that holds a tenth of them."""
    ordered, count = np.sort(values), max(len(values) // 10, 2)
    first = int(np.argmin(ordered[count:] - ordered[:-count]))
    return float(np.median(ordered[first : first + count]))


class _Band(NamedTuple):
    """A gap around the densest readings: the farthest within and the nearest beyond it, rad/s, and the share of the readings within."""

    within: float
    beyond: float
    share: float


def _gap(off: np.ndarray, sided: bool = True) -> _Band | None:
    """A gap in the sizes of readings (N,) from where they are densest, empty though as wide a span beyond it is full.

    Of n readings that lie in the two spans together by a density that does not fall towards zero, all are in the outer one with a chance
    of 2^-n at most; there are N gaps.
    """
    size = np.rint(np.abs(off) / RESOLVED) * RESOLVED
    ordered = np.sort(size)
    count, low = len(ordered), int(LEAST_WITHIN * len(ordered))
    gaps = np.diff(ordered)
    full = np.searchsorted(ordered, ordered[1:] + gaps, side="right") - np.arange(1, count)
    full[:low] = 0
    places = np.flatnonzero((full >= np.log2(count / BY_CHANCE)) & (gaps > np.maximum(MOST_OF_IT * ordered[1:], 2 * RESOLVED)))
    for place in places[np.argsort(gaps[places])[: -WIDEST - 1 : -1]]:
        within, beyond, width = float(ordered[place]), float(ordered[place + 1]), float(gaps[place])
        far = np.searchsorted(ordered, beyond + 2 * width, side="right")
        if np.diff(ordered[place + 1 : far], append=beyond + 2 * width).max() > NEXT_GAP * width:
            continue
        inside = size <= within
        crossings = int(np.count_nonzero(inside[1:] != inside[:-1]))
        outer = off[(size >= beyond) & (size <= beyond + width)]
        side = float((outer > 0).mean())
        if crossings >= CROSSINGS and (not sided or min(side, 1 - side) >= LEAST_SIDE):
            return _Band(within, beyond, float(inside.mean()))
    return None


# Faults that show from rest to rest.  The rests are those of the accelerometer: what is wrong with the gyroscope may hide them from it.

#: s: cut off a rest at either end, and what is left at least; rests at least, on either side of a change; s of a rest that are looked at
TRIMMED_S, LEAST_REST_S, LEAST_RESTS, LONGEST_S = 0.3, 0.7, 3, 30.0


@dataclass(frozen=True, eq=False)
class _Rests:
    """Runs (start, stop) of blocks at rest; means (R, 3) of the rate, rad/s; sigmas (R, 3) of these by noise alone."""

    samples: Samples
    blocks: Blocks
    runs: list[tuple[int, int]]
    noise: np.ndarray

    @property
    def means(self) -> np.ndarray:
        return np.array([self.blocks.gyro_mean[start:stop].mean(axis=0) for start, stop in self.runs])

    def rows(self, number: int) -> slice:
        """Of one rest; of a long one its beginning."""
        start, stop = (edge * self.blocks.size for edge in self.runs[number])
        return slice(start, min(stop, start + round(LONGEST_S / self.samples.period_s)))

    def between(self, number: int) -> str:
        """The seconds between a rest and the one before."""
        before, behind = self.runs[number - 1][1] * self.blocks.size, self.runs[number][0] * self.blocks.size
        return f"between {self.samples.at_s(before):.1f} and {self.samples.at_s(behind):.1f} s"


def _rests(samples: Samples) -> _Rests | None:
    blocks = block_moments(samples)
    if len(blocks) < 3 or blocks.duration_s > LONGEST_S / LEAST_RESTS or not samples.accel[:MOST].any():  # time in another unit
        return None
    trimmed, least = (max(1, round(seconds / blocks.duration_s)) for seconds in (TRIMMED_S, LEAST_REST_S))
    runs = [(start + trimmed, stop - trimmed) for start, stop in quiet_runs(blocks, by_force=True)[0]]
    runs = [(start, stop) for start, stop in runs if stop - start >= max(least, LEAST_RESTS)]
    if len(runs) < 2 * LEAST_RESTS:
        return None
    steps = np.concatenate([np.diff(blocks.gyro_mean[start:stop], axis=0) for start, stop in runs])
    return _Rests(samples, blocks, runs, np.maximum(sigma_of(steps) / np.sqrt(2), np.finfo(float).tiny))


# A full scale or a filter that changes within a log: the noise of neighbouring readings at rest does, at one row.

#: log of the power of neighbours' differences: by as much it changes, and the share of rests on the wrong side of the middle
LEAST_CHANGE, WRONG_SIDE = 0.3, 0.05
#: correlation of neighbouring differences: by so much it changes where a filter of all axes does, and of one; the full scale leaves it
LEAST_CORRELATION = (0.1, 0.15)
#: sigmas of that change: normal ones are beyond with a chance of 6e-7
SURELY = 5.0
#: that of white noise is -1/2, and no filter's is less by more than chance
ALTERNATES = -0.6
#: of what gravity requires of the rates: a change of the full scale
FACTOR = 1.2
#: log-likelihood of one row, at most: a turn's own jerks are no noise
MOST_LIKELIHOOD = 5.0


def _check_change(where: str, rests: _Rests) -> list[Finding]:
    steps = [np.diff(rests.samples.gyro[rests.rows(number)], axis=0) for number in range(len(rests.runs))]
    power = np.array([step.var(axis=0) for step in steps])
    alive = power.all(axis=0)  # an axis that stands in a rest is dead or coarse, another finding
    power[:, ~alive] = 1.0
    level, follows = np.log(power), np.array([(step[1:] * step[:-1]).mean(axis=0) for step in steps]) / power
    found = [[0, 1, 2]] if _changes(level) is not None else [[axis] for axis in range(3) if _changes(level[:, [axis]]) is not None]
    for axes in found:
        at = _changes(level[:, axes]) or 0
        row, change = _row_of_change(rests, at, axes), _change(level[:, axes], at)
        place, much = f"from row {row} ({rests.samples.at_s(row):.1f} s) on", significant(np.exp(change.mean() / 2), 2)
        if len(axes) == 3 and (factor := _factor(rests, at)) is not None:
            text = f"{place} the rates are {factor:.3g} times what they were by gravity, and their noise {much} times"
            do = "the full scale changes there: record with one, or cut the log there and give each piece its own"
            return [Finding("error", where, RANGE, text, do)]
        # A filter makes the quieter side the smoother one; a vibration is in the louder one, and has its own frequency.
        own, louder = follows[:, axes], slice(at, None) if change.mean() > 0 else slice(0, at)
        smoother = -np.sign(change.mean()) * _change(own, at)
        alternates = np.median(own[louder], axis=0).min() < ALTERNATES
        if _sigmas(own.mean(axis=1), at) > SURELY and smoother.min() > LEAST_CORRELATION[len(axes) < 3] and not alternates:
            text = f"{place} neighbouring readings of {', '.join('xyz'[axis] for axis in axes)} at rest differ by {much} times as much"
            do = "a filter or a mean changes there, and with it the delay: record with one setting, or cut the log there"
            return [Finding("warning", where, FILTER, f"{text}, and follow each other otherwise", do)]
    return []


def _changes(level: np.ndarray) -> int | None:
    """The rest from which on values (R, A) are others, all of them in one sense; None where they are not."""
    size = level.mean(axis=1)
    at = min(range(LEAST_RESTS, len(size) - LEAST_RESTS + 1), key=lambda k: _apart(size[:k]) + _apart(size[k:]))
    change = _change(level, at)
    return at if _clean(size, at) and (change * np.sign(change.mean())).min() > LEAST_CHANGE else None


def _factor(rests: _Rests, at: int) -> float | None:
    """How many times as large the rates are from a rest on, by gravity; None where it is not much, or gravity does not show it."""
    stills = [measure(rests.samples, [run], rests.blocks.size) for run in rests.runs]
    before, behind = (agreement(rests.samples, part) for part in (stills[:at], stills[at:]))
    if before is None or behind is None or not np.array_equal(before.axes, behind.axes):
        return None
    factor = before.scale / behind.scale
    return factor if abs(np.log(factor)) > np.log(FACTOR) else None


def _apart(values: np.ndarray) -> float:
    return float(np.abs(values - np.median(values)).sum())


def _change(values: np.ndarray, at: int) -> np.ndarray:
    """(A,): by how much the median of values (R, A) changes at a rest."""
    return np.asarray(np.median(values[at:], axis=0) - np.median(values[:at], axis=0))


def _sigmas(values: np.ndarray, at: int) -> float:
    """By how many of its sigmas the median of values (R,) changes at a rest; a median's is 1.25 times a mean's."""
    parts = values[:at], values[at:]
    sigma = float(sigma_of(np.concatenate([part - np.median(part) for part in parts])))
    return abs(float(_change(values, at))) / max(1.25 * sigma * float(np.sqrt(sum(1 / len(part) for part in parts))), np.finfo(float).tiny)


def _clean(values: np.ndarray, at: int) -> bool:
    """Whether values (R,) lie on either side of a middle before and behind a rest, but for a few; the change may be within that one."""
    up = values > (np.median(values[:at]) + np.median(values[at:])) / 2
    return all(min(part.mean(), 1 - part.mean()) <= WRONG_SIDE for part in (up[: at - 1], up[at + 1 :]))


def _row_of_change(rests: _Rests, at: int, axes: list[int]) -> int:
    """The likeliest row about the rest from which on it differs, by differences of these axes that hold no smooth movement."""

    def jerks(rows: slice) -> np.ndarray:
        return np.diff(rests.samples.gyro[rows][:, axes], n=3, axis=0) ** 2

    first, last = (sum(rests.runs[number]) // 2 * rests.blocks.size for number in (at - 2, at + 1))
    square, count = jerks(slice(first, last)), len(rests.runs)
    sides = [np.concatenate([jerks(rests.rows(i)) for i in part]).mean(axis=0) for part in (range(at), range(at, count))]
    before, behind = ((square / side + np.log(side)).sum(axis=1) / -2 for side in sides)
    gained = np.clip(before - behind, -MOST_LIKELIHOOD, MOST_LIKELIHOOD)
    return first + int(np.argmax(running_sum(gained)))


# A high-pass: the rate behind a turn is less by a share of the angle turned, and comes back.  With w at rest before and behind a turn the
# same, y' = w' - y / tau makes y[behind] - y[before] = -integral of y / tau, whatever the turn was.

#: of the scatter of what rests read, that the law leaves; noises of a rest that it must be beyond
LAW_LEAVES, BEYOND = 0.25, 5.0
#: of a zero, that a high-pass takes away within the log: a slower one is no high-pass, but turns read for rests
LEAST_TAKEN = 0.1


def _check_high_pass(where: str, rests: _Rests) -> list[Finding]:
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(rests.blocks.gyro_mean, axis=0) * rests.blocks.duration_s])
    middles = np.array([turned[start : stop + 1].mean(axis=0) for start, stop in rests.runs])
    change, angle = np.diff(rests.means, axis=0), np.diff(middles, axis=0)
    lasting = np.array([stop - start for start, stop in rests.runs])
    found, tau_s = np.zeros(3, dtype=bool), np.zeros(3)
    for axis in range(3):
        large = np.abs(angle[:, axis]) > np.median(np.abs(angle[:, axis])) / 2
        if large.sum() < 2 * LEAST_RESTS:
            continue
        slope = float(np.median(change[large, axis] / angle[large, axis]))
        scatter, left = (float(sigma_of(values)) for values in (change[:, axis], change[:, axis] - slope * angle[:, axis]))
        beyond = scatter > BEYOND * rests.noise[axis] / np.sqrt(np.median(lasting))
        beyond &= -slope * rests.samples.duration_s > LEAST_TAKEN
        found[axis], tau_s[axis] = beyond and left < LAW_LEAVES * scatter, -1 / slope if slope else np.inf
    if not found.any():
        return []
    corners = ", ".join(significant(1 / (2 * np.pi * tau), 2) for tau in tau_s[found])
    over = ", ".join(f"{tau:.3g}" for tau in tau_s[found])
    text = f"behind each turn the rate of {axes_text(found)} is less by the angle turned over {over} s, and comes back: a high-pass of "
    text += f"{corners} Hz"
    do = "switch the sensor's or the firmware's high-pass off, and record again: it takes away the zero, and a share of every turn"
    return [Finding("error", where, HIGH_PASS, text, do)]


# A zero that is tracked: at rest the rates are drawn to 0, exponentially, whatever they began with.

#: s that are tried: at the first it is the end of a turn, at the last a sensor that warms up; share of what rests differ from a constant
#: by, that the law explains; what it gains at least, in chi-square: of one parameter, white noise gains that with a chance below 1e-11
DRAWN_S, EXPLAINED, GAINED = np.geomspace(0.2, 12.0, 30), 0.7, 50.0


def _check_tracked(where: str, rests: _Rests) -> list[Finding]:
    most = round(LONGEST_S / rests.blocks.duration_s)
    runs = [rests.blocks.gyro_mean[start : min(stop, start + most)] for start, stop in rests.runs]
    constant = sum(((run - run.mean(axis=0)) ** 2).sum(axis=0) for run in runs)
    left = np.zeros((len(DRAWN_S), 3))
    for run in runs:
        law = np.exp(-np.arange(len(run)) * rests.blocks.duration_s / DRAWN_S[:, None])
        left += (run**2).sum(axis=0) - (law @ run) ** 2 / (law**2).sum(axis=1, keepdims=True)
    best, free = left.argmin(axis=0), sum(map(len, runs)) - len(runs)
    least, square = left.min(axis=0), rests.noise**2
    gained = constant - least
    settles = (best > 0) & (best < len(DRAWN_S) - 1)
    found = settles & (gained > EXPLAINED * (constant - free * square)) & (gained > GAINED * np.maximum(square, least / free))
    if not found.any():
        return []
    shown, sigma = _share_turned(rests, runs, found)
    if shown - SURELY * sigma > 0.5:
        return []
    text = f"at rest {axes_text(found)} are drawn to 0 with {DRAWN_S[best[found]].min():.2g} s: the sensor or its firmware tracks its zero"
    do = "switch that off, and record again: each turn begins with an unknown zero"
    if shown + SURELY * sigma > 0.5:
        text, do = f"{text}, or the mount creeps", f"hold the sensor firmly, or {do}"
    return [Finding("warning", where, TRACKED, text, do)]


def _share_turned(rests: _Rests, runs: list[np.ndarray], axes: np.ndarray) -> tuple[float, float]:
    """The share of the angle that rates (B, 3) of rests state that gravity shows, 1 where the body creeps, and its sigma; only angles about
    horizontal axes show."""
    product, square, steps = 0.0, float(np.finfo(float).tiny), []
    for (start, _), run in zip(rests.runs, runs, strict=True):
        force = rests.blocks.accel_mean[start : start + len(run)]
        text = np.cross(force.mean(axis=0), (np.cumsum(run, axis=0) - run / 2) * axes * rests.blocks.duration_s)
        text -= text.mean(axis=0)
        product, square = product + float((text * force).sum()), square + float((text**2).sum())
        steps.append(np.diff(force, axis=0))
    return product / square, float(sigma_of(np.concatenate(steps), axis=None)) / np.sqrt(2 * square)


# A zero that is taken again within a log, or steps.

#: scatters from rest to rest: of a step to 0 on all axes, which firmware makes, and of any other; rests that show that it stays
TO_ZERO, STEP, STAYS = 8.0, 20.0, 4


def _check_new_zero(where: str, rests: _Rests) -> list[Finding]:
    means, step_rps = rests.means, lsb_of(rests.samples.gyro[:MOST])
    rounding = rounding_variance(step_rps, rests.noise * np.sqrt(rests.blocks.size))
    scatter = np.maximum(sigma_of(np.diff(means, axis=0)), np.sqrt(rounding + np.finfo(float).tiny))
    found = []
    for at in range(LEAST_RESTS, len(means) - LEAST_RESTS + 1):
        before, behind = (np.median(part, axis=0) for part in (means[max(at - STAYS, 0) : at], means[at : at + STAYS]))
        step = np.minimum(np.abs(means[at] - means[at - 1]), np.abs(behind - before)) / scatter
        to_zero = bool((np.abs(behind) < TO_ZERO / 2 * scatter).all())
        if step.max() > (TO_ZERO if to_zero else STEP):
            found.append((float(step.max()), at, behind - before, to_zero))
    if not found:
        return []
    _, at, step, to_zero = max(found, key=lambda each: each[0])
    text = f"the zero steps by {xyz_text(step / DEG)} dps{' to 0' if to_zero else ''} {rests.between(at)}"
    do = "does the board reset its zero there? switch that off" if to_zero else "a knock, a restart, a new zero?"
    return [Finding("warning", where, _NEW_ZERO, text, f"{do}, or cut the log there; the effect gyro.bias_step fits it")]
