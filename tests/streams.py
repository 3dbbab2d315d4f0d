"""What a board sends, known sample by sample: as frames and as text, spoilt on the wire, and made to cost a decoder dear."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import TROUBLES, Info, SampleChunk

PERIOD_US = 600


INFO = Info(500.0, 4.0, 1666.5, "77")


def rng(seed=0):
    return np.random.default_rng(seed)


def smooth_registers(count, seed=0):
    """Registers (count, 7) int16 that turn and tremble as a sensor's do."""
    rng = np.random.default_rng(seed)
    k = np.arange(count)[:, None]
    swing = 4000 * np.sin(2 * np.pi * k / np.array([1500, 1900, 2300, 5000, 7000, 9000, 1e9]))
    return np.rint(swing + rng.normal(0, [6, 6, 6, 12, 12, 12, 2], (count, 7))).astype(np.int16)


def sent(count, start_us=1_000_000, seed=0):
    """Device times (count,), unrolled, and registers (count, 7)."""
    return start_us + PERIOD_US * np.arange(count), smooth_registers(count, seed)


def frame_list(t_us, registers, first=0):
    return [row.tobytes() for row in frames.encode_samples(first + np.arange(len(t_us)), t_us, registers)]


def line_list(t_us, registers, end="\n"):
    rows = np.column_stack([t_us % 2**32, registers]).tolist()
    return [(",".join(map(str, row)) + end).encode() for row in rows]


#: a test of both forms
BOTH = pytest.mark.parametrize("encode", [frame_list, line_list], ids=["frames", "text"])


def decode(data, cuts=None, told=None):
    """Decode bytes, whole or in pieces that end at ``cuts``, and finish; told: the header that nobody sends."""
    decoder, events = StreamDecoder(told), []
    edges = [0, *sorted(cuts or []), len(data)]
    for start, stop in itertools.pairwise(edges):
        events += decoder.feed(data[start:stop])
    return decoder, events + decoder.finish()


def samples(events):
    """Device times (n,) and registers (n, 7) of all chunks."""
    chunks = [event for event in events if isinstance(event, SampleChunk)]
    if not chunks:
        return np.zeros(0, np.int64), np.zeros((0, 7), np.int16)
    return np.concatenate([chunk.t_us for chunk in chunks]), np.concatenate([chunk.registers for chunk in chunks])


def same(events, t_us, registers):
    got_us, got = samples(events)
    return np.array_equal(got_us, t_us) and np.array_equal(got, registers)


def strangers(events, t_us, registers):
    """How many samples came out that were not sent: times ``t_us`` increasing."""
    got_us, got = samples(events)
    place = np.searchsorted(t_us, got_us).clip(0, len(t_us) - 1)
    return int(((t_us[place] != got_us) | (registers[place] != got).any(axis=1)).sum())


def troubles(events):
    """Counts by kind."""
    total: dict[str, int] = {}
    for event in events:
        if event.kind in TROUBLES:
            total[event.kind] = total.get(event.kind, 0) + event.count
    return total


def spoilt(messages, seed, lost=0.0, torn=0.0, flip=0.0):
    """The messages on a bad wire: shares of them that are lost, and cut off somewhere, and of all bits that are turned."""
    draw = np.random.default_rng(seed)
    kept = [m[: draw.integers(1, len(m))] if draw.random() < torn else m for m in messages if draw.random() >= lost]
    bits = np.unpackbits(np.frombuffer(b"".join(kept), np.uint8))
    return np.packbits(bits ^ (draw.random(len(bits)) < flip)).tobytes()


def costly(size, seed=1):
    """Streams that cost the most for their length, by name; and ordinary ones to hold them against."""
    draw, registers = np.random.default_rng(seed), smooth_registers(size // 18, seed)
    t_us = PERIOD_US * np.arange(len(registers))
    coded, lines = frame_list(t_us, registers), line_list(t_us, registers)
    short = line_list(60 * np.arange(len(registers)), 0 * registers)
    garbage = [bytes(draw.integers(1, 256, 515, np.uint8)) for _ in range(size // 540)]
    letters = np.frombuffer(b"0123456789,,,,-.#\n\r\0 te", np.uint8)
    disorder = frame_list(draw.integers(0, 2**32, len(registers)), registers)
    streams = {
        "frames": coded,
        "text": lines,
        "frames, 1 % of bits turned": [spoilt(coded, seed, flip=0.01)],
        "a zero behind each line": [line + b"\0" for line in lines],
        "frames between garbage": [part + b"\0" + frame for part, frame in zip(garbage, coded, strict=False)],
        "a line and a frame by turns": [b"\0" + frame + line for frame, line in zip(coded, lines, strict=True)],
        "lines too long": [lines[0], b"1" * 514 + b"\n"] * size,
        "short lines": short,
        "a comment behind each line": [line + b"#a\n" for line in lines],
        "frames in disorder": disorder,
        "a reset every 4 frames": coded[:4] * size,
        "random text": [draw.choice(letters, size).tobytes()],
    }
    return {name: b"".join(parts)[:size] for name, parts in streams.items()}
