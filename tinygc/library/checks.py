"""``tinygc.check``: the first look at a session, or at a folder whose logs may be unreadable."""

from __future__ import annotations

from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from session.base.names import CLOCKS, is_array
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder, check_session
from session.detect.stills import SessionStills
from session.log.folder import Session
from tinygc.closure.prepared import first_look_at_fit
from tinygc.library.arguments import public, session_or_folder
from tinygc.noise.measured import measured_noise


@public()
def check(session: Any, clock: str = CLOCKS[0]) -> list[Finding]:
    """Check a recording before a fit: rates, scales, stills, turns, gaps, the accelerometer.

    Parameters
    ----------
    session : Session, ArraySession, str or Path
        The recording, or its folder.
    clock : {"board", "arrivals"}, optional
        Times as the board stamped them, or divided by ``sensor.clock_ratio``; of one sensor.

    Returns
    -------
    list of Finding
        In the order of the checks: ``level`` (ok, note, warning, error), ``where``, ``what``, ``says``, ``do``.  In a folder, a log
        that cannot be read is an error among the findings.  For an array, ``where`` begins with the unit's number.

    Raises
    ------
    CalibrationError
        If ``session`` is not a recording, or has no such clock.

    Examples
    --------
    >>> import tinygc
    >>> findings = tinygc.check(tinygc.simulate(segments=12, odr_hz=104.0, seed=1).session)
    >>> any(finding.level == "error" for finding in findings)
    False

    """
    if isinstance(session, Session):
        found = SessionStills(session := session.on_clock(clock))
        findings = check_session(session, found)
        return findings if worst(findings) == "error" else findings + first_look_at_fit(session, found, measured_noise())
    if isinstance(session, str | PathLike):
        folder = Path(session)
        if not is_array(folder):
            return check_folder(folder, partial(first_look_at_fit, at_rest=measured_noise()), clock)
        if clock != CLOCKS[0]:
            raise CalibrationError(f"{folder}: an array, whose units have clocks of their own; leave --clock {clock} out")
        read_array = need("recordings of arrays").read_array
        try:
            session = read_array(folder)
        except CalibrationError as error:
            return [Finding("error", folder.name, "reading", str(error))]
    elif not hasattr(session, "units"):
        session_or_folder(session)
    return need("checks of arrays").check_array(session, first_look_at_fit)
