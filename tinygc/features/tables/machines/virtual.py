"""A virtual table: the device's side of a make's dialogue over moving axes, with the faults of a real controller and its line.

In process it is an object that takes bytes and returns bytes, at any clock; ``TableLine`` puts it behind a port, on POSIX alone.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.virtual_motion import BRAKE, Fault, Mechanics

if TYPE_CHECKING:
    from tinygc.simulation.terminal import Terminal


# Controllers of virtual tables: what each make answers to which bytes, written from its documentation and not from its dialogue file.
#
# So a mistake in a file of ``makes`` is found by its virtual table.  What of a make is documented and what is only recalled stands in that
# file; its virtual table knows no more.

LONGEST_LINE = 256
NUMBER = r"[-+]?\d+(?:\.\d*)?"


class Firmware:
    """A controller that takes lines.  ``answer`` of a line; ``later``: answers to a request that ends with a motion."""

    END = "\r\n"

    def __init__(self, mechanics: Mechanics):
        self.mechanics = mechanics
        self.words = [axis.word for axis in mechanics.description.axes]
        self._line = b""
        self._alarm = ""
        self.later: list[str] = []

    def greeting(self) -> bytes:
        """What it states when it is switched on."""
        return b""

    def events(self) -> bytes:
        """What it states by itself by now."""
        reported = []
        if (problem := self.mechanics.stopped_by) != self._alarm:
            self._alarm = problem
            reported += self.alarm(problem) if problem else []
            self.later = []
        if self.later and not self.mechanics.is_homing:
            reported, self.later = reported + self.later, []
        return self.lines(reported)

    def alarm(self, problem: str) -> list[str]:
        """What it states by itself when it is stopped."""
        return []

    def take(self, byte: bytes) -> bytes:
        """One byte from the host; the answer."""
        if byte not in b"\r\n":
            self._line = (self._line + byte)[-LONGEST_LINE:]
            return b""
        line, self._line = self._line.decode("latin-1").strip(), b""
        return self.lines(self.answer(line)) if line else b""

    def lines(self, texts: list[str]) -> bytes:
        """Lines as they are sent."""
        return "".join(text + self.END for text in texts).encode("latin-1")

    def answer(self, line: str) -> list[str]:
        """The answer to a line."""
        raise NotImplementedError

    def deg(self, axis: int) -> float:
        """The angle that is stated."""
        return self.mechanics.reported(axis) / DEG


class Grbl(Firmware):
    """GRBL 1.1 (its wiki: interface, jogging, commands; what it does with them: its sources); angles as mm, rates as mm/min.

    Lines are read ``READ_S`` late, and none is while it homes, is held, or behind a limit switch, where a reset alone is taken.
    """

    READ_S = 0.02

    def __init__(self, mechanics: Mechanics):
        super().__init__(mechanics)
        has_homing = bool(mechanics.description.settings.get("homing", True))
        self._numbers = {13: 0.0, 20: 0.0, 21: 0.0, 22: float(has_homing), 23: 0.0, 27: 1.0} | dict.fromkeys((130, 131, 132), 400.0)
        self._is_locked = has_homing
        self._is_held = self._is_requested = self._runs = False
        self._is_reset = False  # since its last alarm
        self._unread: list[tuple[float, str]] = []  # lines that wait, and since when

    def greeting(self) -> bytes:
        """The start-up message, and the lock where homing is enabled."""
        return self.lines(["", "Grbl 1.1h ['$' for help]", *(["[MSG:'$H'|'$X' to unlock]"] if self._is_locked else [])])

    def events(self) -> bytes:
        """Lines that it has received by now; after homing, the report that was requested meanwhile."""
        reported = super().events()
        now_s = self.mechanics.now_s()
        while self._unread and now_s >= self._unread[0][0] + self.READ_S and not self._is_busy:
            reported += self.lines(self.answer(self._unread.pop(0)[1]))
        if self._is_requested and not self.mechanics.is_homing:
            self._is_requested = False
            reported += self.lines([self._status()])
        return reported

    def alarm(self, problem: str) -> list[str]:
        """A hard limit, an abort by the emergency stop, or homing that failed."""
        self._is_locked, self._is_reset = True, False
        self.mechanics.releases += problem != "home_fails"  # amid homing the motors hold
        self._unread.clear()
        return [{"limit": "ALARM:1", "estop": "ALARM:3", "home_fails": "ALARM:9"}[problem]]

    def take(self, byte: bytes) -> bytes:
        """Real-time characters act at once, wherever they stand."""
        mechanics = self.mechanics
        if self._hears_no_line and byte != b"\x18":
            return b""
        if byte == b"?" and mechanics.is_homing:
            self._is_requested = True  # it has no time for reports, and sends one afterwards
            return b""
        if byte == b"?":
            return self.lines([self._status()])
        if byte == b"!":
            self._is_held = self._is_held or self._state() in ("Run", "Idle")
            if self._state() in ("Jog", "Hold:1"):
                mechanics.stop()
        elif byte == b"~":
            self._is_held = False
        elif byte == b"\x85":
            if self._state() == "Jog":
                mechanics.stop()
        elif byte == b"\x18":
            moving = mechanics.is_moving()
            homing = mechanics.is_homing
            mechanics.stop(BRAKE)
            mechanics.releases += moving and not homing
            self.later, self._line, self._is_held, self._is_reset = [], b"", False, True
            self._unread.clear()
            self._is_locked = self._is_locked or moving
            alarm = ["ALARM:6" if homing else "ALARM:3"] if moving else []
            return self.lines(alarm) + self.greeting()
        elif byte in b"\r\n":
            line, self._line = self._line.decode("latin-1").strip(), b""
            self._unread += [(mechanics.now_s(), line)] if line else []
        else:
            return super().take(byte)
        return b""

    @property
    def _is_busy(self) -> bool:
        return self.mechanics.is_homing or self._is_held or self._hears_no_line

    @property
    def _hears_no_line(self) -> bool:
        """Whether it waits for a reset, as behind a limit switch."""
        return self.mechanics.stopped_by == "limit" and not self._is_reset

    def answer(self, line: str) -> list[str]:
        """A line of ``$`` commands or G-code."""
        mechanics = self.mechanics
        text = line.replace(" ", "").upper()
        if mechanics.once("unknown_error"):
            return ["error:99"]
        if text == "$H":
            if not self._numbers[22]:
                return ["error:5"]
            if not self.mechanics.clear():
                return ["error:13"]
            if self._state() not in ("Idle", "Alarm"):
                return ["error:8"]
            self.mechanics.clear()
            self._is_locked = False
            if self.mechanics.home(-self._numbers[27] * DEG):  # next to its switch, which is at 0
                self.later = ["ok"]
            return []
        if text == "$X":
            if not mechanics.clear():
                return ["error:13"]
            was, self._is_locked = self._is_locked, False
            return [*(["[MSG:Caution: Unlocked]"] if was else []), "ok"]
        if text == "$$":
            return [*(f"${number}={value:.3f}" for number, value in self._numbers.items()), "ok"]
        if (setting := re.fullmatch(rf"\$(\d+)=({NUMBER})", text)) and int(setting[1]) in self._numbers:
            if setting[1] == "20" and float(setting[2]) and not self._numbers[22]:
                return ["error:10"]
            self._numbers[int(setting[1])] = float(setting[2])
            return ["ok"]
        if self._is_locked:
            return ["error:9"]
        if text.startswith(("$J=", "G1")):
            self._runs = text[0] == "G"
            return [self._move(text.removeprefix("$J=").removeprefix("G1"))]
        return ["ok" if text in ("G21", "G90", "G94", "$I") else "error:20"]

    def _move(self, text: str) -> str:
        words = re.findall(rf"([A-Z])({NUMBER})", text)
        if "".join(letter + number for letter, number in words) != text:
            return "error:2"
        if self._state() not in ("Idle", "Jog", "Run"):
            return "error:8"
        codes = [number for letter, number in words if letter == "G"]
        if set(codes) - {"20", "21", "53", "90", "91"}:
            return "error:16"
        moves = {letter: float(number) for letter, number in words if letter not in "GF"}
        feed = [float(number) for letter, number in words if letter == "F"]
        if not feed or feed[0] <= 0:
            return "error:22"
        if not moves or set(moves) - set("XYZABC") or "91" in codes or "20" in codes:
            return "error:16"
        far = {letter: self._numbers.get(130 + "XYZ".find(letter), 200.0) for letter in moves}
        if self._numbers[20] and not all(-far[letter] <= number <= 0 for letter, number in moves.items()):
            return "error:15"  # of both signs only what is not above 0
        if self.mechanics.suffers("disabled"):
            return "error:7"  # GRBL knows nothing of an amplifier; a failed read of its settings stands for it
        for letter, number in moves.items():
            if letter in self.words:
                axis = self.words.index(letter)
                fastest = self.mechanics.description.axes[axis].fastest_rps
                self.mechanics.turn_to(axis, number * DEG, min(feed[0] / 60 * DEG, fastest))
        return "ok"

    def _state(self) -> str:
        if self.mechanics.is_homing:
            return "Home"
        if self._is_locked or self.mechanics.stopped_by:
            return "Alarm"
        if self._is_held:
            return "Hold:1" if self.mechanics.is_moving() else "Hold:0"
        return ("Run" if self._runs else "Jog") if self.mechanics.is_moving() else "Idle"

    def _status(self) -> str:
        unit = 25.4 if self._numbers[13] else 1.0
        places = [0.0] * max(3, *(1 + "XYZABC".find(word) for word in self.words))
        for axis, word in enumerate(self.words):
            if len(word) == 1 and word in "XYZABC":
                places["XYZABC".index(word)] = self.deg(axis)
        return f"<{self._state()}|MPos:{','.join(f'{place / unit:.3f}' for place in places)}|FS:0,0>"


class Scpi(Firmware):
    """Commands as of SCPI with a subsystem for each axis: ``AXIS1:POS 30``, ``AXIS1:VEL 10``, ``AXIS1:MOV?``, ``SYST:ERR?``."""

    END = "\n"

    def __init__(self, mechanics: Mechanics):
        super().__init__(mechanics)
        self._rate_dps = [10.0] * len(mechanics.tracks)
        self._errors: list[str] = []

    def alarm(self, problem: str) -> list[str]:
        """An instrument shows nothing by itself: it is in the queue."""
        self._errors.append({"estop": '-310,"emergency stop"', "limit": '-311,"limit switch"', "home_fails": '-312,"no home"'}[problem])
        return []

    def answer(self, line: str) -> list[str]:
        """Only queries are answered; errors queue."""
        mechanics = self.mechanics
        if line == "*IDN?":
            return ["TinyGC,virtual table,0,1"]
        if line == "SYST:ERR?":
            return [self._errors.pop(0) if self._errors else '0,"No error"']
        if line == "SYST:TIME?":
            return [f"{mechanics.now_s():.4f}"]
        if line == "STAT:STOP?":
            return [{"": "0", "estop": "1", "limit": "2", "home_fails": "3"}[mechanics.stopped_by]]
        if line == "ABOR":
            mechanics.stop()
            return []
        if line == "STAT:CLE":
            self._errors += [] if mechanics.clear() else ['-310,"emergency stop"']
            return []
        if line == "HOME":
            self._motion(0, "HOME", 0.0)
            return []
        match = re.fullmatch(rf"(\w+):(POS|VEL|RATE)(?: ({NUMBER})|(\?))|(\w+):MOV\?", line)
        word = (match[1] or match[5]) if match else ""
        if match is None or word not in self.words:
            self._errors.append('-113,"Undefined header"')
            return []
        axis = self.words.index(word)
        if match[5]:
            return [str(int(mechanics.is_moving(axis)))]
        if match[4]:
            return [f"{self._rate_dps[axis] if match[2] == 'VEL' else self.deg(axis):.5f}"]
        if match[2] == "VEL":
            self._rate_dps[axis] = float(match[3])
        else:
            self._motion(axis, match[2], float(match[3]))
        return []

    def _motion(self, axis: int, kind: str, number: float) -> None:
        mechanics = self.mechanics
        if mechanics.once("unknown_error"):
            self._errors.append('-999,"?"')
        elif mechanics.stopped_by or mechanics.suffers("disabled"):
            self._errors.append('-200,"Execution error"')
        elif kind == "HOME":
            mechanics.home()
        elif kind == "POS":
            mechanics.turn_to(axis, number * DEG, self._rate_dps[axis] * DEG)
        else:
            mechanics.turn_at(axis, number * DEG)


class Line(Firmware):
    """The protocol for firmware of one's own (tables.md): ``HOME``, ``TURN``, ``RATE``, ``WHERE``, ``STOP``, ``CLEAR``."""

    END = "\n"

    def greeting(self) -> bytes:
        """Its name and number."""
        return self.lines(["TABLE 1"])

    def alarm(self, problem: str) -> list[str]:
        """What it states by itself."""
        return [{"estop": "ALARM 1", "limit": "ALARM 2", "home_fails": "ALARM 3"}[problem]]

    def answer(self, line: str) -> list[str]:
        """A word and its arguments."""
        mechanics = self.mechanics
        word, *rest = line.split()
        if word == "WHERE" and not rest:
            angles = ",".join(f"{self.deg(axis):.4f}" for axis in range(len(self.words)))
            state = "ALARM" if mechanics.stopped_by else "MOVING" if mechanics.is_moving() or mechanics.is_homing else "REST"
            return [f"AT {mechanics.now_s():.4f} {state} {angles}"]
        if word == "STOP" and not rest:
            mechanics.stop()
            return ["OK"]
        if mechanics.once("unknown_error"):
            return ["ERROR 99"]
        if word == "CLEAR":
            return ["OK" if mechanics.clear() else "ERROR 4"]
        numbers = [float(text) for text in rest[1:] if re.fullmatch(NUMBER, text)]
        if (word, len(rest), len(numbers)) not in (("HOME", 0, 0), ("TURN", 3, 2), ("RATE", 2, 1)) or (rest and rest[0] not in self.words):
            return ["ERROR 1"]
        if mechanics.stopped_by or mechanics.suffers("disabled"):
            return ["ERROR 4" if mechanics.stopped_by else "ERROR 3"]
        if word == "HOME":
            mechanics.home()
        elif word == "TURN":
            mechanics.turn_to(self.words.index(rest[0]), numbers[0] * DEG, numbers[1] * DEG)
        else:
            mechanics.turn_at(self.words.index(rest[0]), numbers[0] * DEG)
        return ["OK"]


FIRMWARE: dict[str, type[Firmware]] = {
    "grbl": Grbl,
    "scpi": Scpi,
    "line": Line,
}


def firmware_of(make: str) -> type[Firmware]:
    """The controller of a make.  CalibrationError where there is no virtual one."""
    if make not in FIRMWARE:
        raise CalibrationError(f"no virtual table of the make {make[:40]!r}; there is one of {', '.join(FIRMWARE)}")
    return FIRMWARE[make]


#: s that a late answer is late
LATE_S = 0.6


class VirtualTable:
    """A controller of ``description.make``, with ``tracks``, the true motion of each axis in seconds since it was switched on.

    The same seed changes the same bytes of garbled answers.
    """

    def __init__(self, description: Description, clock: Clock, faults: Sequence[Fault] = (), seed: int = 0):
        self.description = description
        self.mechanics = Mechanics(description, clock, faults)
        self.tracks = self.mechanics.tracks
        self._firmware = firmware_of(description.make)(self.mechanics)
        self._rng = np.random.default_rng(seed)
        self._answers: list[tuple[float, bytes]] = []  # when it is due, and what
        self._restarts = 0
        self._write(self._firmware.greeting())

    @property
    def is_connected(self) -> bool:
        """Whether the cable is in."""
        return not self.mechanics.suffers("cable")

    def feed(self, data: bytes = b"") -> bytes:
        """Take what the host sent; what the host receives by now."""
        mechanics = self.mechanics
        now_s = mechanics.now_s()
        if not self.is_connected:
            self._answers.clear()
            return b""
        if mechanics.restarts != self._restarts:
            self._restarts = mechanics.restarts
            self._firmware = firmware_of(self.description.make)(mechanics)
            self._write(self._firmware.greeting())
        self._write(self._firmware.events())
        for number in range(len(data)):
            self._write(self._firmware.take(data[number : number + 1]))
        due = b"".join(text for at_s, text in self._answers if at_s <= now_s)
        self._answers = [(at_s, text) for at_s, text in self._answers if at_s > now_s]
        return due

    def _write(self, text: bytes) -> None:
        mechanics = self.mechanics
        if not text or mechanics.suffers("silence"):
            return
        if mechanics.suffers("garbled"):
            changed = np.frombuffer(text, dtype=np.uint8).copy()
            wrong = self._rng.random(len(changed)) < 0.3
            changed[wrong] = self._rng.integers(0, 256, int(wrong.sum()))
            text = changed.tobytes()
        delay_s = LATE_S if mechanics.suffers("late") else 0.0
        self._answers += [(mechanics.now_s() + delay_s, text)] * (2 if mechanics.suffers("doubled") else 1)


#: name of the port where none is given
LINK = Path(tempfile.gettempdir()) / "tinygc-table"


class TableLine(Clock):
    """A virtual table at a terminal; a clock, too: while it waits, the table answers.

    resets: an opened port restarts the controller, as it does an Arduino Uno.
    """

    def __init__(self, table: VirtualTable, terminal: Terminal, resets: bool):
        self._table, self._terminal, self._resets = table, terminal, resets
        self._had_reader = False

    def sleep(self, seconds: float) -> None:
        """Answer the table's host, then wait."""
        self.answer()
        super().sleep(seconds)

    def answer(self) -> None:
        """Take what has come, and answer it.  Where the cable drops, the port goes away; the motion goes on."""
        if not self._table.is_connected:
            self._terminal.unplug()
        has_reader = self._terminal.has_reader
        if self._resets and has_reader and not self._had_reader:
            self._table.mechanics.restart()
        self._had_reader = has_reader
        if answer := self._table.feed(self._terminal.read()):
            self._terminal.write(answer)
