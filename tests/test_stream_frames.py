"""Frames: the check, the coding, byte by byte."""

from __future__ import annotations

import binascii

import numpy as np
from streams import INFO, decode, frame_list, rng, sent

from session.bench import frames
from session.bench.events import Comment


def test_crc_is_the_published_one():
    """CRC-16/CCITT-FALSE of "123456789" is 0x29B1."""
    assert frames.crc(np.frombuffer(b"123456789", np.uint8)[None])[0] == 0x29B1
    bodies = rng().integers(0, 256, (100, 21)).astype(np.uint8)
    assert frames.crc(bodies).tolist() == [binascii.crc_hqx(body.tobytes(), 0xFFFF) for body in bodies]


def test_a_frame_byte_by_byte():
    """Worked out by hand from docs/formats.md and the definition of COBS: registers of zero are the many codes 01."""
    frame = frames.encode_samples(np.array([0x0102]), np.array([0x03000405]), np.zeros((1, 7), np.int16))[0].tobytes()
    body = bytes([1, 0x02, 0x01, 0x05, 0x04, 0x00, 0x03]) + bytes(14)
    check = binascii.crc_hqx(body, 0xFFFF)
    assert frame == bytes([6, 1, 2, 1, 5, 4, 2, 3]) + b"\x01" * 13 + bytes([3, check & 0xFF, check >> 8, 0])
    assert len(frame) == 25
    assert len(frames.encode_info(1, INFO)) == 19


def test_blocks_decode_to_what_was_encoded():
    registers = rng(1).integers(-3, 4, (5000, 7)).astype(np.int16)  # many zeros
    coded = frames.encode_samples(np.arange(5000), np.arange(5000) * 256, registers)
    assert coded[:, :-1].all()
    assert not coded[:, -1].any()
    bodies, good = frames.decode_blocks(coded[:, :-1])
    assert good.all()
    assert np.array_equal(np.ascontiguousarray(bodies).view(frames.SAMPLE)[:, 0]["registers"], registers)


def test_no_frame_with_one_two_or_three_flipped_bits_passes():
    """A CRC-16 with this polynomial has distance 4 at this length; COBS may spread an error, so all places are tried."""
    frame = np.frombuffer(frame_list(*sent(1))[0], np.uint8)[:-1]
    bits = [(byte, 1 << bit) for byte in range(len(frame)) for bit in range(8)]
    pairs = [(a, b) for i, a in enumerate(bits) for b in bits[:i]]
    table = np.tile(frame, (len(pairs), 1))
    for row, pair in enumerate(pairs):
        for byte, mask in pair:
            table[row, byte] ^= mask
    assert not frames.decode_blocks(table[(table != 0).all(axis=1)])[1].any()


def test_what_is_longer_than_any_line_says_nothing_however_the_bytes_are_cut():
    """Found by fuzzing: comments in what is passed over, since modes changed too often, were heard where a read held all of it."""
    t_us, registers = sent(600)
    parts = [b"".join(frame_list(t_us[k : k + 6], registers[k : k + 6], k)) + 600 * b"x" + b"\n# said=1\n\0" for k in range(0, 600, 6)]
    data = b"\0" + b"".join(parts)
    whole, events = decode(data)
    for step in (25, 511):
        other, cut = decode(data, range(step, len(data), step))
        assert (other.garbage, other.samples, other.lost) == (whole.garbage, whole.samples, whole.lost)
        assert sum(isinstance(event, Comment) for event in cut) == sum(isinstance(event, Comment) for event in events)


def test_frames_for_others_are_passed_over_and_nothing_is_missing():
    """What the firmware says besides: each type, at each length, an info frame's and a sample's among them.  A damaged one is damage."""
    random, count = rng(5), 400
    samples = frames.encode_samples(np.arange(count), np.arange(count) * 600, random.integers(-9, 9, (count, 7)))
    others = []
    for n in range(count):
        size = 3 + n % (frames.LONGEST_OTHER - 5)
        body = np.concatenate([[3 + n % 6], np.array([n & 255, n >> 8]), random.integers(0, 256, size - 3)]).astype(np.uint8)
        others.append(frames.encode_blocks(body[None]).tobytes())
    assert {len(other) for other in others} > {frames.INFO_BYTES + 1, frames.SAMPLE_BYTES + 1}
    stream = b"".join(sample.tobytes() + other for other, sample in zip(others, samples, strict=True))
    decoder, _ = decode(stream)
    assert (decoder.samples, decoder.lost, decoder.garbage, decoder.crc_errors, decoder.implausible) == (count, 0, 0, 0, 0)
    assert decoder.info is None
    at = stream.index(others[70]) + 5
    decoder, _ = decode(stream[:at] + bytes([stream[at] ^ 0x40]) + stream[at + 1 :])
    assert decoder.samples >= count - 1
    assert decoder.garbage >= len(others[70]) - 1
