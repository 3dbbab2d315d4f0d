"""``tinygc.check``: the first look at a session, or at a folder that may not even be readable as one."""

from __future__ import annotations

from pathlib import Path

from session.checks.findings import Finding, worst
from session.checks.first_look import check_folder, check_session
from session.common.errors import CalibrationError
from session.detect.session_stills import SessionStills
from session.log.array_reading import is_array, read_array
from session.log.array_session import ArraySession
from session.log.folder import Session
from tinygc.problem.gravity_sign import first_look_at_gravity_sign


def check(session: Session | ArraySession | Path | str) -> list[Finding]:
    """All findings, in the order in which they are looked for: ``level`` (ok, note, warning, error), ``where``, ``what``, ``says``, ``do``.

    Of a folder, a log that cannot be read is an error among the findings.  Of an array, ``where`` begins with the unit's number.
    """
    if isinstance(session, ArraySession):
        return _check_array(session)
    if not isinstance(session, Session) and is_array(Path(session)):
        try:
            array = read_array(session)
        except CalibrationError as error:
            return [Finding("error", Path(session).name, "reading", str(error))]
        return _check_array(array)
    if not isinstance(session, Session):
        return check_folder(Path(session), first_look_at_gravity_sign)
    found = SessionStills(session)
    findings = check_session(session, found)
    return findings if worst(findings) == "error" else findings + first_look_at_gravity_sign(session, found)


def _check_array(array: ArraySession) -> list[Finding]:
    from tinygc.array.check import check_array  # its correlations are slow to import, and few folders are arrays

    return check_array(array, first_look_at_gravity_sign)
