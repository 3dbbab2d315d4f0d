"""``view``: a page to look at a recording, and to leave out or change turns and stills by hand."""

from __future__ import annotations

import os
import queue
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from json import dumps, loads
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.options import argument, file_written, option
from session.base.texts import printable
from tinygc.cli.logs import of_session
from tinygc.cli.options import Command
from tinygc.cli.recording import while_seen
from tinygc.cli.results import Interruption, output, try_file

if TYPE_CHECKING:
    from session.bench.page.server import PageServer
    from session.log.config import ByHand
    from tinygc.reporting.view.content import Closure, Recording


@dataclass(frozen=True)
class Options(Command):
    """Options of ``view``."""

    folder: Path = argument("session folder")
    json: Path | None = option(None, "no result but the page", cli=False)
    out: Path | None = option(None, "write one HTML file that only shows, and open no page", metavar="FILE.html", read=file_written)


def run(args: Options) -> int:
    """Serve the page while it is looked at, or write it."""
    from session.log.folder import read_session
    from tinygc.reporting.view.content import Recording

    args, _ = of_session(args)
    if args.out is not None:
        return _write(args, args.out)
    from session.bench.page.server import PageServer
    from tinygc.reporting.view.page import FOLDER

    session = read_session(args.folder)
    recording = Recording(session)
    recording.parts  # noqa: B018  # what cannot be shown ends the command here
    server = PageServer(folder=FOLDER)
    viewer = Viewer(recording, server)
    with Interruption() as wanted:
        server.start()
        output(args).print(f"look at the recording: {server.address}", soft_wrap=True)
        _open(server.address)
        viewer.start()
        for _ in while_seen(server, wanted):
            pass
    server.close()
    return 0


def _open(address: str) -> None:
    """Open a browser with windows, where there is one: not one that takes the terminal."""
    if sys.stdout.isatty() and (sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        import webbrowser

        webbrowser.open(address)


def _write(args: Options, out: Path) -> int:
    from session.base.files import result_folder
    from session.base.results import write_text_whole
    from session.log.folder import read_session
    from tinygc.reporting.terminal import progress_bar
    from tinygc.reporting.view.content import Recording, fitted, logs_of
    from tinygc.reporting.view.curves import Curves
    from tinygc.reporting.view.page import whole_page

    try_file(out, None)
    recording = Recording(read_session(args.folder))
    with progress_bar(args.quiet) as progress:
        closure, why = fitted(recording, progress)
    content, curves = recording.content(closure, why=why), Curves(logs_of(recording.session))
    with result_folder(out.parent):
        write_text_whole(out, whole_page(content, curves.between(0.0, content["length_s"])))
    output(args).print(f"written: {out}", soft_wrap=True)
    return 0


class Viewer:
    """What the page shows and asks for: it keeps changes in ``session.toml``, and fits in a thread of its own."""

    def __init__(self, recording: Recording, server: PageServer):
        from tinygc.reporting.view.content import logs_of
        from tinygc.reporting.view.curves import Curves

        self.recording, self._server = recording, server
        self.toml = recording.session.folder / "session.toml"
        self._curves = Curves(logs_of(recording.session))
        self._closure: Closure | None = None
        self._before: Closure | None = None
        self._why, self._stale, self._version, self._doing, self._refused = "", False, 0, "", ""
        self._changing = threading.Lock()
        self._fits: queue.Queue[Recording] = queue.Queue()
        server.heard, server.answer_of = self.hear, self.answer

    def start(self) -> None:
        """Show the recording, and fit it."""
        threading.Thread(target=self._work, name="fit", daemon=True).start()
        self._changed()
        self._refit()

    def answer(self, name: str) -> bytes | None:
        """The JSON of this name: ``content``, ``curves`` of all, ``curves/FROM/TO/COUNT``; None of any other."""
        kind, *numbers = name.split("/")
        if kind == "content" and not numbers:
            with self._changing:
                found: Any = self.recording.content(self._closure, self._before, self._stale, self._why)
        elif kind == "curves" and len(numbers) in (0, 3):
            try:
                from_s, to_s, count = map(float, numbers or (0.0, self._curves.began_s[-1], 4000))
                if not from_s < to_s:
                    return None
                found = self._curves.between(from_s, to_s, min(max(int(count), 2), 20_000))
            except (ValueError, OverflowError):
                return None
        else:
            return None
        return dumps(found, allow_nan=False).encode()

    def hear(self, body: bytes) -> HTTPStatus:
        """Do what the page asks for."""
        from session.base.files import replaced
        from session.log.folder import add_by_hand, remove_by_hand

        try:
            wish = loads(body)
            if wish["do"] == "refit":
                self._refit()
                return HTTPStatus.OK
            with self._changing:
                gone, row = self._rows(wish)
                kept = self.toml.read_bytes()
                try:
                    for each in gone:
                        remove_by_hand(self.toml, each)
                    if row is not None:
                        add_by_hand(self.toml, row)
                    recording = self.recording.again()
                    recording.parts  # noqa: B018  # a change that cannot be is refused here
                except CalibrationError:
                    if self.toml.read_bytes() != kept:  # whole or not at all: a full disk leaves the file as it is
                        with replaced(self.toml) as file:
                            file.write(kept)
                    raise
                self.recording, self._stale, self._refused = recording, True, ""
        except (CalibrationError, OSError) as error:
            self._refused = printable(str(error).removeprefix(f"{self.toml}: "))
            self._publish()
            return HTTPStatus.CONFLICT
        except (ValueError, TypeError, ArithmeticError, LookupError, StopIteration, RecursionError):
            return HTTPStatus.BAD_REQUEST
        self._changed()
        return HTTPStatus.OK

    def _rows(self, wish: dict[str, Any]) -> tuple[Sequence[ByHand], ByHand | None]:
        """Rows of session.toml that a wish takes away, and the one that it adds."""
        recording, number = self.recording, int(wish["number"])
        if wish["kind"] == "segment" and recording.session.reference is not None:
            raise CalibrationError(f"{recording.session.reference.title}s cut these segments; leave one out with fit --exclude {number}")
        if wish["kind"] == "segment":
            segment = recording.segment(number)
            there = recording.rows_of_segment(segment)
            if wish["do"] == "take back":
                return there, None
            return [], None if there else recording.leave_out(segment)  # another window may have left it out
        before = recording.row_of_still(*recording.place(number))
        gone = [] if before is None else [before]
        if wish["do"] == "take back":
            return gone, None
        if wish["do"] == "leave out":
            return gone, recording.change(number, None)
        start_s, stop_s = map(float, wish["ends"])
        if not isfinite(start_s) or not isfinite(stop_s):
            raise ValueError(wish["ends"])
        return gone, recording.change(number, (start_s, stop_s))

    def _changed(self) -> None:
        self._version += 1
        self._publish()

    def _publish(self) -> None:
        self._server.publish("state", {"version": self._version, "doing": self._doing, "refused": self._refused})

    def _refit(self) -> None:
        if not self._doing:
            self._doing = "fitting"
            self._publish()
            self._fits.put(self.recording)

    def _work(self) -> None:
        from tinygc.reporting.view.content import fitted

        def progress(what: str, done: int, of: int) -> None:
            if self._doing != what:
                self._doing = what
                self._publish()

        while True:
            recording = self._fits.get()
            try:
                closure, why = fitted(recording, progress)
            except Exception as error:  # a defect ends this fit, and not the page
                closure, why = None, f"the program failed ({type(error).__name__}: {error}); take the last change back, and report this"
            with self._changing:
                self._before, self._closure, self._why = self._closure, closure, why
                self._stale, self._doing = recording is not self.recording, ""
            self._changed()
