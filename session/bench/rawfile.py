"""The raw file: every byte as it came, when it came, and how it is kept safe (locks, rescue of deleted files).

``raw.bin`` holds what the port gave and nothing else, so any capture of a port replays.  ``raw.times`` is text, ``host_ns,bytes,event``: at
host_ns (monotonic clock) the file held that many bytes.  Events are ``open`` (the port was opened, with wall-clock time and port),
``close``, decisions at the table (``decision_of``), and ``cut``: bytes that were noted before were gone when the recording
went on, so their events are void.  A write goes straight to the operating system, so a killed process loses
nothing; twice a second it is forced to the disk, against a power failure.  ``raw.bin`` is locked against other writers.  Files that are
removed during a recording are saved under another name.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from session.base.errors import FormatError, StorageError
from session.base.files import created, open_file, open_written
from session.base.texts import unicode_text
from session.bench.events import Event

# File locks: the system releases them with the process that holds them, however it ends.

if sys.platform == "win32":
    import msvcrt
else:
    try:
        import fcntl
    except ImportError:  # a POSIX system without locks
        fcntl = None  # type: ignore[assignment]  # a module or none

#: errors of a file that is locked by another process; any other is of a file system without locks
TAKEN = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
#: Windows locks bytes against reading: this is a byte that no recording reaches
BEYOND = 1 << 62


def lock(file: int, shared: bool = False) -> bool:
    """Lock an open file until it is closed; False if another process holds the lock.  A file system without locks counts as unlocked.

    shared: allow other shared locks, as for a test of the lock; Windows does not know them.
    """
    try:
        if sys.platform == "win32":
            os.lseek(file, BEYOND, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        elif fcntl is not None:
            fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in TAKEN
    return True


def is_locked(path: Path) -> bool:
    """Whether a process holds the lock of a file; False for a missing file."""
    try:
        file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return False
    try:
        return not lock(file, shared=True)
    finally:
        os.close(file)


_RESCUED = "_rescued"
BLOCK = 1 << 20
APPENDED = os.O_RDWR | os.O_APPEND | os.O_CREAT


def is_gone(file: int, path: Path) -> bool:
    """Whether an open file is no longer found under its path.

    A file system that renumbers files shows another number, but the same size; one that does not answer at the moment proves nothing.
    """
    mine = os.fstat(file)
    try:
        there = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False
    same = (there.st_dev, there.st_ino) == (mine.st_dev, mine.st_ino)
    return not same and (mine.st_nlink == 0 or there.st_size != mine.st_size)


RAW, TIMES = "raw.bin", "raw.times"
TIMES_HEADER = "host_ns,bytes,event"
SYNC_S = 0.5
CHECK_S = 0.25  #: between two checks that the files still exist
#: message where another process records into the folder
IN_USE = "another record is writing there now; wait until it has ended, or give --out another folder"
#: errors of a disk that accepted bytes and could not store them
NOT_KEPT = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EIO)
#: bytes of a line of raw.times, whose longest part is a log's name or a note
LONGEST_MARK = 1 << 16
#: largest number of decisions and openings of a port in one recording
MOST_EVENTS = 100_000
#: event of a recording that went on behind bytes that are gone
CUT = "cut"
#: bytes of raw.times that hold how much had come
TAIL = 2 * LONGEST_MARK
#: arrival times closer together than this share a line
TIME_STEP_NS = 10_000_000


@dataclass(frozen=True)
class Mark:
    """At host_ns the raw file held ``offset`` bytes; event is empty, or ``open …``, ``close …``, or a decision."""

    host_ns: int
    offset: int
    event: str = ""


class RawFile:
    """Appends bytes and marks.  When nothing more can be written, a StorageError states what is safe; later calls raise it again.

    Files that were removed are saved in another folder when they are closed: the open ones still hold every byte.
    """

    def __init__(self, folder: Path):
        self.path = folder / RAW  #: of the bytes
        self.trouble: StorageError | None = None  #: once received bytes are not, or not only, where they should be
        self.saved: Path | None = None  #: the folder where they are instead
        self._gone: Path | None = None  # the first of the files whose name is gone
        self.cut = ""  #: what is missing from the end of the file that was there
        self._failed: StorageError | None = None
        self._discarded = False
        self._missed = 0  # successive checks in which the files were missing
        self._last_ns = -TIME_STEP_NS
        self._made = [path for path in (self.path, folder / TIMES, folder, *folder.parents) if not os.path.lexists(path)]
        try:
            self._open(folder)
        except StorageError:
            if not self._in_use:
                self._unmake()
            raise
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._syncing = threading.Thread(target=self._sync, name="raw-sync", daemon=True)
        self._syncing.start()

    def _open(self, folder: Path) -> None:
        self._in_use = False
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._raw = self._locked()
            self._times = open_written(folder / TIMES, APPENDED)
        except OSError as error:
            raise StorageError(f"{error.filename or folder}: {error.strerror or error}; give --out another folder") from None
        self.size = os.fstat(self._raw).st_size
        if os.fstat(self._times).st_size == 0:
            self._write(self._times, f"{TIMES_HEADER}\n".encode())
            return
        os.lseek(self._times, -1, os.SEEK_END)
        if os.read(self._times, 1) != b"\n":  # a process was killed while it wrote a line
            self._write(self._times, b"\n")
        if words := cut_words(self.path):
            self.cut = words
            self._write(self._times, f"{time.monotonic_ns()},{self.size},{CUT}\n".encode())

    def _locked(self) -> int:
        """Open and lock the raw file; another process may remove it between the two."""
        while True:
            file = open_written(self.path, APPENDED)
            if not lock(file):
                os.close(file)
                self._in_use = True
                raise StorageError(f"{self.path.parent}: {IN_USE}")
            if not is_gone(file, self.path):
                return file
            os.close(file)

    def append(self, host_ns: int, data: bytes) -> None:
        """Append bytes that arrived at host_ns."""
        with self._lock:
            self._write(self._raw, data)
            if host_ns - self._last_ns >= TIME_STEP_NS:
                self._last_ns = host_ns
                self._write(self._times, f"{host_ns},{self.size},\n".encode())

    def mark(self, host_ns: int, event: str, offset: int | None = None) -> None:
        """Note an event behind the first ``offset`` bytes; without an offset, behind all."""
        with self._lock:
            where = self.size if offset is None else offset
            self._write(self._times, f"{host_ns},{where},{unicode_text(' '.join(event.split()))}\n".encode())

    def close(self) -> None:
        """Force everything to the disk and close; may be called twice."""
        if self._done.is_set():
            return
        self._done.set()
        self._syncing.join()
        if self._gone is not None:
            self._save(self._gone)
        for file in (self._raw, self._times):
            os.close(file)

    def discard(self) -> None:
        """Close; if no byte was received, remove the files and folders that did not exist before."""
        self._discarded = True
        if os.name == "posix":  # before another process can lock it; Windows removes no open file
            self._unmake()
        self.close()
        self._unmake()

    def _unmake(self) -> None:
        with contextlib.suppress(OSError):
            if self.path.exists() and self.path.stat().st_size > 0:
                return
            for path in self._made:
                # A folder that is no longer empty stays.
                path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)

    def _write(self, file: int, data: bytes) -> None:
        if self._failed:
            raise self._failed
        while data:
            try:
                written = os.write(file, data)
            except OSError as error:
                safe = f"{self.size} bytes received before are safe in {self.path}"
                self._failed = StorageError(f"{self.path}: {error.strerror or error}; {safe}; make room, then go on with --resume")
                raise self._failed from None
            if file == self._raw:
                self.size += written
            data = data[written:]

    def _sync(self) -> None:
        synced_s = time.monotonic()
        while True:
            last = self._done.wait(CHECK_S)
            self._check(last)
            if last or time.monotonic() - synced_s >= SYNC_S:
                synced_s = time.monotonic()
                for file in (self._raw, self._times):
                    try:
                        os.fsync(file)
                    except OSError as error:  # a pipe or a device is not forced anywhere
                        if error.errno in NOT_KEPT and self.trouble is None:
                            self.trouble = StorageError(
                                f"{self.path}: {error.strerror or error}; what was received last may not be on the disk; make room, "
                                "then go on with --resume"
                            )
            if last:
                return

    def _check(self, last: bool) -> None:
        """Check that the files exist; if they are missing twice in a row, the recording ends, and ``close`` saves them."""
        if self._discarded or self._gone is not None:
            return
        files = ((self._raw, self.path), (self._times, self.path.with_name(TIMES)))
        gone = [path for file, path in files if is_gone(file, path)]
        self._missed = self._missed + 1 if gone else 0
        if gone and (self._missed > 1 or last):
            self._gone = gone[0]
            self.trouble = StorageError(f"{gone[0]}: was removed, moved or replaced while it was being recorded")

    def _save(self, gone: Path) -> None:
        """Copy what the open files of a recording whose names are gone still hold into another folder."""
        what, why = f"{gone}: was removed, moved or replaced while it was being recorded", ""
        for place in (Path(os.path.abspath(self.path.parent)).parent, Path(tempfile.gettempdir())):
            try:
                folder = Path(tempfile.mkdtemp(prefix=f"{self.path.parent.name}{_RESCUED}_", dir=place))
                for file, name in ((self._raw, RAW), (self._times, TIMES)):
                    os.lseek(file, 0, os.SEEK_SET)
                    with created(folder / name) as copy:
                        while data := os.read(file, BLOCK):
                            copy.write(data)
            except OSError as error:
                why = f": {error.strerror or error}"
                continue
            self.saved = folder
            self.trouble = StorageError(f"{what}; what was received is saved in {folder}; go on with record --resume --out {folder}")
            return
        self.trouble = StorageError(f"{what}, and what was received could not be saved{why}")


def read_marks(raw_path: Path, last: int | None = None) -> Iterator[Mark]:
    """The marks of a raw file in the order of ``raw.times``, line by line: a day has millions.  last: only those in so many last bytes.

    There are none without that file.  Truncated lines are skipped; a line that is too long ends the file.
    """
    path = raw_path.with_suffix(".times")
    if not path.exists():
        return
    with open_file(path) as file:
        if last is not None and path.stat().st_size > last:
            file.seek(-last, os.SEEK_END)
            file.readline(LONGEST_MARK)
        while (line := file.readline(LONGEST_MARK)).endswith(b"\n"):
            cells = line[:-1].decode(errors="replace").split(",", 2)
            if len(cells) == 3 and all(cell.isascii() and cell.isdigit() and len(cell) < 20 for cell in cells[:2]):
                yield Mark(int(cells[0]), int(cells[1]), cells[2])


def read_events(raw_path: Path) -> list[Mark]:
    """The marks that are events.  FormatError for more than ``MOST_EVENTS``, and where another board's samples were noted, as once was."""
    events: list[Mark] = []
    for number, mark in enumerate(mark for mark in read_marks(raw_path) if mark.event):
        if number >= MOST_EVENTS:
            raise FormatError(f"{raw_path.with_suffix('.times')}: more than {MOST_EVENTS} events; is it this tool's?")
        events = [each for each in events if each.offset <= mark.offset] if mark.event == CUT else [*events, mark]
    if any(mark.event.startswith("foreign ") for mark in events):
        what = f'{raw_path.with_suffix(".times")}: notes ("foreign") that {raw_path.name} holds samples of another board, too'
        raise FormatError(f"{what}; this folder's log*.csv do not: use them as they are, and record on into another folder")
    return sorted(events, key=lambda mark: mark.offset)


def cut_words(raw_path: Path) -> str:
    """That a raw file holds fewer bytes than ``raw.times`` noted last, in one line; empty where it holds them."""
    noted, size = 0, raw_path.stat().st_size
    for mark in read_marks(raw_path, TAIL):
        noted = mark.offset if mark.event == CUT else max(noted, mark.offset)
    if noted <= size:
        return ""
    return (
        f"{raw_path}: {noted - size} bytes are missing from its end: it holds {size}, and {noted} had come by {raw_path.stem}.times "
        "(it was cut, or the power failed); what it holds is used"
    )


# Decisions at the table, each an event in ``raw.times``, so that a replay repeats them at the same byte.
#
# ``begin STEM``: samples from here on go to a new ``STEM*.csv``.  ``pause``: they go to no log.  ``keep STEM``: the file that was begun
# last is complete, and gets this name; samples behind it go to no log.  ``drop T_US``: the turn that moved at this device time does not
# count.  ``note TEXT``.


def raw_event(event: Event) -> str:
    """As in raw.times."""
    return f"{event.kind} {event.text}".rstrip()


def decision_of(mark: Mark) -> Event | None:
    """The decision of a mark; None for another event, and for an invalid one."""
    word, _, rest = mark.event.partition(" ")
    is_stem, is_time = rest.isidentifier(), rest.isascii() and rest.isdigit()
    valid = {"begin": is_stem, "keep": is_stem, "drop": is_time, "pause": True, "note": True, "finish": not rest}
    return Event(word, text=rest) if valid.get(word, False) else None


def name_kept(marks: Sequence[Mark], begun: int) -> str | None:
    """The stem under which the file that marks[begun] begins was kept; None if it was not."""
    for mark in marks[begun + 1 :]:
        decision = decision_of(mark)
        if decision is not None and decision.kind == "keep":
            return decision.text
        if mark.event.startswith("open") or (decision is not None and decision.kind in ("begin", "pause")):
            return None
    return None


# A log that only grows: what it holds already is never written again.
#
# After Ctrl-C or a crash the logs are made again from the raw bytes, and somebody may have used them meanwhile.  So the new text is
# compared with the existing one, and only what lies behind it is added; a log that somebody has changed is kept under another name.

ASIDE = ".changed"


class GrowingFile:
    """Write to it as to a new file, or (behind) after what it holds.  aside: where an old file with another beginning went, or None.
    Raises OSError."""

    def __init__(self, path: Path, behind: bool = False):
        self.path = path
        self.aside: Path | None = None
        self._same = 0  # bytes of the old file that were found again
        if path.is_fifo():  # opening it would wait for its reader
            raise FileExistsError(errno.EEXIST, f"{path.name} is a named pipe", str(path))
        self._left = path.stat().st_size if path.is_file() else 0
        self._file = os.fdopen(open_written(path, os.O_RDWR | os.O_CREAT), "r+b" if self._left else "wb")
        if behind:
            self._left, self._same = 0, self._file.seek(0, os.SEEK_END)

    def write(self, text: str) -> None:
        """Add text, unless the file holds it already."""
        data = text.encode()
        if self._left:
            there = self._file.read(min(len(data), self._left))
            if there != data[: len(there)]:
                # Continue in a new file that begins with the part that was right.
                self._file.seek(0)
                right, self._left = self._file.read(self._same), 0
                self._file.close()
                self.aside = put_aside(self.path)
                self._file = created(self.path)
                self._file.write(right)
            else:
                self._same, self._left, data = self._same + len(there), self._left - len(there), data[len(there) :]
        if data:
            self._file.write(data)

    def flush(self) -> None:
        """Pass buffered text to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def put_aside(path: Path) -> Path | None:
    """Rename an existing file, and return its new path; None if there is none.  Raises OSError."""
    if not path.exists():
        return None
    names = (path.with_name(f"{path.name}{ASIDE}{number}") for number in itertools.count(1))
    return path.rename(next(name for name in names if not name.exists()))
