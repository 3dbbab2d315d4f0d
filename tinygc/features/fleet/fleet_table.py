"""OUT/fleet.sqlite: a row for each key, and the key of each folder.  One process writes it; the table survives its sudden end.

The write-ahead log commits each row separately, so that no end of the process can revert it; a loss of power may cost the last rows, and
leaves the table consistent.  Lost rows are computed again.  Concurrent readers (SQL, ``--csv``) see whole rows.
"""

from __future__ import annotations

import contextlib
import os
import re
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

from session.base.errors import CalibrationError, FormatError, StorageError
from session.base.files import open_written, refuse_link, result_folder
from session.base.texts import command_line, printable, unicode_text
from session.bench.rawfile import lock
from tinygc.features.fleet.fleet_row import BLOB, COLUMNS, DIED, DONE, FAILED, INTEGER, REAL, TEXT, Outcome, Row

NAME, LOCK = "fleet.sqlite", "fleet.lock"
#: file format (PRAGMA application_id, "TGCF"), and its version (user_version)
APPLICATION, VERSION = 0x54474346, 4
SCHEMA = f"""
CREATE TABLE results (key TEXT PRIMARY KEY, {", ".join(f"{name} {kind}" for name, kind in COLUMNS.items())});
CREATE TABLE folders (folder TEXT PRIMARY KEY, key TEXT, error TEXT) WITHOUT ROWID;
CREATE INDEX folders_of_key ON folders (key);
CREATE TABLE durations (key TEXT PRIMARY KEY, cpu_s REAL, wall_s REAL) WITHOUT ROWID;
"""
#: results of sessions whose folders still exist, one for each key, with the first of its folders
EACH = "results JOIN (SELECT key, min(folder) AS folder, count(*) AS folders FROM folders GROUP BY key) USING (key)"
#: SQL function for natural sorting of names
COUNTED = "counted"
#: of any number in a row, whose square is a number
LARGEST = "1e150"
FULL, LOCKED, READ_ONLY = "SQLITE_FULL", "SQLITE_BUSY", "SQLITE_READONLY"


#: s between two looks at whether a run's table is still where it was
WATCH_S = 1.0


class FleetTable:
    """A fleet's table, from ``open_table`` or ``read_table``."""

    def __init__(self, path: Path, connection: sqlite3.Connection):
        self.path, self._connection = path, connection
        self._file, self._looked_s = _identity(path), monotonic()
        connection.create_function(COUNTED, 1, _counted, deterministic=True)

    def require_there(self, at_once: bool = False) -> None:
        """Raise StorageError where the file was removed or replaced, within ``WATCH_S``: rows then go into a file that no one can open."""
        if not at_once and monotonic() - self._looked_s < WATCH_S:
            return
        self._looked_s = monotonic()
        if _identity(self.path) != self._file:
            raise StorageError(f"{self.path}: was removed or replaced during the run, whose rows are lost with it; run again")

    def status(self, key: str) -> str | None:
        """Return the status of a key's result; None where there is none."""
        found = self.rows("SELECT status FROM results WHERE key = ?", (key,))
        return found[0][0] if found else None

    def put_folder(self, folder: Path, key: str | None, error: str | None = None) -> None:
        """Store a folder's key, or the reason for having none; a missing folder of the same content was moved here."""
        row = (unicode_text(os.fspath(folder)), key, error)
        with named_errors(self.path):
            same = self._connection.execute("SELECT key, error FROM folders WHERE folder = ?", row[:1]).fetchone()
            if same == row[1:]:  # an unchanged row is not written
                return
            others = [] if key is None else self.rows("SELECT folder FROM folders WHERE key = ? AND folder <> ?", (key, row[0]))
            moved = [each for each in others if not os.path.isdir(each[0])]
            with self._connection:
                self._connection.executemany("DELETE FROM folders WHERE folder = ?", moved)
                self._connection.execute("INSERT OR REPLACE INTO folders VALUES (?, ?, ?)", row)

    def put(self, outcome: Outcome, row: Row, folders: Sequence[Path]) -> None:
        """Store a result and its folders, in one transaction."""
        marks = ", ".join("?" * (len(COLUMNS) + 1))
        with named_errors(self.path), self._connection:
            values = (outcome.key, *(row[name] for name in COLUMNS))
            self._connection.execute(f"INSERT OR REPLACE INTO results VALUES ({marks})", values)
            self._connection.execute("INSERT OR REPLACE INTO durations VALUES (?, ?, ?)", (outcome.key, outcome.cpu_s, outcome.wall_s))
            self._connection.executemany(
                "INSERT OR REPLACE INTO folders VALUES (?, ?, NULL)",
                [(unicode_text(os.fspath(folder)), outcome.key) for folder in folders],
            )

    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[tuple]:
        """Return all rows of a short query."""
        with named_errors(self.path):
            return self._connection.execute(sql, values).fetchall()

    def each(self, sql: str, values: Sequence[Any] = ()) -> Iterator[tuple]:
        """Yield the rows of any query."""
        with named_errors(self.path):
            yield from self._connection.execute(sql, values)

    def one(self, sql: str) -> Any:
        """Return a single number or text."""
        return self.rows(sql)[0][0]


@contextlib.contextmanager
def open_table(out: Path) -> Iterator[FleetTable]:
    """Open a folder's table for writing, and create it if missing.

    Raises CalibrationError where another run writes it, FormatError for a file that is no such table or of another version, StorageError
    where writing fails.
    """
    path = out / NAME
    with result_folder(out), _alone(out):
        with named_errors(path):
            refuse_link(path)
            connection = sqlite3.connect(path)
        try:
            with named_errors(path):
                if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                    ours = f"PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION};"
                    connection.executescript(f"BEGIN; {ours} {SCHEMA} COMMIT;")
                _require_ours(path, connection)
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = NORMAL")
            yield FleetTable(path, connection)
        finally:
            with contextlib.suppress(sqlite3.Error):
                connection.execute("PRAGMA journal_mode = DELETE")  # one file again, which any program can read; fails if another reads
            connection.close()


@contextlib.contextmanager
def read_table(out: Path) -> Iterator[FleetTable]:
    """Open a folder's table read-only, also while another run writes it.  Raises FormatError where there is none."""
    path = out / NAME
    if not path.is_file():
        raise FormatError(f"{path}: not found; `{command_line('fleet', 'DIR', '--out', out)}` makes it")
    with named_errors(path):
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
    try:
        with named_errors(path):
            _require_ours(path, connection)
            _require_rows(path, connection)
            connection.execute("BEGIN")  # all queries see the same rows, also while another run writes
        yield FleetTable(path, connection)
    finally:
        connection.close()


def _identity(path: Path) -> tuple[int, int] | None:
    """Return which file the name stands for; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _require_rows(path: Path, connection: sqlite3.Connection) -> None:
    """Raise FormatError for the first value that ``fleet`` does not write: another program may have edited the table."""
    kinds = {TEXT: "'text'", INTEGER: "'integer'", REAL: "'real', 'integer'", BLOB: "'blob'"}
    wrong = [(name, f"typeof({name}) NOT IN ('null', {kinds[kind]})") for name, kind in COLUMNS.items()]
    wrong += [(name, f"abs({name}) > {LARGEST}") for name, kind in COLUMNS.items() if kind == REAL]
    wrong += [(name, f"{name} = -1") for name in COLUMNS if name.startswith("accel_scale")]  # an axis that reads nothing
    wrong += [
        ("status", f"ifnull(status, '') NOT IN ('{DONE}', '{FAILED}', '{DIED}')"),
        ("error", f"status <> '{DONE}' AND error IS NULL"),
        ("key", "typeof(key) <> 'text'"),
    ]
    which = " ".join(f"WHEN {each} THEN {number}" for number, (_, each) in enumerate(wrong))
    named = [name for name, _ in wrong]
    checks = {
        f"SELECT ifnull((SELECT min(folder) FROM folders f WHERE f.key = results.key), key), CASE {which} END AS bad FROM results": named,
        "SELECT folder, CASE WHEN typeof(folder) <> 'text' THEN 0 WHEN typeof(key) NOT IN ('text', 'null') THEN 1 "
        "WHEN typeof(error) NOT IN ('text', 'null') OR (key IS NULL AND error IS NULL) THEN 2 END AS bad FROM folders": [
            "folder",
            "key",
            "error",
        ],
        "SELECT key, CASE WHEN typeof(cpu_s) <> 'real' THEN 0 WHEN typeof(wall_s) <> 'real' THEN 1 END AS bad FROM durations": [
            "cpu_s",
            "wall_s",
        ],
    }
    for sql, names in checks.items():
        found = connection.execute(f"SELECT * FROM ({sql}) WHERE bad IS NOT NULL LIMIT 1").fetchone()
        if found:
            raise not_as_written(path, str(found[0]), f" ({names[found[1]]})")


def not_as_written(path: Path, row: str, what: str = "") -> FormatError:
    """Return the error for a row that another program has changed; row: its folder, or its key."""
    return FormatError(
        f"{path}: the row of {printable(row)} holds what fleet does not write{what}; delete it from the table, and run fleet again"
    )


def _counted(name: str) -> str:
    """Insert the length before each number: s2, s10 become s0001:2, s0002:10."""
    return re.sub(r"0*([0-9]+)", lambda found: f"{len(found[1]):04d}:{found[1]}", name)


def _require_ours(path: Path, connection: sqlite3.Connection) -> None:
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION:
        raise FormatError(f"{path}: is no table of `calibrate.py fleet`; give --out another folder")
    names = [row[1] for row in connection.execute("PRAGMA table_info(results)")]
    if version != VERSION or names != ["key", *COLUMNS]:
        raise FormatError(
            f"{path}: is a table of form {version} with {len(names)} columns, this version writes form {VERSION} with {len(COLUMNS) + 1}; "
            "give --out another folder, and keep this one for the version that made it"
        )


@contextlib.contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Hold the lock, which ends with the process."""
    try:
        file = open_written(out / LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise StorageError(f"{out / LOCK}: cannot be written ({error.strerror}); give --out another folder") from None
    try:
        if not lock(file):
            raise CalibrationError(f"{out / NAME}: another run is writing it; wait for its end, or give --out another folder")
        yield
    finally:
        os.close(file)


@contextlib.contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Convert errors of SQLite to one line."""
    try:
        yield
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "") or ""
        if name.startswith((FULL, "SQLITE_IOERR")):
            raise StorageError(f"{path}: {error}; free space there and run again, what is finished is kept") from None
        if name.startswith((READ_ONLY, "SQLITE_CANTOPEN", "SQLITE_PERM")):
            raise StorageError(f"{path}: {error}; give --out a folder that can be written") from None
        if name.startswith(LOCKED):
            raise CalibrationError(f"{path}: another program holds it ({error}); close that one and run again") from None
        raise FormatError(f"{path}: is broken, or no table ({error}); restore it, or give --out another folder") from None
