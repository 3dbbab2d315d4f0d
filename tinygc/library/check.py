"""``tinygc.check``: the first look at a session, or at a folder that may not even be readable as one."""

from __future__ import annotations

from pathlib import Path

from session.checks.findings import Finding
from session.checks.first_look import check_folder, check_session
from session.log.folder import Session


def check(session: Session | Path | str) -> list[Finding]:
    """All findings, in the order in which they are looked for: ``level`` (ok, note, warning, error), ``where``, ``what``, ``says``, ``do``.

    Of a folder, a log that cannot be read is an error among the findings.
    """
    return check_session(session) if isinstance(session, Session) else check_folder(Path(session))
