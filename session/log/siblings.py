"""Other recordings of one unit: the session folders next to one, or in a folder, that name its serial number."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from session.base.errors import CalibrationError, DataError
from session.base.names import is_session, is_special, refuse_special
from session.log.config import read_config

#: most folders next to a session that are looked at; a fleet's own command reads more
MOST_LOOKED_AT = 200


def sibling_sessions(folder: Path) -> list[Path]:
    """Return the sessions in the parent folder that name the same unit, in order of their names; none if the session names no serial."""
    try:
        serial = serial_of(folder)
        near = sessions_of(folder.resolve().parent, serial, MOST_LOOKED_AT) if serial else ()
        return [other for other in near if other != folder.resolve()]
    except (CalibrationError, OSError):
        return []


def recordings_at(place: Path, first: Path, serial: str) -> list[Path]:
    """Return a session folder itself, or the sessions in it of the unit with this serial number, without the session ``first``.

    Raises DataError if there is none.
    """
    if not place.exists():
        raise DataError(f"{place}: not found; give a session folder, or one that holds sessions of the unit")
    if place.is_dir():
        refuse_special(place)
    if place.resolve() == first.resolve():
        raise DataError(f"{place}: is the recording itself, which confirms nothing; give another one of the unit")
    if is_session(place):
        return [place]
    found = [other for other in sessions_of(place, serial) if other.resolve() != first.resolve()] if place.is_dir() else []
    if not found:
        unit = f"of the unit {serial!r} " if serial else ""
        raise DataError(f"{place}: expected a session folder, or one that holds sessions {unit}other than {first.name}; give one")
    return found


def serial_of(folder: Path) -> str:
    """Return the serial number that a session names, or ``""``.  Raises what ``read_config`` raises."""
    return read_config(folder / "session.toml").sensor.serial


def sessions_of(place: Path, serial: str, most: int | None = None) -> Iterator[Path]:
    """Yield the session folders among the first ``most`` of a folder that name this serial number; all of them for ``""``.

    Folders that cannot be read are none.
    """
    for folder in sorted(path for path in place.iterdir() if path.is_dir())[:most]:
        try:
            if is_session(folder) and not is_special(folder) and (not serial or serial_of(folder) == serial):
                yield folder
        except CalibrationError:
            continue
