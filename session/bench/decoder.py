"""Bytes in, events out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.bench import frames
from session.bench.continuity import Continuity, StepFilter
from session.bench.events import (
    REGISTERS,
    AcceptedSamples,
    BoardMessageFilter,
    Collector,
    Comment,
    Event,
    Info,
    ModeChangeBudget,
    ReceivedSamples,
    RemarkBudget,
    SampleChunk,
    StreamFormat,
    Trouble,
)
from session.bench.text_stream import LONGEST_LINE, Garbage, LineClasses, LineReader, TextRows, parse_comment
from session.bench.text_stream import LONGEST_LINE as LONGEST

# What stands between zero bytes, many blocks at a time: sample frames, info frames, frames for others, and what is none.


@dataclass(frozen=True, eq=False)
class DecodedFrames:
    """Of b blocks.  readings (n,) frames.SAMPLE and the blocks they are of, rows (n,); damaged (n,) bool, whether something unreadable
    came since the one before; behind: whether it did behind the last one; infos, others: bodies by block, of info frames and
    of what else a board says; left_over (b,) bytes of each that
    are neither; crc_errors: blocks of the right length whose check is wrong."""

    readings: np.ndarray
    rows: np.ndarray
    damaged: np.ndarray
    behind: bool
    infos: dict[int, np.ndarray]
    others: dict[int, np.ndarray]
    left_over: np.ndarray
    crc_errors: int

    def part(self, begin: int, stop: int) -> ReceivedSamples:
        """Readings begin <= i < stop."""
        table = self.readings[begin:stop]
        registers = table["registers"].astype(np.int16)
        return ReceivedSamples(table["sequence"].astype(np.int64), table["t_us"].astype(np.int64), registers, self.damaged[begin:stop])


def decode_frames(codes: np.ndarray, ends: np.ndarray, lengths: np.ndarray) -> DecodedFrames:
    """Blocks of codes (n,) uint8 of these lengths up to these ends.  A whole frame at the end of something longer counts: what was torn
    off or said before it took only its delimiter along; but in what is longer than any line nothing counts."""
    sample, info, bad = frames.SAMPLE_BYTES, frames.INFO_BYTES, lengths > 0
    readings, rows = np.zeros(0, frames.SAMPLE), np.zeros(0, np.int64)
    if len(candidates := np.flatnonzero((lengths >= sample) & (lengths <= LONGEST_LINE))):
        bodies, good = frames.decode_blocks(codes[ends[candidates, None] + np.arange(-sample, 0)])
        rows = candidates[good]
        bad[rows] = False
        table = np.ascontiguousarray(bodies[good]).view(frames.SAMPLE)[:, 0]
        ours = table["type"] == frames.SAMPLE_TYPE
        readings, rows = table[ours], rows[ours]
    infos: dict[int, np.ndarray] = {}
    if len(candidates := np.flatnonzero(lengths == info)):
        bodies, good = frames.decode_blocks(codes[ends[candidates, None] + np.arange(-info, 0)])
        bad[candidates[good]] = False
        good &= bodies[:, 0] == frames.INFO_TYPE
        infos = dict(zip(candidates[good].tolist(), bodies[good], strict=True))
    passed, others = _others(codes, ends, lengths, bad)
    bad[passed] = False
    wrong = bad & ((lengths == sample) | (lengths == info))
    left_over = np.where(bad & ~wrong, lengths, 0)
    left_over[rows] = lengths[rows] - sample
    spoilt = np.cumsum(bad | (left_over > 0))
    damaged = np.diff(spoilt[rows], prepend=0) > 0
    behind = len(spoilt) > 0 and int(spoilt[-1]) > (int(spoilt[rows[-1]]) if len(rows) else 0)
    return DecodedFrames(readings, rows, damaged, behind, infos, others, left_over, int(np.count_nonzero(wrong)))


def _others(codes: np.ndarray, ends: np.ndarray, lengths: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Those of the bad blocks that are whole frames of another type, with which nothing is wrong, and their bodies by block."""
    rows = np.flatnonzero(bad & (lengths >= frames.SHORTEST_OTHER) & (lengths <= frames.LONGEST_OTHER))
    rows = rows[frames.is_other(codes[ends[rows] - lengths[rows] + 1])]
    found = [np.zeros(0, np.int64)]
    said: dict[int, np.ndarray] = {}
    for length in np.unique(lengths[rows]).tolist():
        alike = rows[lengths[rows] == length]
        bodies, good = frames.decode_blocks(codes[ends[alike, None] + np.arange(-length, 0)])
        found.append(alike[good])
        said.update(zip(alike[good].tolist(), bodies[good], strict=True))
    return np.concatenate(found), said


def frame_ending_at(codes: np.ndarray, places: np.ndarray, tried: np.ndarray, lengths: np.ndarray) -> tuple[int | None, int]:
    """The first delimiter of those to be tried at which a good frame ends that is no longer than ``lengths`` say, and where it begins;
    None: at none."""
    found = [(len(places), 0)]
    for size, right in ((frames.INFO_BYTES, lengths == frames.INFO_BYTES), (frames.SAMPLE_BYTES, lengths >= frames.SAMPLE_BYTES)):
        if len(rows := np.flatnonzero(tried & right)):
            good = frames.decode_blocks(codes[places[rows, None] + np.arange(-size, 0)])[1]
            found += [(int(k), int(places[k]) - size) for k in rows[good][:1]]
    first, begin = min(found)
    return (None, 0) if first == len(places) else (first, begin)


# Bytes in, events out.
#
# Three modes.  ``frames``: what stands between two zero bytes is a frame.  ``text``: what stands between two line ends is a line.
# Neither, at the start and whenever a mode has lost its footing: both are tried on the same bytes, and the first whole frame with a good
# check, or the first whole line, decides.  Every decision is made at a fixed place in the stream, so that it does not matter how the
# bytes were cut on their way.

#: bytes looked at in one go: few behind a change of mode, since another may follow, then twice as many each time
NARROW, WIDE = 1024, 65_536


class StreamDecoder:
    """Tells text from frames by itself, finds its way back after garbage, counts what is missing.

    Counts so far: samples, lost (samples missing), crc_errors (frames), garbage (bytes), implausible (samples left out), resets.
    told: the header of a text stream that does not send it.  info: the last ``Info``, or None.
    mode: "text" or "frames", or None while it is not known.  taken: bytes so far; examined: each as often as it was looked at.
    """

    def __init__(self, told: str | None = None) -> None:
        self._told = told
        self.samples = self.lost = self.crc_errors = self.garbage = self.implausible = self.resets = self.taken = self.examined = 0
        self.info: Info | None = None
        self._period_us: float | None = None
        self._begin()

    def _begin(self) -> None:
        self.mode: str | None = None
        self._buffer, self._window = b"", NARROW
        self._place = 0  # bytes of this connection before what is kept
        self._torn = False  # whether, without a mode, what is kept begins within a line
        self._behind_zero = False  # whether, in text, a zero byte is right before what is kept
        self._passing_over = False  # whether, in frames, what comes up to the next zero byte is none
        self._remarks, self._changes, self._board = RemarkBudget(), ModeChangeBudget(), BoardMessageFilter()
        self._text_lines = LineReader(self._told, self._remarks)
        self._form = self._text_lines.form  # of the lines that are taken now
        self._continuity, self._steps = Continuity(), StepFilter(self._form)
        self._damaged = False  # something unreadable came since the last reading
        self._last_us: int | None = None
        self._numbered_before: bool | None = None

    @property
    def measured_odr_hz(self) -> float | None:
        """Samples per second of device time, as the stamps of this connection show it, or else of the last; None before the first."""
        period_us = self._continuity.period_us or self._period_us
        return 1e6 / period_us if period_us else None

    def feed(self, data: bytes) -> list[Event]:
        """Events of these bytes and of what was kept from before; never raises, whatever the bytes."""
        out, self.taken = Collector(), self.taken + len(data)
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

    def finish(self) -> list[Event]:
        """The stream ends here, or the port was closed: what is incomplete is dropped, what follows begins anew."""
        out = Collector()
        self._period_us = self._continuity.period_us or self._period_us
        whole = self._buffer.rfind(b"\n") + 1 if self.mode == "text" else 0
        if whole:  # short lines that might have been the beginning of a frame
            self._lines(self._buffer[:whole].replace(b"\0", b"\n"), None, out)
        self._garbage(len(self._buffer) - whole, out)
        self._pass_on(self._continuity.finish(), out)
        self._add(self._steps.finish(), out)
        self._begin()
        return out.events()

    # Each of the three takes what it can of a block from its beginning; returned: how much, and whether another mode is to go on.
    def _search(self, block: bytes, out: Collector) -> tuple[int, bool]:
        """No mode yet: look at every delimiter for a frame or a line that ends there."""
        codes = np.frombuffer(block, np.uint8)
        places = np.flatnonzero((codes == 0) | (codes == 10))
        is_zero = codes[places] == 0
        # Where a frame and where a line that ends here would begin: behind the last zero, and behind the last delimiter of either kind.
        zeros = np.concatenate([[0], np.maximum.accumulate(np.where(is_zero, places + 1, 0))])
        lines = np.concatenate([[0], places + 1])
        frame, begin = frame_ending_at(codes, places, is_zero, places - zeros[:-1])
        worth = LineClasses(codes, lines[:-1], places).worth & ~is_zero & (places - lines[:-1] <= LONGEST)
        if self._torn:
            worth[:1] = False
        for k in np.flatnonzero(worth[:frame]).tolist():
            if self._text_lines.is_line(block[lines[k] : places[k]].rstrip(b"\r")):
                return self._found("text", int(lines[k]), out)
        if frame is not None:
            return self._found("frames", begin, out)
        keep = max(int(min(zeros[-1], lines[-1])), len(block) - LONGEST - 1)
        self._garbage(keep, out)
        if keep:
            self._torn = block[keep - 1] not in b"\0\n"
        return keep, False

    def _found(self, mode: str, begin: int, out: Collector) -> tuple[int, bool]:
        self._garbage(begin, out)
        self.mode, self._behind_zero, self._torn = mode, False, False
        return begin, True

    def _frames(self, block: bytes, out: Collector) -> tuple[int, bool]:
        codes = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero(codes == 0)
        starts = np.concatenate([[0], ends + 1])
        lengths = np.diff(np.concatenate([ends, [len(block)]]), prepend=-1) - 1  # the last is not complete
        if self._passing_over:
            used = int(starts[1]) if len(ends) else len(block)
            self._garbage(used - len(ends[:1]), out)
            self._passing_over = not len(ends)
            return used, bool(len(ends))
        too_long = lengths > LONGEST
        change = np.flatnonzero(too_long & (starts + self._place >= self._changes.earliest))
        count = int(change[0]) if len(change) else len(ends)
        for before, row in pairwise([-1, *np.flatnonzero(too_long[:count]).tolist(), count]):
            if row > before + 1:
                part = slice(before + 1, row)
                self._blocks(codes, block, starts[part], ends[part], lengths[part], out)
            self._garbage(int(lengths[row]) if row < count else 0, out)  # as it is passed over where its end has not come yet
        if len(change):
            self.mode = None
            self._changes.change(self._place + int(starts[count]))
        elif too_long[-1]:
            self._garbage(int(lengths[-1]), out)
            self._passing_over = True
            return len(block), False
        return int(starts[count]), bool(len(change))

    def _blocks(self, codes: np.ndarray, data: bytes, starts: np.ndarray, ends: np.ndarray, lengths: np.ndarray, out: Collector) -> None:
        blocks = decode_frames(codes, ends, lengths)
        if blocks.crc_errors:
            self.crc_errors += blocks.crc_errors
            out.add(Trouble("crc", blocks.crc_errors, self._last_us))
        left_over, rows = blocks.left_over, blocks.rows
        remarks = [row for row in np.flatnonzero(left_over).tolist() if b"#" in data[starts[row] : ends[row]]] if left_over.any() else []
        self._garbage(int(left_over.sum()), out, damages=False)
        damaged_before = self._damaged
        if len(rows):
            blocks.damaged[0] |= damaged_before
        begin = earned = 0
        others = self._board.fresh(blocks.others)
        said = sorted({*blocks.infos, *others, *remarks})
        for row, stop in zip(said, np.searchsorted(rows, said).tolist(), strict=True):
            self._remarks.earn(stop - earned)
            earned = stop
            if (row in blocks.infos or row in others) and not self._remarks.spend():
                continue
            if stop > begin:
                self._take(blocks.part(begin, stop), out)
            begin = stop
            if row in others:
                out.add(others[row])
            else:
                self._word(blocks.infos.get(row), data[starts[row] : ends[row]], out)
        self._remarks.earn(len(rows) - earned)
        if len(rows) > begin:
            self._take(blocks.part(begin, len(rows)), out)
        self._damaged = blocks.behind or (damaged_before and not len(rows))

    def _word(self, body: np.ndarray | None, block: bytes, out: Collector) -> None:
        """An info frame's body; without one, text: a board that starts up may say something before its first frame."""
        if body is None:
            for line in block.split(b"\n")[:-1]:
                if line.startswith(b"#") and self._remarks.spend() and (comment := parse_comment(line.rstrip(b"\r"))):
                    out.add(Comment(comment))
            return
        info = frames.decode_info(body.tobytes())
        self._continuity.info(int(body[1]) | int(body[2]) << 8)
        if info is not None:
            self.info = info
            out.add(info)

    def _text(self, block: bytes, out: Collector) -> tuple[int, bool]:
        """Lines.  A zero byte ends what is before it, as a line's end does: behind a line's end it says nothing (firmware that sends
        ``sizeof`` a string), behind anything else that was no line; or it was a frame, and frames go on."""
        whole = block.rfind(b"\n") + 1
        if not self._behind_zero and b"\0" not in block:
            ends = np.flatnonzero(np.frombuffer(block, np.uint8) == 10) if whole > LONGEST else np.zeros(0, np.int64)
            if len(block) - whole <= LONGEST and not (np.diff(ends, prepend=-1) > LONGEST + 1).any():
                if whole:
                    self._lines(block[:whole], None, out)
                return whole, False
        codes = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero((codes == 10) | (codes == 0))
        starts = np.concatenate([[0], ends + 1])
        is_zero, lengths = codes[ends] == 0, ends - starts[:-1]
        first = 0 if self._behind_zero else -2 * LONGEST
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
        if count:
            torn = (is_zero & (lengths > 0)) | (lengths > LONGEST)
            self._lines(block[: starts[count]].replace(b"\0", b"\n"), torn[:count], out)
        if frame is None and (dropped := len(block) - LONGEST - 1) > used:
            self._garbage(dropped - used, out)
            used = dropped
        elif frame is not None:
            self._garbage(begin - int(starts[count]), out)
            self.mode = "frames"
            self._changes.change(self._place + int(ends[frame]))
        self._behind_zero = frame is None and (used == int(zeros[-1]))
        return used, frame is not None

    def _lines(self, block: bytes, torn: np.ndarray | None, out: Collector) -> None:
        for item in self._text_lines.take(block.replace(b"\r\n", b"\n"), torn):
            if isinstance(item, TextRows):
                self._stamped(item, out)
            elif isinstance(item, Garbage):
                self._garbage(item.count, out, damages=item.behind)
            elif isinstance(item, StreamFormat):
                self._another_form(item, out)
            else:
                self.info = item if isinstance(item, Info) else self.info
                out.add(item)

    def _stamped(self, rows: TextRows, out: Collector) -> None:
        damaged = rows.damaged.copy()
        damaged[0] |= self._damaged
        self._damaged = False
        self._take(ReceivedSamples(None, rows.t_us, rows.values, damaged), out)

    def _another_form(self, form: StreamFormat, out: Collector) -> None:
        """A header says that the columns are others: what was before, if anything, is another recording."""
        self._pass_on(self._continuity.finish(), out)
        if self._numbered_before is not None:
            self._pass_on([Trouble("reset", 1, self._last_us)], out)
        self._add(self._steps.finish(), out)
        self._form, self._steps, self._numbered_before = form, StepFilter(form), None

    def _take(self, readings: ReceivedSamples, out: Collector) -> None:
        numbered = readings.sequence is not None
        if self._numbered_before not in (None, numbered):
            # The board was told to speak otherwise: what was before has no sequence to go on from.
            self._pass_on(self._continuity.finish(), out)
            self._pass_on([Trouble("reset", 1, self._last_us)], out)
        if self._numbered_before != numbered:  # the first, too: a header of text in physical units says nothing of frames
            self._steps = StepFilter(REGISTERS if numbered else self._form)
        self._numbered_before = numbered
        self._pass_on(self._continuity.take(readings), out)

    def _garbage(self, count: int, out: Collector, damages: bool = True) -> None:
        if count:
            self.garbage += count
            self._damaged |= damages
            out.add(Trouble("garbage", count, self._last_us))

    def _pass_on(self, items: list[AcceptedSamples | Trouble], out: Collector) -> None:
        for item in items:
            if isinstance(item, AcceptedSamples):
                self._add(self._steps.take(item), out)
                continue
            if item.kind == "reset":
                self._add(self._steps.finish(), out)
            self._add([item], out)

    def _add(self, events: list[SampleChunk | Trouble], out: Collector) -> None:
        for event in events:
            if isinstance(event, SampleChunk):
                self.samples += len(event)
                self._last_us = int(event.t_us[-1])
            else:
                self.lost += event.count * (event.kind == "lost")
                self.implausible += event.count * (event.kind == "implausible")
                self.resets += event.kind == "reset"
            out.add(event)
