"""Moments at which one unit's register leaps: did the others feel it?  A false reading is in one unit, a knock in all."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.common.units import DEG, NS
from session.detect.impacts import find_impacts
from tinygc.array.fit import ArrayFit
from tinygc.explanation.mends.events import FALSE, bridged, proposed

FALSE_READING, KNOCK = "false reading", "knock"
#: of the leap: what the others feel less of, they have not felt (benchmarks/array_fit.py: knocks are felt alike to a tenth)
FELT = 0.5
#: samples beside the leap in which the others' clocks may see it
BESIDE = 1
#: s around a leap that is read of the others
NEAR_S = 0.1
#: a board's impact lasts so long, s: units that jump within it have felt one knock
TOGETHER_S = 0.05


@dataclass(frozen=True, eq=False)
class Moment:
    """what: ``false reading`` or ``knock``; at_s of the array's clock; unit: number of the one whose register leaps, or that feels a knock
    most; size_rps of the leap, 0 of a knock that only accelerometers show; felt: share of it that the other units feel; units: numbers of
    those in which a detector found it."""

    what: str
    at_s: float
    unit: int
    size_rps: float
    felt: float
    units: tuple[int, ...]

    @property
    def words(self) -> str:
        """Whose it is."""
        leap, felt = f"leaps by {self.size_rps / DEG:.3g}°/s", f"{100 * max(self.felt, 0.0):.0f} % of it"
        if self.what == FALSE_READING:
            return f"unit {self.unit} alone {leap}, the others feel {felt}: a false reading"
        if self.size_rps:
            return f"unit {self.unit} {leap}, and the others feel {felt}: a knock, no false reading"
        return f"{len(self.units)} units' specific force jumps at once: a knock that all felt"


def moments_of(fit: ArrayFit) -> list[Moment]:
    """Leaps that any unit's detector proposes, and impacts, in order of time."""
    leaps = []
    for i, unit in enumerate(fit.prepared):
        session = unit.problem.session
        events = [event for event in proposed(session) if event.id == FALSE]
        calm = bridged(session, events)
        for event in events:
            rows = np.arange(event.row, event.row + event.samples)
            samples, smooth = (each.logs[event.log].samples for each in (session, calm))
            t_s = samples.t_ns[rows] * NS
            leap = _in_array(fit, i, np.asarray(samples.gyro)[rows] - np.asarray(smooth.gyro)[rows], bias=False)
            usual = _in_array(fit, i, np.asarray(smooth.gyro)[rows])
            felt = _felt(fit, i, event.log, t_s, leap, usual, samples.period_s)
            if felt is None:
                continue
            what = KNOCK if felt > FELT else FALSE_READING
            size = float(np.linalg.norm(leap, axis=1).max())
            leaps.append(Moment(what, float(t_s.mean()), unit.number, size, felt, (unit.number,)))
    leaps = _one_knock_each(leaps)
    return sorted([*leaps, *_impacts(fit, leaps)], key=lambda moment: moment.at_s)


def _one_knock_each(leaps: list[Moment]) -> list[Moment]:
    """Leaps of several units at once that all felt are one knock: that of the unit which leaps most."""
    kept: list[Moment] = []
    for leap in sorted(leaps, key=lambda moment: -moment.size_rps):
        same = [k for k, one in enumerate(kept) if one.what == leap.what == KNOCK and abs(one.at_s - leap.at_s) < TOGETHER_S]
        if same:
            one = kept[same[0]]
            kept[same[0]] = replace(one, units=tuple(sorted({*one.units, *leap.units})))
        else:
            kept.append(leap)
    return kept


def _in_array(fit: ArrayFit, i: int, rate: np.ndarray, bias: bool = True) -> np.ndarray:
    """Measured rates (K, 3) of the i-th unit, or differences of such, as rates of the body in the array's axes."""
    unit = fit.units[i]
    return np.asarray((rate @ unit.model.E.T + (unit.model.B if bias else 0.0)) @ unit.place.mounting.T)


def _felt(fit: ArrayFit, i: int, log: int, t_s: np.ndarray, leap: np.ndarray, usual: np.ndarray, period_s: float) -> float | None:
    """Share of the leap in the mean of the others; None where none of them was there."""
    shares = []
    for late in np.arange(-BESIDE, BESIDE + 1) * period_s / 2:
        others = []
        for j, other in enumerate(fit.prepared):
            if j == i or log >= len(other.problem.session.logs):
                continue
            samples = other.problem.session.logs[log].samples
            theirs = samples.t_ns * NS
            near = slice(*np.searchsorted(theirs, [t_s[0] - NEAR_S, t_s[-1] + NEAR_S]))
            if not theirs[near].size or theirs[near][0] > t_s[0] + late or theirs[near][-1] < t_s[-1] + late:
                continue
            rate = _in_array(fit, j, np.asarray(samples.gyro[near]))
            others.append(np.column_stack([np.interp(t_s + late, theirs[near], axis) for axis in rate.T]) - usual)
        if others:
            shares.append(float(np.sum(np.median(others, axis=0) * leap) / np.sum(leap**2)))
    return max(shares) if shares else None


def _impacts(fit: ArrayFit, leaps: list[Moment]) -> list[Moment]:
    """Impacts that more than half of the units' accelerometers show at once, and no leap told already."""
    found: list[tuple[float, int]] = []
    for unit in fit.prepared:
        for log in unit.problem.session.logs:
            found += [(log.samples.t_ns[each.row] * NS, unit.number) for each in find_impacts(log.samples)]
    moments: list[Moment] = []
    spans = [(float(a), float(b)) for a, b in fit.same.time_s]
    for at_s, _ in sorted(found):
        who = tuple(sorted({number for other_s, number in found if abs(other_s - at_s) < TOGETHER_S}))
        inside = spans[0][0] <= at_s <= spans[-1][1]
        told = any(abs(moment.at_s - at_s) < TOGETHER_S for moment in (*leaps, *moments))
        if inside and not told and len(who) > len(fit.units) / 2:
            moments.append(Moment(KNOCK, float(at_s), who[0], 0.0, 1.0, who))
    return moments
