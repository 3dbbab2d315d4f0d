"""The stream decoder: frames and text, cut anywhere, damaged anyhow, or composed of sound frames in any order."""

from __future__ import annotations

import binascii
import itertools
from pathlib import Path

import numpy as np

from fuzz_targets.material import FRAMES, INFO, INFO_FRAME, REGISTER_HEADER, REGISTER_LINES, REGISTERS, UNIT_HEADER, UNIT_LINES
from fuzz_targets.rules import choose, finite
from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import Comment, Event, Info, SampleChunk, Trouble

MODES = (None, UNIT_HEADER, "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2,temp_c", "composed")
TIME_WRAP = 2**32
#: sound frames behind everything, of which the later ones must come out whatever was before
LATER = 60
LATER_US = 3_000_000_000 + 9600 * np.arange(LATER)
LATER_REGISTERS = np.tile(REGISTERS[:1], (LATER, 1))
LATER_FRAMES = b"".join(row.tobytes() for row in frames.encode_samples(7000 + np.arange(LATER), LATER_US, LATER_REGISTERS))


def seeds() -> list[bytes]:
    """Frames, text, both forms of text, and a program for ``composed``."""
    text = REGISTER_HEADER.encode() + b"\n" + REGISTER_LINES.encode()
    comment = f"# {INFO.text}\n".encode()
    steady, odd = bytes([1, 0, 0] * 30), bytes([1, 0, 0] * 5 + [2, 9, 1, 4, 3, 2, 65, 66, 5, 3, 6, 200] + [1, 0, 0] * 9)
    return [
        b"\0\x11" + INFO_FRAME + FRAMES,
        b"\0\x12hello\n" + FRAMES + b"\0" + FRAMES[:40] + FRAMES[47:],
        b"\0\x13" + comment + text,
        b"\0\x14" + text.replace(b"\n", b"\r\n") + FRAMES + text,
        b"\0\x15" + UNIT_HEADER.encode() + b"\n" + UNIT_LINES.encode(),
        b"\1\x16" + UNIT_LINES.encode(),
        b"\2\x17" + UNIT_LINES.replace("\n", ",25.5\n").encode(),
        b"\3\x18" + steady,
        b"\3\x19" + odd,
    ]


def run(data: bytes, folder: Path) -> None:
    """What comes out was sent, does not depend on how the bytes were cut, adds up, and does not keep sound frames behind it away."""
    mode, data = choose(data, MODES)
    step, data = choose(data, range(1, 257))
    told = None if mode == "composed" else mode
    stream = _composed(data) if mode == "composed" else data
    decoder, events = _decode(stream, told, [len(stream)])
    for size in (step, 1) if len(stream) < 200 else (step,):
        other, parts = _decode(stream, told, range(size, len(stream) + size, size))
        assert _same(events, parts), f"cut into {size} bytes: other events"
        assert (decoder.mode, decoder.garbage, decoder.crc_errors) == (other.mode, other.garbage, other.crc_errors)
    _adds_up(stream, decoder, events)
    _was_sent(stream, told, events)
    if step % 4 == 0 and told is None:
        _goes_on(stream)


def _decode(stream: bytes, told: str | None, ends: range | list[int]) -> tuple[StreamDecoder, list[Event]]:
    decoder, events = StreamDecoder(told), []
    for start, stop in itertools.pairwise([0, *ends]):
        events += decoder.feed(stream[start:stop])
    return decoder, events + decoder.finish()


def _chunks(events: list[Event]) -> list[SampleChunk]:
    return [event for event in events if isinstance(event, SampleChunk)]


def _same(one: list[Event], other: list[Event]) -> bool:
    """Events of a stream, however they were gathered."""
    samples = []
    for events in (one, other):
        chunks = _chunks(events)
        samples.append(
            [(t, tuple(row), chunk.form) for chunk in chunks for t, row in zip(chunk.t_us, chunk.registers.tolist(), strict=True)]
        )
    said = [[event for event in events if isinstance(event, Comment | Info)] for events in (one, other)]
    return samples[0] == samples[1] and said[0] == said[1] and _troubles(one) == _troubles(other)


def _troubles(events: list[Event]) -> dict[str, int]:
    found: dict[str, int] = {}
    for event in events:
        if isinstance(event, Trouble):
            found[event.kind] = found.get(event.kind, 0) + event.count
    return found


def _adds_up(stream: bytes, decoder: StreamDecoder, events: list[Event]) -> None:
    chunks, counts = _chunks(events), _troubles(events)
    for chunk in chunks:
        finite(chunk.registers)
        assert len(chunk.t_us) == len(chunk.registers)
        assert (chunk.t_us >= 0).all()
    t_us = np.concatenate([np.zeros(0, np.int64), *(chunk.t_us for chunk in chunks)])
    assert "reset" in counts or (np.diff(t_us) > 0).all(), "time goes backward without a reset"
    assert decoder.samples == len(t_us)
    for kind, total in (("crc", decoder.crc_errors), ("garbage", decoder.garbage), ("implausible", decoder.implausible)):
        assert counts.get(kind, 0) == total, kind
    assert (decoder.lost, decoder.resets) == (counts.get("lost", 0), counts.get("reset", 0))
    least = 2 * len(chunks[0].form.names) if chunks and chunks[0].form.physical else 16
    used = decoder.garbage + (decoder.samples + decoder.implausible) * least + decoder.crc_errors * frames.INFO_BYTES
    assert 0 <= used <= len(stream), f"{used} bytes accounted for of {len(stream)}"


def _was_sent(stream: bytes, told: str | None, events: list[Event]) -> None:
    """Every sample stands in the stream: as a frame with its CRC, or as a line with its numbers.  By code of its own."""
    chunks = _chunks(events)
    if not chunks:
        return
    framed = _frames_in(stream)
    lines: dict[str, list[list[str]]] = {}
    for line in stream.replace(b"\0", b"\n").decode("latin-1").split("\n"):
        cells = [cell.strip(" \t\r") for cell in line.split(",")]
        for cell in cells:
            lines.setdefault(cell, []).append(cells)
    for chunk in chunks:
        if chunk.form.physical:
            continue
        for t, row in zip(chunk.t_us.tolist(), chunk.registers.tolist(), strict=True):
            if (t % TIME_WRAP, tuple(row)) in framed:
                continue
            near = [cells for k in range(3) for cells in lines.get(str(t % TIME_WRAP + k * TIME_WRAP), [])]
            near += lines.get(str(t), [])
            assert any({str(value) for value in row} <= set(cells) for cells in near), f"a sample at {t} that nobody sent"


def _frames_in(stream: bytes) -> set[tuple[int, tuple[int, ...]]]:
    """(t_us, registers) of each sound sample frame, found from its closing zero backward."""
    found = set()
    size = frames.SAMPLE_BYTES
    for end in (place for place, byte in enumerate(stream) if byte == 0 and place >= size):
        block, body, at = stream[end - size : end], bytearray(), 0
        while at < size and block[at] and at + block[at] <= size:
            body += block[at + 1 : at + block[at]] + b"\0"
            at += block[at]
        body = body[:-1]
        if at == size and len(body) == size - 1 and body[0] == 1 and _crc_is_right(bytes(body)):
            found.add((int.from_bytes(body[3:7], "little"), tuple(np.frombuffer(bytes(body[7:21]), "<i2").tolist())))
    return found


def _crc_is_right(body: bytes) -> bool:
    return binascii.crc_hqx(body[:-2], 0xFFFF).to_bytes(2, "little") == body[-2:]


def _goes_on(stream: bytes) -> None:
    """Behind anything, and a zero byte, sound frames are found again."""
    decoder = StreamDecoder()
    decoder.feed(stream)
    events = decoder.feed(b"\0" + LATER_FRAMES) + decoder.finish()
    got = {t % TIME_WRAP for chunk in _chunks(events) for t in chunk.t_us.tolist()}
    assert set(LATER_US[LATER // 2 : -1].tolist()) <= got, "sound frames behind it do not come out"


def _composed(program: bytes) -> bytes:
    """A stream of sound frames and lines whose numbers and stamps go on as a program says: an operation, and what it takes."""
    out, sequence, t_us, values = bytearray(), 65500, TIME_WRAP - 200_000, REGISTERS[0].astype(np.int64)
    places = iter(program)
    for op in places:
        a, b = next(places, 0), next(places, 0)
        kind = op % 8
        if kind in (1, 7):  # the next sample: b off the period, register a beyond
            sequence, t_us = sequence + 1, t_us + 9600 + (b if b < 128 else b - 256) * 20
            row = values + np.eye(7, dtype=np.int64)[a % 7] * (a // 7) * 300
            row = ((row + 32768) % 65536 - 32768).astype(np.int16)
            if kind == 1:
                out += frames.encode_samples(np.array([sequence]), np.array([t_us]), row[None]).tobytes()
            else:
                out += ",".join(map(str, [t_us % TIME_WRAP, *row.tolist()])).encode() + b"\n"
        elif kind == 2:  # numbers are skipped
            sequence, t_us = sequence + a, t_us + (a * 9600 if b % 2 else 0)
        elif kind == 3:
            out += bytes([a, b])
        elif kind == 4:
            out += frames.encode_info(sequence := sequence + 1, INFO)
        elif kind == 5:  # a reset, or a jump of the clock
            sequence, t_us = (a, b * 1000) if a < 128 else (sequence, t_us + b * 1_000_000)
        elif kind == 6:
            out += b"\0" if a < 100 else b"\n" if a < 200 else f"# {INFO.text}\n".encode()
        else:  # the end is cut off
            del out[len(out) - min(a, len(out)) :]
    return bytes(out)
