"""The stream decoder: bytes in, events out.

It has three modes.  ``frames``: what stands between two zero bytes is a frame.  ``text``: what stands between two line ends is a line.
Without a mode, at the start and whenever a mode has lost its footing, both are tried on the same bytes, and the first whole frame with a
good check, or the first whole line, decides.  Every decision is made at a fixed place in the stream, so it does not matter how the bytes
were divided on their way.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from session.bench import frames
from session.bench.continuity import Continuity, StepFilter
from session.bench.events import (
    CHANGES,
    REGISTERS,
    REMARKS,
    Allowance,
    AnyEvent,
    BoardStatus,
    Event,
    EventCollector,
    Info,
    SampleChunk,
    StreamFormat,
)
from session.bench.text_stream import LONGEST_LINE, Garbage, LineReader, parse_comment


class DecodedFrames(NamedTuple):
    """What b blocks between zero bytes hold.

    readings: n samples, of the blocks rows (n,); behind: whether something unreadable came behind the last one.
    infos, messages: bodies of info frames and of board messages, by their blocks.
    left_over (b,): bytes of each block that are none of these; crc_errors: number of blocks of the right length with a wrong check.
    """

    readings: SampleChunk
    rows: np.ndarray
    behind: bool
    infos: dict[int, np.ndarray]
    messages: dict[int, np.ndarray]
    left_over: np.ndarray
    crc_errors: int


def decode_frames(codes: np.ndarray, ends: np.ndarray, lengths: np.ndarray) -> DecodedFrames:
    """Decode the b blocks of codes (n,) uint8, each between two zero bytes, that end at ``ends`` and have these lengths.

    A whole frame at the end of a longer block counts: what was before it only lost its delimiter.  In a block that is longer than any
    line nothing counts.
    """
    sample, info, bad = frames.SAMPLE_BYTES, frames.INFO_BYTES, lengths > 0
    rows, bodies = _good_frames(codes, ends, np.flatnonzero((lengths >= sample) & (lengths <= LONGEST_LINE)), sample)
    bad[rows] = False
    table = np.ascontiguousarray(bodies).view(frames.SAMPLE)[:, 0]
    ours = table["type"] == frames.SAMPLE_TYPE
    table, rows = table[ours], rows[ours]
    found, bodies = _good_frames(codes, ends, np.flatnonzero(lengths == info), info)
    bad[found] = False
    infos = {row: body for row, body in zip(found.tolist(), bodies, strict=True) if body[0] == frames.INFO_TYPE}
    left = np.flatnonzero(bad & (lengths >= frames.SHORTEST_OTHER) & (lengths <= frames.LONGEST_OTHER))
    types = codes[ends[left] - lengths[left] + 1]
    left = left[(types >= frames.FIRST_OTHER) & (types <= frames.LAST_OTHER)]
    messages: dict[int, np.ndarray] = {}
    for length in np.unique(lengths[left]).tolist():
        found, bodies = _good_frames(codes, ends, left[lengths[left] == length], length)
        messages.update(zip(found.tolist(), bodies, strict=True))
        bad[found] = False
    wrong = bad & ((lengths == sample) | (lengths == info))
    left_over = np.where(bad & ~wrong, lengths, 0)
    left_over[rows] = lengths[rows] - sample
    spoilt = np.cumsum(bad | (left_over > 0))
    damaged = np.diff(spoilt[rows], prepend=0) > 0
    behind = len(spoilt) > 0 and int(spoilt[-1]) > (int(spoilt[rows[-1]]) if len(rows) else 0)
    t_us, registers, sequence = table["t_us"].astype(np.int64), table["registers"].astype(np.int16), table["sequence"].astype(np.int64)
    readings = SampleChunk(t_us, registers, REGISTERS, damaged, sequence)
    return DecodedFrames(readings, rows, behind, infos, messages, left_over, int(np.count_nonzero(wrong)))


def _good_frames(codes: np.ndarray, ends: np.ndarray, rows: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Those of the rows whose block ends in a good frame of so many bytes, and the bodies (n, size - 3) of these."""
    bodies, good = frames.decode_blocks(codes[ends[rows, None] + np.arange(-size, 0)])
    return rows[good], bodies[good]


def frame_ending_at(codes: np.ndarray, places: np.ndarray, tried: np.ndarray, lengths: np.ndarray) -> tuple[int | None, int]:
    """The first of the tried delimiters at which a good frame ends that is no longer than ``lengths``, and where that frame begins; None:
    there is no such frame."""
    found = [(len(places), 0)]
    for size, right in ((frames.INFO_BYTES, lengths == frames.INFO_BYTES), (frames.SAMPLE_BYTES, lengths >= frames.SAMPLE_BYTES)):
        good, _ = _good_frames(codes, places, np.flatnonzero(tried & right), size)
        found += [(int(k), int(places[k]) - size) for k in good[:1]]
    first, begin = min(found)
    return (None, 0) if first == len(places) else (first, begin)


def behind_terminators(codes: np.ndarray, ends: np.ndarray, behind_zero: bool, behind_terminator: bool) -> np.ndarray:
    """Whether each of the lines that end at ``ends``, and what is behind the last, begins right behind a zero byte and a line's end.

    Returns (k + 1,) bool.  behind_zero, behind_terminator: what is before codes (n,) uint8.
    """
    starts = np.concatenate([[0], ends + 1])
    behind = np.concatenate([[behind_zero], codes[ends] == 0])[:-1]
    length = ends - starts[:-1]
    blank = (length == 0) | ((length == 1) & (codes[starts[:-1]] == 13)) if len(ends) else behind
    return np.concatenate([[behind_terminator], behind & blank & (codes[ends] == 10)])


def before_line_ends(codes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Whether a line's end follows each of the delimiters (k,): the next byte, or the one behind a carriage return."""
    following = np.concatenate([codes, np.zeros(2, np.uint8)])
    return (following[ends + 1] == 10) | ((following[ends + 1] == 13) & (following[ends + 2] == 10))


#: bytes decoded at once: few behind a change of mode, since another may follow, then twice as many each time
NARROW, WIDE = 1024, 65_536


class StreamDecoder:
    """Detects text or frames, resynchronises after garbage, and counts what is missing.

    Counts so far: samples, lost (samples missing), crc_errors (frames), garbage (bytes), implausible (samples left out), resets, taken
    (bytes), examined (bytes, each as often as it was decoded).  info: the last ``Info``, or None.  mode: "text", "frames", or None
    while it is not known.  header: the header of a text stream that does not send it.
    """

    def __init__(self, header: str | None = None) -> None:
        self._header = header
        self.samples = self.lost = self.crc_errors = self.garbage = self.implausible = self.resets = self.taken = self.examined = 0
        self.info: Info | None = None
        self._period_us: float | None = None
        self._begin()

    def _begin(self) -> None:
        self.mode: str | None = None
        self._buffer, self._window = b"", NARROW
        self._place = 0  # bytes of this connection before what is kept
        self._torn = False  # without a mode: what is kept begins within a line
        self._behind_zero = False  # in text: a zero byte is right before what is kept
        self._behind_terminator = False  # a zero byte and a line's end are
        self._skipping = False  # in frames: bytes up to the next zero byte are garbage
        self._remarks, self._changes = Allowance(*REMARKS), Allowance(*CHANGES)
        self._board: dict[int, bytes] = {}  # the last content of each message that a board repeats each second
        self._text_lines = LineReader(self._header, self._remarks)
        self._form = self._text_lines.form  # of the lines that are taken now
        self._continuity, self._steps = Continuity(), StepFilter(self._form)
        self._damaged = False  # something unreadable came since the last reading
        self._last_us: int | None = None
        self._numbered_before: bool | None = None

    @property
    def measured_odr_hz(self) -> float | None:
        """Samples per second of device time, by the stamps of this connection or else of the last; None before the first."""
        period_us = self._continuity.period_us or self._period_us
        return 1e6 / period_us if period_us else None

    def feed(self, data: bytes) -> list[AnyEvent]:
        """Decode bytes, with what was kept from before; never raises, whatever the bytes."""
        out, self.taken = EventCollector(), self.taken + len(data)
        data, at = self._buffer + data, 0
        while True:
            block = data[at : at + self._window]
            self.examined += len(block)
            used, other_mode = {"frames": self._frames, "text": self._text, None: self._search}[self.mode](block, out)
            at += used
            self._place += used
            if other_mode:
                self._window = NARROW
            elif at - used + len(block) == len(data):
                break
            else:
                self._window = min(WIDE, 2 * self._window)
        self._buffer = data[at:]
        return out.events()

    def finish(self) -> list[AnyEvent]:
        """End the stream, or the connection: what is incomplete is dropped, and what follows starts a new one."""
        out = EventCollector()
        self._period_us = self._continuity.period_us or self._period_us
        whole = self._buffer.rfind(b"\n") + 1 if self.mode == "text" else 0
        if whole:  # short lines that might have been the beginning of a frame
            self._lines(self._buffer[:whole].replace(b"\0", b"\n"), None, out)
        self._garbage(len(self._buffer) - whole if self._buffer[whole:].strip(b"\0") else 0, out)
        self._pass_on(self._continuity.finish(), out)
        self._add(self._steps.finish(), out)
        self._begin()
        return out.events()

    # Each of the three takes what it can of a block from its beginning; it returns how much, and whether the mode has changed.
    def _search(self, block: bytes, out: EventCollector) -> tuple[int, bool]:
        """Without a mode: examine every delimiter for a frame or a line that ends there."""
        codes = np.frombuffer(block, np.uint8)
        places = np.flatnonzero((codes == 0) | (codes == 10))
        is_zero = codes[places] == 0
        # A frame that ends here would begin behind the last zero, a line behind the last delimiter of either kind.
        zeros = np.concatenate([[0], np.maximum.accumulate(np.where(is_zero, places + 1, 0))])
        lines = np.concatenate([[0], places + 1])
        frame, begin = frame_ending_at(codes, places, is_zero, places - zeros[:-1])
        terminators = behind_terminators(codes, places, self._behind_zero, self._behind_terminator)
        whole = ~is_zero | (terminators[:-1] & before_line_ends(codes, places))
        worth = whole & (places > lines[:-1]) & (places - lines[:-1] <= LONGEST_LINE)
        if self._torn:
            worth[:1] = False
        for k in np.flatnonzero(worth[:frame]).tolist():
            if self._text_lines.is_line(block[lines[k] : places[k]].rstrip(b"\r")):
                self._behind_terminator = bool(terminators[k])
                return self._found("text", int(lines[k]), out)
        if frame is not None:
            return self._found("frames", begin, out)
        last = int(np.searchsorted(places, len(block.rstrip(b"\r")) - 1)) if block.endswith((b"\0", b"\0\r")) else len(places)
        keep = max(int(min(zeros[-1], lines[last])), len(block) - LONGEST_LINE - 1)
        self._garbage(keep, out)
        if keep:
            self._torn = block[keep - 1] not in b"\0\n"
            self._behind_zero = block[keep - 1] == 0
            self._behind_terminator = keep == lines[last] and bool(terminators[last])
        return keep, False

    def _found(self, mode: str, begin: int, out: EventCollector) -> tuple[int, bool]:
        self._garbage(begin, out)
        self.mode, self._behind_zero, self._torn = mode, False, False
        self._behind_terminator &= mode == "text"
        return begin, True

    def _frames(self, block: bytes, out: EventCollector) -> tuple[int, bool]:
        codes = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero(codes == 0)
        starts = np.concatenate([[0], ends + 1])
        lengths = np.diff(np.concatenate([ends, [len(block)]]), prepend=-1) - 1  # the last is not complete
        if self._skipping:
            used = int(starts[1]) if len(ends) else len(block)
            self._garbage(used - len(ends[:1]), out)
            self._skipping = not len(ends)
            return used, bool(len(ends))
        too_long = lengths > LONGEST_LINE
        change = np.flatnonzero(too_long & (starts + self._place >= self._changes.earliest))
        count = int(change[0]) if len(change) else len(ends)
        for before, row in pairwise([-1, *np.flatnonzero(too_long[:count]).tolist(), count]):
            if row > before + 1:
                part = slice(before + 1, row)
                self._blocks(block, starts[part], ends[part], lengths[part], out)
            self._garbage(int(lengths[row]) if row < count else 0, out)
        if len(change):
            self.mode = None
            self._changes.spend(self._place + int(starts[count]))
        elif too_long[-1]:
            self._garbage(int(lengths[-1]), out)
            self._skipping = True
            return len(block), False
        return int(starts[count]), bool(len(change))

    def _blocks(self, data: bytes, starts: np.ndarray, ends: np.ndarray, lengths: np.ndarray, out: EventCollector) -> None:
        found = decode_frames(np.frombuffer(data, np.uint8), ends, lengths)
        readings, rows, infos, left_over = found.readings, found.rows, found.infos, found.left_over
        if found.crc_errors:
            self.crc_errors += found.crc_errors
            out.add(Event("crc", found.crc_errors, self._last_us))
        remarks = [row for row in np.flatnonzero(left_over).tolist() if b"#" in data[starts[row] : ends[row]]] if left_over.any() else []
        self._garbage(int(left_over.sum()), out, damages=False)
        damaged_before = self._damaged
        if len(rows):
            readings.damaged[0] |= damaged_before
        begin = earned = 0
        others = self._news(found.messages)
        placed = sorted({*infos, *others, *remarks})
        for row, stop in zip(placed, np.searchsorted(rows, placed).tolist(), strict=True):
            self._remarks.at += stop - earned
            earned = stop
            if (row in infos or row in others) and not self._remarks.spend():
                continue
            if stop > begin:
                self._take(readings.part(begin, stop), out)
            begin = stop
            if row in others:
                out.add(others[row])
            else:
                self._remark(infos.get(row), data[starts[row] : ends[row]], out)
        self._remarks.at += len(rows) - earned
        if len(rows) > begin:
            self._take(readings.part(begin), out)
        self._damaged = found.behind or (damaged_before and not len(rows))

    def _news(self, bodies: dict[int, np.ndarray]) -> dict[int, BoardStatus | Event]:
        """Of bodies by block, in order, those that differ from the last of their type, and every answer."""
        found: dict[int, BoardStatus | Event] = {}
        for row in sorted(bodies):
            body = bodies[row].tobytes()
            kind, content = body[0], body[3:]
            repeated = kind in (frames.BOARD_TYPE, frames.FAULTS_TYPE) and self._board.get(kind) == content
            if not repeated and (message := frames.decode_message(body)) is not None:
                self._board[kind] = content
                found[row] = message
        return found

    def _remark(self, body: np.ndarray | None, block: bytes, out: EventCollector) -> None:
        """Take an info frame's body; without one, comments: a board may send text before its first frame."""
        if body is None:
            for line in block.split(b"\n")[:-1]:
                if line.startswith(b"#") and self._remarks.spend() and (comment := parse_comment(line.rstrip(b"\r"))):
                    out.add(Event("comment", text=comment))
            return
        info = frames.decode_info(body.tobytes())
        self._continuity.info(int(body[1]) | int(body[2]) << 8)
        if info is not None:
            self.info = info
            out.add(info)

    def _text(self, block: bytes, out: EventCollector) -> tuple[int, bool]:
        """Lines.  A zero byte ends what is before it, as a line's end does.

        Behind a line's end it is ignored (firmware that sends ``sizeof`` a string), and before one where the line before ended so as well
        (a string's terminator, then the line's end).  Behind anything else, what it ends is no line; or it is a frame, and the mode
        changes.
        """
        whole = block.rfind(b"\n") + 1
        if not self._behind_zero and b"\0" not in block:
            ends = np.flatnonzero(np.frombuffer(block, np.uint8) == 10) if whole > LONGEST_LINE else np.zeros(0, np.int64)
            if len(block) - whole <= LONGEST_LINE and not (np.diff(ends, prepend=-1) > LONGEST_LINE + 1).any():
                if whole:
                    self._lines(block[:whole], None, out)
                    self._behind_terminator = False
                return whole, False
        codes = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero((codes == 10) | (codes == 0))
        starts = np.concatenate([[0], ends + 1])
        is_zero, lengths = codes[ends] == 0, ends - starts[:-1]
        first = 0 if self._behind_zero else -2 * LONGEST_LINE
        zeros = np.concatenate([[first], np.maximum.accumulate(np.where(is_zero, starts[1:], first))])  # right behind the last zero byte
        exact = np.isin(ends - zeros[:-1], (frames.INFO_BYTES, frames.SAMPLE_BYTES))  # a frame may hold a line's end
        allowed = is_zero & (ends + self._place >= self._changes.earliest)
        frame, begin = frame_ending_at(codes, ends, allowed, np.where(exact, ends - zeros[:-1], lengths))
        used, count = begin, int(np.searchsorted(ends, begin))
        if frame is None:
            # What is behind a zero byte and no longer than a frame may be one.
            last_zero = int(zeros[-1])
            used = last_zero if len(block) - last_zero <= frames.SAMPLE_BYTES else int(starts[-1])
            count = int(np.searchsorted(ends, used))
            if block.endswith((b"\0", b"\0\r")):  # what follows decides what the zero byte is
                count = min(count, int(np.searchsorted(ends, len(block.rstrip(b"\r")) - 1)))
                used = int(starts[count])
        terminators = behind_terminators(codes, ends, self._behind_zero, self._behind_terminator)
        if count:
            torn = (is_zero & (lengths > 0) & ~(terminators[:-1] & before_line_ends(codes, ends))) | (lengths > LONGEST_LINE)
            self._lines(block[: starts[count]].replace(b"\0", b"\n"), torn[:count], out)
        if frame is None and (dropped := len(block) - LONGEST_LINE - 1) > used:
            self._garbage(dropped - used, out)
            used = dropped
        elif frame is not None:
            self._garbage(begin - int(starts[count]), out)
            self.mode = "frames"
            self._changes.spend(self._place + int(ends[frame]))
        if used:
            self._behind_zero = frame is None and block[used - 1] == 0
            self._behind_terminator = frame is None and used == int(starts[count]) and bool(terminators[count])
        return used, frame is not None

    def _lines(self, block: bytes, torn: np.ndarray | None, out: EventCollector) -> None:
        for item in self._text_lines.take(block.replace(b"\r\n", b"\n"), torn):
            if isinstance(item, SampleChunk):
                item.damaged[0] |= self._damaged
                self._damaged = False
                self._take(item, out)
            elif isinstance(item, Garbage):
                self._garbage(item.length, out, damages=item.behind)
            elif isinstance(item, StreamFormat):
                # A header has changed the columns: what was before, if anything, is another recording.
                self._end_run(out)
                self._form, self._steps, self._numbered_before = item, StepFilter(item), None
            else:
                self.info = item if isinstance(item, Info) else self.info
                out.add(item)

    def _take(self, readings: SampleChunk, out: EventCollector) -> None:
        numbered = readings.sequence is not None
        if self._numbered_before not in (None, numbered):
            # The board has changed between frames and text: there is no sequence to continue.
            self._end_run(out)
        if self._numbered_before != numbered:  # for the first, too: a header of text in physical units does not apply to frames
            self._steps = StepFilter(REGISTERS if numbered else self._form)
        self._numbered_before = numbered
        self._pass_on(self._continuity.take(readings), out)

    def _end_run(self, out: EventCollector) -> None:
        """What follows continues nothing."""
        self._pass_on(self._continuity.finish(), out)
        if self._numbered_before is not None:
            self._pass_on([Event("reset", 1, self._last_us)], out)

    def _garbage(self, count: int, out: EventCollector, damages: bool = True) -> None:
        if count:
            self.garbage += count
            self._damaged |= damages
            out.add(Event("garbage", count, self._last_us))

    def _pass_on(self, items: list[SampleChunk | Event], out: EventCollector) -> None:
        for item in items:
            if isinstance(item, SampleChunk):
                self._add(self._steps.take(item), out)
                continue
            if item.kind == "reset":
                self._add(self._steps.finish(), out)
            self._add([item], out)

    def _add(self, events: list[SampleChunk | Event], out: EventCollector) -> None:
        for event in events:
            if isinstance(event, SampleChunk):
                self.samples += len(event)
                self._last_us = int(event.t_us[-1])
            else:
                self.lost += event.count * (event.kind == "lost")
                self.implausible += event.count * (event.kind == "implausible")
                self.resets += event.kind == "reset"
            out.add(event)
