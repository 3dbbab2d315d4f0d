"""Checks of time itself: the data rate by the stamps, stamps that were counted and not measured, a time column in another unit."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding
from session.common.units import NS
from session.detect.pace import pace_of
from session.log.config import Sensor
from session.log.logfile import Log
from session.log.samples import Samples

ODR_UNIT_SPREAD = 0.01  #: part-to-part departure from the nominal rate that is usual
ODR_WRONG = 0.10  #: beyond what parts were seen to have (5 %): another rate is set than the one declared
ODR_CLOCKS = 0.005  #: INTERNAL_FREQ_FINE's step 0.15 % and the host clock's 0.3 %
#: of a period, by which all stamps lie on multiples of the declared period where they are counted.  A clock of its own that is only
#: 1 ppm off leaves this after 1000 samples
COUNTED_WITHIN, LEAST_COUNTED = 1e-3, 1000
#: by which a time column in another unit runs too fast or too slow
UNIT_FACTORS = (1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9)
#: degC per second over a whole log: soldering heats no package faster (J-STD-020, ramp-up 3 degC/s at most)
FASTEST_C_PER_S, BLOCKS = 3.0, 8

FASTER = {1e3: "us that are read as ns, ms as us, or s as ms", 1e6: "ms that are read as ns, or s as us", 1e9: "s that are read as ns"}
SLOWER = {1e3: "ns that are read as us, us as ms, or ms as s", 1e6: "ns that are read as ms, or us as s", 1e9: "ns that are read as s"}


def check_rate(log: Log, sensor: Sensor) -> list[Finding]:
    """The true output data rate, from the stamps, against the declared one and the log's ``odr_hz=``.

    The nominal rate is only that: an ASM330LHH's oscillator is off by up to 5 %.  Rates are integrated with the stamps, so a true
    rate that differs does no harm; stamps that are wrong are a scale error of the same size.
    """
    where, true_hz = log.path.name, pace_of(log.samples.t_ns).rate_hz
    if (wrong := unit_factor(true_hz, sensor.odr_hz)) is not None:
        return [_wrong_unit(where, true_hz, sensor, wrong)]
    findings = [_counted(log, sensor) or _against_declared(where, true_hz, sensor)]
    said_hz = _number(log.comments.get("odr_hz"))
    if said_hz and abs(off := true_hz / said_hz - 1) > ODR_CLOCKS:
        says = f"{true_hz:.2f} Hz by the stamps, odr_hz={said_hz:g} by the log's own comment ({off:+.1%}, bar {ODR_CLOCKS:.1%})"
        findings.append(Finding("warning", where, "sample rate", says, "one of them is wrong; wrong stamps are a scale error of this size"))
    return findings


def _against_declared(where: str, true_hz: float, sensor: Sensor) -> Finding:
    off, profile = true_hz / sensor.odr_hz - 1, sensor.profile
    says = f"{true_hz:.2f} Hz by the stamps, {sensor.odr_hz:g} Hz declared ({off:+.1%})"
    if abs(off) <= ODR_WRONG:
        level = "note" if abs(off) > ODR_UNIT_SPREAD else "ok"
        return Finding(level, where, "sample rate", says + ("; the stamps are used" if level == "note" else ""))
    near = None if profile is None else profile.nearest_hz(true_hz)
    otherwise = "or the stamps are not the device's time: then every rate is wrong by this much"
    if profile is None or near is None:
        says += "; the stamps are used, and how far this sensor's clock may be off is not known"
        return Finding("warning", where, "sample rate", says, f"correct odr_hz; {otherwise}")
    fits = f"the sensor has {near:g} Hz: correct odr_hz" if abs(true_hz / near - 1) < ODR_WRONG else "no rate of the sensor fits"
    if profile.clock_within is not None:
        says += f"; parts differ by {100 * profile.clock_within.value:g} % at most"
    return Finding("error", where, "sample rate", says, f"{fits}; {otherwise}")


def _counted(log: Log, sensor: Sensor) -> Finding | None:
    """Stamps that say nothing of the true rate: the log says so, or each is a multiple of the declared period."""
    said = log.comments.get("stamps") == "counted"
    if not said and (log.in_memory or not _looks_counted(log.samples, sensor.odr_hz)):
        return None
    why = "the log had no stamps, its samples were counted" if said else "and every step exactly so: they look counted, not measured"
    says = f"{sensor.odr_hz:g} Hz as declared, {why}; the true rate is not known"
    do = "a true rate that differs is a scale error of the same size; log the device's own time"
    return Finding("note", log.path.name, "sample rate", says, do)


def _looks_counted(samples: Samples, odr_hz: float) -> bool:
    if len(samples) < LEAST_COUNTED or abs(samples.period_s * odr_hz - 1) > COUNTED_WITHIN:
        return False
    periods = (samples.t_ns - samples.t_ns[0]) * (odr_hz * NS)
    return bool(np.abs(periods - np.rint(periods)).max() <= COUNTED_WITHIN)


def unit_factor(true_hz: float, declared_hz: float) -> float | None:
    """By which time runs too fast (beyond 1) or too slow, where a wrong unit of the time column explains it; else None."""
    ratio = true_hz / declared_hz
    return next((factor for factor in UNIT_FACTORS if abs(ratio / factor - 1) <= ODR_WRONG), None)


def _wrong_unit(where: str, true_hz: float, sensor: Sensor, factor: float) -> Finding:
    fast = factor > 1
    times = round(factor if fast else 1 / factor)
    says = f"{true_hz:.6g} Hz by the stamps, {sensor.odr_hz:g} Hz declared: time runs {times} times too {'fast' if fast else 'slowly'}"
    do = f"{(FASTER if fast else SLOWER)[times]}? correct the name of the time column (t_ns, t_us, t_s), or --time-unit of replay"
    return Finding("error", where, "time unit", says, do)


def check_warming(log: Log) -> list[Finding]:
    """A temperature that moves faster than any sensor's can: then it is time that is wrong."""
    samples = log.samples
    if samples.temp_c is None or len(samples) < 2 * BLOCKS or samples.duration_s <= 0:
        return []
    means = np.array([block.mean() for block in np.array_split(samples.temp_c, BLOCKS)])
    moved, over_s = float(np.ptp(means)), samples.duration_s * (1 - 1 / BLOCKS)
    if moved / over_s <= FASTEST_C_PER_S:
        return []
    says = f"{moved:.0f} degC within {over_s:.3g} s, bar {FASTEST_C_PER_S:g} degC/s: no sensor warms or cools so fast"
    return [Finding("warning", log.path.name, "time unit", says, "is the time column's unit right (us read as ns)? is the temperature's?")]


def check_length(log: Log, segment_s: float) -> list[Finding]:
    """A log in which nothing rests, and which is over before one segment could be: time may be in another unit."""
    lasts_s = log.samples.duration_s
    if lasts_s >= segment_s:
        return []
    says = f"no still and no turn: all {len(log.samples)} samples lie within {lasts_s:.3g} s, less than one segment of {segment_s:g} s"
    return [Finding("error", log.path.name, "time unit", says, "is the time column's unit right (us read as ns)? else record for longer")]


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
