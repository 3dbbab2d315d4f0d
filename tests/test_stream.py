"""The stream decoder: both forms, every fault that a wire has, nothing that was not sent."""

from __future__ import annotations

import binascii

import numpy as np
import pytest
from streams import INFO, PERIOD_US, decode, frame_list, line_list, samples, sent, strangers, troubles

from session.stream import frames
from session.stream.decoder import StreamDecoder
from session.stream.events import Chunk, Comment, Info, Trouble
from session.stream.text import parse_lines
from tinygc.simulation.board.faults import Faults, flipped, spoil

BOTH = pytest.mark.parametrize("encode", [frame_list, line_list], ids=["frames", "text"])


def rng(seed=0):
    return np.random.default_rng(seed)


def same(events, t_us, registers) -> bool:
    got_us, got = samples(events)
    return np.array_equal(got_us, t_us) and np.array_equal(got, registers)


# Frames


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


# The decoder, undisturbed


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
    data = spoil(encode(t_us, registers), Faults(lost=0.05, torn=0.03, flip=0.0005), rng(2))
    data = rng(3).bytes(90) + data + b"\n# board starts\n" + b"".join(encode(*sent(50, 0)))
    whole, events = decode(data)
    for size in (1, 7, 64):
        cut, pieces = decode(data, range(size, len(data), size))
        assert same(pieces, *samples(events))
        assert troubles(pieces) == troubles(events)
        assert [e for e in pieces if isinstance(e, Comment)] == [e for e in events if isinstance(e, Comment)]
        assert (cut.samples, cut.lost, cut.garbage, cut.resets) == (whole.samples, whole.lost, whole.garbage, whole.resets)


@BOTH
def test_time_and_sequence_wrap(encode):
    """u32 microseconds after 71.6 minutes, u16 after 39 s at 1667 Hz."""
    count = 70_000
    t_us = 2**32 - 5_000_000 + PERIOD_US * np.arange(count)
    registers = sent(count)[1]
    _, events = decode(b"".join(encode(t_us, registers)))
    assert same(events, t_us, registers)
    assert troubles(events) == {}


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


@BOTH
def test_the_true_rate_is_measured_from_the_stamps(encode):
    t_us = np.rint(np.arange(20_000) * 1e6 / 1707.008).astype(np.int64)
    decoder = StreamDecoder()
    decoder.feed(b"".join(encode(t_us, sent(20_000)[1])))
    assert decoder.measured_odr_hz == pytest.approx(1707.008, rel=1e-5)


@BOTH
def test_stamps_of_25_us_ticks_at_6667_hz(encode):
    t_us = np.arange(5000) * 1_000_000 // 6667 // 25 * 25
    _, events = decode(b"".join(encode(t_us, sent(5000)[1])))
    assert same(events, t_us, sent(5000)[1])
    assert troubles(events) == {}


# Faults


def test_five_percent_lost_frames_are_counted_exactly():
    t_us, registers = sent(20_000)
    messages = np.array(frame_list(t_us, registers), dtype=object)
    kept = rng(4).random(len(messages)) >= 0.05
    kept[[0, -1]] = True
    decoder, events = decode(b"".join(messages[kept]))
    assert same(events, t_us[kept], registers[kept])
    assert decoder.lost == np.count_nonzero(~kept) > 900
    assert troubles(events) == {"lost": decoder.lost}


def test_lost_lines_are_counted_from_the_stamps_and_take_the_line_before_along():
    """A line before a gap may be two halves; it is left out, and counted as lost."""
    t_us, registers = sent(20_000)
    gone = np.zeros(20_000, bool)
    gone[rng(5).choice(np.arange(10, 19_000, 10), 500, replace=False)] = True
    decoder, events = decode(b"".join(np.array(line_list(t_us, registers), dtype=object)[~gone]))
    before = np.concatenate([gone[1:], [False]])
    assert same(events, t_us[~gone & ~before], registers[~gone & ~before])
    assert decoder.lost == 1000


def test_one_percent_of_flipped_bits():
    """87 % of the frames are hit; of the rest, all arrive."""
    t_us, registers = sent(20_000)
    messages = frame_list(t_us, registers)
    data = flipped(b"".join(messages), 0.01, rng(6))
    whole = sum(data[25 * k : 25 * k + 25] == message for k, message in enumerate(messages))
    decoder, events = decode(data)
    assert strangers(events, t_us, registers) == 0
    assert whole - 5 <= decoder.samples <= 1.2 * whole  # a spoilt delimiter costs no frame that it stands in front of
    assert 0.1 < whole / 20_000 < 0.16
    assert decoder.crc_errors > 10_000


@BOTH
def test_torn_messages_cost_only_themselves(encode):
    t_us, registers = sent(5000)
    messages = encode(t_us, registers)
    torn = np.zeros(5000, bool)
    torn[rng(7).choice(np.arange(10, 4900, 10), 200, replace=False)] = True
    data = b"".join(m[: rng(k).integers(1, len(m) - 1)] if t else m for k, (m, t) in enumerate(zip(messages, torn, strict=True)))
    decoder, events = decode(data)
    assert strangers(events, t_us, registers) == 0
    if encode is frame_list:
        assert same(events, t_us[~torn], registers[~torn])
    else:  # the next line has no beginning of its own; the line before a gap is doubted
        assert decoder.samples >= 5000 - 3 * 200
    assert decoder.garbage > 0


@BOTH
def test_garbage_before_the_first_message(encode):
    t_us, registers = sent(500)
    for seed in range(30):
        decoder, events = decode(rng(seed).bytes(3000) + b"".join(encode(t_us, registers)))
        got_us, _ = samples(events)
        assert strangers(events, t_us, registers) == 0
        assert len(got_us) >= 498
        assert 2500 < decoder.garbage < 3200


@BOTH
def test_a_baud_rate_that_was_wrong_for_a_moment(encode):
    """Bytes of other lengths and values, in which zeros and line ends are as frequent as any."""
    t_us, registers = sent(4000)
    messages = encode(t_us, registers)
    first, wrong, rest = (b"".join(part) for part in (messages[:1000], messages[1000:2000], messages[2000:]))
    bits = np.unpackbits(np.frombuffer(wrong, np.uint8))[::3]
    decoder, events = decode(first + np.packbits(bits).tobytes() + rest)
    got_us, _ = samples(events)
    assert strangers(events, t_us, registers) == 0
    assert len(got_us) >= 2990
    assert decoder.resets == 0
    assert 1000 <= decoder.lost <= 1010


@BOTH
def test_a_reset_in_the_middle(encode):
    first, second = sent(1000, 50_000_000), sent(1000, 1234, seed=1)
    data = b"".join(encode(*first))[:-7] + b"# boot\r\n" + b"".join(encode(*second))
    decoder, events = decode(data)
    kinds = [event.kind for event in events if isinstance(event, Trouble) and event.kind == "reset"]
    assert kinds == ["reset"]
    at = next(k for k, event in enumerate(events) if isinstance(event, Trouble) and event.kind == "reset")
    got_us, _ = samples(events[:at])
    assert np.array_equal(got_us, first[0][: len(got_us)])
    assert len(got_us) >= 998
    got_us, _got = samples(events[at:])
    assert np.array_equal(got_us, second[0][-len(got_us) :])
    assert len(got_us) >= 999
    assert decoder.resets == 1


def test_boot_messages_between_frames_are_comments():
    first, second = sent(100, 10_000_000), sent(100, 0)
    data = b"".join(frame_list(*first)) + b"# firmware 1.2\r\n# FREQ_FINE=7\r\n" + b"".join(frame_list(*second))
    _, events = decode(data)
    assert [event.text for event in events if isinstance(event, Comment)] == ["firmware 1.2", "FREQ_FINE=7"]
    assert sum(len(event) for event in events if isinstance(event, Chunk)) == 200


def test_a_board_that_changes_from_text_to_frames_and_back():
    parts = [line_list(*sent(100, 0)), frame_list(*sent(100, 10_000_000)), line_list(*sent(100, 20_000_000))]
    decoder, events = decode(b"".join(b"".join(part) for part in parts))
    assert decoder.samples >= 295
    assert (
        strangers(events, np.concatenate([sent(100, start)[0] for start in (0, 10_000_000, 20_000_000)]), np.tile(sent(100)[1], (3, 1)))
        == 0
    )


def test_another_rate_is_no_reset():
    first = sent(500)
    t_us = first[0][-1] + 2400 * np.arange(1, 501)
    _, events = decode(b"".join(frame_list(*first) + frame_list(t_us, first[1], first=500)))
    assert same(events, np.concatenate([first[0], t_us]), np.concatenate([first[1], first[1]]))
    assert "reset" not in troubles(events)


@pytest.mark.parametrize(
    "field", [{"sequence": 300}, {"t_us": 2_000_000_000}, {"t_us": 1_000_000 + 500 * PERIOD_US + 900}, {"sequence": 501, "t_us": 77}]
)
def test_a_damaged_frame_with_a_good_check_and_a_wrong_number_or_stamp_is_left_out(field):
    t_us, registers = sent(1000)
    messages = frame_list(t_us, registers)
    sequence, stamp = field.get("sequence", 500), field.get("t_us", int(t_us[500]))
    messages[500] = frames.encode_samples(np.array([sequence]), np.array([stamp]), registers[500:501])[0].tobytes()
    _, events = decode(b"".join(messages))
    others = np.arange(1000) != 500
    assert same(events, t_us[others], registers[others])
    assert troubles(events) == {"implausible": 1, "lost": 1}


@pytest.mark.parametrize(("register", "step"), [(0, 400), (1, -9000), (4, 800), (6, 100)])
def test_a_register_that_stands_alone_is_left_out_on_a_wire_that_spoils_frames(register, step):
    t_us, registers = sent(1000)
    wrong = registers.copy()
    wrong[500, register] += step
    messages = frame_list(t_us, wrong)
    _, events = decode(b"".join(messages))
    assert same(events, t_us, wrong)  # without any damage it is a knock
    messages[400] = flipped(messages[400][:-1], 0.1, rng(8)) + b"\0"
    decoder, events = decode(b"".join(messages))
    others = (np.arange(1000) != 500) & (np.arange(1000) != 400)
    assert same(events, t_us[others], registers[others])
    assert decoder.implausible == 1
    assert [event.t_us for event in events if isinstance(event, Trouble) and event.kind == "implausible"] == [t_us[500]]


def test_of_many_damaged_frames_none_enters():
    """The worst case for number and stamp: only the registers are damaged.  benchmarks/stream.py does this with a million."""
    count = 60_000
    t_us, registers = sent(count)
    coded = frames.encode_samples(np.arange(count), t_us, registers)
    hit = np.flatnonzero(rng(9).random(count) < 0.9)
    bodies, _ = frames.decode_blocks(coded[hit, :-1])
    bodies[:, 7:] = rng(10).integers(0, 256, (len(hit), 14))
    false = rng(11).choice(len(hit), 40, replace=False)  # as many as pass in 2.6 million
    spoilt = frames.encode_blocks(bodies)
    checks = spoilt[false, -3:-1].copy()
    spoilt[:, -3:-1] = rng(12).integers(1, 256, (len(hit), 2))
    spoilt[false, -3:-1] = checks
    coded[hit] = spoilt
    decoder, events = decode(coded.tobytes())
    assert strangers(events, t_us, registers) == 0
    assert decoder.implausible >= 38
    assert decoder.samples == count - len(hit)


def test_motion_and_knocks_are_not_doubted_on_a_bad_wire(simulated):
    """Simulated hand turns at 104 Hz, where steps are largest, with a damaged frame in seven: every whole frame arrives."""
    from tinygc.simulation.board.source import recorded

    source = recorded(simulated())
    t_us = np.rint(np.arange(len(source.rows)) * 1e6 / source.info.odr_hz).astype(np.int64)
    messages = frame_list(t_us, source.rows)
    damaged = rng(13).random(len(messages)) < 1 / 7
    damaged[:3] = damaged[-2:] = False
    data = b"".join(m[:-9] + bytes([m[-9] ^ 1 or 3]) + m[-8:] if hit else m for m, hit in zip(messages, damaged, strict=True))
    decoder, events = decode(data)
    assert decoder.implausible == 0
    assert same(events, t_us[~damaged], source.rows[~damaged])


# Lines


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
        assert sum(len(event) for event in events if isinstance(event, Chunk)) >= 296


def test_megabytes_of_nothing_need_no_memory():
    decoder = StreamDecoder()
    for byte in (b"\xff", b"7", b"\0", b"\n", b","):
        for _ in range(4):
            decoder.feed(byte * 1_000_000)
            assert len(decoder._buffer) < 2000
    assert decoder.samples == 0
