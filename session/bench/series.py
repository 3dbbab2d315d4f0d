"""A series of boards at one bench: those that are done, and the one that is plugged in now (``calibrate.py record --series``)."""

from __future__ import annotations

import contextlib
import itertools
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

from session.bench.decoder import StreamDecoder
from session.bench.events import NO_SERIAL, Info
from session.bench.port import RETRY_S, UNPLUGGED, open_serial
from session.bench.rawfile import RAW
from session.io.results import Flag, Keys, ListOf, Number, Text, read_required, write_whole

NAME, SCHEMA = "series.json", "tinygc-series/1"
#: of samples: a board sends its info once a second
NAMELESS_S = 5.0
_ENTRY = Keys({"serial": Text(), "session": Text(), "done": Flag(), "segments": Number(0, whole=True), "ended": Text()})
SHAPE = Keys({"schema": Text((SCHEMA,)), "boards": ListOf(_ENTRY)})


@dataclass(frozen=True)
class SeriesEntry:
    """One board of a series."""

    serial: str  #: empty without a number
    session: str  #: name of its folder
    done: bool  #: whether all segments are accepted
    segments: int  #: accepted
    ended: str  #: local time, ISO 8601


class BoardSeries:
    """The boards of a folder, with one session folder each and ``series.json``.  Raises FormatError for a broken file."""

    def __init__(self, folder: Path):
        self.folder = folder
        path = folder / NAME
        rows = read_required(path, SHAPE)["boards"] if path.exists() else []
        self.entries = [SeriesEntry(*(each[field.name] for field in fields(SeriesEntry))) for each in rows]

    def done(self, serial: str) -> SeriesEntry | None:
        """The entry of a finished board; None for another one, and for a board without a serial number."""
        return next((each for each in self.entries if serial and each.serial == serial and each.done), None)

    def place(self, serial: str) -> tuple[Path, bool]:
        """The folder of a board, and whether it holds a recording that can be resumed."""
        if serial:
            # Two numbers may give the same folder name, and some systems ignore case.
            taken = {NAME, *(each.session.lower() for each in self.entries if each.serial != serial)}
            plain = folder_name(serial)
            names = itertools.chain([plain], (f"{plain}_{number}" for number in itertools.count(2)))
            folder = self.folder / next(name for name in names if name.lower() not in taken)
            return folder, (folder / RAW).exists()
        free = (self.folder / f"board{number}" for number in range(1, 1_000_000))
        return next(folder for folder in free if not folder.exists()), False

    def add(self, entry: SeriesEntry) -> None:
        """Store an entry, in place of an earlier one of the same folder."""
        self.entries = [each for each in self.entries if each.session != entry.session] + [entry]
        write_whole(self.folder / NAME, {"schema": SCHEMA, "boards": [vars(each) for each in self.entries]})


def folder_name(serial: str) -> str:
    """A serial number as a folder name: special characters become underscores."""
    plain = re.sub(r"[^A-Za-z0-9._-]", "_", serial)
    return plain if re.match(r"[A-Za-z0-9]", plain) else f"board_{plain}"


class BoardListener:
    """Identifies the board that is plugged in: opens the port, reads the board's info, and closes the port.

    port: returns the port's name each time that it is to be opened, None while there is none; name: the port of the last board.
    """

    def __init__(self, port: Callable[[], str | None], baudrate: int, header: str | None):
        self._port, self._baudrate, self._header = port, baudrate, header
        self._away = True  # whether the port was gone since the last board was done
        self.name: str | None = None

    def next_board(self, last: str | None, stopped: Callable[[], bool]) -> str | None:
        """The serial number of the next board, empty without one; None when ``stopped``.

        last: the number of the board before, which may still be plugged in.  A board with the same number, or none, is the next only once
        the port has been gone.
        """
        self._away = last is None
        while not stopped():
            serial = self._identify(last, stopped)
            if serial is not None:
                return serial
        return None

    def _identify(self, last: str | None, stopped: Callable[[], bool]) -> str | None:
        """Listen to one connection for a board that is not the last one; None when the port goes."""
        self.name = self._port()
        try:
            port = open_serial(self.name, self._baudrate) if self.name is not None else None
        except UNPLUGGED:
            port = None
        if port is None:
            self._away = True
            time.sleep(RETRY_S)
            return None
        decoder, first_s = StreamDecoder(self._header), None
        with contextlib.closing(port):
            while not stopped():
                try:
                    data = port.read(max(1, port.in_waiting))
                except UNPLUGGED:
                    self._away = True
                    return None
                first_s = time.monotonic() if data and first_s is None else first_s
                serials = ["" if event.serial in NO_SERIAL else event.serial for event in decoder.feed(data) if isinstance(event, Info)]
                late = first_s is not None and time.monotonic() - first_s > NAMELESS_S
                if late and not serials and decoder.info is None and decoder.samples:
                    serials = [""]
                for serial in serials:
                    if serial != last or self._away:
                        return serial
        return None
