"""The raw file: every byte as it came, when it came, and how it is kept safe (locks, rescue of deleted files)."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from session.io.errors import FormatError, StorageError
from session.io.files import open_file
from session.io.texts import unicode_text

# Locks of files, which the system takes away with the process that holds them, however it ends.

if sys.platform == "win32":
    import msvcrt
else:
    try:
        import fcntl
    except ImportError:  # a POSIX system without it: nobody can be told to wait
        fcntl = None  # type: ignore[assignment]  # a module or none

#: what a system says of a file that somebody else has locked; anything else is a file system without locks
TAKEN = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
#: Windows locks bytes, and nobody else may then read them: one that no recording reaches
BEYOND = 1 << 62


def lock(file: int, shared: bool = False) -> bool:
    """Lock an open file until it is closed; False where another holder has it.  A file system without locks says nothing of others.

    shared: with others who ask so, as who only wants to know does; Windows knows no such thing.
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
    """Whether somebody holds the lock of a file; False for one that is not there."""
    try:
        file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return False
    try:
        return not lock(file, shared=True)
    finally:
        os.close(file)


# Files that are being written and have no name any more: noticed, and saved under another one.
#
# Who removes, moves or replaces the folder of a recording that runs takes away the names; the open files still hold every byte.

RESCUED = "_rescued"
BLOCK = 1 << 20
#: Windows would turn line ends into its own
BINARY = getattr(os, "O_BINARY", 0)


def is_gone(file: int, path: Path) -> bool:
    """Whether an open file cannot be found under its path any more.

    A file system that numbers files anew shows another number, but the same size; one that does not answer at the moment says nothing.
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


def new_folder(folder: Path) -> Iterator[Path]:
    """Make a folder for what was saved: beside the lost one, where we stand, or in the temporary folder; each that can be made."""
    name = folder.resolve().name
    for parent in dict.fromkeys((Path(os.path.abspath(folder)).parent, _here(), Path(tempfile.gettempdir()))):
        for number in range(1, 1000):
            place = parent / f"{name}{RESCUED}{'' if number == 1 else number}"
            try:
                place.mkdir(parents=True)
            except FileExistsError:
                continue
            except OSError:
                break
            yield place
            break


def _here() -> Path:
    try:
        return Path.cwd()
    except OSError:  # that was removed, too
        return Path(tempfile.gettempdir())


def copied(files: Sequence[int], paths: Sequence[Path]) -> list[int]:
    """Open files with the same bytes under those new names, to append to.  Raises OSError, and leaves then what it has copied."""
    made: list[int] = []
    try:
        for path in paths:
            made.append(os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_EXCL | BINARY, 0o644))
        for source, target in zip(files, made, strict=True):
            catch_up(source, target)
    except OSError:
        for file in made:
            os.close(file)
        raise
    return made


def discard(folder: Path, paths: Sequence[Path]) -> None:
    """Take away a copy that could not be made."""
    with contextlib.suppress(OSError):
        for path in paths:
            path.unlink(missing_ok=True)
        folder.rmdir()


def catch_up(source: int, target: int) -> None:
    """Append to a copy what its source holds beyond it.  Raises OSError."""
    os.lseek(source, os.fstat(target).st_size, os.SEEK_SET)  # appending does not mind where it stands
    while data := os.read(source, BLOCK):
        while data:
            data = data[os.write(target, data) :]


# The raw file: the bytes as they came, and beside it when they came.
#
# ``raw.bin`` holds what the port gave and nothing else, so any capture of a port replays.  ``raw.times`` is text,
# ``host_ns,bytes,event``: at host_ns (monotonic clock) the file held that many bytes.  Events are ``open`` (the port was opened, with
# wall-clock time and port), ``close``, and what was decided at the table (``decisions``).  A write goes straight to the operating
# system, so a killed process loses nothing that it had; twice a second it is forced to the disk, against a power failure.  Nobody else
# writes meanwhile: ``raw.bin`` is locked.  Files that are removed under a recording are saved under another name.

RAW, TIMES = "raw.bin", "raw.times"
TIMES_HEADER = "host_ns,bytes,event"
SYNC_S = 0.5
LOOK_S = 0.25  #: whether the files are still there
#: what is said where another process has the folder
IN_USE = "another record is writing there now; wait until it has ended, or give --out another folder"
#: of a disk that took bytes, and then could not keep them
NOT_KEPT = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EIO)
#: bytes of a line of raw.times, whose longest part is a log's name or a person's note
LONGEST_MARK = 1 << 16
#: decisions at a table and openings of a port in one recording
MOST_EVENTS = 100_000
#: arrival times closer together than this share a line
TIME_STEP_NS = 10_000_000


@dataclass(frozen=True)
class Mark:
    """At host_ns the raw file held ``offset`` bytes; event is empty, or ``open …``, ``close …``, or a decision (``decisions``)."""

    host_ns: int
    offset: int
    event: str = ""


class RawFile:
    """Append bytes and marks.  StorageError says what is safe when no more can be written; later calls raise it again.

    path: of the bytes; trouble: a StorageError, once what was received is not, or not only, where it should be; saved: the folder where it
    is instead.  Files that were removed go on in that folder, so that nothing that comes meanwhile is lost.
    """

    def __init__(self, folder: Path):
        self.path = folder / RAW
        self.trouble: StorageError | None = None
        self.saved: Path | None = None
        self._failed: StorageError | None = None
        self._discarded = False
        self._missed = 0  # how often running the files were not there
        self._last_ns = -TIME_STEP_NS
        self._made = [path for path in (self.path, folder / TIMES, folder, *folder.parents) if not path.exists()]
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
            self._times = os.open(folder / TIMES, os.O_RDWR | os.O_APPEND | os.O_CREAT | BINARY, 0o644)
        except OSError as error:
            raise StorageError(f"{error.filename or folder}: {error.strerror or error}; give --out another folder") from None
        self.size = os.fstat(self._raw).st_size
        if os.fstat(self._times).st_size == 0:
            self._write(self._times, f"{TIMES_HEADER}\n".encode())
            return
        os.lseek(self._times, -1, os.SEEK_END)
        if os.read(self._times, 1) != b"\n":  # a process was killed while it wrote a line
            self._write(self._times, b"\n")

    def _locked(self) -> int:
        """The raw file, locked.  Its place may change between opening and locking: another process may give it up, and take it away."""
        while True:
            file = os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT | BINARY, 0o644)
            if not lock(file):
                os.close(file)
                self._in_use = True
                raise StorageError(f"{self.path.parent}: {IN_USE}")
            if not is_gone(file, self.path):
                return file
            os.close(file)

    def append(self, host_ns: int, data: bytes) -> None:
        """Bytes that arrived at host_ns."""
        with self._lock:
            self._write(self._raw, data)
            if host_ns - self._last_ns >= TIME_STEP_NS:
                self._last_ns = host_ns
                self._write(self._times, f"{host_ns},{self.size},\n".encode())

    def mark(self, host_ns: int, event: str, offset: int | None = None) -> None:
        """Something that happened behind the first ``offset`` bytes; without one, behind all there are."""
        with self._lock:
            where = self.size if offset is None else offset
            self._write(self._times, f"{host_ns},{where},{unicode_text(' '.join(event.split()))}\n".encode())

    def close(self) -> None:
        """Force everything to the disk and close; may be called twice."""
        if self._done.is_set():
            return
        self._done.set()
        self._syncing.join()
        for file in (self._raw, self._times):
            os.close(file)

    def discard(self) -> None:
        """Close; where no byte was received, take away the files and folders that were not there before."""
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
                # A folder that somebody has put something into by now stays.
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
            last = self._done.wait(LOOK_S)
            self._look(last)
            if last or time.monotonic() - synced_s >= SYNC_S:
                synced_s = time.monotonic()
                self._force_to_disk()
            if last:
                return

    def _force_to_disk(self) -> None:
        for file in (self._raw, self._times):
            try:
                os.fsync(file)
            except OSError as error:  # a pipe or a device is not forced anywhere
                if error.errno in NOT_KEPT and self.trouble is None:
                    self.trouble = StorageError(
                        f"{self.path}: {error.strerror or error}; what was received last may not be on the disk; make room, "
                        "then go on with --resume"
                    )

    def _look(self, last: bool) -> None:
        """Whether the files are where they were; where they are not, twice running, save them."""
        if self._discarded or self.saved is not None:
            return
        with self._lock:
            gone = [path for file, path in self._files if is_gone(file, path)]
        self._missed = self._missed + 1 if gone else 0
        if gone and (self._missed > 1 or last):
            self._save(gone[0])

    @property
    def _files(self) -> tuple[tuple[int, Path], tuple[int, Path]]:
        return (self._raw, self.path), (self._times, self.path.with_name(TIMES))

    def _save(self, gone: Path) -> None:
        """Go on in copies under another name."""
        what = f"{gone}: was removed, moved or replaced while it was being recorded"
        why = "no place was found for what was received"
        for folder in new_folder(self.path.parent):
            old, paths = [self._raw, self._times], [folder / RAW, folder / TIMES]
            try:
                new = copied(old, paths)
                with self._lock:  # the reader waits only for what has come meanwhile
                    for source, target in zip(old, new, strict=True):
                        catch_up(source, target)
                    self._raw, self._times = new
                    self.path, self.saved = folder / RAW, folder
            except OSError as error:
                why = f"what was received could not be saved in {folder}: {error.strerror or error}"
                discard(folder, paths)  # to be tried again
                continue
            lock(self._raw)
            for file in old:
                os.close(file)
            self.trouble = StorageError(f"{what}; what was received is saved in {folder}; go on with record --resume --out {folder}")
            return
        self.trouble = StorageError(f"{what}, and {why}")


def read_marks(raw_path: Path) -> list[Mark]:
    """The marks beside a raw file, by offset; none where there is no such file.  Lines that were cut off are passed over."""
    return sorted(_marks(raw_path), key=lambda mark: mark.offset)


def read_events(raw_path: Path) -> list[Mark]:
    """Those marks at which something happened.  FormatError for more of them than a table has decisions."""
    events = []
    for mark in _marks(raw_path):
        if mark.event:
            events.append(mark)
        if len(events) > MOST_EVENTS:
            raise FormatError(f"{raw_path.with_suffix('.times')}: more than {MOST_EVENTS} events; is it this tool's?")
    return sorted(events, key=lambda mark: mark.offset)


def _marks(raw_path: Path) -> Iterator[Mark]:
    """A line at a time: a day has millions.  A line too long to be one ends the file."""
    path = raw_path.with_suffix(".times")
    if not path.exists():
        return
    with open_file(path) as file:
        while (line := file.readline(LONGEST_MARK)).endswith(b"\n"):
            cells = line[:-1].decode(errors="replace").split(",", 2)
            if len(cells) == 3 and all(cell.isascii() and cell.isdigit() and len(cell) < 20 for cell in cells[:2]):
                yield Mark(int(cells[0]), int(cells[1]), cells[2])


# What was decided at the table while bytes came: an event in ``raw.times`` each, so that a replay decides the same at the same byte.
#
# ``begin STEM``: samples from here on go to a new ``STEM*.csv``.  ``pause``: they go to no log.  ``keep STEM``: the file that was begun
# last is whole, and bears this name; behind it they go to no log.  ``drop T_US``: the turn that moved at this device time does not count.
# ``note TEXT``.


@dataclass(frozen=True)
class RecordingDecision:
    """word: begin, pause, keep, drop or note; rest: STEM, T_US, TEXT, or nothing; log: the one that was growing, in a replay."""

    word: str
    rest: str = ""
    log: str = ""

    @property
    def text(self) -> str:
        """As raw.times holds it."""
        return f"{self.word} {self.rest}".rstrip()


def decision_of(mark: Mark) -> RecordingDecision | None:
    """The decision that a mark tells of; None for any other, and for one that makes no sense."""
    word, _, rest = mark.event.partition(" ")
    right = {
        "begin": rest.isidentifier(),
        "keep": rest.isidentifier(),
        "drop": rest.isascii() and rest.isdigit(),
        "pause": True,
        "note": True,
    }
    return RecordingDecision(word, rest) if right.get(word, False) else None


def name_kept(marks: Sequence[Mark], begun: int) -> str | None:
    """The stem under which the file that marks[begun] begins was kept in the end; None where it was not."""
    for mark in marks[begun + 1 :]:
        decision = decision_of(mark)
        if decision is not None and decision.word == "keep":
            return decision.rest
        if mark.event.startswith("open") or (decision is not None and decision.word in ("begin", "pause")):
            return None
    return None


# A log that only grows: what it holds already is never written again.
#
# After Ctrl-C or a crash the logs are made again from the raw bytes, and somebody may have fitted them meanwhile.  So what is there is
# compared with what would be written, and only what lies behind it is added; a log that somebody has changed is kept under another name.

ASIDE = ".changed"


class GrowingFile:
    """Write to it as to a new file, or behind what it holds.  aside: where a file went whose beginning was another one, or None.
    Raises OSError."""

    def __init__(self, path: Path, behind: bool = False):
        self.path = path
        self.aside: Path | None = None
        self._same = 0  # bytes of the old file that were found again
        if path.is_fifo():  # opening it would wait for its reader
            raise FileExistsError(errno.EEXIST, f"{path.name} is a named pipe", str(path))
        self._left = path.stat().st_size if path.is_file() else 0
        self._file = path.open("r+b" if self._left else "wb")
        if behind:
            self._left, self._same = 0, self._file.seek(0, os.SEEK_END)

    def write(self, text: str) -> None:
        """Add text, or find it there already."""
        data = text.encode()
        if self._left:
            there = self._file.read(min(len(data), self._left))
            if there != data[: len(there)]:
                self._put_aside()
            else:
                self._same, self._left, data = self._same + len(there), self._left - len(there), data[len(there) :]
        if data:
            self._file.write(data)

    def flush(self) -> None:
        """Hand what is buffered to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """End it."""
        self._file.close()

    def _put_aside(self) -> None:
        """Go on in a new file that begins as far as the old one did right."""
        self._file.seek(0)
        right, self._left = self._file.read(self._same), 0
        self._file.close()
        self.aside = put_aside(self.path)
        self._file = self.path.open("xb")
        self._file.write(right)


def put_aside(path: Path) -> Path | None:
    """Give a file that is in the way another name, and return it; None where there is none.  Raises OSError."""
    if not path.exists():
        return None
    number = 1
    while (aside := path.with_name(f"{path.name}{ASIDE}{number}")).exists():
        number += 1
    return path.rename(aside)
