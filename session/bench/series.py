"""A row of boards at one bench: which were done, and who is plugged in now (``calibrate.py record --series``)."""

from __future__ import annotations

import contextlib
import itertools
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import serial

from session.bench.decoder import StreamDecoder
from session.bench.events import Info
from session.bench.port import READ_S, RETRY_S, UNPLUGGED, is_left_behind
from session.bench.rawfile import RAW
from session.io.results import Flag, Keys, ListOf, Number, Text, read_required, write_whole

NAME, SCHEMA = "series.json", "tinygc-series/1"
#: what a firmware sends that knows no serial number
NO_SERIAL = ("", "0")
#: of samples, for a board that says what it is once a second
NAMELESS_S = 5.0
_ENTRY = Keys({"serial": Text(), "session": Text(), "done": Flag(), "segments": Number(0, whole=True), "ended": Text()})
SHAPE = Keys({"schema": Text((SCHEMA,)), "boards": ListOf(_ENTRY)})


@dataclass(frozen=True)
class SeriesEntry:
    """One board of a row: serial, or empty where it says none; session: name of its folder; done: all segments are there; segments
    accepted; ended: local time, ISO 8601."""

    serial: str
    session: str
    done: bool
    segments: int
    ended: str


class BoardSeries:
    """The boards of a folder, one session folder each, and ``series.json`` beside them.  Raises FormatError for a broken one."""

    def __init__(self, folder: Path):
        self.folder = folder
        path = folder / NAME
        rows = read_required(path, SHAPE)["boards"] if path.exists() else []
        self.entries = [SeriesEntry(*(each[field.name] for field in fields(SeriesEntry))) for each in rows]

    def done(self, serial: str) -> SeriesEntry | None:
        """The entry of a board that is done; of one without a serial number nobody knows."""
        return next((each for each in self.entries if serial and each.serial == serial and each.done), None)

    def place(self, serial: str) -> tuple[Path, bool]:
        """The folder of a board, and whether a recording was begun there that can go on."""
        if serial:
            # Two numbers may be one folder's name, and some systems take capitals for small letters.
            taken = {NAME, *(each.session.lower() for each in self.entries if each.serial != serial)}
            plain = folder_name(serial)
            names = itertools.chain([plain], (f"{plain}_{number}" for number in itertools.count(2)))
            folder = self.folder / next(name for name in names if name.lower() not in taken)
            return folder, (folder / RAW).exists()
        free = (self.folder / f"board{number}" for number in range(1, 1_000_000))
        return next(folder for folder in free if not folder.exists()), False

    def add(self, entry: SeriesEntry) -> None:
        """Keep it, in the place of an earlier one of the same folder."""
        self.entries = [each for each in self.entries if each.session != entry.session] + [entry]
        write_whole(self.folder / NAME, {"schema": SCHEMA, "boards": [vars(each) for each in self.entries]})


def folder_name(serial: str) -> str:
    """A serial number as a folder's name: what could mean something to a file system is an underscore."""
    plain = re.sub(r"[^A-Za-z0-9._-]", "_", serial)
    return plain if re.match(r"[A-Za-z0-9]", plain) else f"board_{plain}"


class BoardListener:
    """Who is plugged in: opens the port, hears what the board says of itself, and lets go of it.

    port: its name, asked for anew each time that it has to be opened, None while there is none; name: that of the last board.
    """

    def __init__(self, port: Callable[[], str | None], baudrate: int, header: str | None):
        self._port, self._baudrate, self._header = port, baudrate, header
        self._away = True  # whether nobody has been at the port since the last board was done
        self.name: str | None = None

    def next_board(self, last: str | None, wanted: Callable[[], bool]) -> str | None:
        """The serial number of the next board, empty where it says none; None where somebody wants to end.

        last: that of the board before, which may still be there: one that says it again, or none, is the next only once the port has been
        away.
        """
        self._away = last is None
        while not wanted():
            heard = self._hear(last, wanted)
            if heard is not None:
                return heard
        return None

    def _hear(self, last: str | None, wanted: Callable[[], bool]) -> str | None:
        """One connection: who speaks first that is not the last one; None where the port goes."""
        self.name = self._port()
        try:
            if self.name is None or is_left_behind(self.name):
                raise serial.SerialException("nobody there")
            port = serial.Serial(self.name, self._baudrate, timeout=READ_S, exclusive=True)
        except UNPLUGGED:
            self._away = True
            time.sleep(RETRY_S)
            return None
        decoder, first_s = StreamDecoder(self._header), None
        with contextlib.closing(port):
            while not wanted():
                try:
                    data = port.read(max(1, port.in_waiting))
                except UNPLUGGED:
                    self._away = True
                    return None
                first_s = time.monotonic() if data and first_s is None else first_s
                said = [event.serial for event in decoder.feed(data) if isinstance(event, Info)]
                if (
                    not said
                    and decoder.info is None
                    and decoder.samples
                    and first_s is not None
                    and time.monotonic() - first_s > NAMELESS_S
                ):
                    said = [""]
                for each in said:
                    name = "" if each in NO_SERIAL else each
                    if name != last or self._away:
                        return name
        return None
