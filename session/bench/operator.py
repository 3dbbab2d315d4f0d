"""The person at the table: keys, typed notes, and what is decided with them."""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import select
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from enum import Enum
from typing import Any
from typing import Protocol as Interface

from session.bench.closure_guide import BEGIN
from session.bench.guide import Guide
from session.bench.messages import GuideMessage, Kind, Stage
from session.bench.rawfile import RecordingDecision
from session.bench.recorder import Recorder
from session.io.errors import CalibrationError, StorageError

# Keys while a recording runs: as they are pressed, without an echo.  There are none where standard input is no terminal.
#
# Ctrl-C stays what it is.  A process in the background is stopped by the system if it touches the terminal: then there are none, either.

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
    """A context.  there: whether there are keys; call it for what was typed since the last call."""

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
                self._at_once()
        except (OSError, ValueError):  # closed, or no terminal after all
            self.there = False
        except Exception as error:
            if termios is None or not isinstance(error, termios.error):
                raise
            self.there = False
        return self

    def __exit__(self, *error: object) -> None:
        if termios is not None and self._before is not None and self._in_front():
            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def __call__(self) -> str:
        """What was typed, without what arrows and function keys send."""
        if not self.there:
            return ""
        if sys.platform == "win32":
            typed = ""
            while msvcrt.kbhit():
                typed += msvcrt.getwch()
            return re.sub("[\x00\xe0].", "", typed)
        return self._typed() if self._in_front() else ""

    def _typed(self) -> str:
        assert termios is not None
        try:
            self._at_once()
            if not select.select([self._file], [], [], 0)[0]:
                return ""
            data = os.read(self._file, READ_BYTES)
        except (OSError, termios.error):
            data = b""
        if not data:  # the terminal has gone
            self.there = False
        return SEQUENCE.sub("", self._decoder.decode(data))

    def _at_once(self) -> None:
        """Characters without waiting for the end of a line, and without an echo; a shell may have set it back (Ctrl-Z, fg)."""
        assert termios is not None
        if not self._in_front():
            return
        mode = termios.tcgetattr(self._file)
        if mode[3] & (termios.ICANON | termios.ECHO):
            mode[3] &= ~(termios.ICANON | termios.ECHO)
            termios.tcsetattr(self._file, termios.TCSADRAIN, mode)

    def _in_front(self) -> bool:
        """Whether the terminal is ours to read."""
        try:
            return os.tcgetpgrp(self._file) == os.getpgrp()
        except OSError:  # it does not control us: nobody is stopped for reading it
            return True


# What typed characters ask for: a command each, or a note that ends with Enter.

ENTER, ESCAPE, ERASE = ("\r", "\n"), "\x1b", ("\x7f", "\b")
LONGEST_NOTE = 200


class OperatorCommand(Enum):
    """What a person can ask for."""

    PAUSE = "p"
    DROP = "d"
    NOTE = "n"
    HERE = "Enter"


class TypingLine:
    """``take`` characters; note: the text that is being typed, or None."""

    def __init__(self) -> None:
        self.note: str | None = None

    def take(self, typed: str) -> list[tuple[OperatorCommand, str]]:
        """Wishes, in order, and the text of a note."""
        wishes: list[tuple[OperatorCommand, str]] = []
        for sign in typed:
            if self.note is None:
                if sign in ENTER:
                    wishes.append((OperatorCommand.HERE, ""))
                elif sign.lower() == OperatorCommand.NOTE.value:
                    self.note = ""
                elif sign.lower() in (OperatorCommand.PAUSE.value, OperatorCommand.DROP.value):
                    wishes.append((OperatorCommand(sign.lower()), ""))
            elif sign in ENTER:
                if text := " ".join(self.note.split()):
                    wishes.append((OperatorCommand.NOTE, text))
                self.note = None
            elif sign == ESCAPE:
                self.note = None
            elif sign in ERASE:
                self.note = self.note[:-1]
            elif sign.isprintable() and len(self.note) < LONGEST_NOTE:
                self.note += sign
        return wishes

    def words(self, closure: bool) -> str:
        """The last line of the screen.  closure: whether the closure run is on."""
        if self.note is not None:
            return f"note: {self.note}_   (Enter keeps it, Esc does not)"
        last = "d the closure run again   Enter it is on its mark" if closure else "d drop the last turn"
        return f"keys: p pause   {last}   n note"


# What a person decides at the table, with keys, and what the guide decides about files: it is written down where a replay finds it.


class Notebook(Interface):
    """Where notes and turns that do not count are written down: session.toml."""

    def note(self, text: str, when: datetime) -> None:
        """A person's words of this moment (UTC)."""

    def exclude(self, log: str, at_s: float) -> None:
        """The turn that moved at that moment of a log's clock does not count."""

    def excludes(self, log: str, at_s: float) -> bool:
        """Whether that is written down (and was not taken back since)."""


class Wished(Interface):
    """What is asked for elsewhere, on a page: call it for what was since it was last asked."""

    def __call__(self) -> list[tuple[OperatorCommand, str]]:
        """In order, each once."""

    def begin(self) -> None:
        """They are taken from here on."""

    def end(self) -> None:
        """None that come later are taken."""


class OperatorInput:
    """tell: takes what has changed; keys: gives what was typed since it was last asked; None: there are none; wished: what was asked
    for elsewhere, likewise."""

    def __init__(
        self,
        guide: Guide,
        recorder: Recorder,
        tell: Callable[[list[GuideMessage]], None],
        notebook: Notebook | None,
        keys: Callable[[], str] | None,
        wished: Wished | None = None,
    ):
        self._guide, self._recorder, self._tell, self._notebook = guide, recorder, tell, notebook
        self._keys, self._wished = keys, wished
        self._typing = TypingLine()

    @property
    def after_pause(self) -> RecordingDecision:
        """How it goes on: before the closure run in a log, behind it in none until the table stands on its mark."""
        return RecordingDecision("begin", "log") if self._guide.closure is None else BEGIN

    def decide(self, decision: RecordingDecision) -> None:
        """Do it with the files, and tell the guide."""
        self._recorder.decide(decision)
        self._tell(self._guide.decided(decision))

    def was_decided(self, decision: RecordingDecision) -> None:
        """In the recording that is resumed: the guide decides it again."""
        if decision.word == "drop" and self._notebook and not self._notebook.excludes(decision.log, int(decision.rest) * 1e-6):
            return  # somebody has taken it back
        if decision.word != "note":
            self._tell(self._guide.decided(decision))

    def begin(self) -> None:
        """Somebody obeys from here on."""
        if self._wished is not None:
            self._wished.begin()

    def end(self) -> None:
        """Nobody does any more."""
        if self._wished is not None:
            self._wished.end()

    def obey(self, begun: bool) -> None:
        """What was typed, or asked for.  begun: whether samples are judged."""
        wishes = self._wished() if self._wished is not None else []
        if self._keys is not None:
            wishes += self._typing.take(self._keys())
        for wish, text in wishes:
            try:
                self._do(wish, text, begun)
            except StorageError:
                raise
            except CalibrationError as error:  # nothing that a person types ends a recording
                self._say(Kind.WARNING, str(error))
        if self._keys is not None:
            self._guide.keys = self._typing.words(self._guide.closure is not None)

    def _do(self, wish: OperatorCommand, text: str, begun: bool) -> None:
        guide = self._guide
        if wish is OperatorCommand.NOTE and self._notebook is not None:
            self._recorder.decide(RecordingDecision("note", text))  # first where nothing can refuse it
            self._notebook.note(text, datetime.now(UTC))
            self._say(Kind.STAGE, f"noted: {text}")
        elif wish is OperatorCommand.HERE and guide.closure is not None:
            guide.closure.on_the_mark()
        elif not begun or guide.stage is Stage.DONE:
            return
        elif wish is OperatorCommand.PAUSE:
            self.decide(self.after_pause if guide.stage is Stage.PAUSED else RecordingDecision("pause"))
        elif wish is OperatorCommand.DROP and guide.closure is not None:
            guide.closure.interrupted()
        elif wish is OperatorCommand.DROP and self._notebook is not None:
            self._drop(self._notebook)

    def _drop(self, notebook: Notebook) -> None:
        moment_us, why = self._guide.to_drop
        if moment_us is None:
            self._say(Kind.WARNING, why)
            return
        # First where fit reads it, then where a replay does: a mark without its entry is one that was taken back.
        notebook.exclude(self._recorder.logs.paths[-1].name, moment_us * 1e-6)
        self.decide(RecordingDecision("drop", str(moment_us)))

    def _say(self, kind: Kind, text: str) -> None:
        self._tell([GuideMessage(kind, text, self._guide.now_s)])
