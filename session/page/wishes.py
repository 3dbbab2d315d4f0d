"""What a person may ask for from the page: the keys of the terminal, and the report at the end.  Nothing else is understood."""

from __future__ import annotations

import threading
from collections import deque

from session.guide.typing_line import LONGEST_NOTE, Wish

LONGEST = 4 * LONGEST_NOTE + 16  #: bytes of a request
MOST = 8  #: that wait; a recording takes them ten times a second
WORDS = {"pause": Wish.PAUSE, "drop": Wish.DROP, "here": Wish.HERE}
REPORT = "report"


class Wishes:
    """Filled by the threads of browsers; call it, as the recording does, for what was asked since.  report: whether that was asked for."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Wish, str]] = deque(maxlen=MOST)
        self.report = threading.Event()

    def __call__(self) -> list[tuple[Wish, str]]:
        """In order, each once."""
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

    def hear(self, body: bytes) -> bool:
        """``pause``, ``drop``, ``here``, ``note TEXT`` or ``report``; whether it was one of them."""
        try:
            word, _, text = body.decode().partition(" ")
        except UnicodeDecodeError:
            return False
        if word == "note":
            note = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())[:LONGEST_NOTE]
            if note:
                self._waiting.append((Wish.NOTE, note))
            return bool(note)
        if text or (word not in WORDS and word != REPORT):
            return False
        if word == REPORT:
            self.report.set()
        else:
            self._waiting.append((WORDS[word], ""))
        return True
