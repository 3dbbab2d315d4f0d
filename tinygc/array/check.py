"""The first look at an array: each unit as a session of its own, then whether they are one body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from session.checks.accelerometer import with_own_accelerometer
from session.checks.findings import Finding, worst
from session.checks.first_look import check_session
from session.common.errors import CalibrationError
from session.detect.session_stills import SessionStills
from session.log.array_session import ArraySession
from session.log.folder import Session
from tinygc.array.places.clocks import ClockFit
from tinygc.array.places.places import clock_fits

WHAT = "one body"
PPM = 1e6


def check_array(array: ArraySession, further: Callable[[Session, SessionStills], list[Finding]]) -> list[Finding]:
    """Findings of every unit, ``where`` beginning with its number, and of the array; further: a look at a unit's whole session and its
    stills, that is taken where nothing of it is an error."""
    findings: list[Finding] = []
    for number, unit in zip(array.numbers, array.units, strict=True):
        session, own = with_own_accelerometer(unit)
        found = SessionStills(session)
        mine = own + check_session(session, found)
        if worst(mine) != "error":
            mine += further(session, found)
        findings += [replace(finding, where=f"unit {number}: {finding.where}") for finding in mine]
    return findings + check_one_body(array)


def check_one_body(array: ArraySession) -> list[Finding]:
    """Whether all units felt the same motion, and where their clocks are."""
    try:
        fits = clock_fits(array)
    except CalibrationError as error:
        return [Finding("error", array.name, WHAT, str(error), "")]
    return [
        Finding("ok", f"unit {number}", WHAT, _said(fit, array.numbers[0]), "")
        for number, fit in list(zip(array.numbers, fits, strict=True))[1:]
    ]


def _said(fit: ClockFit, first: int) -> str:
    clock = fit.clock
    way = "slow" if clock.rate > 0 else "fast"
    rate = f"{abs(clock.rate) * PPM:.1f} ± {clock.rate_sigma * PPM:.1f} ppm {way}"
    return (
        f"its rates follow unit {first}'s by {fit.agreement:.4f} of 1; against it its clock is {clock.offset_s * 1e3:+.2f} ± "
        f"{clock.offset_sigma_s * 1e3:.2f} ms and " + (rate if clock.rate else "as fast")
    )
