"""``check`` of an array: each unit as a session of its own, then whether all are one body, and whose their noise at rest is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from session.base.errors import CalibrationError
from session.base.rotation import nearest_rotation
from session.detect.check_references import with_own_accelerometer
from session.detect.findings import Finding, worst
from session.detect.first_look import check_session
from session.detect.stills import SessionStills
from session.log.folder import Session
from tinygc.features.arrays.clocks import ClockFit
from tinygc.features.arrays.extrinsics import clock_fits
from tinygc.features.arrays.recording import ArraySession
from tinygc.features.arrays.rest_noise import BODY, SENSORS, noise_at_rest
from tinygc.inference.choose import Statement

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
    bodies = [Finding("ok", f"unit {n}", WHAT, _said(fit, array.numbers[0])) for n, fit in zip(array.numbers[1:], fits[1:], strict=True)]
    return [*(_with_source(finding, noise) for finding in findings), *bodies, *(_at_rest(array, each) for each in noise.values())]


def _noise_of_fits(array: ArraySession, fits: list[ClockFit]) -> dict[str, Statement]:
    """Return what the noise at rest of the units has in common, by sensor; empty where the motion does not tell their mountings."""
    if not all(fit.map_is_known for fit in fits):
        return {}
    clocks, matrices = [fit.clock for fit in fits], [fit.matrix for fit in fits]
    return noise_at_rest(array.units, clocks, list(map(np.linalg.inv, matrices)), [nearest_rotation(each).T for each in matrices])


def _with_source(finding: Finding, noise: dict[str, Statement]) -> Finding:
    """Say of a unit's noise that is too large what the other units tell of it, in place of what one unit alone can tell."""
    sensor, _, what = finding.what.rpartition(" ")
    if finding.level != "warning" or what != "noise" or (shared := noise.get(sensor)) is None:
        return finding
    agrees = f"the units' noise at rest correlates by {shared.value:.2f} ± {shared.sigma:.2f}"
    if shared.figures["source"] == SENSORS:
        return replace(finding, do=f"{agrees}: it is this sensor's own, not the body's; or its units are wrong")
    if shared.figures["source"] == BODY:
        return replace(finding, do=f"{agrees}: a table, a floor, a fan or a hand moves the body")
    return finding


def _at_rest(array: ArraySession, shared: Statement) -> Finding:
    level = "ok" if shared.figures["source"] == SENSORS else "note"
    do = "lay the body on something heavy, away from hands, fans and steps" if shared.figures["source"] == BODY else ""
    return Finding(level, array.name, AT_REST, shared.words, do)


def _said(fit: ClockFit, first: int) -> str:
    clock = fit.clock
    way = "slow" if clock.rate > 0 else "fast"
    rate = f"{abs(clock.rate) * PPM:.1f} ± {clock.rate_sigma * PPM:.1f} ppm {way}"
    return (
        f"its rates follow unit {first}'s by {fit.agreement:.4f} of 1; against it its clock is {clock.offset_s * 1e3:+.2f} ± "
        f"{clock.offset_sigma_s * 1e3:.2f} ms and " + (rate if clock.rate else "as fast")
    )
