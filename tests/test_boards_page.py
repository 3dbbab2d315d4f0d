"""What docs/boards.md tells somebody with a soldering iron is what the code does: pins, frames on the wire, lines, baud rates."""

import binascii
import re

import numpy as np
import pytest
from conftest import ROOT

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import Info

PAGE = (ROOT / "docs" / "boards.md").read_text(encoding="utf-8")
HEX = re.compile(r"^```\n((?:[0-9a-f]{2} )+00)\n```", re.M)


def test_the_two_frames_and_the_lines_say_the_same():
    """The page's sample as bytes and as text, and its info."""
    sample, info = (bytes.fromhex(text) for text in HEX.findall(PAGE))
    (text,) = re.findall(r"^```\n(# gyro_fs_dps.*?)```", PAGE, re.S | re.M)
    rows = np.array([line.split(",") for line in text.splitlines()[2:]], int)
    assert np.diff(rows[:, 0]) == pytest.approx(1e6 / 417, abs=0.6)
    assert StreamDecoder().feed(info) == [Info(500.0, 4.0, 417.0, "4711")]
    lines = StreamDecoder()
    lines.feed(text.encode())
    assert lines.info == Info(500.0, 4.0, 417.0, "4711", "ASM330LHH")
    assert frames.encode_samples(np.array([1]), rows[:1, 0], rows[:1, 1:].astype(np.int16)).tobytes() == sample
    inside = "".join(re.findall(r"^\| `((?:[0-9a-f]{2} ?)+)` \|", PAGE, re.M))
    assert uncobs(sample[:-1]) == bytes.fromhex(inside)
    assert binascii.crc_hqx(bytes.fromhex(inside)[:-2], 0xFFFF) == int.from_bytes(bytes.fromhex(inside)[-2:], "little")


def uncobs(coded):
    decoded = b""
    while coded:
        decoded += coded[1 : coded[0]] + (b"\0" if coded[0] < len(coded) else b"")
        coded = coded[coded[0] :]
    return decoded
