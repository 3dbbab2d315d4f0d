"""What a board says of its sensor, in words for whoever turns the table: faults when their counts rise, a stand-in once."""

from __future__ import annotations

from session.stream.board import SENSOR, STANDIN, Board, Faults, Said, SelfTest

WIRES = "look at supply, wires and their length"
#: what happened, and what to do
FAULT_SAYS = {
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
    "crowded_out": ("the board's port had no room", "a higher --baud, or a lower --odr"),
}
#: of these the board counts samples, or what follows from another fault
COUNTED_APART = ("lost", "starts")
NO_SENSOR = (
    "the board has no sensor (source 0): what comes is made up, or played to it, and calibrates no sensor; "
    "look at the wiring, then switch the board on again (it looks for its sensor when it is switched on)"
)
FOUND = (
    "the board has found its sensor: a new log begins; "
    "those before it hold no sensor's samples: take them out of the folder (check names them)"
)
#: WHO_AM_I of a bus on which nobody answers, and of the sensor and its siblings
NOBODY, FAMILY = (0x00, 0xFF), 0x6B
#: times that faults are said; a sensor with a loose wire would say nothing else
MOST_SAID = 20


class BoardWords:
    """``hear`` what a board says; gives what to say to the person, a line each."""

    def __init__(self) -> None:
        self.board: Board | None = None
        self.faults: Faults | None = None
        self._said = 0
        self._open_fault = False  # one was said, and what it costs may be counted only once the sensor is back

    def new_connection(self) -> None:
        """What is said from here on may be another board's, or of one that was switched on again."""
        self.board = self.faults = None
        self._open_fault = False

    def changes_source(self, board: Board) -> bool:
        """Whether the samples are another's from here on: the sensor's, and not what stood in for it."""
        return self.board is not None and board.source != self.board.source

    def hear(self, said: Said) -> list[str]:
        """In words, where there is something to be said."""
        if isinstance(said, Board):
            found = self.changes_source(said) and said.source == SENSOR
            before, self.board = self.board, said
            if found:
                return [FOUND]
            return [_no_sensor(said)] if said.source == STANDIN and (before is None or before.source != STANDIN) else []
        if isinstance(said, SelfTest):
            return [f"the sensor's self-test failed (bits 0x{said.failed:X})"] if said.failed else []
        if not isinstance(said, Faults):
            return []
        before_faults, self.faults = self.faults, said
        risen = said.since(before_faults)
        if not risen:
            return []
        if not set(risen) - set(COUNTED_APART):  # without a fault it is what setting the sensor anew has cost
            was_open, self._open_fault = self._open_fault and "lost" in risen, self._open_fault and "lost" not in risen
            return [f"the sensor is back: {risen['lost']} samples lost"] if was_open else []
        self._open_fault = True
        self._said += 1
        if self._said > MOST_SAID:
            return []
        words = [_words(risen, since_power_up=before_faults is None)]
        if self._said == MOST_SAID:
            words.append(f"this was the {MOST_SAID}th fault, and they are said no more; the logs' comments have all")
        return words


def _no_sensor(board: Board) -> str:
    if board.who_am_i in NOBODY:
        return NO_SENSOR
    who = "a sensor answers on its bus, but did not start" if board.who_am_i == FAMILY else "a chip that is no ASM330LHH answers on its bus"
    return f"{NO_SENSOR}; {who}: WHO_AM_I 0x{board.who_am_i:02X}"


def _words(risen: dict[str, int], since_power_up: bool) -> str:
    kinds = [name for name in risen if name not in COUNTED_APART]
    what = "; ".join(f"{FAULT_SAYS[name][0]} ({risen[name]}×)" for name in kinds)
    lost = risen.get("lost", 0) + risen.get("crowded_out", 0)
    how_many = f"{lost} samples lost" if lost else "no sample lost so far"
    do = "; ".join(dict.fromkeys(FAULT_SAYS[name][1] for name in kinds))
    do = f"; {do}" if do else ""
    return f"{'before this recording: ' if since_power_up else ''}{what}: {how_many}{do}"
