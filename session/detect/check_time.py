"""Checks of time: the data rate, stamps, and motion faster than half the data rate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from session.base.numeric import rms_of, running_sum
from session.base.texts import measured, significant
from session.base.units import DEG, NS
from session.detect.findings import Correction, Finding
from session.detect.segments import Ends
from session.detect.stamp_errors import RATE_CHANGES, rate_pieces
from session.detect.stills import Noise, Still, noise_floor
from session.log.config import Config, Sensor
from session.log.logfile import Log
from session.log.samples import Samples

# Checks of time itself: the data rate by the stamps, stamps that were counted and not measured, a time column in another unit.

ODR_UNIT_SPREAD = 0.01  #: part-to-part departure from the nominal rate that is usual
ODR_WRONG = 0.10  #: beyond what parts were seen to have (5 %): another rate is set than the one declared
ODR_CLOCKS = 0.005  #: INTERNAL_FREQ_FINE's step 0.15 % and the host clock's 0.3 %
#: of a period, by which all stamps lie on multiples of the declared period where they are counted.  A clock of its own that is only
#: 1 ppm off leaves this after 1000 samples
COUNTED_WITHIN, LEAST_COUNTED = 1e-3, 1000
FASTER = {1e3: "us that are read as ns, ms as us, or s as ms", 1e6: "ms that are read as ns, or s as us", 1e9: "s that are read as ns"}
SLOWER = {1e3: "ns that are read as us, us as ms, or ms as s", 1e6: "ns that are read as ms, or us as s", 1e9: "ns that are read as s"}


def check_rate(log: Log, sensor: Sensor) -> list[Finding]:
    """The true output data rate, from the stamps, against the declared one and the log's ``odr_hz=``.

    The nominal rate is only that: an ASM330LHH's oscillator is off by up to 5 %.  Rates are integrated with the stamps, so a true
    rate that differs does no harm; stamps that are wrong are a scale error of the same size.
    """
    where, true_hz = log.path.name, log.samples.pace.rate_hz
    if (wrong := unit_factor(true_hz, sensor.odr_hz)) is not None:
        return [_wrong_unit(where, true_hz, sensor, wrong)]
    findings = [_counted(log, sensor) or _against_declared(where, true_hz, sensor)]
    stated_hz = log.number("odr_hz")
    if stated_hz and abs(off := true_hz / stated_hz - 1) > ODR_CLOCKS:
        text = f"{true_hz:.2f} Hz by the stamps, odr_hz={stated_hz:g} by the log's own comment ({off:+.1%}, bar {ODR_CLOCKS:.1%})"
        findings.append(Finding("warning", where, "sample rate", text, "one of them is wrong; wrong stamps are a scale error of this size"))
    return findings


def _against_declared(where: str, true_hz: float, sensor: Sensor) -> Finding:
    off, profile = true_hz / sensor.odr_hz - 1, sensor.profile
    text = f"{true_hz:.2f} Hz by the stamps, {sensor.odr_hz:g} Hz declared ({off:+.1%})"
    if abs(off) <= ODR_WRONG:
        level = "note" if abs(off) > ODR_UNIT_SPREAD else "ok"
        return Finding(level, where, "sample rate", text + ("; the stamps are used" if level == "note" else ""))
    near = None if profile is None else profile.nearest_hz(true_hz)
    otherwise = "or the stamps are not the device's time: then every rate is wrong by this much"
    if profile is None or near is None:
        text += "; the stamps are used, and how far this sensor's clock may be off is not known"
        return Finding("warning", where, "sample rate", text, f"correct odr_hz; {otherwise}", _rates(true_hz, sensor, true_hz))
    fits = f"the sensor has {near:g} Hz: correct odr_hz" if abs(true_hz / near - 1) < ODR_WRONG else "no rate of the sensor fits"
    if profile.clock_within is not None:
        text += f"; parts differ by {100 * profile.clock_within.value:g} % at most"
    return Finding("error", where, "sample rate", text, f"{fits}; {otherwise}", _rates(true_hz, sensor, near))


def _rates(true_hz: float, sensor: Sensor, rate_hz: float) -> tuple[Correction, ...]:
    """A rate that is declared wrongly, as this one, or stamps that are."""
    ratio = true_hz / sensor.odr_hz
    declared = Correction(f"the data rate is {rate_hz:.5g} Hz, not {sensor.odr_hz:g}", settings=(("odr_hz", float(f"{rate_hz:.5g}")),))
    fits = sensor.profile is None or abs(true_hz / rate_hz - 1) < ODR_WRONG
    stamps = Correction(f"time runs {measured(max(ratio, 1 / ratio))} times too {'fast' if ratio > 1 else 'slowly'}", "time", ratio)
    return (declared, stamps) if fits else (stamps,)


def _counted(log: Log, sensor: Sensor) -> Finding | None:
    """Stamps that show nothing of the true rate: the log or session.toml states so, or each is a multiple of the declared period."""
    if log.counted or sensor.odr_sigma is not None:
        if (nominal := sensor.nominal_rate) is None:
            text = f"{sensor.odr_hz:g} Hz, measured (sensor.odr_sigma = 0)"
            return Finding("ok", log.path.name, "sample rate", text)
        text = nominal.doubt + "; its samples were counted" * log.counted
        do = "log the device's own time, or measure the data rate and give odr_hz with sensor.odr_sigma"
        return Finding("warning", log.path.name, "sample rate", text, do)
    if not looks_counted(log, sensor):
        return None
    text = f"{sensor.odr_hz:g} Hz as declared, and every step exactly so: they look counted, not measured; the true rate is not known"
    do = "a true rate that differs is a scale error of the same size; were they counted, give sensor.odr_sigma (0.03 is usual)"
    return Finding("note", log.path.name, "sample rate", text, do)


def looks_counted(log: Log, sensor: Sensor) -> bool:
    """Whether every stamp of a file is a multiple of the declared period, and nothing states what the true rate is.

    A board that states a rate which is neither the sensor's nor whole has measured it: its even stamps are no count.
    """
    measured = sensor.odr_hz != sensor.nominal_hz and sensor.odr_hz % 1 > 0
    known = log.in_memory or log.counted or measured or sensor.odr_sigma is not None or sensor.clock_sigma is not None
    samples = log.samples
    if known or len(samples) < LEAST_COUNTED or abs(samples.period_s * sensor.odr_hz - 1) > COUNTED_WITHIN:
        return False
    periods = (samples.t_ns - samples.t_ns[0]) * (sensor.odr_hz * NS)
    return bool(np.abs(periods - np.rint(periods)).max() <= COUNTED_WITHIN)


def unit_factor(true_hz: float, declared_hz: float) -> float | None:
    """By which time runs too fast (beyond 1) or too slow, where a wrong unit of the time column explains it; else None."""
    ratio = true_hz / declared_hz
    return next((factor for factor in (*FASTER, *(1 / factor for factor in SLOWER)) if abs(ratio / factor - 1) <= ODR_WRONG), None)


def _wrong_unit(where: str, true_hz: float, sensor: Sensor, factor: float) -> Finding:
    fast = factor > 1
    times = round(factor if fast else 1 / factor)
    text = f"{true_hz:.6g} Hz by the stamps, {sensor.odr_hz:g} Hz declared: time runs {times} times too {'fast' if fast else 'slowly'}"
    named = (FASTER if fast else SLOWER)[times]
    do = f"{named}? correct the name of the time column (t_ns, t_us, t_s), or --time-unit of import"
    return Finding("error", where, "time unit", text, do, (Correction(f"the time column is in another unit: {named}", "time", factor),))


def check_length(log: Log, segment_s: float) -> list[Finding]:
    """A log in which nothing rests, and which is over before one segment could be: time may be in another unit."""
    length_s = log.samples.duration_s
    if length_s >= segment_s:
        return []
    within = f"{significant(length_s)} s, less than one segment of {segment_s:g} s"
    text = f"no still and no turn: all {len(log.samples)} samples lie within {within}"
    return [Finding("error", log.path.name, "time unit", text, "is the time column's unit right (us read as ns)? else record for longer")]


# Where the rate by the stamps changes within a log.


def check_rate_changes(samples: Samples, where: str, turns: Sequence[Ends], noise: Noise | None, segment_s: float) -> list[Finding]:
    """Where the rate by the stamps changes at once; turns: the stills around each.  Slow stamps make a turn too long by as much."""
    found = rate_pieces(samples)
    usual = max(found, key=lambda piece: piece.stop - piece.start)
    others = [piece for piece in found if piece is not usual]
    angles = [float(np.linalg.norm(angle, axis=1).sum()) for a, b in turns if (angle := _turn(samples, a, b)) is not None]
    worst = max((abs(piece.hz / usual.hz - 1) for piece in others), default=0.0) * (float(np.median(angles)) if angles else 0.0)
    if not others or worst <= noise_floor(noise, segment_s):
        return []
    stated = [f"{piece.hz:.2f} Hz from {samples.at_s(piece.start):.1f} to {samples.at_s(piece.stop - 1):.1f} s" for piece in found]
    text = f"by the stamps {', '.join(stated[:4])}" + (f" and {len(stated) - 4} more" if len(stated) > 4 else "")
    text += f": {worst / DEG:.2g} deg per turn, if the clock changed"
    do = "stamp with the device's own clock, and switch off what sets the clock meanwhile; or take the part of one rate, --lines of import"
    return [Finding("warning", where, RATE_CHANGES, text, do)]


def _turn(samples: Samples, first: Still, last: Still) -> np.ndarray | None:
    start, stop = first.stop - 1, last.start + 1
    steps = np.diff(samples.t_ns[start:stop])[:, None] * NS
    return (samples.gyro[start : stop - 1] - first.gyro_mean) * steps if stop > start else None


# Motion faster than half the data rate: what the readings of a turn miss of it, estimated by thinning them.
#
# A turn is the sum of its readings.  Every k-th, taken alone, misses more; of a spectrum that falls as a power of frequency,
#
#     |sum of every k-th - sum of all|^2 = (k^2p - 1) E^2,
#
# E what all readings miss.  White noise is thinned out as well, and its share is known: it is taken off.

#: every 2nd, 3rd and 4th reading: more leave too few in a quick turn
STEPS = (2, 3, 4)
#: exponents that are searched; hands have 1.35 to 2.5, what noise or a false reading adds has 0.5
EXPONENTS = (0.25, 4.0)
LEAST_EXPONENT = 1.0
#: rows of rest at either end of a turn: every 4th reading then begins and ends at rest
MARGIN = 4
#: of the floor: less than that is nothing
LEAST_REPORTED = 0.1
#: fewer turns determine no exponent
LEAST_TURNS = 5
#: rows that are looked at together
AT_ONCE = 1 << 19
#: times the usual turn's error: beyond it, it is that turn's own fault
MOST = 3.0


def check_undersampling(log: Log, turns: Sequence[Ends], noise: Noise | None, config: Config) -> list[Finding]:
    """Against what white noise makes of a turn: angle random walk x sqrt(duration).

    No finding where the turns are too few, or where the excess does not grow with the step as motion does.
    """
    if noise is None:
        return []
    missed = _missed_of_turns(log.samples, turns, noise, config.protocol.segment_s)
    if missed is None:
        return []
    rms_rad, exponent, floor_rad = missed
    where, what, half_hz = log.path.name, "fast motion", 0.5 / log.samples.period_s
    error, floor = (f"{angle / DEG:.2g}°" for angle in (rms_rad, floor_rad))
    if rms_rad <= floor_rad:
        by = f"by about {error} rms" if rms_rad > LEAST_REPORTED * floor_rad else "nothing"
        text = f"turns miss {by} of what is faster than {half_hz:.4g} Hz, half the data rate; white noise makes {floor}"
        return [Finding("ok", where, what, text)]
    if exponent < LEAST_EXPONENT:
        return []
    needed_hz = 2 * half_hz * (rms_rad / floor_rad) ** (1 / exponent)  # where the rms would be down at the floor
    text = f"motion above {half_hz:.4g} Hz: turns miss by {error} rms (white noise {floor})"
    do = f"no calibration removes it: record at {needed_hz:.0f} Hz, or with a low-pass below {half_hz:.4g} Hz, or turn more smoothly"
    return [Finding("warning", where, what, text, do)]


def _missed_of_turns(samples: Samples, turns: Sequence[Ends], noise: Noise, segment_s: float) -> tuple[float, float, float] | None:
    """What all readings miss of the tilt of turns between these pairs of stills, rad rms; the exponent p; and the rms, rad, of what white
    noise alone makes of a segment, ``segment_s`` long or as long as the turn.  None where they are too few.

    A false reading in one of the turns does not count for more than that turn can.
    """
    if len(turns) < LEAST_TURNS:
        return None
    rows = np.array([[max(a.start, a.stop - 1 - MARGIN), min(b.stop - 1, b.start + MARGIN)] for a, b in turns]).T
    down = np.array([[a.accel_mean / max(a.gravity_mps2, 1e-12), b.accel_mean / max(b.gravity_mps2, 1e-12)] for a, b in turns])
    # Beyond the stills' mean rate: sums over a log of hours then stay small.
    rest = np.mean([still.gyro_mean for turn in turns for still in turn], axis=0)
    walk = np.mean(noise.angle_random_walk**2)
    length_s = np.empty(len(turns))
    square = np.empty((len(STEPS), len(turns)))
    for some, looked_at in _together(rows, len(samples)):
        rate, t_s = samples.gyro[looked_at] - rest, (samples.t_ns[looked_at] - samples.t_ns[0]) * NS
        ends = np.searchsorted(looked_at, rows[:, some])
        length_s[some] = t_s[ends[1]] - t_s[ends[0]]
        whole = _sums(rate, t_s, ends, looked_at, 1, 0)
        for number, step in enumerate(STEPS):
            apart = [_tilt_square(_sums(rate, t_s, ends, looked_at, step, offset) - whole, down[some]) for offset in range(step)]
            square[number, some] = np.mean(apart, axis=0) - 2 * (step - 1) * walk * length_s[some]
    exponent = thinning_exponent(square)
    error = np.sqrt(np.maximum(np.mean(square / thinning_weights(exponent)[:, None], axis=0), 0.0)) if exponent else np.zeros(len(turns))
    return rms_of(capped(error)), exponent, float(np.sqrt(2 * walk * np.mean(np.maximum(length_s, segment_s))))


def _together(rows: np.ndarray, count: int) -> Iterator[tuple[slice, np.ndarray]]:
    """Turns from the first to the last of rows (2, S), and the rows of the log that are looked at for them: all, or of a long log the
    turns' own, so many at a time."""
    if count <= AT_ONCE:
        yield slice(0, rows.shape[1]), np.arange(count)
        return
    behind = np.cumsum(rows[1] - rows[0] + 1) // AT_ONCE
    edges = [0, *(np.flatnonzero(np.diff(behind)) + 1).tolist(), rows.shape[1]]
    for first, last in pairwise(edges):
        mine = rows[:, first:last]
        begin = int(mine.min())
        looked_at = np.zeros(int(mine.max()) + 1 - begin, dtype=bool)
        for a, b in (mine - begin).T.tolist():
            looked_at[a : b + 1] = True
        yield slice(first, last), np.flatnonzero(looked_at) + begin


def _sums(rate: np.ndarray, t_s: np.ndarray, rows: np.ndarray, looked_at: np.ndarray, step: int, offset: int) -> np.ndarray:
    """(S, 3) rad: the readings (N, 3) rad/s from the first to the last of rows (2, S), every ``step``-th and both ends, by trapezoids;
    looked_at (N,): their rows in the log, by which every ``step``-th is counted."""
    kept = np.flatnonzero((looked_at - offset) % step == 0)
    some, at_s = rate[kept], t_s[kept]
    running = running_sum((some[1:] + some[:-1]) * (np.diff(at_s) / 2)[:, None])
    first, last = rows
    begin, end = np.searchsorted(kept, first), np.searchsorted(kept, last, side="right") - 1
    before = (rate[first] + some[begin]) * ((at_s[begin] - t_s[first]) / 2)[:, None]
    after = (rate[last] + some[end]) * ((t_s[last] - at_s[end]) / 2)[:, None]
    return running[end] - running[begin] + before + after


def _tilt_square(vector: np.ndarray, down: np.ndarray) -> np.ndarray:
    """(S,) of vectors (S, 3) in body axes, without their part along gravity (S, 2, 3) before and after the turn.

    Of a turn about one axis both are the same, and the same as at any moment between: its attitudes are not needed.
    """
    return np.sum(vector**2, axis=1) - np.mean(np.einsum("sij,sj->si", down, vector) ** 2, axis=1)


def capped(error_rad: np.ndarray) -> np.ndarray:
    """(S,) of errors (S,) >= 0, one a turn: none larger than ``MOST`` times their median, so that a false reading in one turn does not
    count for more than that turn can."""
    return np.minimum(error_rad, MOST * np.median(error_rad))


def thinning_weights(exponent: float) -> np.ndarray:
    """(K,) of each k in ``STEPS``: k^2p - 1, the square of what every k-th reading misses beyond all of them, in squares of what all
    miss."""
    return np.array(STEPS, dtype=float) ** (2 * exponent) - 1


def thinning_exponent(square: np.ndarray) -> float:
    """p of squares (K, S) rad^2 that follow k^2p - 1: K steps of ``STEPS``, S turns, white noise's share taken off.

    Least squares of the logarithms of their means over the usual turns (none beyond ``MOST`` times the median), p from ``EXPONENTS``;
    0 where at some step nothing is beyond noise.
    """
    size = square.sum(axis=0)
    mean = square[:, size <= MOST**2 * max(float(np.median(size)), 0.0)].mean(axis=1) if (size > 0).any() else np.zeros(len(square))
    if not (mean > 0).all():
        return 0.0
    tried = np.linspace(*EXPONENTS, 151)
    law = np.log(np.array(STEPS)[None] ** (2 * tried[:, None]) - 1)
    return float(tried[np.argmin(np.var(np.log(mean)[None] - law, axis=1))])
