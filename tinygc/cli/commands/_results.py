"""What every command does with its results: print them, write them as JSON, refuse in time what cannot be written."""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from session.common.errors import CalibrationError
from session.common.texts import printable
from session.files.recorded import refuse_recorded
from session.files.results import is_stream, json_text, whole
from tinygc.cli.paths import is_standard_output

if TYPE_CHECKING:
    from rich.console import RenderableType

    from session.common.console import PlainConsole


def output(args: argparse.Namespace) -> PlainConsole:
    """Standard output for people; silent when quiet, and where the JSON has standard output to itself."""
    from tinygc.cli import console

    return console.output(args.quiet or is_standard_output(args.json))


def beside_log(args: argparse.Namespace, lines: list[str], to_stdout: bool) -> None:
    """What is said of a log that was written: on standard error where the log itself goes to standard output."""
    for line in lines:
        if not to_stdout:
            output(args).print(line, soft_wrap=True)
        elif not args.quiet:
            print(printable(line), file=sys.stderr)


def verdict(args: argparse.Namespace, line: RenderableType) -> None:
    """What a command was asked for, in a line: with ``--quiet`` it is all that is printed; without, it is on the page already,
    and of several folders a table says it."""
    from tinygc.cli import console

    if args.quiet and not is_standard_output(args.json) and not getattr(args, "of_several", False):
        console.output().print(line, soft_wrap=True)


def complain(line: str) -> None:
    """One line on standard error, whatever file or folder it quotes."""
    print(f"calibrate: {printable(line)}", file=sys.stderr)


def try_destinations(args: argparse.Namespace, default: str) -> None:
    """Refuse before the work, not after it, what cannot be written: make the folder, write there, and take both away again."""
    if args.out is None and not args.folder.is_dir():
        return  # the reading of the session has more to say
    _try_folder(args.out or args.folder / default, args, "another folder")


def try_file(args: argparse.Namespace, path: Path) -> None:
    """The same where the result is one file."""
    if args.out is None and not args.folder.is_dir():
        return
    if path.is_dir():
        raise CalibrationError(f"{path}: that is a folder; give --out a file")
    refuse_recorded(Path(os.path.realpath(path)))
    _try_folder(path.parent, args, "another file")


def _try_folder(folder: Path, args: argparse.Namespace, instead: str) -> None:
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        if args.json is not None and not is_standard_output(args.json):
            _try_json(args.json)
    except OSError as error:
        raise CalibrationError(f"{error.filename or folder}: {error.strerror or error}; give --out {instead}") from None
    finally:
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()


def write_json(path: Path | None, table: dict) -> None:
    """Where ``--json`` says: nowhere, standard output (-), or a file."""
    if path is None:
        return
    if is_standard_output(path):
        every = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
        with standard_output():
            sys.stdout.write(json_text(table, ascii_only=not every) + "\n")
        return
    text = json_text(table) + "\n"
    try:
        with contextlib.nullcontext(path) if _is_the_systems(path) else whole(_place(path)) as place:
            place.write_text(text, encoding="utf-8")
    except OSError as error:
        raise _no_json(path, error) from None


def _try_json(path: Path) -> None:
    if is_stream(path) or _is_the_systems(path):  # which is not opened twice
        return
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        tempfile.TemporaryFile(dir=_place(path).parent).close()
    except OSError as error:
        raise _no_json(path, error) from None


def _place(path: Path) -> Path:
    """Where a link leads, so that it stays one."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _is_the_systems(path: Path) -> bool:
    """Whether the name is one that the system shows, such as /dev/stdout: nothing can be put in its place."""
    name = Path(os.path.normpath(path))
    return name.is_relative_to("/dev/fd") or name.is_relative_to("/proc") or name == Path("/dev/stderr")


def _no_json(path: Path, error: OSError) -> CalibrationError:
    return CalibrationError(f"{path}: cannot be written ({error.strerror}); give --json another path")


@contextlib.contextmanager
def standard_output() -> Iterator[None]:
    """Give a failure to write its name, which a stream's errors lack."""
    try:
        yield
    except OSError as error:
        error.filename = "standard output"
        raise
