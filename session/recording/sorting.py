"""Events into logs: those of the recording's own board, and, apart from them, those of another that was plugged in once.

Which bytes are another board's is written down in ``raw.times`` as ``foreign N``, at the connection that they came by: what follows the
N-th landmark of the recording is another board's, until the port is opened again.  A landmark is a new log or an info: it has its place
among the events however the bytes were cut, which a number of bytes has not.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from session.recording.logwriter import NEW_LOG, LogWriter
from session.recording.rawfile import Mark
from session.stream.decoder import StreamDecoder
from session.stream.events import Chunk, Event, Info, Trouble

WORD = "foreign"


@dataclass(frozen=True)
class Landmark:
    """number: of all in the recording; offset: bytes before its connection; logs, samples: how many there were of the own board's."""

    number: int
    offset: int
    logs: int
    samples: int


class Sorting:
    """``take`` events, ``opened`` where a connection begins.  samples: those of the recording's own board."""

    def __init__(self, decoder: StreamDecoder, logs: LogWriter):
        self._decoder, self._logs = decoder, logs
        self.samples = 0
        self._info: Info | None = None  # of the recording's own board
        self._number = self._offset = 0
        self._since: int | None = None  # the landmark behind which another board speaks
        self._seen = [Landmark(0, 0, 0, 0)]  # by who takes the events

    def opened(self, offset: int, since: int | None = None) -> None:
        """The port was opened behind so many bytes; since: the landmark behind which another board speaks, or None."""
        self._logs.back()
        self._offset, self._since = offset, since
        self._turn()

    def take(self, events: Iterable[Event]) -> list[Event]:
        """Write each where it belongs; those of the recording's own board."""
        own: list[Event] = []
        for event in events:
            apart = self._logs.is_apart
            self._logs.write([event])
            if not apart:
                own.append(event)
                self.samples += len(event) if isinstance(event, Chunk) else 0
                self._info = event if isinstance(event, Info) else self._info
            if isinstance(event, Info) or (isinstance(event, Trouble) and event.kind in NEW_LOG):
                self._number += 1
                if not apart:
                    self._seen.append(Landmark(self._number, self._offset, len(self._logs.paths), self.samples))
                self._turn()
        if self._logs.is_apart:  # who asks what the board is, asks for this recording's
            self._decoder.info = self._info
        return own

    def _turn(self) -> None:
        if self._since is not None and self._number >= self._since:
            self._logs.apart()

    def set_apart(self, count: int) -> Landmark:
        """What came behind the count-th landmark that ``take`` gave away was another board's: its logs get another name.  Where it was."""
        landmark = self._seen[count]
        following = next((each for each in self._seen if each.offset > landmark.offset), None)
        self._logs.rename_apart(slice(landmark.logs, following.logs if following else None))
        self.samples -= (following.samples if following else self.samples) - landmark.samples
        if following is None:
            self._since = landmark.number
            self._turn()
        return landmark


def other_board(marks: Sequence[Mark], begun: int) -> int | None:
    """The landmark behind which another board speaks in the connection that marks[begun] opens (-1: before the first); None: in none."""
    found = []
    for mark in marks[begun + 1 :]:
        word, _, rest = mark.event.partition(" ")
        if word == "open":
            break
        if word == WORD and rest.isascii() and rest.isdigit():
            found.append(int(rest))
    return min(found, default=None)
