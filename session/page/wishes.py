"""What a person may ask for from the page: the keys of the terminal, and the report at the end.  Nothing else is understood."""

from __future__ import annotations

import threading
from collections import deque
from http import HTTPStatus

from session.guide.typing_line import LONGEST_NOTE, Wish

LONGEST = 4 * LONGEST_NOTE + 16  #: bytes of a request
MOST = 8  #: that wait; a recording takes them ten times a second, and refuses more than it can keep
WORDS = {"pause": Wish.PAUSE, "drop": Wish.DROP, "here": Wish.HERE}
REPORT = "report"


class Wishes:
    """Filled by the threads of browsers; call it, as the recording does, for what was asked since.  Whatever was answered with OK is
    given.  report: whether that was asked for."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Wish, str]] = deque()
        self._changing, self._taken = threading.Lock(), False
        self.report = threading.Event()

    def begin(self) -> None:
        """A recording takes them from here on."""
        with self._changing:
            self._taken = True

    def end(self) -> None:
        """It takes none that come later."""
        with self._changing:
            self._taken = False

    def __call__(self) -> list[tuple[Wish, str]]:
        """In order, each once."""
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

    def hear(self, body: bytes) -> HTTPStatus:
        """``pause``, ``drop``, ``here``, ``note TEXT`` or ``report``: BAD_REQUEST where it is none of them, SERVICE_UNAVAILABLE where
        nobody takes it."""
        try:
            word, _, text = body.decode().partition(" ")
        except UnicodeDecodeError:
            return HTTPStatus.BAD_REQUEST
        if word == "note":
            note = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())[:LONGEST_NOTE]
            return self._keep(Wish.NOTE, note) if note else HTTPStatus.BAD_REQUEST
        if text or (word not in WORDS and word != REPORT):
            return HTTPStatus.BAD_REQUEST
        if word in WORDS:
            return self._keep(WORDS[word], "")
        self.report.set()
        return HTTPStatus.OK

    def _keep(self, wish: Wish, text: str) -> HTTPStatus:
        with self._changing:
            if not self._taken or len(self._waiting) >= MOST:
                return HTTPStatus.SERVICE_UNAVAILABLE
            self._waiting.append((wish, text))
        return HTTPStatus.OK
