"""The stream decoder: what is sent arrives, what is spoilt is left out, nothing else comes, and no stream costs more than its bytes."""

import binascii
import struct
import sys

import numpy as np
import pytest
from conftest import DEG, config
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from streams import BOTH, INFO, costly, decode, frame_list, line_list, rng, same, samples, sent, strangers, troubles

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import (
    FAULTS,
    TROUBLES,
    BoardStatus,
    Event,
    Info,
    SampleChunk,
    faults_text,
    parse_header,
)
from session.bench.guide import samples_of
from session.bench.logwriter import LogWriter
from session.bench.text_stream import LineReader, parse_comment, parse_info, parse_line
from session.log.registers import RegisterUnits

# Frames, byte by byte.


def by_hand(body):
    """CRC behind, then COBS as Cheshire and Baker define it: groups that end before each zero, each with its length in front."""
    check = binascii.crc_hqx(body, 0xFFFF)
    plain = body + bytes([check & 0xFF, check >> 8])
    return b"".join(bytes([len(group) + 1]) + group for group in plain.split(b"\0")) + b"\0"


@pytest.mark.parametrize("size", [0, 2, 21, 78])
def test_blocks_of_any_length_are_coded_checked_and_decoded(size):
    bodies = rng(size).integers(0, 256, (40, size)).astype(np.uint8)
    bodies[:10] = 0
    bodies[10:20] = 255
    bodies[20:30] *= rng(1).integers(0, 2, (10, size)).astype(np.uint8)  # many zeros
    assert frames.crc(bodies).tolist() == [binascii.crc_hqx(body.tobytes(), 0xFFFF) for body in bodies]
    coded = frames.encode_blocks(bodies)
    assert [row.tobytes() for row in coded] == [by_hand(body.tobytes()) for body in bodies]
    found, good = frames.decode_blocks(coded[:, :-1])
    assert good.all()
    assert np.array_equal(found, bodies)
    for place in range(size + 3):  # each byte wrong by one bit; a zero would have been the delimiter
        wrong = coded[:, :-1].copy()
        wrong[:, place] ^= 1
        assert not frames.decode_blocks(wrong[(wrong != 0).all(axis=1)])[1].any()


def test_a_sample_frame_byte_by_byte():
    """Little-endian; number and time wrap, registers are signed."""
    registers = np.array([[-1, 2, -300, 4, 5, 6, 32767]], np.int16)
    (frame,) = frames.encode_samples(np.array([0x10102]), np.array([0x103000405]), registers)
    assert frame.tobytes() == by_hand(struct.pack("<BHI7h", 1, 0x0102, 0x03000405, *registers[0]))
    assert len(frame) == frames.SAMPLE_BYTES + 1 == 25


def test_an_info_frame_byte_by_byte_and_back():
    frame = frames.encode_info(0x10007, Info(500.0, 4.0, 1666.5, "77"))
    body = struct.pack("<BHHHfI", 2, 7, 500, 4, 1666.5, 77)
    assert frame == by_hand(body)
    assert len(frame) == frames.INFO_BYTES + 1 == 19
    assert frames.decode_info(body) == Info(500.0, 4.0, 1666.5, "77")
    for serial, sent_as in (("x7", 0), ("٧", 0), ("", 0), (str(2**32 + 5), 5)):
        assert frames.encode_info(7, Info(500.0, 4.0, 1666.5, serial)) == by_hand(struct.pack("<BHHHfI", 2, 7, 500, 4, 1666.5, sent_as))


@pytest.mark.parametrize(
    ("gyro_fs", "accel_fs", "odr_hz", "known"),
    [(0, 1, 1.0, False), (1, 0, 1.0, False), (1, 1, 0.11, True), (1, 1, 0.09, False), (1, 1, 1e5, True),
     (1, 1, 100_001.0, False), (1, 1, float("nan"), False)],
)  # fmt: skip
def test_an_info_of_values_that_no_sensor_has_is_none(gyro_fs, accel_fs, odr_hz, known):
    assert (frames.decode_info(struct.pack("<BHHHfI", 2, 0, gyro_fs, accel_fs, odr_hz, 0)) is not None) == known


@pytest.mark.parametrize(
    ("command", "number", "form", "values"),
    [(frames.DATA_RATE, 0x11, "<f", (208.5,)), (frames.RANGES, 0x12, "<HH", (500, 4)), (frames.FILTERS, 0x13, "<BH", (3, 400)),
     (frames.START, 0x14, "<", ()), (frames.STOP, 0x15, "<", ()), (frames.SELF_TEST, 0x16, "<", ()), (frames.IDENTIFY, 0x17, "<", ()),
     (frames.BAUD, 0x18, "<I", (921_600,))],
)  # fmt: skip
def test_commands_byte_by_byte(command, number, form, values):
    expected = by_hand(struct.pack("<BH", number, 0x0203) + struct.pack(form, *values))
    assert frames.encode_command(command, 0x10203, *values) == expected


def test_a_wire_carries_25_bytes_a_sample_and_200_of_ten_bits_a_second_besides():
    assert frames.least_baud(1000.0) == 1000 * 25 * 10 + 200 * 10


# What a board says beside its samples.


#: what decides that the stream is of frames
HELLO = frames.encode_info(0, INFO)


REGISTERS = bytes.fromhex("50540044001000000020")


def frame(body):
    return frames.encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()


def board_frame(
    source=1,
    sequence=0,
    baud=921600,
    odr_hz=417.0,
    freq_fine=-4,
    who=0x6B,
    state=3,
):
    head = struct.pack("<BBBBBBb", source, state, 1, 2, 3, who, freq_fine)
    return frame(struct.pack("<BH", 0x05, sequence) + head + REGISTERS + struct.pack("<If", baud, odr_hz))


def faults_frame(sequence=0, **counts):
    return frame(struct.pack("<BH17I", 0x06, sequence, *(counts.get(name, 0) for name in FAULTS)))


def done_frame(sequence, command, result):
    return frame(struct.pack("<BHBB", 0x07, sequence, command, result))


def self_test_frame():
    return frame(struct.pack("<BHH6f", 0x08, 0, 2, 300, 310, 320, 90, 95, 100))


def test_the_order_of_the_counts_is_that_of_the_firmware():
    """A frame as it goes over the wire, byte for byte: where each count is, by docs/firmware.md.  Overrun is 1, order 2, ..., rate 17."""
    body = bytes.fromhex(
        "06 0000 01000000 02000000 03000000 04000000 05000000 06000000 07000000 08000000 09000000 0a000000 0b000000 0c000000 0d000000"
        "0e000000 0f000000 10000000 11000000"
    )
    (message,) = StreamDecoder().feed(HELLO + frame(body))[-1:]
    assert StreamDecoder().feed(HELLO + frame(body[:-4]))[-1].numbers == (*range(1, 17), 0)  # firmware 1.0 has no rate
    assert faults_text(message.numbers) == (
        "faults overrun=1 order=2 parity=3 tag=4 hang=5 zeros=6 ones=7 reset=8 changed=9 identity=10 silent=11 stamp=12 incomplete=13 "
        "starts=14 lost=15 crowded_out=16 rate=17"
    )


def test_every_field_of_the_four_frames():
    counts = dict.fromkeys(FAULTS, 0) | {"parity": 3, "lost": 5}
    events = StreamDecoder().feed(HELLO + board_frame() + faults_frame(parity=3, lost=5) + done_frame(7, 0x11, 4) + self_test_frame())
    assert events[1:] == [
        BoardStatus(1, True, True, "1.2.3", 0x6B, -4, REGISTERS, 921600, 417.0),
        Event("faults", numbers=tuple(counts.values())),
        Event("done", numbers=(7, 0x11, 4)),
        Event("tested", numbers=(2, 300.0, 310.0, 320.0, 90.0, 95.0, 100.0)),
    ]


@pytest.mark.parametrize("size", [7, 100_000])
def test_they_come_between_the_samples_take_no_number_and_are_said_once_each(size):
    rows = frame_list(*sent(300))
    second = board_frame() + faults_frame(overrun=1)
    data = b"".join([*rows[:100], second, *rows[100:200], second, *rows[200:], faults_frame(overrun=2)])
    decoder, events = decode(data, range(0, len(data), size))
    assert decoder.samples == 300
    assert decoder.lost == decoder.garbage == decoder.crc_errors == 0
    assert [event.kind for event in events if event.kind not in ("samples", *TROUBLES)] == ["board", "faults", "faults"]


def test_frames_for_others_are_passed_over_and_nothing_is_missing():
    """What the firmware says besides: each type, at each length.  A body without a number is none."""
    rows = frame_list(*sent(400))
    bodies = [struct.pack("<BH", 3 + n % 6, n) + rng(n).bytes(n % (frames.LONGEST_OTHER - 5)) for n in range(400)]
    decoder, _ = decode(b"".join(row + frame(body) for row, body in zip(rows, bodies, strict=True)))
    assert (decoder.samples, decoder.lost, decoder.garbage, decoder.crc_errors, decoder.implausible) == (400, 0, 0, 0, 0)
    assert decoder.info is None
    assert decode(rows[0] + frame(b"\3\3") + rows[1])[0].garbage == 5


# All that is sent arrives.


def test_text_with_carriage_returns_comments_a_header_and_further_columns():
    t_us, registers = sent(200)
    lines = [line.replace(b"\n", b",0.5,ok\r\n") for line in line_list(t_us, registers)]
    lines[50:50] = [b"# hello, world\r\n", b"\r\n", f"# {INFO.text}\r\n".encode()]
    _, events = decode(b"t_us,gx,gy,gz,ax,ay,az,temp,vbat,state\r\n" + b"".join(lines))
    assert same(events, t_us, registers)
    assert next(event for event in events if event.kind == "comment") == Event("comment", text="hello, world")
    assert [event for event in events if isinstance(event, Info)] == [INFO]
    assert troubles(events) == {}


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


# The wire.


def test_five_percent_lost_frames_are_counted_exactly():
    t_us, registers = sent(4000)
    messages = np.array(frame_list(t_us, registers), dtype=object)
    kept = rng(4).random(len(messages)) >= 0.05
    kept[[0, -1]] = True
    decoder, events = decode(b"".join(messages[kept]))
    assert same(events, t_us[kept], registers[kept])
    assert decoder.lost == np.count_nonzero(~kept) > 150
    assert troubles(events) == {"lost": decoder.lost}


@BOTH
def test_garbage_before_the_first_message(encode):
    t_us, registers = sent(500)
    for seed in range(4):
        decoder, events = decode(rng(seed).bytes(3000) + b"".join(encode(t_us, registers)))
        got_us, _ = samples(events)
        assert strangers(events, t_us, registers) == 0
        assert len(got_us) >= 498
        assert 2500 < decoder.garbage < 3200


@BOTH
def test_a_reset_in_the_middle(encode):
    first, second = sent(1000, 50_000_000), sent(1000, 1234, seed=1)
    data = b"".join(encode(*first))[:-7] + b"# boot\r\n" + b"".join(encode(*second))
    decoder, events = decode(data)
    (at,) = (k for k, event in enumerate(events) if event.kind == "reset")
    got_us, _ = samples(events[:at])
    assert np.array_equal(got_us, first[0][: len(got_us)])
    assert len(got_us) >= 998
    got_us, _got = samples(events[at:])
    assert np.array_equal(got_us, second[0][-len(got_us) :])
    assert len(got_us) >= 999
    assert decoder.resets == 1


def test_of_many_damaged_frames_none_enters():
    """The worst case for number and stamp: only the registers are damaged."""
    count = 15_000
    t_us, registers = sent(count)
    coded = frames.encode_samples(np.arange(count), t_us, registers)
    hit = np.flatnonzero(rng(9).random(count) < 0.9)
    bodies, _ = frames.decode_blocks(coded[hit, :-1])
    bodies[:, 7:] = rng(10).integers(0, 256, (len(hit), 14))
    false = rng(11).choice(len(hit), 10, replace=False)  # as many as pass in 0.65 million
    spoilt = frames.encode_blocks(bodies)
    checks = spoilt[false, -3:-1].copy()
    spoilt[:, -3:-1] = rng(12).integers(1, 256, (len(hit), 2))
    spoilt[false, -3:-1] = checks
    coded[hit] = spoilt
    decoder, events = decode(coded.tobytes())
    assert strangers(events, t_us, registers) == 0
    assert decoder.implausible >= 9
    assert decoder.samples == count - len(hit)


@pytest.mark.parametrize(
    "line",
    [
        "1,2,3,4,5,6,7,",
        "1,2,3,4,5,6,7,--8",
        "1,2,3,4,,6,7,8",
        "1,2,3,4,5,6,7,08",
        "1,2,3,4,5,6,7,32768",
        "1,2,3,4,5,6,7,-32769",
        "-1,2,3,4,5,6,7,8",
        "1,2,3,4,5,6,7,8x",
        "1,2,3,4,5,6,7,99999999999999999999999",
    ],
)
def test_lines_that_are_none(line):
    rows, garbage = LineReader().take(f"10,0,-1,2,3,4,5,6\n{line}\n20,0,-32768,32767,3,4,5,6\n".encode())
    assert rows.t_us.tolist() == [10, 20]
    assert rows.registers.tolist() == [[0, -1, 2, 3, 4, 5, 6], [0, -32768, 32767, 3, 4, 5, 6]]
    assert (rows.damaged.tolist(), garbage) == ([False, True], (len(line) + 1, False))
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


@pytest.mark.parametrize("end", ["\0\n", "\0\r\n"])
@pytest.mark.parametrize("header", [False, True])
def test_a_strings_terminator_before_the_lines_end_is_no_damage(end, header):
    """However the bytes are divided.  The first line alone shows no such habit, and may be half a line before a frame."""
    t_us, registers = sent(120)
    lines = ([f"t_us,gx,gy,gz,ax,ay,az,temp{end}".encode()] if header else []) + line_list(t_us, registers, end)
    first, data, middle = 0 if header else 1, b"".join(lines), len(b"".join(lines[:50]))
    for cuts in (None, range(1, len(data), 97), [middle - 1], [middle - len(end)]):
        decoder, events = decode(data, cuts)
        assert same(events, t_us[first:], registers[first:])
        assert decoder.garbage == len(lines[0])


# Physical units.


UNITS = RegisterUnits("ASM330LHH", 500, 4)


HEADER = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"


BOARD = Info(500, 4, 1666.5, "77", "MPU-9250", -33.9)
COMMENT = f"# {BOARD.text}\n".encode()


def values_of(count, seed=0):
    """Stamps (count,) us and numbers (count, 7) in dps, g and degC with the digits that a board prints."""
    t_us, registers = sent(count, seed=seed)
    scale = [UNITS.gyro_rps / DEG] * 3 + [UNITS.accel_mps2 / 9.80665] * 3 + [1 / 256]
    return t_us, np.round(registers * np.array(scale) + np.array([0] * 6 + [25.0]), 5)


def lines_of(t_us, values, header=HEADER, time=lambda t: str(t)):
    rows = zip(t_us.tolist(), values.tolist(), strict=True)
    return [f"{header}\n".encode(), *(f"{time(t)},{','.join(f'{x:.5f}' for x in row)}\n".encode() for t, row in rows)]


@pytest.mark.parametrize(
    ("header", "time", "columns"),
    [
        (HEADER, str, 7),
        (HEADER.replace("t_us", "t_s"), lambda t: f"{t / 1e6:.6f}", 7),
        (HEADER.replace(",temp_c", ""), str, 6),
        (HEADER.replace("_dps", "_rps").replace("_g", "_mps2"), str, 7),
    ],
)
def test_what_is_sent_is_what_the_log_holds(header, time, columns, tmp_path):
    t_us, values = values_of(400)
    values = values[:, :columns]
    lines = lines_of(t_us, values, header, time)
    data = lines[0] + COMMENT + b"".join(lines[1:])
    decoder, events = decode(data)
    found_us, found = samples(events)
    assert_array_equal(found_us, t_us)
    assert_array_equal(found, values)
    assert (decoder.garbage, decoder.lost, decoder.info) == (0, 0, BOARD)
    writer = LogWriter(tmp_path)
    writer.write(events)
    writer.close()
    assert writer.physical
    rad, force = ("rps" in header, "mps2" in header)
    live = samples_of(next(event for event in events if isinstance(event, SampleChunk)), config())
    assert_allclose(live.gyro, values[: len(live), :3] * (1.0 if rad else DEG), rtol=1e-14)
    assert_allclose(live.accel, values[: len(live), 3:6] * (1.0 if force else 9.80665), rtol=1e-14)
    assert (live.temp_c is None) == (columns == 6)


def test_a_spoilt_number_beside_damage_is_left_out():
    t_us, values = values_of(400)
    lines = lines_of(t_us, values)
    lines[200] = b"\xff\xfe\n"
    cells = lines[300].split(b",")
    lines[300] = b",".join([*cells[:2], b"99.9", *cells[3:]])
    decoder, events = decode(b"".join(lines))
    assert decoder.implausible == 1
    assert t_us[299] not in samples(events)[0]
    untouched = lines_of(t_us, values)
    untouched[300] = lines[300]  # on a good wire a jump is a jump
    assert decode(b"".join(untouched))[0].implausible == 0


def test_without_its_header_it_is_nothing_and_with_the_option_all_of_it():
    t_us, values = values_of(300)
    data = b"".join(lines_of(t_us, values)[1:])
    decoder, events = decode(data)
    assert decoder.samples == 0
    assert decoder.garbage == len(data)
    _, events = decode(data, told=HEADER)
    assert_array_equal(samples(events)[1], values)


def test_another_header_begins_another_log(tmp_path):
    t_us, values = values_of(200)
    rows = np.column_stack([t_us + 200 * 600, sent(200)[1]]).tolist()
    registers = "t_us,gx,gy,gz,ax,ay,az,temp\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    data = b"".join(lines_of(t_us, values)) + registers.encode()
    decoder, events = decode(data)
    assert decoder.resets == 1
    assert [event.kind for event in events if event.kind in TROUBLES] == ["reset"]
    writer = LogWriter(tmp_path)
    writer.write(events)
    writer.close()
    assert [path.read_text().split("\n")[0] for path in writer.paths] == [HEADER, "t_us,gx,gy,gz,ax,ay,az,temp"]
    assert sum(len(path.read_text().split("\n")) - 2 for path in writer.paths) == 400


@pytest.mark.parametrize("first", [0, 30], ids=["before anything", "between frames"])
@pytest.mark.parametrize("header", [HEADER, "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"], ids=["as wide", "narrower"])
def test_frames_behind_a_header_of_text_are_registers(header, first):
    """Found by fuzzing: they were taken for numbers in the header's units, or failed where it has no temperature."""
    t_us, registers = sent(80)
    rows = frame_list(t_us, registers)
    text = 600 * b"x" + b"\n" + header.encode() + b"\n"
    _, events = decode(b"\0" + b"".join([*rows[:first], text, b"\0", *rows[first:]]))
    assert not any(event.form.physical for event in events if isinstance(event, SampleChunk))
    assert strangers(events, t_us, registers) == 0
    assert len(samples(events)[0]) >= 70  # the one whose delimiter the text took is lost


@pytest.mark.parametrize(
    "header",
    ["gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g", "t_us,gx_dps,gy_dps,gz_dps", "t_us,gx_dps,gy_rps,gz_dps,ax_g,ay_g,az_g", ""],
)
def test_what_is_no_header(header):
    assert parse_header(header.encode()) is None


@pytest.mark.parametrize("cell", ["nan", "inf", "1e999", "0x1", "01.5", "--1", "1_0", "", ".", "1.2.3", "1,", "٣"])
def test_numbers_that_are_none(cell):
    _, order, form = parse_header(HEADER.encode())
    good = parse_line(b"10,1.5,-.5,2.,1e-3,+0.25,0,25", order, form)
    assert good == (8, [10, 1.5, -0.5, 2.0, 0.001, 0.25, 0.0, 25.0])
    found = parse_line(f"10,{cell},-.5,2,1e-3,0.25,0,25".encode(), order, form)
    assert found is None or cell == "1,"  # an empty column more is another width


@pytest.mark.parametrize(("column", "number"), [(1, "100001"), (6, "-10000.1"), (7, "1e5"), (4, "1e99")])
def test_what_no_sensor_measures_is_no_line(column, number):
    """Found by fuzzing: it was written into a log that no command reads."""
    t_us, values = values_of(40)
    lines = lines_of(t_us, values)
    cells = lines[20].split(b",")
    lines[20] = b",".join([*cells[:column], number.encode(), *cells[column + 1 :]]).rstrip(b"\n") + b"\n"
    decoder, _ = decode(COMMENT + b"".join(lines))
    assert (decoder.garbage, decoder.samples) == (len(lines[20]), 38)  # a line counts when the next one follows it


COUNT = 60
T_US, SENT = sent(COUNT, start_us=2**32 - 20_000)
FRAMES, LINES = (b"".join(encode(T_US, SENT)) for encode in (frame_list, line_list))
#: bytes that mean something to the decoder, more often than others
PIECES = [
    b"x" * 600,
    HEADER.encode() + b"\n",
    LINES[:41].replace(b"\n", b",7\n"),
    b"\0",
    b"\n",
    b"\0\n",
    b"# ",
    b"t_us,gx,gy,gz,ax,ay,az,temp\n",
    FRAMES[:25],
    FRAMES[5:60],
    LINES[:41],
    LINES[7:90],
    HELLO,
]
pieces = st.one_of(st.binary(max_size=80), st.text("0123456789,-# \r\n", max_size=80).map(str.encode), st.sampled_from(PIECES))
# A line has no check: what is lost of it here is longer than a line, and what is put in holds no digit.
in_frames = st.tuples(st.integers(0, len(FRAMES)), st.integers(0, 200), st.binary(max_size=60))
words = st.text("#x \r\n\0;", max_size=60).map(str.encode)
in_lines = st.tuples(st.integers(200, len(LINES) - 400), st.sampled_from([0, 45, 60, 150]), words)
stretches = st.one_of(
    st.tuples(st.just(FRAMES), st.lists(in_frames, max_size=6)),
    st.tuples(st.just(LINES), st.lists(in_lines, max_size=2)),
    st.tuples(st.none(), st.lists(pieces, max_size=40)),
)


@settings(max_examples=50)
@given(stretches, st.lists(st.integers(0, 3000), max_size=12))
def test_whatever_bytes_come_nothing_comes_out_that_was_not_sent_and_no_cut_changes_that(data, cuts):
    """Frames and lines with stretches cut out and bytes put in; and any bytes.  Nothing raises."""
    sent_data, edits = data
    stream = b"".join(edits) if sent_data is None else sent_data
    for place, length, inserted in edits if sent_data is not None else ():
        stream = stream[:place] + inserted + stream[place + length :]
    whole, events = decode(stream)
    _, parts = decode(stream, [place for place in cuts if place < len(stream)])
    assert same(parts, *samples(events))
    assert troubles(events) == troubles(parts)
    assert [e for e in events if e.kind in ("comment", "info")] == [e for e in parts if e.kind in ("comment", "info")]
    got_us, _ = samples(events)
    assert whole.samples == len(got_us)
    assert "reset" in troubles(events) or (np.diff(got_us) > 0).all()
    assert sent_data is None or strangers(events, T_US, SENT) == 0


# The work.


EXAMINED = 3.0  #: times that a byte is looked at


CALLS = 4.0  #: of functions, for each byte


AT_ONCE = 4096


KEPT = 600  #: bytes that may be kept from one portion to the next, and are looked at again


CALLS_EACH = 1500  #: of functions, for each portion


def work(data):
    """Bytes looked at and functions called, for each byte, less what each portion may cost."""
    decoder, before, calls = StreamDecoder(), sys.getprofile(), 0

    def seen(frame, event, argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(seen)
    try:
        for start in range(0, len(data), AT_ONCE):
            decoder.feed(data[start : start + AT_ONCE])
        decoder.finish()
    finally:
        sys.setprofile(before)
    portions = 1 + len(data) // AT_ONCE
    return (decoder.examined - KEPT * portions) / len(data), (calls - CALLS_EACH * portions) / len(data)


def test_the_work_for_a_byte_is_bounded_on_every_stream():
    for name, data in costly(30_000).items():
        examined, calls = work(data)
        assert examined <= (1.2 if name == "text" else EXAMINED), name
        assert calls <= CALLS, name
