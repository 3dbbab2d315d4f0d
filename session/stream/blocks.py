"""What stands between zero bytes, many blocks at a time: sample frames, info frames, frames for others, and what is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.stream import frames
from session.stream.readings import Readings
from session.stream.text import LONGEST_LINE


@dataclass(frozen=True, eq=False)
class Blocks:
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

    def part(self, begin: int, stop: int) -> Readings:
        """Readings begin <= i < stop."""
        table = self.readings[begin:stop]
        registers = table["registers"].astype(np.int16)
        return Readings(table["sequence"].astype(np.int64), table["t_us"].astype(np.int64), registers, self.damaged[begin:stop])


def take_apart(codes: np.ndarray, ends: np.ndarray, lengths: np.ndarray) -> Blocks:
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
    return Blocks(readings, rows, damaged, behind, infos, others, left_over, int(np.count_nonzero(wrong)))


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
