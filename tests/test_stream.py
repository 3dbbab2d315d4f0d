"""The stream decoder, undisturbed: all that was sent arrives, in both forms."""

from __future__ import annotations

import numpy as np
import pytest
from streams import BOTH, INFO, decode, frame_list, line_list, rng, same, samples, sent, troubles

from session.bench import frames
from session.bench.events import Comment, Info
from session.bench.text_stream import parse_comment, parse_info
from tinygc.simulation.virtual_board import LineFaults, spoil


@BOTH
def test_everything_arrives(encode):
    t_us, registers = sent(3000)
    decoder, events = decode(b"".join(encode(t_us, registers)))
    assert same(events, t_us, registers)
    assert (decoder.samples, decoder.lost, decoder.crc_errors, decoder.garbage, decoder.implausible) == (3000, 0, 0, 0, 0)
    assert troubles(events) == {}
    assert all(chunk.t_us.dtype == np.int64 and chunk.registers.dtype == np.int16 for chunk in events)


@BOTH
def test_it_does_not_matter_how_the_bytes_are_cut(encode):
    t_us, registers = sent(400)
    data = spoil(encode(t_us, registers), LineFaults(lost=0.05, torn=0.03, flip=0.0005), rng(2))
    data = rng(3).bytes(90) + data + b"\n# board starts\n" + b"".join(encode(*sent(50, 0)))
    whole, events = decode(data)
    for size in (1, 7, 64):
        cut, pieces = decode(data, range(size, len(data), size))
        assert same(pieces, *samples(events))
        assert troubles(pieces) == troubles(events)
        assert [e for e in pieces if isinstance(e, Comment)] == [e for e in events if isinstance(e, Comment)]
        assert (cut.samples, cut.lost, cut.garbage, cut.resets) == (whole.samples, whole.lost, whole.garbage, whole.resets)


def test_text_with_carriage_returns_comments_a_header_and_further_columns():
    t_us, registers = sent(200)
    lines = [line.replace(b"\n", b",0.5,ok\r\n") for line in line_list(t_us, registers)]
    lines[50:50] = [b"# hello, world\r\n", b"\r\n", f"# {INFO.text}\r\n".encode()]
    _, events = decode(b"t_us,gx,gy,gz,ax,ay,az,temp,vbat,state\r\n" + b"".join(lines))
    assert same(events, t_us, registers)
    assert next(event for event in events if isinstance(event, Comment)) == Comment("hello, world")
    assert [event for event in events if isinstance(event, Info)] == [INFO]
    assert troubles(events) == {}


def test_a_header_says_in_which_order_the_columns_are():
    t_us, registers = sent(100)
    table = np.column_stack([registers[:, 6], t_us, registers[:, 3:6], registers[:, :3]])
    text = "temp,t_us,ax,ay,az,gx,gy,gz\n" + "".join(",".join(map(str, row)) + "\n" for row in table.tolist())
    for cuts in ([], range(100, len(text), 100)):
        assert same(decode(text.encode(), cuts)[1], t_us, registers)


@pytest.mark.parametrize("shared_counter", [True, False])
def test_info_frames_are_read_and_do_not_count_as_lost(shared_counter):
    """docs/formats.md says one counter for both types; a board that has two is understood as well."""
    t_us, registers = sent(3000)
    messages, number = [], 0
    for k, row in enumerate(zip(t_us, registers, strict=True)):
        if k % 100 == 50:
            messages.append(frames.encode_info(number, INFO))
            number += shared_counter
        messages += frame_list(*(np.array([x]) for x in row), first=number)
        number += 1
    decoder, events = decode(b"".join(messages))
    assert same(events, t_us, registers)
    assert decoder.lost == 0
    info = [event for event in events if isinstance(event, Info)]
    assert len(info) == 30
    assert info[0] == decoder.info == INFO


@pytest.mark.parametrize(
    ("written", "kept"),
    [
        ("serial=👨\u200d👩\u200d👧-7", r"serial=👨\u200d👩\u200d👧-7"),
        ("\ufeffserial=7\u200b", r"\ufeffserial=7\u200b"),
        ("serial=\u202e7", r"serial=\u202e7"),
    ],
)
def test_signs_that_only_shape_others_cost_no_comment(written, kept):
    """A joiner within an emoji cost the whole line, and with it the ranges that the board said."""
    text = parse_comment(f"# gyro_fs_dps=500 accel_fs_g=4 odr_hz=208 {written}".encode())
    assert text == f"gyro_fs_dps=500 accel_fs_g=4 odr_hz=208 {kept}"
    assert parse_info(text).gyro_fs_dps == 500
    assert parse_comment(f"# {written}\x1b[31m".encode()) is None
    assert parse_comment(f"# {text}".encode()) == text  # as the log has it
