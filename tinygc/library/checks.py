"""``tinygc.check``: the first look at a session, or at a folder whose logs may be unreadable."""

from __future__ import annotations

from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from session.base import features
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder, check_session
from session.detect.stills import SessionStills
from session.log.folder import Session
from tinygc.closure.prepared import first_look_at_fit
from tinygc.estimation.options import Clock
from tinygc.library.arguments import public
from tinygc.library.sources import session_of_table, session_or_folder
from tinygc.library.tables import is_table
from tinygc.noise.measured import measured_noise


@public(Clock)
def check(session: Any, **choices: Any) -> list[Finding]:
    """Check a recording before a fit: rates, scales, stills, turns, gaps, the accelerometer.

    Parameters
    ----------
    session : Session, ArraySession, table, str or Path
        The recording, or its folder.

    Returns
    -------
    list of Finding
        In the order of the checks: ``level`` (ok, note, warning, error), ``where``, ``what``, ``description``, ``do``.  In a folder, a log
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
    at_rest, clock = measured_noise(), Clock(**choices).clock
    recording = Path(session) if isinstance(session, str | PathLike) else session_of_table(session) if is_table(session) else session
    if (found := features.first("check of a recording", recording, clock, first_look_at_fit)) is not None:
        return found
    if isinstance(recording, Path):
        return check_folder(recording, partial(first_look_at_fit, at_rest=at_rest), clock)
    own = session_or_folder(recording)
    assert isinstance(own, Session)
    stills = SessionStills(session := own.on_clock(clock))
    findings = check_session(session, stills)
    return findings if worst(findings) == "error" else findings + first_look_at_fit(session, stills, at_rest)
