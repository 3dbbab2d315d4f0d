"""Keys while a recording runs: as they are pressed, without an echo.  There are none where standard input is no terminal.

Ctrl-C stays what it is.  A process in the background is stopped by the system if it touches the terminal: then there are none, either.
"""

from __future__ import annotations

import codecs
import contextlib
import os
import re
import select
import sys
from typing import Any

try:
    import termios
except ImportError:  # Windows
    termios = None  # type: ignore[assignment]
if sys.platform == "win32":
    import msvcrt

#: what an arrow or a function key sends
SEQUENCE = re.compile(r"\x1b(\[[0-9;]*[A-Za-z~]|O[A-Za-z])")
READ_BYTES = 256


class Keys:
    """A context.  there: whether there are keys; call it for what was typed since the last call."""

    def __init__(self) -> None:
        self.there = False
        self._file = -1
        self._before: list[Any] | None = None
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def __enter__(self) -> Keys:
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
