"""What a result was made from: the hash of every file of a session."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from session.common.texts import unicode_text
from session.files.reading import open_file, unreadable
from session.log.folder import KNOWN_TURNS, Session
from session.log.logfile import Log


def input_files(session: Session) -> list[Path]:
    """Every file of a session that a result depends on: session.toml, logs, closure runs, dial readings, known turns, truth."""
    dials = [session.folder / "attitudes.csv"] if session.attitudes is not None else []
    in_memory = all(log.in_memory for log in session.logs)
    dials += [session.folder / KNOWN_TURNS] if session.turns and not in_memory else []
    truths = [truth.path for truth in session.truths or ()]
    config = [] if in_memory else [session.folder / "session.toml"]
    return [*config, *(log.path for log in (*session.logs, *session.closures)), *dials, *truths]


def input_hashes(session: Session) -> dict[str, str]:
    """SHA-256 of each of ``input_files``, by name, or of arrays that were never a file; FormatError where one cannot be read any more."""
    logs = {log.path: log for log in (*session.logs, *session.closures)}
    hashes = {file_key(path): hash_of_log(logs[path]) if path in logs else sha256_of(path) for path in input_files(session)}
    if session.turns and KNOWN_TURNS not in hashes:
        rows = [(turn.turn, turn.log, turn.axis.tolist(), turn.angle_rad, turn.sigma_rad) for turn in session.turns]
        hashes[KNOWN_TURNS] = hashlib.sha256(repr(rows).encode()).hexdigest()
    return hashes


def file_key(path: Path) -> str:
    """The file's name as JSON can hold it, and gives it back."""
    return unicode_text(path.name)


def hash_of_log(log: Log) -> str:
    """Of its file; of arrays that were never a file, of their bytes, little-endian, one array after the other."""
    if not log.in_memory:
        return sha256_of(log.path)
    digest, samples = hashlib.sha256(), log.samples
    for array, kind in ((samples.t_ns, "<i8"), (samples.gyro, "<f8"), (samples.accel, "<f8"), (samples.temp_c, "<f8")):
        if array is not None:
            digest.update(np.ascontiguousarray(array, dtype=kind).tobytes())
    return digest.hexdigest()


def sha256_of(path: Path) -> str:
    """Of a file's bytes as they lie on the disk (packed logs packed), in hexadecimal."""
    try:
        with open_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(path, error) from None
