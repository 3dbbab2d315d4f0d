"""The n-th call to the system fails, or is the process's last: what then stands in a folder (as SQLite tests itself).

Python's own ``_pyio`` stands for the files that C opens, so that each of their calls is one of ``os``, which can be counted and refused.
"""

from __future__ import annotations

import _pyio
import builtins
import contextlib
import errno
import gc
import gzip
import io
import os
import shutil
import sys
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError, StorageError

CALLS = (
    *("open", "read", "write", "fsync", "close", "lseek", "truncate", "ftruncate", "stat", "lstat", "listdir", "scandir"),
    *("replace", "rename", "unlink", "mkdir", "rmdir", "readlink"),
)
KILLED = "killed"
FAULTS = ("ENOSPC", "EIO", "EINTR", KILLED)
#: a random name of a file that is not whole yet, and a folder that is not
PARTIAL, UNFINISHED, OLD = ".tinygc-", ".unfinished", ".old"


class Killed(BaseException):
    """The process has ended: no call of it reaches the system any more."""


class Calls:
    """A context in which the n-th call fails; without n, they are counted."""

    def __init__(self, number=None, fault="EIO"):
        self.number, self.fault, self.count, self.dead = number, fault, 0, False
        self.names: list[str] = []

    def __enter__(self):
        gc.disable()  # what other tests have left would be closed here, and counted
        gc.freeze()
        self._before = {name: getattr(os, name) for name in CALLS} | {"": (builtins.open, io.open)}
        for name in CALLS:
            setattr(os, name, self._counted(name, self._before[name]))
        builtins.open = io.open = _pyio.open  # type: ignore[assignment]
        self._told = told = sys.unraisablehook
        # Since Python 3.13 a file says why its last close failed; a killed process says nothing, and to say it is a call, too
        sys.unraisablehook = lambda what: None if self.dead else told(what)
        return self

    def __exit__(self, *error):
        if self.dead:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                gc.collect()  # buffers that were never written die with the process
        gc.unfreeze()
        sys.unraisablehook = self._told
        builtins.open, io.open = self._before.pop("")
        for name, call in self._before.items():
            setattr(os, name, call)
        gc.enable()

    def _counted(self, name, call):
        def counted(*args, **options):
            if self.dead:
                raise Killed
            self.count += 1
            self.names.append(name)
            if self.count != self.number:
                return call(*args, **options)
            if name == "close":
                call(*args)
            if self.fault == KILLED:
                self.dead = True
                raise Killed
            number = getattr(errno, self.fault)
            raise OSError(number, os.strerror(number), *(args[:1] if args and isinstance(args[0], str | os.PathLike) else ()))

        return counted


@dataclass(frozen=True)
class Writer:
    """before: makes what stands there; write: writes over it or beside it; folder: that is a session folder; grows: files only grow."""

    write: Callable[[Path], object]
    before: Callable[[Path], object] = lambda folder: None
    folder: bool = False
    grows: bool = False


def contents(folder):
    """What each file holds, unpacked; folders as empty.  What the next run takes away is left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.name == UNFINISHED and not any(path.iterdir()):
            continue
        data = path.read_bytes() if path.is_file() else b""
        if path.suffix == ".gz":
            with contextlib.suppress(OSError, EOFError, zlib.error):
                data = gzip.decompress(data)
        found[path.relative_to(folder).as_posix()] = data
    return found


def tried(writer, place, fault, every=lambda number: True):
    """How many calls were made to fail, and what was wrong then."""
    place.mkdir()

    def fresh(name):
        folder = place / name
        folder.mkdir()
        writer.before(folder)
        return folder

    writer.write(fresh("warm"))
    counted = fresh("whole")
    before = contents(counted)
    with Calls() as calls:
        writer.write(counted)
    after, wrong, count = contents(counted), [], 0
    assert after != before, "nothing was written"
    for number in range(1, calls.count + 1):
        if not every(number):
            continue
        folder, said = fresh(f"{number}"), ""
        try:
            with Calls(number, fault) as failing:
                writer.write(folder)
        except Killed:
            said = KILLED
        except (CalibrationError, OSError) as error:
            said = str(error)
        count += 1
        where = f"{fault} in call {number} ({failing.names[number - 1] if failing.count >= number else 'none'})"
        wrong += [f"{where}: {each}" for each in _wrong(writer, contents(folder), before, after, said)]
        shutil.rmtree(folder)
    shutil.rmtree(place)
    return count, wrong


def _wrong(writer, there, before, after, said):
    wrong = ["more than a line"] if "\n" in said else []
    if not said and there != after:
        wrong.append("no error, and not what was to be written")
    mine = {name: data for name, data in there.items() if not Path(name).name.startswith(PARTIAL)}
    if said != KILLED and mine != there:
        wrong.append("a partial file is left")
    if writer.grows:
        for name, data in before.items():
            if not any(data == each[: len(data)] for each in mine.values()):
                wrong.append(f"{name} has lost what it held")
        wrong += [
            f"{name} holds what nobody wrote" for name, data in mine.items() if not any(each.startswith(data) for each in after.values())
        ]
    elif writer.folder:
        if mine not in (before, after):
            outside = {name: data for name, data in mine.items() if UNFINISHED not in Path(name).parts}
            if said != KILLED:
                wrong.append(f"an error left {sorted(set(mine) ^ set(before))}")
            elif outside != after:
                kept = [outside.get(name) == data for name, data in before.items()]
                torn = [name for name in outside if name.endswith("session.toml") and _lacks(outside, after, Path(name).parent)]
                if any(not all(kept) or name not in before for name in torn):
                    wrong.append("a session that is not whole")
                moved = [mine.get(str(Path(name).parent / UNFINISHED / OLD / Path(name).name)) for name in before]
                if not all(each or there == data for each, there, data in zip(kept, moved, before.values(), strict=True)):
                    wrong.append("what stood there before is lost")
    else:
        for name, data in (before | after | mine).items():
            if mine.get(name) not in (before.get(name), after.get(name)):
                wrong.append(f"{name} is neither old nor new ({len(data)} bytes)")
    return wrong


def _lacks(there, after, folder):
    """Whether a session's folder lacks what was to be written there; of an array each unit is a session."""
    return any(there.get(name) != data for name, data in after.items() if Path(name).is_relative_to(folder))


def hold_whole(writer, name, tmp_path):
    """Whichever call fails, what stands there is whole, the old or the new; and nothing goes through a link."""
    for fault in ("ENOSPC", KILLED):
        (tmp_path / fault).mkdir()
        count, wrong = tried(writer, tmp_path / fault / "w", fault, lambda number: True)
        assert (wrong, count > 3) == ([], True)
    (tmp_path / "w").mkdir()
    writer.before(tmp_path / "w")
    path, victim = tmp_path / "w" / name, tmp_path / "victim"
    victim.write_bytes(path.read_bytes() if path.exists() else b"")
    path.unlink(missing_ok=True)
    path.symlink_to(victim)
    before = contents(tmp_path)
    said = ""
    try:
        writer.write(tmp_path / "w")
    except StorageError as error:
        said = str(error)
    assert f"{path.name}: is a link to" in said
    assert "remove it" in said
    assert contents(tmp_path) == before
