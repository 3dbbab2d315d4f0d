"""Streams that are made to cost a decoder dear, and ordinary ones to hold them against: each a function of (bytes, seed)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.bench import frames
from session.bench.events import HEADER, Info

PERIOD_US = 600
PHYSICAL_HEADER = b"t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c\n"
Stream = Callable[[int, int], bytes]


def sample_frames(count: int, seed: int, first: int = 0, period_us: int = PERIOD_US) -> np.ndarray:
    """(count, 25) uint8: frames that follow each other."""
    index = first + np.arange(count)
    return frames.encode_samples(index, index * period_us, _registers(count, seed))


def sample_lines(count: int, seed: int, separator: str = ",", end: str = "\n", short: bool = False) -> list[bytes]:
    """Lines that follow each other; short: one digit a register, and small stamps."""
    step, registers = (1, np.zeros((count, 7), np.int64)) if short else (PERIOD_US, _registers(count, seed))
    rows = np.column_stack([100 * step + np.arange(count) * (60 if short else step), registers]).tolist()
    return [(separator.join(map(str, row)) + end).encode() for row in rows]


def _registers(count: int, seed: int) -> np.ndarray:
    """Registers (count, 7) int16 that turn and tremble as a sensor's do."""
    rng, k = np.random.default_rng(seed), np.arange(count)[:, None]
    swing = 4000 * np.sin(2 * np.pi * k / np.array([1500, 1900, 2300, 5000, 7000, 9000, 1e9]))
    return np.rint(swing + rng.normal(0, [6, 6, 6, 12, 12, 12, 2], (count, 7))).astype(np.int16)


def _joined(parts: list[bytes], size: int) -> bytes:
    """The parts again and again, up to size bytes."""
    data = b"".join(parts)
    return (data * (1 + size // max(1, len(data))))[:size]


def _physical(size: int, seed: int) -> bytes:
    table = np.column_stack([np.arange(size // 60) * PERIOD_US, _registers(size // 60, seed) * 0.0175])
    return PHYSICAL_HEADER + (("%d" + ",%.7g" * 7 + "\n") * len(table) % tuple(table.ravel().tolist())).encode()


def _one_percent_of_bits(data: bytes, seed: int) -> bytes:
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    return np.packbits(bits ^ (np.random.default_rng(seed).random(len(bits)) < 0.01)).tobytes()


#: what a sensor sends
ORDINARY: dict[str, Stream] = {
    "frames": lambda size, seed: sample_frames(size // 25, seed).tobytes(),
    "text": lambda size, seed: b"".join(sample_lines(size // 38, seed)),
    "text with blanks": lambda size, seed: b"".join(sample_lines(size // 45, seed, ", ", "\r\n")),
    "text in dps, g and °C": _physical,
}


def _zero_behind_each_line(size: int, seed: int) -> bytes:
    return b"".join(sample_lines(size // 39, seed, end="\n\0"))


def _zeros_within_lines(size: int, seed: int) -> bytes:
    data = np.frombuffer(b"".join(sample_lines(size // 38, seed)), np.uint8).copy()
    data[np.random.default_rng(seed).integers(0, len(data), len(data) // 60)] = 0
    return data.tobytes()


def _frames_between_garbage(size: int, seed: int) -> bytes:
    rng, coded = np.random.default_rng(seed), sample_frames(size // 540, seed)
    return b"".join(bytes(rng.integers(1, 256, 515, np.uint8)) + b"\0" + frame.tobytes() for frame in coded)


def _lines_and_frames_by_turns(size: int, seed: int) -> bytes:
    count = size // 66
    return b"".join(b"\0" + f.tobytes() + li for f, li in zip(sample_frames(count, seed), sample_lines(count, seed), strict=True))


def _text_and_frames_by_turns(size: int, seed: int) -> bytes:
    """Long enough that the decoder takes each for what it is."""
    count = size // (14 * 38 + 26)
    lines, coded = sample_lines(14 * count, seed), sample_frames(count, seed)
    return b"".join(b"".join(lines[14 * k : 14 * k + 14]) + b"\0" + coded[k].tobytes() for k in range(count))


def _frames_in_disorder(size: int, seed: int) -> bytes:
    """Each good, none fits the one before."""
    rng, count = np.random.default_rng(seed), size // 25
    return frames.encode_samples(rng.integers(0, 2**16, count), rng.integers(0, 2**32, count), _registers(count, seed)).tobytes()


def _frames_after_ten_minutes(size: int, seed: int) -> bytes:
    """Stamps far apart whose numbers nearly fit."""
    count = size // 25
    t_us = np.cumsum(np.where(np.arange(count) % 4, PERIOD_US, 599_000_000 + 37 * np.arange(count)))
    return frames.encode_samples(np.arange(count), t_us, _registers(count, seed)).tobytes()


def _resets(size: int, seed: int, every: int) -> bytes:
    return _joined([row.tobytes() for row in sample_frames(every, seed)], size)


def _infos(size: int, seed: int) -> bytes:
    return _joined([frames.encode_info(k, Info(500.0, 4.0, 1666.5 + k % 2, str(k))) for k in range(2000)], size)


def _bad_infos(size: int, seed: int) -> bytes:
    blocks = np.random.default_rng(seed).integers(1, 256, (size // 18, 18), np.uint8)
    blocks[:, -1] = 0
    return blocks.tobytes()


def _info_behind_each_frame(size: int, seed: int) -> bytes:
    count = size // 43
    coded = frames.encode_samples(2 * np.arange(count), np.arange(count) * PERIOD_US, _registers(count, seed))
    return b"".join(row.tobytes() + frames.encode_info(2 * k + 1, Info(500.0, 4.0, 1666.5, str(k))) for k, row in enumerate(coded))


def _every_second_frame_bad(size: int, seed: int) -> bytes:
    coded = sample_frames(size // 25, seed)
    coded[1::2, 9] ^= 1
    return coded.tobytes()


def _steps_beside_damage(size: int, seed: int) -> bytes:
    """A register that goes out and back at every second frame, while the wire is bad."""
    count = size // 25
    registers = _registers(count, seed)
    registers[::2, 0] += 9000
    coded = frames.encode_samples(np.arange(count), np.arange(count) * PERIOD_US, registers)
    coded[::500, 9] ^= 1
    return coded.tobytes()


def _widths_by_turns(size: int, seed: int) -> bytes:
    lines = sample_lines(2000, seed)
    return _joined([line if k % 2 else line[:-1] + b",1\n" for k, line in enumerate(lines)], size)


def _header_before_each_line(size: int, seed: int) -> bytes:
    return b"".join((HEADER.encode() + b"\n" if k % 2 else PHYSICAL_HEADER) + line for k, line in enumerate(sample_lines(size // 77, seed)))


def _comment_behind_each_line(size: int, seed: int) -> bytes:
    return b"".join(line + b"#a\n" for line in sample_lines(size // 41, seed))


def _lines_in_disorder(size: int, seed: int) -> bytes:
    lines = sample_lines(size // 38, seed)
    return b"".join(lines[k] for k in np.random.default_rng(seed).permutation(len(lines)))


def _random(size: int, seed: int) -> bytes:
    return np.random.default_rng(seed).bytes(size)


def _random_text(size: int, seed: int) -> bytes:
    letters = np.frombuffer(b"0123456789,,,,-.#\n\r\0 te", np.uint8)
    return np.random.default_rng(seed).choice(letters, size).tobytes()


#: what costs the most for its length; what repeats a few pieces is in test_stream_work.py
ADVERSARIAL: dict[str, Stream] = {
    "frames, 1 % of bits turned": lambda size, seed: _one_percent_of_bits(sample_frames(size // 25, seed).tobytes(), seed),
    "text, 1 % of bits turned": lambda size, seed: _one_percent_of_bits(b"".join(sample_lines(size // 38, seed)), seed),
    "a zero behind each line": _zero_behind_each_line,
    "zeros within lines": _zeros_within_lines,
    "frames between garbage": _frames_between_garbage,
    "a line and a frame by turns": _lines_and_frames_by_turns,
    "14 lines and a frame by turns": _text_and_frames_by_turns,
    "no delimiter in text": lambda size, seed: b"".join(sample_lines(2, seed)) + b"1" * size,
    "lines too long": lambda size, seed: _joined([*sample_lines(1, seed), b"1" * 514 + b"\n"], size),
    "short lines": lambda size, seed: b"".join(sample_lines(size // 18, seed, short=True)),
    "short lines with blanks": lambda size, seed: b"".join(sample_lines(size // 26, seed, ", ", short=True)),
    "short lines with a word": lambda size, seed: b"".join(sample_lines(size // 20, seed, end=",a\n", short=True)),
    "lines in disorder": _lines_in_disorder,
    "lines of two widths by turns": _widths_by_turns,
    "comments": lambda size, seed: _joined([b"#a\n"], size),
    "a comment behind each line": _comment_behind_each_line,
    "a header before each line": _header_before_each_line,
    "frames in disorder": _frames_in_disorder,
    "gaps of ten minutes": _frames_after_ten_minutes,
    "a reset every 4 frames": lambda size, seed: _resets(size, seed, 4),
    "info frames": _infos,
    "bad info frames": _bad_infos,
    "an info frame behind each frame": _info_behind_each_frame,
    "every second frame bad": _every_second_frame_bad,
    "steps beside damage": _steps_beside_damage,
    "random bytes": _random,
    "random text": _random_text,
}
