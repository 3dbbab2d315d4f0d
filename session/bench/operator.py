"""The operator's input: keys, typed notes, commands from a browser."""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import select
import sys
import threading
from http import HTTPStatus
from typing import Any

from session.base.texts import one_line
from session.bench.guide import REST, Guide
from session.bench.port import UNPLUGGED, TerminalError

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
        except (ValueError, OSError, TerminalError):  # closed, or no terminal after all
            self.there = False
        return self

    def __exit__(self, *error: object) -> None:
        if termios is not None and self._before is not None and self._in_foreground():
            with contextlib.suppress(*UNPLUGGED):
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
        except UNPLUGGED:
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
            text = one_line(text)[:LONGEST_NOTE]
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
