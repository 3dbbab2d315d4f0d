"""Open, read and write files, within bounds and with one line for all that can be wrong."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from io import BufferedReader, BufferedWriter
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.budget import current
from session.base.errors import CalibrationError, FormatError, StorageError
from session.base.texts import printable

if TYPE_CHECKING:
    import numpy as np

# The one place where files are opened to be read: regular files only, and none that is larger than its kind can sensibly be.
#
# A named pipe would make us wait for whoever writes to it, a device may never end, and opening some of them does something (a serial port
# resets its board).  So a path is looked at before it is opened, is opened so that nothing waits, and what was opened is looked at again:
# between the two looks it may have become another.

KB, MB = 1 << 10, 1 << 20
#: session.toml: it holds some hundred bytes, and a line for every note and every turn that does not count
MOST_TOML = MB
#: a result as JSON.  The longest of ours has some hundred bytes for each segment; what Python makes of JSON takes up to 30 times its length
MOST_JSON = 16 * MB
#: texts of one archive; the largest known has 20 MB
MOST_ARCHIVE = 256 * MB
#: without these names of the system's nothing waits either (Windows)
NO_WAIT = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: how a shell names what it has opened for us: ``apply MODEL <(zcat LOG)``
DESCRIPTOR = re.compile(r"/dev/(?:fd/(\d{1,6})|(stdin))")
KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_file(path: Path) -> BufferedReader:
    """A regular file, opened for its bytes, at once.  FormatError states what it is instead, or why it cannot be read."""
    try:
        _require_file(path, os.stat(path))
        number = os.open(path, os.O_RDONLY | NO_WAIT)
        try:
            _require_file(path, os.fstat(number))
            return os.fdopen(number, "rb")
        except BaseException:
            os.close(number)
            raise
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        raise unreadable(path, error) from None


def require_file(path: Path) -> None:
    """What ``open_file`` would refuse is refused now, before others are opened that take time."""
    try:
        _require_file(path, os.stat(path))
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from None


def open_stream(path: Path) -> BufferedReader | None:
    """A stream that the caller has opened, ``-`` or a shell's ``/dev/fd/63``, where it is no regular file; else None.

    Reading from it may wait for its writer.
    """
    name = str(path)
    match = DESCRIPTOR.fullmatch(name)
    if name != "-" and match is None:
        return None
    number = int(match[1]) if match and match[1] else 0
    try:
        if name != "-" and stat.S_ISREG(os.fstat(number).st_mode):
            return None
        if stat.S_ISDIR(os.fstat(number).st_mode):
            raise IsADirectoryError(0, "it is a folder, expected a file")
        return os.fdopen(os.dup(number), "rb")
    except OSError as error:
        raise unreadable(path, error) from None


def read_bytes(path: Path, most: int) -> bytes:
    """All of a file.  FormatError for one that is larger than ``most`` bytes, before it is read."""
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            data = b"" if size > most else file.read(most + 1)  # some files of the system have a size of 0
        except OSError as error:
            raise unreadable(path, error) from None
        if size > most or len(data) > most:
            length = f"{size / MB:.1f} MB" if size > most else "its bytes do not end"
            raise FormatError(f"{path}: {length}, and no file of its kind has more than {most / MB:g} MB; is it the right one?")
        return data


def read_text(path: Path, most: int, mark: bool = False) -> str:
    """All of a text file in UTF-8, line ends as they are, a byte order mark only with ``mark``.

    FormatError as ``read_bytes``, and for what is no text.
    """
    try:
        return read_bytes(path, most).decode("utf-8" if mark else "utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{path}: not UTF-8 text; save it in UTF-8") from None


def unreadable(path: Path, error: OSError | ValueError) -> FormatError:
    """The complaint about what cannot be opened or read."""
    return FormatError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})")


def _require_file(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise FormatError(f"{path}: cannot be read (it is {KINDS.get(stat.S_IFMT(status.st_mode), 'no file')}, expected a file)")


# NumPy's archives of arrays (``.npz``), of the size that they state and no larger.

#: what NumPy and zipfile raise where an archive's bytes are damaged, whatever they meet first
FAULTS = (
    *(OSError, ValueError, KeyError, EOFError, SyntaxError, OverflowError, MemoryError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)


def read_npz(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Arrays of an archive by name.  FormatError where it is none, has not all of them, or unpacks to more than the budget."""
    with open_file(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                members = {f"{name}.npy": archive.getinfo(f"{name}.npy") for name in names}
                current().need(path, sum(member.file_size for member in members.values()))
                return {name: _array(archive, member) for name, member in zip(names, members.values(), strict=True)}
        except FAULTS:
            raise FormatError(f"{path}: not an archive of {', '.join(names)}, or a damaged one; download it again") from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """ValueError where its header states more than the member holds."""
    import numpy as np  # only where an archive is read

    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
        if read is None:
            raise ValueError(version)
        shape, _, dtype = read(file)
        if dtype.hasobject or int(np.prod(shape, dtype=object)) * dtype.itemsize > member.file_size:
            raise ValueError(shape)
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


# Writing: the one place where files are made.  No name leads a result elsewhere, and none is half there.
#
# A file is made under a random name next to its own, which it takes once it is on the disk.  So two runs at once do not meet, and an
# earlier one is whole until the new is.  A link is not written through: what it leads to is somebody's, and no name of ours.

FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
#: what a device, or a file system that cannot do it, answers to fsync
NOT_FORCED = (errno.EINVAL, errno.ENOTSUP, errno.EROFS)
OWN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: in a folder that is being made: what will be in it
UNFINISHED = ".unfinished"
#: in that one, while its files take their places: what stood there before
OLD = ".old"
#: the system's names for what is open; reading them begins nothing new
STREAM = re.compile(r"/dev/(fd/\d+|stdout|stderr)|/proc/(self|thread-self|\d+)/fd/\d+")


def is_stream(path: Path) -> bool:
    """Whether it is there and is a device, a pipe or a socket, or one of the system's names for what is open."""
    return STREAM.fullmatch(os.path.normpath(path)) is not None or (path.exists() and not path.is_file() and not path.is_dir())


def refuse_link(path: Path) -> None:
    """StorageError for a link, but for one to a device or a pipe."""
    if path.is_symlink() and not is_stream(path):
        raise StorageError(
            f"{path}: is a link to {os.readlink(path)}, and nothing is written through one; give the path it leads to, or remove it"
        )


def open_written(path: Path, flags: int) -> int:
    """Open a file that is written, ``os.O_WRONLY | os.O_APPEND`` and the like; StorageError for a link.

    A stream may be of a file that holds something: it is added to.
    """
    refuse_link(path)
    own = flags & ~os.O_TRUNC | os.O_APPEND if is_stream(path) else flags | getattr(os, "O_NOFOLLOW", 0)
    return os.open(path, own | OWN, 0o666)


def created(path: Path) -> BufferedWriter:
    """A new file, open for its bytes.  FileExistsError for what is there."""
    return os.fdopen(open_written(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb")


def write_new(path: Path, data: str | bytes) -> None:
    """A new file of bytes, or of text in UTF-8."""
    with created(path) as file:
        file.write(data.encode() if isinstance(data, str) else data)


def copy_new(source: Path, path: Path) -> None:
    """A new file of another one's bytes."""
    with open_file(source) as read, created(path) as file:
        shutil.copyfileobj(read, file)


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[BufferedWriter]:
    """A file to write to; it becomes ``path`` once the block ends well and its bytes are on the disk.

    It is ``path`` itself where that is a device or a pipe.  Raises StorageError, which names ``path``, for a full disk and for a link.
    """
    refuse_link(path)
    if is_stream(path):
        with naming(path), os.fdopen(open_written(path, os.O_WRONLY), "wb") as stream:
            yield stream
        return
    partial = path.with_name(f".tinygc-{secrets.token_hex(8)}.partial")
    try:
        with naming(path, partial):
            with created(partial) as file:
                yield file
                file.flush()
                _force(file.fileno())
            os.replace(partial, path)
            _force_folder(path.parent)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def _force(number: int) -> None:
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in NOT_FORCED:
            raise


def _force_folder(folder: Path) -> None:
    with contextlib.suppress(PermissionError, FileNotFoundError):  # Windows opens no folder; or somebody has removed it
        _force_path(folder, os.O_RDONLY | NO_WAIT)


def _force_path(path: Path, flags: int) -> None:
    number = os.open(path, flags)
    try:
        _force(number)
    finally:
        os.close(number)


@contextlib.contextmanager
def naming(path: Path, *aliases: Path) -> Iterator[None]:
    """Give a failure to write the name of the result, which it has not, or which it gives by an alias or by that of a file it copies.

    Raises StorageError for a full disk, else the OSError with that name.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise StorageError(f"{path}: {error.strerror}; free space there, or choose another folder") from None
        if error.filename is None or str(error.filename) in map(str, aliases):
            error.filename = str(path)
            del error.filename2  # None would be shown
        raise


@contextlib.contextmanager
def result_folder(folder: Path) -> Iterator[None]:
    """Make a folder for the block to write into; where it fails, take away again what was made here and is empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    for path in missing:
        refuse_link(path)
    try:
        with naming(folder):
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()
        raise


def refuse_unfinished(folder: Path) -> None:
    """FormatError where a run is making the folder, or did not end."""
    if os.path.lexists(folder / UNFINISHED):
        kept = f", and {UNFINISHED}/{OLD} holds what stood here before" if (folder / UNFINISHED / OLD).is_dir() else ""
        raise FormatError(
            f"{folder}: {UNFINISHED} in it is of a run that did not end, or still goes on{kept}; remove {UNFINISHED} and run again"
        )


def require_empty(folder: Path, do: str) -> None:
    """FormatError, which states what to do, where a folder that is to be made holds something already."""
    refuse_unfinished(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FormatError(f"{folder}: {do}")


@contextlib.contextmanager
def folder_whole(out: Path, stale: Iterable[str] = ()) -> Iterator[Path]:
    """A folder to write into, within ``out``; its files become ``out``'s once the block ends well, session.toml last.

    A process that is killed leaves nothing next to ``out``, and either no session in it or the whole.  stale: what goes then; until all
    is in its place, it and what is written over are kept in a folder of the unfinished one.  Errors name ``out``.
    """
    work, new = out / UNFINISHED, list[Path]()
    old = work / OLD
    with result_folder(out), naming(out, work):
        with contextlib.suppress(OSError):
            work.rmdir()  # one that is empty
        try:
            work.mkdir()
        except FileExistsError:
            refuse_unfinished(out)
            raise
        try:
            yield work
            for path in work.rglob("*"):
                if path.is_file():
                    _force_path(path, os.O_WRONLY | OWN)  # Windows forces nothing that is open to be read
            made = sorted(work.iterdir(), key=lambda path: (path.name == "session.toml", path.name))
            for path in made:
                refuse_link(out / path.name)
            old.mkdir()
            new = made
            # what is written over last is whole at any time
            for name in sorted({*stale, *(path.name for path in made[:-1])}, key=lambda name: (name != "session.toml", name)):
                if os.path.lexists(out / name):
                    os.replace(out / name, old / name)
            for path in made:
                os.replace(path, out / path.name)
        except BaseException as error:
            if any(path.exists() for path in new):
                for path in new:
                    if not path.exists():
                        os.replace(out / path.name, path)
                for path in sorted(old.iterdir(), key=lambda path: path.name == "session.toml"):
                    os.replace(path, out / path.name)
            _removed(work)
            if isinstance(error, CalibrationError):
                error.args = tuple(str(each).replace(printable(str(work)), printable(str(out))) for each in error.args)
            elif isinstance(error, OSError) and error.filename:
                error.filename = str(error.filename).replace(str(work), str(out))
                del error.filename2
            raise
        _removed(work)
        _force_folder(out)


def _removed(folder: Path) -> None:
    for _ in range(2):  # once more where a call failed
        with contextlib.suppress(OSError):  # of closing a folder, which is not ignored
            shutil.rmtree(folder, ignore_errors=True)
