"""Lines of text that are none, or only look whole."""

from __future__ import annotations

import numpy as np
import pytest
from streams import decode, line_list, same, samples, sent, strangers

from session.bench.decoder import StreamDecoder
from session.bench.events import SampleChunk
from session.bench.text_stream import parse_lines


@pytest.mark.parametrize(
    "line",
    [
        "1,2,3,4,5,6,7",
        "1,2,3,4,5,6,7,",
        "1,2,3,4,5,6,7,--8",
        "1,2,3,4,5,6,7,8-",
        "1,2,3,4,5,6,7,-",
        "1,2,3,4,,6,7,8",
        "1,2,3,4,5,6,7,08",
        "1,2,3,4,5,6,7,-0",
        "1,2,3,4,5,6,7,32768",
        "1,2,3,4,5,6,7,-32769",
        "-1,2,3,4,5,6,7,8",
        "1,2,3,4,5,6,7,8x",
        "99999999999999999999,2,3,4,5,6,7,8",
        "1,2,3,4,5,6,7,99999999999999999999999",
    ],
)
def test_lines_that_are_none(line):
    good, values = parse_lines(f"10,0,-1,2,3,4,5,6\n{line}\n20,0,-32768,32767,3,4,5,6\n".encode(), 8, tuple(range(8)))
    assert good.tolist() == [True, False, True]
    assert values.tolist() == [[10, 0, -1, 2, 3, 4, 5, 6], [20, 0, -32768, 32767, 3, 4, 5, 6]]
    t_us, registers = sent(100)
    lines = line_list(t_us, registers)
    lines[50] = f"{line}\n".encode()
    decoder, events = decode(b"".join(lines))
    others = ~np.isin(np.arange(100), [49, 50])
    assert same(events, t_us[others], registers[others])
    assert decoder.garbage == len(line) + 1


def test_two_halves_of_lines_that_look_whole_do_not_enter():
    """Bytes lost from the middle of one line to the same column of a later one."""
    t_us, registers = sent(300)
    lines = line_list(t_us, registers)
    for column in range(1, 8):
        head, tail = lines[150].split(b","), lines[152].split(b",")
        halves = b",".join([*head[:column], head[column][:1] + tail[column][1:], *tail[column + 1 :]])
        data = b"".join([*lines[:150], halves, *lines[153:]])
        _, events = decode(data)
        assert strangers(events, t_us, registers) == 0
        assert sum(len(event) for event in events if isinstance(event, SampleChunk)) >= 296


@pytest.mark.broad
@pytest.mark.parametrize("end", ["\0\n", "\0\r\n"])
@pytest.mark.parametrize("header", [False, True])
def test_a_strings_terminator_before_the_lines_end_is_no_damage(end, header):
    """However the bytes are divided.  The first line alone shows no such habit, and may be half a line before a frame."""
    t_us, registers = sent(300)
    lines = ([f"t_us,gx,gy,gz,ax,ay,az,temp{end}".encode()] if header else []) + line_list(t_us, registers, end)
    first = 0 if header else 1
    data = b"".join(lines)
    for cuts in (None, range(1, len(data)), [len(b"".join(lines[:100])) - 1], [len(b"".join(lines[:100])) - len(end)]):
        decoder, events = decode(data, cuts)
        assert same(events, t_us[first:], registers[first:])
        assert decoder.garbage == len(lines[0])


def test_half_a_line_before_a_zero_byte_stays_none():
    """A zero byte and a line's end once, among lines that end otherwise: what was before it may have lost its end."""
    t_us, registers = sent(300)
    lines = line_list(t_us, registers)
    lines[150] = lines[150][:-2] + b"\0\n"
    _, events = decode(b"".join(lines))
    assert strangers(events, t_us, registers) == 0
    got_us, _ = samples(events)
    assert t_us[150] not in got_us
    assert len(got_us) >= 298


@pytest.mark.broad
def test_megabytes_of_nothing_need_no_memory():
    decoder = StreamDecoder()
    for byte in (b"\xff", b"7", b"\0", b"\n", b","):
        for _ in range(4):
            decoder.feed(byte * 1_000_000)
            assert len(decoder._buffer) < 2000
    assert decoder.samples == 0


@pytest.mark.parametrize("step", [1, 20, 64, 1000])
def test_lines_that_change_their_width_are_taken_alike_however_the_bytes_are_cut(step):
    """Found by fuzzing: how many lines of another width had come was forgotten or not, by where a read ended."""
    t_us, registers = sent(60)
    wide = [line.replace(b"\n", b",7\n") for line in line_list(t_us, registers)]
    lines = line_list(t_us, registers)
    data = b"".join([*wide[:20], lines[20], wide[21], *lines[22:24], wide[24], *lines[25:40], *wide[40:42], *lines[42:]])
    whole, events = decode(data)
    parts, cut = decode(data, range(step, len(data), step))
    assert (parts.garbage, parts.lost, parts.implausible) == (whole.garbage, whole.lost, whole.implausible)
    for one, other in zip(samples(events), samples(cut), strict=True):
        np.testing.assert_array_equal(one, other)
    assert strangers(events, t_us, registers) == 0
    assert whole.samples > 30
