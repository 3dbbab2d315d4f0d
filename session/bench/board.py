"""What a board reports of itself, in words for the operator; and whether it is still the same board."""

from __future__ import annotations

from collections import Counter

from session.base.errors import OtherSensor
from session.bench.events import CHIPS, FAULTS, SENSOR, STANDIN, AnyEvent, BoardStatus, Event, Info
from session.log.config import NO_SERIAL

# The board's messages about its sensor, in words: faults when their counts rise, a stand-in once.

WIRES = "look at supply, wires and their length"
#: each fault, and what to do about it
FAULT_WORDS = {
    "overrun": ("the sensor's FIFO ran over", "the board is too slow for this data rate: a lower --odr"),
    "order": ("words of the FIFO were out of order", WIRES),
    "parity": ("words of the FIFO had a wrong parity", WIRES),
    "tag": ("the FIFO gave words that there are none of", WIRES),
    "hang": ("the bus to the sensor hung", WIRES),
    "zeros": ("the sensor's bus answered 0x00", WIRES),
    "ones": ("the sensor's bus answered 0xFF", WIRES),
    "reset": ("the sensor reset itself", "look at its supply"),
    "changed": ("a register of the sensor changed by itself", "look at its supply"),
    "identity": ("the sensor's identity is another's", WIRES),
    "silent": ("the sensor fell silent", WIRES),
    "stamp": ("the sensor's stamps did not follow each other", WIRES),
    "incomplete": ("words of a sample did not come", WIRES),
    "rate": ("the sensor gave samples at another rate than was set", "look at its supply"),
    "crowded_out": ("the board's port had no room", "a higher --baud, or a lower --odr"),
}
#: counts of samples, or of consequences of another fault
COUNTED_APART = ("lost", "starts")
NO_SENSOR = (
    "the board has no sensor (source 0): what comes is made up, or played to it, and calibrates no sensor; "
    "look at the wiring, then switch the board on again (it looks for its sensor when it is switched on)"
)
FOUND = (
    "the board has found its sensor: a new log begins; "
    "those before it hold no sensor's samples: take them out of the folder (check names them)"
)
SETTLES = "the sensor's filters settle: samples come once they have (narrow filters at a low rate take up to a minute)"
#: by ``BoardStatus.reset``; a board reports it until power-up, so it need not have happened in this recording
RESET_WORDS = {
    "watchdog": "the board's last reset since power-up was its watchdog's: its program had hung",
    "fault": "the board's last reset since power-up was behind a fault of its core: its program had gone astray",
}
NO_ANSWER = (0x00, 0xFF)  #: WHO_AM_I of a bus without an answer
#: relative change of a board's stated rate from one connection to the next: three steps of INTERNAL_FREQ_FINE (0.15 % each);
#: two boards differ by some percent, and settings of the rate by a factor of two
RATE_WITHIN = 0.005
ANOTHER = "give another sensor another --out"
#: reports of faults; a sensor with a loose wire causes them all the time
MOST_REPORTS = 20


class BoardReporter:
    """Turns a board's messages into lines for the operator, and refuses another board's."""

    def __init__(self) -> None:
        self.board: BoardStatus | None = None
        self.faults: tuple[float, ...] | None = None  # the last, of whichever connection: a recording is of one board
        self.counted: Counter[str] = Counter()  #: faults of the whole recording, by name; those before it are not the recording's
        self._reports = 0
        self._open_fault = False  # a fault was reported, and its lost samples may be counted only once the sensor is back
        # A reset shows in the board's status and in the stamps of its samples, mostly in this order; its cause is reported once.
        self._status_first = self._stamps_first = False  # so far only the one, or only the other
        self._serial: str | None = None
        self._odr_hz: float | None = None  # as it was stated last
        self._reconnected = False  # since then

    def new_connection(self) -> None:
        """Messages from here on may be of a board that was switched on again, or of another one."""
        self.board, self._reconnected = None, True
        self._open_fault = self._status_first = self._stamps_first = False

    def was_reset(self) -> list[str]:
        """The samples' stamps have begun again: the line with the cause of the reset, unless it is reported already, or not known."""
        cause = self.board.reset if self.board is not None else ""
        known, self._status_first = self._status_first, False
        self._stamps_first = not (known or cause)
        return [RESET_WORDS[cause]] if cause and not known else []

    def changes_source(self, board: BoardStatus) -> bool:
        """Whether the samples come from another source from here on: the sensor instead of its stand-in, or the reverse."""
        return self.board is not None and board.source != self.board.source

    def hear(self, message: AnyEvent) -> list[str]:
        """The lines of a message; none where it brings no news."""
        if isinstance(message, BoardStatus):
            return self._status(message)
        if not isinstance(message, Event):
            return []
        if message.kind == "tested" and (failed := message.numbers[0]):
            return [f"the sensor's self-test failed (bits 0x{int(failed):X})"]
        return self._faults(message.numbers) if message.kind == "faults" else []

    def _status(self, message: BoardStatus) -> list[str]:
        before, changes, self.board = self.board, self.changes_source(message), message
        lines = [FOUND] if changes and message.source == SENSOR else []
        if message.source == SENSOR and message.settles and not (before is not None and before.settles):
            lines.append(SETTLES)
        if before is None or message.reset != before.reset:
            lines += [RESET_WORDS[message.reset]] if message.reset else []
            self._status_first = before is not None and not self._stamps_first
        self._stamps_first = False
        if message.source != STANDIN or (before is not None and before.source == STANDIN):
            return lines
        if message.who_am_i in NO_ANSWER:
            return [*lines, NO_SENSOR]
        who = "a sensor answers on its bus, but did not start"
        if message.who_am_i not in CHIPS:
            who = f"a chip that is no {' and no '.join(CHIPS.values())} answers on its bus"
        return [*lines, f"{NO_SENSOR}; {who}: WHO_AM_I 0x{message.who_am_i:02X}"]

    def _faults(self, counts: tuple[float, ...]) -> list[str]:
        before, self.faults = self.faults, counts
        old = before or (0,) * len(FAULTS)
        if any(now < then for now, then in zip(counts, old, strict=True)):  # the board was switched on again: it counts from zero
            old = (0,) * len(FAULTS)
        risen = {name: int(now - then) for name, now, then in zip(FAULTS, counts, old, strict=True) if now > then}
        if before is not None:
            self.counted.update(risen)
        kinds = [name for name in risen if name not in COUNTED_APART]
        if not risen:
            return []
        if not kinds:  # samples lost without a fault are the cost of setting the sensor again
            was_open, self._open_fault = self._open_fault and "lost" in risen, self._open_fault and "lost" not in risen
            return [f"the sensor is back: {risen['lost']} samples lost"] if was_open else []
        self._open_fault = True
        self._reports += 1
        if self._reports > MOST_REPORTS:
            return []
        what = "; ".join(f"{FAULT_WORDS[name][0]} ({risen[name]}×)" for name in kinds)
        lost = risen.get("lost", 0) + risen.get("crowded_out", 0)
        how_many = f"{lost} samples lost" if lost else "no sample lost so far"
        do = "; ".join(dict.fromkeys(FAULT_WORDS[name][1] for name in kinds))
        lines = [f"{'before this recording: ' if before is None else ''}{what}: {how_many}; {do}"]
        if self._reports == MOST_REPORTS:
            lines.append(f"this was the {MOST_REPORTS}th fault, later ones are not shown; the logs' comments hold all")
        return lines

    def require_same(self, info: Info) -> None:
        """OtherSensor where the info is of another sensor than those before, resumed or not: two sensors have two calibrations.

        Within a connection a board may correct its rate.
        """
        named = info.serial not in NO_SERIAL
        if named and self._serial not in (None, info.serial):
            raise OtherSensor(f"the board sends serial={info.serial}, this recording is of {self._serial}; {ANOTHER}")
        changed = self._odr_hz is not None and abs(info.odr_hz / self._odr_hz - 1) > RATE_WITHIN
        if changed and self._reconnected:
            who = "this is another board, or it was set otherwise" if named else "this is another board (it has no serial number)"
            raise OtherSensor(f"the board sends odr_hz={info.odr_hz:g}, this recording's {self._odr_hz:g}: {who}; {ANOTHER}")
        self._serial = info.serial if named else self._serial
        self._odr_hz, self._reconnected = info.odr_hz, False
