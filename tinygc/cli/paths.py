"""Paths as arguments: each says whether it is read or written, and what is written never takes the place of what is read or recorded.

``type=path_read``, ``file_written`` or ``folder_written`` is all that a command says.  ``refuse_overwriting`` then holds every output
against every input, and against the files of every session, before the command begins.
"""

from __future__ import annotations

import argparse
import itertools
import os
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from session.common.errors import CalibrationError
from session.files.recorded import has_recorded_name, is_session

#: stands for standard input or output
STANDARD = "-"
#: names that the system has for standard output
STANDARD_OUTPUT = (STANDARD, "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")
#: in a folder that is read: what is not recorded, and what other commands read all the same
DERIVED = ("fit/*.json", "explain/explain.json", "*.py")
#: of a command: the one of these that it writes itself, in the same words as its JSON
OWN = {"fit": "fit.json", "explain": "explain.json"}


def path_read(text: str) -> Path:
    """Argument type: a file or folder that the command reads."""
    return _path(text)


def file_written(text: str) -> Path:
    """Argument type: a file that the command writes."""
    return _path(text)


def log_written(text: str) -> Path:
    """Argument type: a log that the command writes; a new one may lie in a session folder."""
    return _path(text)


def folder_written(text: str) -> Path:
    """Argument type: a folder that the command writes files into."""
    return _path(text)


def is_standard_output(path: Path | None) -> bool:
    """Whether that is where the page for people goes, too."""
    return str(path) in STANDARD_OUTPUT


def _path(text: str) -> Path:
    """A file or folder.  An empty one would be the folder that one happens to stand in: a variable of the shell that was never set."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty name; give a file or folder (. for this one)")
    return Path(text)


for kind in (path_read, file_written, log_written, folder_written):
    kind.__name__ = "path"  # argparse says "invalid path value"


@dataclass(frozen=True)
class Paths:
    """Of a command: its name, and the destinations of its arguments that hold outputs, with the option as a person writes it."""

    command: str
    files: dict[str, str]
    logs: dict[str, str]
    folders: dict[str, str]

    @classmethod
    def of(cls, command: argparse.ArgumentParser) -> Paths:
        """Those of a command's parser."""
        of_kind = {
            kind: {action.dest: (action.option_strings or [action.dest])[-1] for action in command._actions if action.type is kind}
            for kind in (file_written, log_written, folder_written)
        }
        return cls(command.prog.split()[-1], of_kind[file_written], of_kind[log_written], of_kind[folder_written])


def refuse_overwriting(args: argparse.Namespace) -> None:
    """CalibrationError where an output is an input, a recording's own file, or another output; nothing has been changed by then.

    A path counts as what it leads to: through links of either kind, ``..``, ``/dev/fd`` and another case of its letters.
    """
    paths: Paths = args.paths
    for option, path in _given(args, paths.folders):
        if path.exists() and not path.is_dir():
            raise CalibrationError(f"{option} {path}: that is no folder; give {option} a folder, which is made where it is not there")
    written = [(option, path) for option, path in _given(args, {**paths.files, **paths.logs}) if str(path) != STANDARD]
    folders = [path for _, path in _given(args, paths.folders) if str(path) != STANDARD]
    read = list(_read(args, {*paths.files, *paths.logs, *paths.folders}))
    known = _files_of([*read, *folders], OWN.get(paths.command, ""))
    homes = {Path(os.path.realpath(folder)) for folder in folders} | {Path(os.path.realpath(path)) for path in read if path.is_dir()}
    for option, path in written:
        if path.is_dir():
            raise CalibrationError(f"{option} {path}: cannot be written (that is a folder); give {option} a file")
        _refuse_known(f"{option} {path}", _status(path), known)
        for place in (_entry(path), Path(os.path.realpath(path))):
            there = os.path.lexists(place)
            counts = there or option not in paths.logs.values()
            if counts and has_recorded_name(place) and (place.parent in homes or is_session(place.parent)):
                what = "is a file of the recording in" if there else "has the name of a recording's file in"
                raise CalibrationError(f"{option} {path}: {what} {place.parent}, where nothing is written over; give {option} another path")
    for stream, said in ((1, "standard output"), (2, "standard error")):
        _refuse_known(said, _status(stream), known)
    for (one, first), (other, second) in itertools.combinations(written, 2):
        if os.path.realpath(first) == os.path.realpath(second) or _identity(_status(first)) == (_identity(_status(second)) or 0):
            raise CalibrationError(f"{one} and {other} are both {second}; give one of them another path")


def _given(args: argparse.Namespace, options: dict[str, str]) -> Iterator[tuple[str, Path]]:
    for dest, option in options.items():
        if (path := getattr(args, dest)) is not None:
            yield option, path


def _read(args: argparse.Namespace, written: set[str]) -> Iterator[Path]:
    """Whatever of the other arguments is there as a file or folder; a name of a model may be a file, too."""
    for dest, value in vars(args).items():
        for each in value if isinstance(value, (list, tuple)) else [value]:
            if dest not in written and isinstance(each, (str, Path)) and str(each) not in ("", STANDARD):
                path = Path(each)
                if _status(path) is not None:
                    yield path


def _files_of(paths: Iterable[Path], but: str) -> dict[tuple[int, int], Path]:
    """The files that must stay as they are, by what a file system knows them by: those paths, and of folders what is read there."""
    known: dict[tuple[int, int], Path] = {}
    for path in paths:
        inside: Iterable[Path] = [path]
        if path.is_dir():
            derived = (found for pattern in DERIVED for found in path.glob(pattern) if found.name != but)
            inside = itertools.chain((each for each in path.iterdir() if has_recorded_name(each)), derived)
        for each in inside:
            if (identity := _identity(_status(each))) is not None:
                known.setdefault(identity, each)
    return known


def _refuse_known(said: str, status: os.stat_result | None, known: dict[tuple[int, int], Path]) -> None:
    if (source := known.get(_identity(status) or (0, 0))) is not None:
        also = "" if said.endswith(f" {source}") else f" {source}"
        what = f"is{also or ' a file'} that this command reads, or that was recorded"
        raise CalibrationError(f"{said}: {what}; give another path")


def _status(path: Path | int) -> os.stat_result | None:
    try:
        return os.stat(path)
    except (OSError, ValueError):
        return None


def _identity(status: os.stat_result | None) -> tuple[int, int] | None:
    """Of a regular file; devices, pipes and terminals may be read and written at once."""
    return None if status is None or not stat.S_ISREG(status.st_mode) else (status.st_dev, status.st_ino)


def _entry(path: Path) -> Path:
    """The path with its folder's links followed, and not its own."""
    return Path(os.path.realpath(path.parent)) / path.name
