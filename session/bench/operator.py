"""The operator's input: keys, typed notes, commands from a browser; decisions are written down where a replay finds them."""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import select
import sys
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError, StorageError
from session.bench.events import Event
from session.bench.guide import BEGIN, REST, Guide
from session.bench.messages import GuideMessage, Kind, Stage
from session.bench.recorder import Recorder

if TYPE_CHECKING:
    from session.bench.session_file import SessionFile

try:
    import termios
except ImportError:  # Windows
    termios = None  # type: ignore[assignment]
if sys.platform == "win32":
    import msvcrt

#: what an arrow or a function key sends
SEQUENCE = re.compile(r"\x1b(\[[0-9;]*[A-Za-z~]|O[A-Za-z])")
READ_BYTES = 256


class Keyboard:
    """A context; call it for the characters typed since the last call, which are read without an echo.

    there: whether there are keys: not where standard input is no terminal, and not in the background, where the system stops a process
    that touches the terminal.  Ctrl-C keeps its meaning.
    """

    def __init__(self) -> None:
        self.there = False
        self._file = -1
        self._before: list[Any] | None = None
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def __enter__(self) -> Keyboard:
        try:
            self.there = sys.stdin is not None and sys.stdin.isatty() and (termios is not None or sys.platform == "win32")
            if self.there and termios is not None:
                self._file = sys.stdin.fileno()
                self._before = termios.tcgetattr(self._file)
                self._set_unbuffered()
        except (OSError, ValueError):  # closed, or no terminal after all
            self.there = False
        except Exception as error:
            if termios is None or not isinstance(error, termios.error):
                raise
            self.there = False
        return self

    def __exit__(self, *error: object) -> None:
        if termios is not None and self._before is not None and self._in_foreground():
            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def __call__(self) -> str:
        """The typed characters, without those of arrows and function keys."""
        if not self.there:
            return ""
        if sys.platform == "win32":
            typed = ""
            while msvcrt.kbhit():
                typed += msvcrt.getwch()
            return re.sub("[\x00\xe0].", "", typed)
        return self._typed() if self._in_foreground() else ""

    def _typed(self) -> str:
        assert termios is not None
        try:
            self._set_unbuffered()
            if not select.select([self._file], [], [], 0)[0]:
                return ""
            data = os.read(self._file, READ_BYTES)
        except (OSError, termios.error):
            data = b""
        if not data:  # the terminal is gone
            self.there = False
        return SEQUENCE.sub("", self._decoder.decode(data))

    def _set_unbuffered(self) -> None:
        """Read single characters without an echo; a shell may have reset this (Ctrl-Z, fg)."""
        assert termios is not None
        if not self._in_foreground():
            return
        mode = termios.tcgetattr(self._file)
        if mode[3] & (termios.ICANON | termios.ECHO):
            mode[3] &= ~(termios.ICANON | termios.ECHO)
            termios.tcsetattr(self._file, termios.TCSADRAIN, mode)

    def _in_foreground(self) -> bool:
        """Whether this process may read the terminal."""
        try:
            return os.tcgetpgrp(self._file) == os.getpgrp()
        except OSError:  # not its controlling terminal: reading it stops no process
            return True


ENTER, ESCAPE, ERASE = ("\r", "\n"), "\x1b", ("\x7f", "\b")
LONGEST_NOTE = 200


#: commands of the operator: by their keys, and those that a page may send without a text
KEYS = {"p": "pause", "d": "drop", "f": "finish", "s": "stop"}
NOTE_KEY, REPORT_WISH = "n", "report"
WORDS = ("pause", "drop", "here", "finish", REPORT_WISH)
#: a command with its text
Command = tuple[str, str]


class TypingLine:
    """Turns typed characters into commands.  note: the text that is being typed, or None."""

    def __init__(self) -> None:
        self.note: str | None = None

    def take(self, typed: str) -> list[Command]:
        """Take characters; returns commands in order, with the text of a note."""
        commands: list[Command] = []
        for sign in typed:
            if self.note is None:
                if sign.lower() == NOTE_KEY:
                    self.note = ""
                elif word := "here" if sign in ENTER else KEYS.get(sign.lower()):
                    commands.append((word, ""))
            elif sign in ENTER:
                if text := " ".join(self.note.split()):
                    commands.append(("note", text))
                self.note = None
            elif sign == ESCAPE:
                self.note = None
            elif sign in ERASE:
                self.note = self.note[:-1]
            elif sign.isprintable() and len(self.note) < LONGEST_NOTE:
                self.note += sign
        return commands

    def words(self, guide: Guide, machine: bool = False) -> str:
        """The last line of the screen.  machine: whether one turns the table."""
        if self.note is not None:
            return f"note: {self.note}_   (Enter keeps it, Esc does not)"
        last = "" if guide.begun == REST else "d drop the last turn   "
        if guide.closure is not None:
            last = "d the closure run again   Enter it is on its mark   "
        stop = "s stop the table   " if machine else ""
        return f"keys: {stop}p pause   {last}n note{'   f finish' if guide.enough else ''}"


MOST = 8  #: waiting browser commands; a recording takes them ten times a second, and refuses more


class BrowserCommands:
    """Commands from the page: those of the keys, and the report at the end.

    The threads of browsers fill it; the recording calls it for the commands since the last call.  A command that was answered with OK is
    returned.  report: set once the report was requested.
    """

    def __init__(self) -> None:
        self._waiting: list[Command] = []
        self._changing, self._taken = threading.Lock(), False
        self.report = threading.Event()

    def begin(self) -> None:
        """A recording takes commands from here on."""
        with self._changing:
            self._taken = True

    def end(self) -> None:
        """It takes no later ones."""
        with self._changing:
            self._taken = False

    def __call__(self) -> list[Command]:
        """The waiting commands, in order, each once."""
        with self._changing:
            taken, self._waiting = self._waiting, []
        return taken

    def hear(self, body: bytes) -> HTTPStatus:
        """Take ``pause``, ``drop``, ``here``, ``finish``, ``note TEXT`` or ``report``.

        BAD_REQUEST for anything else, SERVICE_UNAVAILABLE where no recording takes it.
        """
        try:
            word, _, text = body.decode().partition(" ")
        except UnicodeDecodeError:
            return HTTPStatus.BAD_REQUEST
        if word == "note":
            text = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())[:LONGEST_NOTE]
        if bool(text) != (word == "note") or word not in ("note", *WORDS):
            return HTTPStatus.BAD_REQUEST
        if word == REPORT_WISH:
            self.report.set()
            return HTTPStatus.OK
        with self._changing:
            if not self._taken or len(self._waiting) >= MOST:
                return HTTPStatus.SERVICE_UNAVAILABLE
            self._waiting.append((word, text))
        return HTTPStatus.OK


class OperatorInput:
    """Carries out the operator's commands, and writes down decisions.

    tell shows messages; notebook is the session.toml that takes notes and dropped turns; keys returns typed characters, None: there are
    no keys; page: the commands from a browser; stop: stops the machine that turns the table, None: there is none.
    """

    def __init__(
        self,
        guide: Guide,
        recorder: Recorder,
        tell: Callable[[list[GuideMessage]], None],
        notebook: SessionFile | None,
        keys: Callable[[], str] | None,
        page: BrowserCommands | None = None,
        stop: Callable[[], None] | None = None,
    ):
        self._stop = stop
        self._guide, self._recorder, self._tell, self._notebook, self._keys = guide, recorder, tell, notebook, keys
        self.page = page or BrowserCommands()
        self._typing = TypingLine()

    @property
    def after_pause(self) -> Event:
        """The decision that ends a pause: a log before the closure run, in the run no log until the table is on its mark."""
        return Event("begin", text=self._guide.stem) if self._guide.closure is None else BEGIN

    def decide(self, decision: Event) -> None:
        """Apply a decision to the files and the guide."""
        self._recorder.decide(decision)
        self._tell(self._guide.decided(decision))

    def was_decided(self, decision: Event) -> None:
        """Apply a decision of the resumed recording to the guide."""
        if decision.kind == "drop" and self._notebook:
            log = self._recorder.logs.paths[-1].name if self._recorder.logs.paths else ""
            if not self._notebook.excludes(log, int(decision.text) * 1e-6):
                return  # the operator has withdrawn it
        if decision.kind not in ("note", "done"):
            self._tell(self._guide.decided(decision))

    def obey(self, begun: bool) -> None:
        """Carry out the commands from keys and page.  begun: whether samples are examined."""
        commands = self.page()
        if self._keys is not None:
            commands += self._typing.take(self._keys())
        for command, text in commands:
            try:
                self._do(command, text, begun)
            except StorageError:
                raise
            except CalibrationError as error:  # no command may end a recording
                self._say(Kind.WARNING, str(error))
        if self._keys is not None:
            self._guide.keys = self._typing.words(self._guide, self._stop is not None)

    def _do(self, command: str, text: str, begun: bool) -> None:
        guide = self._guide
        if command == "note" and self._notebook is not None:
            self._recorder.decide(Event("note", text=text))  # first where nothing can refuse it
            self._notebook.note(text, datetime.now(UTC))
            self._say(Kind.STAGE, f"noted: {text}")
        elif command == "here" and guide.closure is not None:
            guide.closure.on_the_mark()
        elif command == "stop" and self._stop is not None:
            self._stop()
            if begun and guide.stage not in (Stage.PAUSED, Stage.DONE):
                self.decide(Event("pause"))
            self._say(Kind.WARNING, "the table is stopped; p goes on with the next move")
        elif not begun or guide.stage is Stage.DONE:
            return
        elif command == "finish":
            if guide.enough:
                self.decide(Event("finish"))
        elif command == "pause":
            self.decide(self.after_pause if guide.stage is Stage.PAUSED else Event("pause"))
        elif command == "drop" and guide.closure is not None:
            guide.closure.interrupted()
        elif command == "drop" and self._notebook is not None:
            moment_us, why = guide.to_drop
            if moment_us is None:
                self._say(Kind.WARNING, why)
                return
            # First where fit reads it, then where a replay does: a mark without its entry is a withdrawn one.
            self._notebook.exclude(self._recorder.logs.paths[-1].name, moment_us * 1e-6)
            self.decide(Event("drop", text=str(moment_us)))

    def _say(self, kind: Kind, text: str) -> None:
        self._tell([GuideMessage(kind, text, self._guide.now_s)])
