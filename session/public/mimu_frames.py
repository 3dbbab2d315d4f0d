"""The frames of a MIMU4444 board, as a host has received them.

A frame is 106 bytes, big-endian: u8 0xAA, u16 number, u8 100 (bytes of payload), u32 ticks of 64 MHz, 48 x i16 (unit by unit: ax ay az
gx gy gz), u16 sum of all bytes before it.  Number and ticks wrap.  Before the first frame lies the board's answer to the host's command.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.public.sources import bytes_of

UNITS = 8
HEAD, PAYLOAD = 0xAA, 100
LENGTH = 106
SUMMED = LENGTH - 2
#: bytes before the first frame: 4 in every file of the authors, and less than a frame, or a damaged first one would pass for an answer
LONGEST_ANSWER = 16
AGAIN = "download it again"


def read_frames(path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """ticks (N,) int64, 0 at the first frame; registers (N, 8, 6) int16; and how many bytes of a last frame were cut off the end.

    Raises FormatError for a wrong checksum, a missing frame, a file without frames.
    """
    raw = bytes_of(path)
    first = _first_frame(raw)
    if first is None:
        raise FormatError(f"{path}: no whole frame with a right checksum at its beginning; expected the authors' data.bin, {AGAIN}")
    count = (len(raw) - first) // LENGTH
    frames = raw[first : first + count * LENGTH].reshape(count, LENGTH)
    if not (right := _right(frames)).all():
        wrong = int(np.argmin(right))
        raise FormatError(f"{path}: frame {wrong} at byte {first + wrong * LENGTH} is cut short or has a wrong checksum; {AGAIN}")
    step = np.diff(_unsigned(frames[:, 1:3])) % 2**16
    if (step != 1).any():
        wrong = int(np.argmax(step != 1)) + 1
        raise FormatError(f"{path}: {(step[wrong - 1] - 1) % 2**16} frames are missing before frame {wrong}; {AGAIN}")
    rest = raw[first + count * LENGTH :]
    if len(rest) and rest[0] != HEAD:
        raise FormatError(f"{path}: its last {len(rest)} bytes are not the beginning of a frame; {AGAIN}")
    ticks = np.concatenate([[0], np.cumsum(np.diff(_unsigned(frames[:, 4:8])) % 2**32)])
    registers = np.ascontiguousarray(frames[:, 8:SUMMED]).view(">i2").astype(np.int16).reshape(count, UNITS, 6)
    return ticks, registers, len(rest)


def _first_frame(raw: np.ndarray) -> int | None:
    """Where the first whole frame begins."""
    for start in range(min(LONGEST_ANSWER, len(raw) - LENGTH) + 1):
        if _right(raw[None, start : start + LENGTH])[0]:
            return start
    return None


def _right(frames: np.ndarray) -> np.ndarray:
    """(N,) bool: frames (N, 106) uint8 whose head and checksum are right."""
    total = frames[:, :SUMMED].sum(axis=1, dtype=np.int64) % 2**16
    return (frames[:, 0] == HEAD) & (frames[:, 3] == PAYLOAD) & (total == _unsigned(frames[:, SUMMED:]))


def _unsigned(columns: np.ndarray) -> np.ndarray:
    """(N,) int64 of big-endian bytes (N, B)."""
    return columns.astype(np.int64) @ (256 ** np.arange(columns.shape[1] - 1, -1, -1))
