"""The FIFO: words of seven bytes, a tag and six of data."""

from __future__ import annotations

from collections import deque

from tinygc.simulation.asm330lhh.registers import tag_byte

WORDS = 512
EMPTY = bytes(7)
BYPASS, UNTIL_FULL, TO_FIFO, CONTINUOUS = 0, 1, 3, 6


class Fifo:
    """words: unread, oldest first; mode, limit (words that it may hold): as the registers set them.

    lost: words that nobody read in time; overrun: one was lost and no room has been made since; latched: since it was last asked.
    """

    def __init__(self) -> None:
        self.words: deque[bytes] = deque()
        self.mode, self.limit = BYPASS, WORDS
        self.slot = 0
        self._begun = b""
        self.lost = 0
        self.overrun = self.latched = False

    @property
    def collects(self) -> bool:
        """Whether words are kept at all."""
        return self.mode in (UNTIL_FULL, TO_FIFO, CONTINUOUS)

    def set_mode(self, mode: int) -> None:
        """Bypass, or a mode that is taken for it, empties the FIFO."""
        self.mode = mode
        if not self.collects:
            self.clear()

    def clear(self) -> None:
        """Empty, nothing overrun; TAG_CNT goes on."""
        self.words.clear()
        self.overrun = self.latched = False

    def word(self, sensor: int, data: bytes) -> bytes:
        """Seven bytes, of the present time slot."""
        return bytes((tag_byte(sensor, self.slot),)) + data

    def put(self, word: bytes) -> None:
        """Behind the others: if there is no room the oldest goes (continuous), or this one."""
        if len(self.words) < self.limit:
            self.words.append(word)
            return
        self.lost += 1
        self.overrun = self.latched = True
        if self.mode != UNTIL_FULL:
            self.words.append(word)
            while len(self.words) > self.limit:
                self.words.popleft()

    def begin(self) -> bytes:
        """The word to be read next, zeros where there is none: its tag is read, and from then on its data are its own."""
        self._begun = self.words[0] if self.words else EMPTY
        return self._begun

    def data(self) -> bytes:
        """The word whose tag was read last."""
        return self._begun or self.begin()

    def finish(self) -> None:
        """It has been read to its last byte, and is gone, if it was not overrun meanwhile."""
        if self.words and self.words[0] is self._begun:
            self.words.popleft()
            self.overrun = False
        self._begun = b""
