"""``check`` of an array: each unit as a session of its own, whether all are one body, and whose their noise at rest is.

What all units read alike at rest is the body's motion, what each reads by itself is its sensor's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.special import ndtr

from session.base.errors import CalibrationError
from session.base.numeric import sigmas_in
from session.base.rotation import nearest_rotation
from session.base.units import NS
from session.detect.check_references import with_own_accelerometer
from session.detect.findings import Finding, worst
from session.detect.first_look import check_session
from session.detect.stills import BLOCK_S, SessionStills, references
from session.log.folder import Session
from tinygc.features.arrays.clocks import ClockFit, UnitClock
from tinygc.features.arrays.extrinsics import clock_fits
from tinygc.features.arrays.recording import ArraySession
from tinygc.inference.choose import ONE_SIDED, Statement

# The noise at rest that units share.

#: most groups of stills that are left out in turn
GROUPS = 20
#: variance of a correlation of N differences of white noise, times N: 1 + 2 * 0.5^2, as neighbours are correlated by -0.5
OF_DIFFERENCES = 1.5
#: fewest differences: with 50 a correlation is known to 0.17
FEWEST = 50
#: share above which noise is mostly the one's or the other's
HALF = 0.5

#: whose the noise is, in words no stronger than the limits
SENSORS = "it is mostly the sensors' own"
BODY = "it is mostly the body's motion: a table, a floor or a hand moves it"
#: what that means of a unit's noise that is too large
WHOSE = {
    SENSORS: "it is this sensor's own, not the body's; or its units are wrong",
    BODY: "a table, a floor, a fan or a hand moves the body",
}
OPEN = "sensors' or body's: undecided"


def noise_at_rest(
    sessions: Sequence[Session], clocks: Sequence[UnitClock], gyros: Sequence[np.ndarray], accelerometers: Sequence[np.ndarray]
) -> dict[str, Statement]:
    """Return what the noise at rest of the units has in common, by sensor; without those whose stills are too short.

    gyros, accelerometers: of each unit (3, 3), from its readings to one set of axes.
    """
    maps = {"gyro": gyros, "accelerometer": accelerometers}
    found = {name: correlated(_differences(sessions, clocks, each, name != "gyro"), name) for name, each in maps.items()}
    return {name: each for name, each in found.items() if each is not None}


def _differences(
    sessions: Sequence[Session], clocks: Sequence[UnitClock], maps: Sequence[np.ndarray], accelerometer: bool
) -> list[list[np.ndarray]]:
    """Return of each still of the first unit the differences (M, 3) of neighbouring means of each unit's readings."""
    groups: list[list[np.ndarray]] = []
    first = SessionStills(sessions[0])
    for number, log in enumerate(sessions[0].logs):
        if any(number >= len(session.logs) for session in sessions):
            continue
        totals = []  # times (N,) s, and the integral of the readings (N, 3) over them, of each unit
        for session, clock, matrix in zip(sessions, clocks, maps, strict=True):
            samples = session.logs[number].samples
            t_s, readings = clock.array_time(samples.t_ns * NS), np.asarray(samples.accel if accelerometer else samples.gyro)
            totals.append((t_s, cumulative_trapezoid(readings @ matrix.T, t_s, axis=0, initial=0.0)))
        begins_s = float(log.samples.t_ns[0]) * NS
        for still in references(first.of(log).stills):
            edges = begins_s + still.start_s + np.arange(0, still.duration_s, BLOCK_S)
            if len(edges) > 2 and all(t_s[0] <= edges[0] and edges[-1] <= t_s[-1] for t_s, _ in totals):
                at = [np.column_stack([np.interp(edges, t_s, axis) for axis in total.T]) for t_s, total in totals]
                groups.append([np.diff(np.diff(each, axis=0) / BLOCK_S, axis=0) for each in at])
    return groups


def correlated(groups: Sequence[Sequence[np.ndarray]], what: str) -> Statement | None:
    """State the mean correlation, over all pairs of units, of differences (M, 3) of each unit in each of several groups (stills): of a
    motion of the body in the noise of ``what``, half of whose power is what matters; None of too few.

    Its sigma is the jackknife's over the groups, and at least that of white noise without correlation.
    """
    count = sum(len(group[0]) for group in groups)
    if count < FEWEST:
        return None
    products = np.array([[[np.sum(a * b) for b in group] for a in group] for group in groups])
    above = np.triu_indices(len(groups[0]), 1)

    def correlation(part: np.ndarray) -> float:
        size = sigmas_in(part)
        return float((part / np.maximum(np.outer(size, size), 1e-300))[above].mean())

    whole = products.sum(axis=0)
    without = np.array([correlation(whole - part.sum(axis=0)) for part in np.array_split(products, min(GROUPS, len(products)))])
    spread = np.sqrt((len(without) - 1) / len(without) * np.sum((without - without.mean()) ** 2))
    chance = np.sqrt(OF_DIFFERENCES / (3 * count * len(above[0])))
    return shared_noise(correlation(whole), float(max(spread, chance)), what)


def shared_noise(value: float, sigma: float, what: str) -> Statement:
    """State a correlation of the units' noise, and whose it is."""
    upper = min(max(value, 0.0) + ONE_SIDED * sigma, 1.0)
    # Less or more than half of it is common, with 95 %.
    source = SENSORS if upper < HALF else BODY if value - ONE_SIDED * sigma > HALF else OPEN
    size, limit = f"{100 * value:.1f} ± {100 * sigma:.1f} % of its power", f"{100 * upper:.1f} %"
    stated = (f"motion of the body in the {what} noise at rest", "correlation between units", float(ndtr(-value / sigma)), size, limit)
    figures = {"correlation": value, "correlation_sigma": sigma, "source": source}
    return Statement.of(*stated, matters=HALF, value=value, sigma=sigma, upper=upper, more=f"; {source}", figures=figures)


# Check of an array: each unit as a session of its own, then whether all units are on one body.

WHAT, AT_REST = "one body", "noise at rest"
PPM = 1e6


def check_array(array: ArraySession, further: Callable[[Session, SessionStills], list[Finding]]) -> list[Finding]:
    """Return the findings of every unit, ``where`` beginning with its number, and of the array.

    further: a check of a unit's whole session and its stills, run where the unit has no error so far.
    """
    findings: list[Finding] = []
    for number, unit in zip(array.numbers, array.units, strict=True):
        session, own = with_own_accelerometer(unit)
        found = SessionStills(session)
        mine = own + check_session(session, found)
        if worst(mine) != "error":
            mine += further(session, found)
        findings += [replace(finding, where=f"unit {number}: {finding.where}") for finding in mine]
    try:
        fits = clock_fits(array)
    except CalibrationError as error:
        return [*findings, Finding("error", array.name, WHAT, str(error), "")]
    noise = _noise_of_fits(array, fits)
    bodies = [Finding("ok", f"unit {n}", WHAT, _words(fit, array.numbers[0])) for n, fit in zip(array.numbers[1:], fits[1:], strict=True)]
    return [*(_with_source(finding, noise) for finding in findings), *bodies, *(_at_rest(array, each) for each in noise.values())]


def _noise_of_fits(array: ArraySession, fits: list[ClockFit]) -> dict[str, Statement]:
    """Return what the noise at rest of the units has in common, by sensor; empty where the motion does not show their mountings."""
    if not all(fit.map_is_known for fit in fits):
        return {}
    clocks, matrices = [fit.clock for fit in fits], [fit.matrix for fit in fits]
    return noise_at_rest(array.units, clocks, list(map(np.linalg.inv, matrices)), [nearest_rotation(each).T for each in matrices])


def _with_source(finding: Finding, noise: dict[str, Statement]) -> Finding:
    """State of a unit's noise that is too large what the other units show, in place of what one unit alone can."""
    sensor, _, what = finding.what.rpartition(" ")
    shared = noise.get(sensor)
    if finding.level != "warning" or what != "noise" or shared is None or (whose := WHOSE.get(shared.figures["source"])) is None:
        return finding
    return replace(finding, do=f"the units' noise at rest correlates by {shared.value:.2f} ± {shared.sigma:.2f}: {whose}")


def _at_rest(array: ArraySession, shared: Statement) -> Finding:
    level = "ok" if shared.figures["source"] == SENSORS else "note"
    do = "lay the body on something heavy, away from hands, fans and steps" if shared.figures["source"] == BODY else ""
    return Finding(level, array.name, AT_REST, shared.words, do)


def _words(fit: ClockFit, first: int) -> str:
    clock = fit.clock
    way = "slow" if clock.rate > 0 else "fast"
    rate = f"{abs(clock.rate) * PPM:.1f} ± {clock.rate_sigma * PPM:.1f} ppm {way}"
    return (
        f"its rates follow unit {first}'s by {fit.agreement:.4f} of 1; against it its clock is {clock.offset_s * 1e3:+.2f} ± "
        f"{clock.offset_sigma_s * 1e3:.2f} ms and " + (rate if clock.rate else "as fast")
    )
