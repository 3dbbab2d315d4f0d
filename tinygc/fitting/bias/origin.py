"""What a stored model was fitted to, and whether that is the session at hand: its closure there is then no proof of anything."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.common.errors import FormatError
from session.files.results import read_json
from session.log.folder import Session
from session.log.hashes import hash_of_log
from tinygc.fitting import saved_fit


@dataclass(frozen=True)
class Origin:
    """session: the name that the model has of its own, or None; here: whether it was fitted to a log of the session at hand, None where
    only the names agree, or nothing is known; says: the same for people."""

    session: str | None
    here: bool | None
    says: str


def origin_of(path: Path, session: Session) -> Origin:
    """Compare the hashes that the model file, or ``fit``'s record beside it, has of its logs with those of the session's logs."""
    table = read_json(path)
    logs = {hash_of_log(log) for log in session.logs}
    stored = table["stored"] if isinstance(table.get("stored"), dict) else table
    name = stored.get("session") if isinstance(stored.get("session"), str) else None
    known = _hashes(stored.get("sha256")) or (_beside(path) if stored is table else set())
    if logs & known:
        return Origin(name, True, "the stored model was fitted to this very session: its closure is that of fitted segments")
    if name == session.name:
        return Origin(
            name, None, f"the stored model is of a session of the same name ({name}): if it is this one, its segments were fitted"
        )
    if stored is not table and logs & _hashes(table.get("sha256")):
        return Origin(name, False, f"the stored model was fitted to other logs ({name}), and had its bias from this very session already")
    if known:
        return Origin(name, False, f"the stored model was fitted to other logs ({name or 'of a session without a name'})")
    if name:
        return Origin(name, False, f"the stored model is of another session by its name ({name})")
    return Origin(None, None, "what the stored model was fitted to is not known: its file does not say")


def _hashes(entry: object) -> set[str]:
    return {value for value in entry.values() if isinstance(value, str)} if isinstance(entry, dict) else set()


def _beside(path: Path) -> set[str]:
    """From what ``fit`` leaves beside its models."""
    try:
        return _hashes(read_json(path.parent / saved_fit.NAME)["key"]["inputs"])
    except (FormatError, KeyError, TypeError):
        return set()
