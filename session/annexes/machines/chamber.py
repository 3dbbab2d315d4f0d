"""A temperature chamber by two verbs: set, and wait until it is stable.  ``chamber.toml`` says how it is spoken to.

    schema = "tinygc-chamber/1"
    port = "/dev/ttyUSB1"
    set = "SOUR:TEMP {temperature}"
    read = "MEAS:TEMP?"
    answer = "{temperature}"

Its limits are checked before each request.  A chamber has no stop: at the end it is set to ``rest_c``, where one is given.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from session.annexes.machines.clocks import Clock
from session.annexes.machines.makefile import LONGEST_LINE, PATTERNS, Pattern
from session.annexes.machines.verbs import TableFault, TableLimit
from session.annexes.machines.wire import Link, SerialLink, VisaLink
from session.io.errors import FormatError
from session.io.results import Keys, Number, Text, require
from session.io.toml import read_toml

SCHEMA = "tinygc-chamber/1"
AGAIN = "correct the file (docs/formats/tables.md)"
TRIES = 3
LOOK_S = 1.0  #: between two looks of a recording: Ctrl-C waits for no more
_TEMPERATURE = Number(-273.15, 1000)
SHAPE = Keys(
    {"schema": Text((SCHEMA,)), "set": Text(), "read": Text(), "answer": PATTERNS, "least_c": _TEMPERATURE, "most_c": _TEMPERATURE},
    {
        "port": Text(),
        "baud": Number(1, 1e8, whole=True),
        "end": Text(),
        "within_c": Number(0, 50, above=True),
        "stable_s": Number(0, 1e5),
        "longest_s": Number(0, 1e6, above=True),
        "answer_s": Number(0, 100, above=True),
        "rest_c": _TEMPERATURE,
    },
)


class Chamber(Protocol):
    """A chamber that is connected; both verbs raise TableFault where it does not answer."""

    description: ChamberDescription

    def set(self, temperature_c: float) -> None:
        """Begin to go to a temperature.  TableLimit beyond its limits: nothing is sent."""

    def read(self) -> float:
        """Its temperature, degC."""
        ...

    def close(self) -> None:
        """Set it to ``rest_c``, and let go of the port."""


@dataclass(frozen=True)
class ChamberDescription:
    """``chamber.toml``.  It is stable when it stays within ``within_c`` of what was set for ``stable_s``, at most ``longest_s`` after."""

    port: str
    baud: int
    end: str
    set_request: str
    read_request: str
    answers: tuple[Pattern, ...]
    least_c: float
    most_c: float
    within_c: float = 0.5
    stable_s: float = 600.0
    longest_s: float = 4 * 3600.0
    answer_s: float = 2.0
    rest_c: float | None = None


def read_chamber(path: Path) -> ChamberDescription:
    """Read ``chamber.toml``.  Raises FormatError."""
    table = read_toml(path)
    if isinstance(table.get("answer"), str):
        table["answer"] = [table["answer"]]
    require(table, SHAPE, str(path), AGAIN)
    if "{temperature}" not in table["set"] or not all("{temperature}" in text for text in table["answer"]):
        raise FormatError(f"{path}: set and answer need {{temperature}}; {AGAIN}")
    if not table["least_c"] < table["most_c"]:
        raise FormatError(
            f"{path}: least_c and most_c are {table['least_c']:g} and {table['most_c']:g}, expected the smaller first; {AGAIN}"
        )
    if any(ord(character) > 255 for name in ("set", "read", "end") for character in table.get(name, "")):
        raise FormatError(f"{path}: a request holds more than one byte a character; {AGAIN}")
    optional = {name: table[name] for name in ("within_c", "stable_s", "longest_s", "answer_s", "rest_c") if name in table}
    return ChamberDescription(
        table.get("port", ""),
        table.get("baud", 9600),
        table.get("end", "\n"),
        table["set"],
        table["read"],
        tuple(map(Pattern, table["answer"])),
        table["least_c"],
        table["most_c"],
        **optional,
    )


class ChamberDialogue:
    """``Chamber`` over a link."""

    def __init__(self, description: ChamberDescription, link: Link, clock: Clock):
        self.description, self._link, self._clock = description, link, clock
        self._buffer = b""

    def set(self, temperature_c: float) -> None:
        """Begin to go to a temperature."""
        of = self.description
        if not of.least_c <= temperature_c <= of.most_c:
            raise TableLimit(f"chamber: {temperature_c:g} degC, expected {of.least_c:g} to {of.most_c:g}; nothing was sent")
        self._send(of.set_request.replace("{temperature}", f"{temperature_c:.2f}"))

    def read(self) -> float:
        """Its temperature."""
        of = self.description
        heard = ""
        for _ in range(TRIES):
            self._link.read(0.0)
            self._buffer = b""
            self._send(of.read_request)
            end_s = self._clock.now_s() + of.answer_s
            while (left_s := end_s - self._clock.now_s()) > 0:
                *lines, self._buffer = (self._buffer + self._link.read(min(left_s, 0.1))).replace(b"\r", b"\n").split(b"\n")
                for line in (line.decode("latin-1").strip()[:LONGEST_LINE] for line in lines):
                    for pattern in of.answers:
                        if (found := pattern.match(line)) is not None:
                            return float(found["temperature"])
                    heard = line or heard
        said = f"heard {heard[:60]!r}" if heard else "heard nothing"
        raise TableFault(f"chamber: sent {of.read_request!r}, {said}, expected {of.answers[0].text!r} within {of.answer_s:g} s")

    def close(self) -> None:
        """Set it to ``rest_c``, and let go."""
        try:
            if self.description.rest_c is not None:
                self.set(self.description.rest_c)
        finally:
            self._link.close()

    def _send(self, text: str) -> None:
        self._link.write((text + self.description.end).encode("latin-1"))


def open_chamber(description: ChamberDescription, clock: Clock) -> Chamber:
    """Open the port of a chamber.  TableFault where it is not there."""
    if not description.port:
        raise FormatError(f'chamber: has no port; give it one, such as port = "/dev/ttyUSB1"; {AGAIN}')
    is_visa = "::" in description.port
    link: Link = VisaLink(description.port, description.baud, "") if is_visa else SerialLink(description.port, description.baud, clock)
    return ChamberDialogue(description, link, clock)


def wait_until_stable(
    chamber: Chamber, temperature_c: float, clock: Clock, is_over: Callable[[], bool] = lambda: False, look_s: float = 5.0
) -> bool:
    """Set a temperature and wait until the chamber has stayed within ``within_c`` of it for ``stable_s``; False where ``is_over`` ended it.

    TableFault where it is not stable ``longest_s`` after.
    """
    of = chamber.description
    chamber.set(temperature_c)
    begin_s = since_s = clock.now_s()
    while not is_over():
        here, now_s = chamber.read(), clock.now_s()
        if abs(here - temperature_c) > of.within_c:
            since_s = now_s
        if now_s - since_s >= of.stable_s:
            return True
        if now_s - begin_s > of.longest_s:
            raise TableFault(
                f"chamber: {here:.2f} degC after {of.longest_s / 60:g} min, asked for was {temperature_c:g}; is its door closed?"
            )
        clock.sleep(look_s)
    return False


class ChamberOfRecording:
    """A chamber that a recording brings to one temperature after the other.  It is spoken to in a thread: no answer keeps samples waiting.

    ``close`` sets it to ``rest_c``.
    """

    def __init__(self, chamber: Chamber, clock: Clock):
        self.chamber, self._clock = chamber, clock
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="chamber")
        self._goes_to_c: float | None = None
        self._waits: Future[bool] | None = None
        self._ended = threading.Event()

    def is_stable(self, temperature_c: float) -> bool:
        """Whether it is stable at a temperature; it is set to it first, where that has not been done.  Raises TableFault and TableLimit,
        and then the next call sets it again."""
        if self._waits is None or temperature_c != self._goes_to_c:
            self._goes_to_c = temperature_c
            self._waits = self._thread.submit(wait_until_stable, self.chamber, temperature_c, self._clock, self._ended.is_set, LOOK_S)
        waits = self._waits
        if not waits.done():
            return False
        if waits.exception() is not None:
            self._waits = None
        return waits.result()

    def close(self) -> None:
        """End the wait, set it to ``rest_c``, and let go of it."""
        self._ended.set()
        self._thread.shutdown()
        self.chamber.close()


class VirtualChamber:
    """A chamber in this process, for ``VirtualLink``: its temperature follows what was set with one time constant, and answers as SCPI."""

    is_connected = True

    def __init__(self, clock: Clock, begin_c: float = 25.0, time_constant_s: float = 300.0):
        self._clock, self._tau_s = clock, time_constant_s
        self._from_c = self._to_c = begin_c
        self._since_s = clock.now_s()
        self._line = b""

    def temperature(self) -> float:
        """Its temperature now, degC."""
        return self._to_c + (self._from_c - self._to_c) * math.exp((self._since_s - self._clock.now_s()) / self._tau_s)

    def feed(self, data: bytes = b"") -> bytes:
        """Take requests; the answers."""
        *lines, self._line = (self._line + data).split(b"\n")
        said = b""
        for line in lines:
            if line == b"MEAS:TEMP?":
                said += f"{self.temperature():.2f}\n".encode()
            elif line.startswith(b"SOUR:TEMP "):
                self._from_c, self._since_s = self.temperature(), self._clock.now_s()
                self._to_c = float(line.removeprefix(b"SOUR:TEMP "))
        return said
