"""Whatever goes where a session goes: a session, the path of its folder, a table in memory."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError, FormatError
from session.log.folder import Session
from tinygc.library.tables import is_table


def session_of_table(table: Any) -> Session:
    """The session of a table that states its units, or whose units physics shows.  Raises what ``read_log`` does."""
    from session.base.questions import QuestionsError  # late, as most sessions are folders
    from tinygc.library.logs import read_log

    try:
        return read_log(table).session()
    except QuestionsError as cause:
        raise FormatError(f"{cause}, all to tinygc.read_log(data, …).session()") from None


def session_or_folder(session: Any) -> Session | Path:
    """Return a session, that of a table in memory, or the path of its folder; CalibrationError for anything else."""
    if isinstance(session, Session):
        return session
    if isinstance(session, str | PathLike):
        return Path(session)
    if is_table(session):
        return session_of_table(session)
    raise CalibrationError(f"session is a {type(session).__name__}, expected a tinygc.Session, the path of its folder, or a table")
