"""Results of a command: print them, write JSON, stop on a signal, continue with the next folder."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import select
import shutil
import signal
import sys
import tempfile
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.files import is_stream, refuse_link
from session.base.names import refuse_recorded
from session.base.options import declared
from session.base.texts import printable
from tinygc.cli.arguments import is_standard_output

if TYPE_CHECKING:
    from tinygc.reporting.terminal import PlainConsole, RenderableType


# Signals that end a command: Ctrl-C, SIGTERM, and SIGHUP of a closed terminal.  A recording ends between two steps of its loop, not
# within one.
#
# A SIGHUP that was ignored from the start stays ignored, as ``nohup`` requires.  A SIGINT that was ignored, as by a shell that started the
# program in the background, still ends a command that runs at a port.

HANG_UP: signal.Signals | None = getattr(signal, "SIGHUP", None)  # Windows has none
PATIENCE = 3  #: this many signals end the command at once


class Interruption:
    """A context that records signals; calling it returns whether one has requested the end."""

    def __init__(self) -> None:
        self._requests = 0
        self._handled = contextlib.ExitStack()

    def __call__(self) -> bool:
        """Whether the end was requested."""
        return self._requests > 0

    def __enter__(self) -> Interruption:
        self._handled.enter_context(_handled(self._ask, signal.SIGINT))
        return self

    def __exit__(self, *error: object) -> None:
        self._handled.close()

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self._requests += 1
        if number == HANG_UP:
            _let_go()
        if self._requests >= PATIENCE:
            raise KeyboardInterrupt


def ended_by_signals(ignored_interrupt: bool = False) -> contextlib.AbstractContextManager[None]:
    """Return a context in which SIGTERM and SIGHUP act like Ctrl-C, and on request SIGINT too where it was ignored."""
    return _handled(_end, *([signal.SIGINT] if ignored_interrupt else []))


def _end(number: int, frame: FrameType | None) -> None:
    if number == HANG_UP:
        _let_go()
    raise KeyboardInterrupt


@contextlib.contextmanager
def _handled(handler: Callable[[int, FrameType | None], Any], *more: signal.Signals) -> Iterator[None]:
    before: dict[signal.Signals, Any] = {}  # previous handler of a signal: a function, or the system's own number
    with contextlib.suppress(ValueError):  # outside the main thread no signal arrives
        for number in (*more, signal.SIGTERM, *([HANG_UP] if HANG_UP is not None else [])):
            if number != HANG_UP or signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, signal.SIG_DFL if earlier is None else earlier)


def _let_go() -> None:
    """Redirect the output for a closed terminal to the null device, so that the last lines cannot fail."""
    for file in (1, 2):
        with contextlib.suppress(OSError, AttributeError):
            poll = select.poll()
            poll.register(file, 0)
            if any(events & (select.POLLHUP | select.POLLERR) for _, events in poll.poll(0)):
                silence(file)


def silence(file: int) -> None:
    """Let what is written there from now on go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, file)
    os.close(nowhere)


# Results of every command: print them, write them as JSON, fail early if outputs cannot be written.


def output(args: Any) -> PlainConsole:
    """Return standard output for text; silent when quiet, and where the JSON uses standard output."""
    from tinygc.reporting import terminal

    return terminal.output(args.quiet or is_standard_output(args.json))


def print_commands(args: Any, introduction: str, *commands: str) -> None:
    """Print commands for the user to run, each alone on its line."""
    output(args).print(introduction)
    for command in commands:
        output(args).print(f"  {command}", soft_wrap=True)


def print_with_log(args: Any, lines: list[str], to_stdout: bool) -> None:
    """Print lines about a log that was written: on standard error where the log itself goes to standard output."""
    for line in lines:
        if not to_stdout:
            output(args).print(line)
        elif not args.quiet:
            print(printable(line), file=sys.stderr)


def verdict(args: Any, line: RenderableType) -> None:
    """Print the one-line result of a command with ``--quiet``; otherwise it is already in the output.  For several folders a table
    contains it."""
    from tinygc.reporting import terminal

    if args.quiet and not is_standard_output(args.json) and not args.of_several:
        terminal.output().print(line)


def complain(line: str) -> None:
    """Print one line on standard error, whatever file or folder it quotes; on a terminal it wraps between words."""
    text = f"calibrate: {printable(line)}"
    if sys.stderr.isatty():
        text = textwrap.fill(text, shutil.get_terminal_size().columns, break_long_words=False, break_on_hyphens=False)
    print(text, file=sys.stderr)


def state_changes(args: Any) -> None:
    """State on standard error what a person left out or changed of each session that a command was given; nothing when quiet."""
    from session.log.config import by_hand_words, read_config

    given = [getattr(args, each.name) for each, rule in declared(args) if rule.positional]
    for path in (path for value in given for path in (value if isinstance(value, tuple) else (value,)) if isinstance(path, Path)):
        if (path / "session.toml").is_file() and not args.quiet:
            with contextlib.suppress(CalibrationError):
                config = read_config(path / "session.toml")
                if words := by_hand_words([*config.exclude, *config.still]):
                    print(printable(f"{path.name}: {words}"), file=sys.stderr)


def inside(folder: Path, name: str) -> Path | None:
    """Return the place of results in a session folder; None where there is no folder, which the reading of the session reports."""
    return folder / name if folder.is_dir() else None


def try_destinations(folder: Path | None, json: Path | None) -> None:
    """Fail early if outputs cannot be written: create the folder, write a file, and remove both; None: only the JSON."""
    if folder is None:
        try_json(json)
    else:
        _try_folder(folder, folder, json, "another folder")


def try_file(path: Path, json: Path | None) -> None:
    """Fail early if a single output file, and the JSON, cannot be written."""
    if path.is_dir():
        raise CalibrationError(f"{path}: that is a folder; give --out a file")
    refuse_link(path)
    refuse_recorded(Path(os.path.realpath(path)))
    _try_folder(path, path.parent, json, "another file")


def _try_folder(named: Path, folder: Path, json: Path | None, instead: str) -> None:
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        try_json(json)
    except OSError as error:
        raise CalibrationError(f"{named}: {error.strerror or error}; give --out {instead}") from None
    finally:
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()


def write_json(path: Path | None, table: Any) -> None:
    """Write the JSON where ``--json`` names: nowhere, standard output (-), or a file."""
    if path is None:
        return
    from session.base.records import json_text, write_whole

    if is_standard_output(path):
        every = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
        with standard_output():
            sys.stdout.write(json_text(table, ascii_only=not every) + "\n")
        return
    try:
        write_whole(path, table)
    except OSError as error:
        raise _no_json(path, error) from None


def keep(args: Any, found: Any, folder: Path | None, *names: str) -> None:
    """Save a result with its pictures into a folder, or print that nothing is written; then its JSON.  names: of what it saves."""
    if folder is not None:
        found.save(folder, pictures=args.pictures)
        written = [str(folder / name) for name in names if (folder / name).exists() and (args.pictures or not name.endswith(".svg"))]
        output(args).print(f"written: {', '.join(written)}")
    elif args.json is None:
        output(args).print(f"nothing is written; --out DIR keeps {', '.join(names[:-1])} and {names[-1]}")
    write_json(args.json, found.to_json())


def try_json(path: Path | None) -> None:
    """Fail early if the JSON cannot be written where ``--json`` names."""
    if path is None or is_standard_output(path) or is_stream(path):  # the system's is not opened twice
        return
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise _no_json(path, error) from None


def _no_json(path: Path, error: OSError) -> CalibrationError:
    return CalibrationError(f"{path}: cannot be written ({error.strerror}); give --json another path")


@contextlib.contextmanager
def standard_output() -> Iterator[None]:
    """Add the stream's name to a failed write, since errors of streams lack it."""
    try:
        yield
    except OSError as error:
        error.filename = "standard output"
        raise


# Several session folders for one command: each is processed separately, and a failure does not stop the others.


@dataclass(frozen=True)
class Done:
    """code: exit code; table: the command's JSON; words: its result in a few; held_out, floor, runs: figures of the calibration in
    degrees, None and none where there is no such figure."""

    code: int
    table: dict
    words: str = ""
    held_out_deg: float | None = None
    floor_deg: float | None = None
    runs_deg: tuple[float, ...] = ()


def run_each(args: Any, one: Callable[[Any], Done], schema: str, what: str, last: Callable[[list[Path]], str]) -> int:
    """Run ``one`` for each folder, with ``--out DIR`` as DIR/NAME; the exit code is the worst of them.

    The answers of all come first; what each prints follows with ``--verbose`` alone.  what: was done; last: the last line, of the folders
    that did not fail.  Raises CalibrationError, before any work, where two results would have the same path.
    """
    from tinygc.reporting import terminal
    from tinygc.reporting.tables import degrees_text, outcomes_table

    folders, entries, rows, screens, worst = list(dict.fromkeys([args.folder, *args.more])), [], [], [], 0
    places = _places(args, folders)
    for folder in folders:
        screen = io.StringIO()
        try:
            with contextlib.redirect_stdout(screen):
                done = one(replace(args, folder=folder, more=(), out=places.get(folder), of_several=True))
        except (CalibrationError, OSError) as error:
            label = str(error) if isinstance(error, CalibrationError) else f"{error.filename or folder}: {error.strerror or error}"
            code = error.exit_code if isinstance(error, CalibrationError) else 2
            complain(label if str(folder) in label else f"{folder}: {label}")
            entries.append({"folder": str(folder), "exit_code": code, "error": printable(label), "result": None})
            rows.append((str(folder), "–", "–", "–", "FAILED"))
        else:
            code = done.code
            entries.append({"folder": str(folder), "exit_code": code, "error": None, "result": done.table})
            runs = ", ".join(f"{run:.4f}" for run in done.runs_deg)
            rows.append((str(folder), degrees_text(done.held_out_deg), degrees_text(done.floor_deg), runs or "–", done.words))
            screens.append(f"\n{folder}\n{screen.getvalue()}")
        worst = max(worst, code)
    finished = [folder for folder, entry in zip(folders, entries, strict=True) if entry["error"] is None]
    counted = ", ".join(f"{count} {words}" for words, count in Counter(words for *_, words in rows).items())
    console = terminal.output(is_standard_output(args.json))
    console.print(f"{len(finished)} of {len(folders)} {what}: {counted}")  # also with --quiet
    console.print(outcomes_table(rows))
    if finished:
        output(args).print(terminal.one_line(last(finished)))
    if getattr(args, "verbose", False):
        output(args).print(terminal.Text("".join(screens).rstrip()))
    write_json(args.json, {"schema": schema, "sessions": entries})
    return worst


def _places(args: Any, folders: list[Path]) -> dict[Path, Path]:
    if args.out is None:
        return {}
    places = {folder: args.out / folder.resolve().name for folder in folders}
    taken: dict[Path, Path] = {}
    for folder, place in places.items():
        if place in taken:
            raise CalibrationError(f"--out {args.out}: {taken[place]} and {folder} would both go to {place}; rename one, or run them apart")
        taken[place] = folder
    return places
