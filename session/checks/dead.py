"""An axis that dies within a log: it reads one value for a second or more, and twenty readings, while the others move or scatter."""

from __future__ import annotations

from math import erf, exp, pi, sqrt
from statistics import NormalDist

import numpy as np

from session.checks.findings import Finding
from session.checks.samples import without_force
from session.common.runs import runs_of
from session.common.units import DEG, G
from session.log.logfile import Log
from session.log.samples import Samples

#: and so many readings: at 2 Hz two equal neighbours are a coarse register, not a second of silence
LEAST_S, LEAST_READINGS = 1.0, 20
#: a run at the axis's own extreme may be a turn that clips; beyond this no turn lasts
CLIPPED_S = 5.0
#: the body moves where another axis spans this, dps and g, over the middle four fifths of the readings
MOVES_DPS, MOVES_G = 10.0, 0.1
#: an axis scatters where fewer neighbours than this are equal; of a short run fewer (``_scatter_bar``)
SCATTERS = 0.6
#: chance that an axis whose noise is the others' stays in one step of its register for a whole run; from so many readings on, a body
#: that moves is enough
BY_CHANCE, MANY = 1e-5, 60
#: shorter runs than the least, by as much, are a coarse register's: it has runs of every length, noise has none of these
COARSE_S, COARSE_READINGS, COARSE_RUNS = 0.15, 10, 3


def check_dead(log: Log, missing_accel: bool = False) -> list[Finding]:
    """The longest such run of each axis; ``missing_accel``: rows whose accelerometer reads 0, 0, 0 have none, by agreement."""
    samples, findings = log.samples, []
    absent = without_force(samples) if missing_accel else np.zeros(len(samples), dtype=bool)
    for number, column in enumerate(("gx", "gy", "gz", "ax", "ay", "az")):
        values = samples.gyro[:, number] / DEG if number < 3 else samples.accel[:, number - 3] / G
        found = _dead_runs(samples, values, number, absent)
        if not found:
            continue
        start, stop = max(found, key=lambda run: run[1] - run[0])
        sensor, unit = ("gyro", "dps") if number < 3 else ("accelerometer", "g")
        says = (
            f"{column} reads {values[start] + 0.0:.4g} {unit} from row {start} to row {stop - 1}, "
            f"{samples.t_s[start]:.1f} to {samples.t_s[stop - 1]:.1f} s, while others go on; a sensor has noise"
        )
        says += f" ({len(found)} such places)" if len(found) > 1 else ""
        do = "look at the wiring and at what wrote the log; record again, or cut the log there"
        findings.append(Finding("error", log.path.name, f"{sensor} dead", says, do))
    return findings


def _dead_runs(samples: Samples, values: np.ndarray, number: int, absent: np.ndarray) -> list[tuple[int, int]]:
    """start, stop of each run of equal readings of one of six channels, (N,) dps or g, that neither noise, clipping nor a coarse register
    makes."""
    period_s = samples.period_s
    extremes = (values.min(), values.max())
    if extremes[0] == extremes[1]:
        return []  # stuck throughout: said as such
    starts, stops = runs_of((values[1:] == values[:-1]) & ~(absent[1:] & (number >= 3)))  # of steps: a run of readings is one longer
    lengths = stops - starts + 1
    long = (lengths * period_s >= LEAST_S) & (lengths >= LEAST_READINGS)
    coarse = ~long & (lengths * period_s >= COARSE_S) & (lengths >= COARSE_READINGS) & ~np.isin(values[starts], extremes)
    if coarse.sum() >= max(COARSE_RUNS, long.sum() / 4):
        return []
    found = []
    for start, length in zip(starts[long].tolist(), lengths[long].tolist(), strict=True):
        some = slice(start, start + length)
        run = np.concatenate([samples.gyro[some] / DEG, samples.accel[some] / G], axis=1)
        clips = values[start] in extremes and length * period_s <= CLIPPED_S
        if not clips and ((length >= MANY and _others_move(run, number)) or (not coarse.any() and _others_scatter(run, number))):
            found.append((start, start + length))
    return found


def _others_move(run: np.ndarray, number: int) -> bool:
    low, high = np.quantile(np.delete(run, number, axis=1), (0.1, 0.9), axis=0)
    bars = np.delete([MOVES_DPS] * 3 + [MOVES_G] * 3, number)
    return bool((high - low > bars).any())


def _others_scatter(run: np.ndarray, number: int) -> bool:
    """Both other axes of the same sensor."""
    first = number - number % 3
    others = [other for other in range(first, first + 3) if other != number]
    return bool(((np.diff(run[:, others], axis=0) == 0).mean(axis=0) < _scatter_bar(len(run))).all())


def _scatter_bar(length: int) -> float:
    """Share of equal neighbours below which noise leaves one step of a register within so many readings.

    A slow sensor's noise may be smaller than its step: it then stays in one for long.  sigma, in steps, is that at which ``length``
    readings stay within half a step of the middle by ``BY_CHANCE``; the share is what it makes of equal neighbours, over all places
    of the mean within a step.
    """
    sigma = 0.5 / NormalDist().inv_cdf((1 + BY_CHANCE ** (1 / length)) / 2)
    share = erf(1 / (2 * sigma)) - 2 * sigma / sqrt(pi) * (1 - exp(-1 / (4 * sigma**2)))
    return min(SCATTERS, share)
