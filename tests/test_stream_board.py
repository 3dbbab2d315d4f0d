"""What a board says beside its samples: who gives them, which faults there were; fed as bytes."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from streams import INFO, frame_list, sent

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import FAULTS, BoardStatus, CommandResult, FaultCounts, Info, SampleChunk, SelfTestResult, Trouble
from session.bench.guided_session import BY_WATCHDOG, MOST_SAID, NO_SENSOR, SETTLES, BoardReporter, SensorIdentity
from session.bench.logwriter import LogWriter
from session.io.errors import OtherSensor

#: what decides that the stream is of frames
HELLO = frames.encode_info(0, INFO)
REGISTERS = bytes.fromhex("50540044001000000020")


def frame(body: bytes) -> bytes:
    return frames.encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()


def board_frame(
    source: int = 1,
    sequence: int = 0,
    baud: int = 921600,
    odr_hz: float = 417.0,
    freq_fine: int = -4,
    who: int = 0x6B,
    state: int = 3,
) -> bytes:
    head = struct.pack("<BBBBBBb", source, state, 1, 2, 3, who, freq_fine)
    return frame(struct.pack("<BH", 0x05, sequence) + head + REGISTERS + struct.pack("<If", baud, odr_hz))


def faults_frame(sequence: int = 0, **counts: int) -> bytes:
    return frame(struct.pack("<BH17I", 0x06, sequence, *(counts.get(name, 0) for name in FAULTS)))


def done_frame(sequence: int, command: int, result: int) -> bytes:
    return frame(struct.pack("<BHBB", 0x07, sequence, command, result))


def self_test_frame() -> bytes:
    return frame(struct.pack("<BHH6f", 0x08, 0, 2, 300, 310, 320, 90, 95, 100))


def test_faults_of_firmware_1_0_have_no_rate():
    """Sixteen counts, as boards in the field send them."""
    (message,) = StreamDecoder().feed(HELLO + frame(struct.pack("<BH16I", 0x06, 0, *range(16))))[-1:]
    assert message.counts == (*range(16), 0)


def test_every_field_of_the_four_frames():
    events = StreamDecoder().feed(HELLO + board_frame() + faults_frame(parity=3, lost=5) + done_frame(7, 0x11, 4) + self_test_frame())
    assert events[1] == BoardStatus(1, True, True, "1.2.3", 0x6B, -4, REGISTERS, 921600, 417.0)
    assert dict(zip(FAULTS, events[2].counts, strict=True)) == {name: {"parity": 3, "lost": 5}.get(name, 0) for name in FAULTS}
    assert events[3:] == [CommandResult(7, 0x11, 4), SelfTestResult(2, (300.0, 310.0, 320.0), (90.0, 95.0, 100.0))]


@pytest.mark.parametrize("size", [1, 7, 64, 100_000])
def test_they_come_between_the_samples_take_no_number_and_are_said_once_each(size):
    rows = frame_list(*sent(300))
    second = board_frame() + faults_frame(overrun=1)
    data = b"".join([*rows[:100], second, *rows[100:200], second, *rows[200:], faults_frame(overrun=2)])
    decoder, events = StreamDecoder(), []
    for at in range(0, len(data), size):
        events += decoder.feed(data[at : at + size])
    events += decoder.finish()
    assert decoder.samples == 300
    assert decoder.lost == decoder.garbage == decoder.crc_errors == 0
    assert [type(event) for event in events if not isinstance(event, (SampleChunk, Trouble))] == [BoardStatus, FaultCounts, FaultCounts]


def test_infos_without_a_number_of_their_own_cost_no_lost_sample():
    """The driver's infos bear the number of the next sample.  One within a gap took none of the missing numbers."""
    rows = sent(900)
    body = frame_list(*rows)
    stream = (
        b"".join(body[:300])
        + frames.encode_info(300, INFO)
        + b"".join(body[300:600])
        + frames.encode_info(600, INFO)
        + b"".join(body[650:])
    )
    decoder = StreamDecoder()
    decoder.feed(stream)
    assert decoder.lost == 50
    assert decoder.samples == 850


@pytest.mark.broad
def test_at_the_lowest_rate_a_board_that_repeats_itself_leaves_room_for_infos():
    """12.5 Hz earns 1.5 remarks a second; info, board and faults are three."""
    decoder, rows = StreamDecoder(), frame_list(*sent(12 * 1000))
    seconds = [b"".join(rows[12 * i : 12 * i + 12]) + frames.encode_info(0, INFO) + board_frame() + faults_frame() for i in range(1000)]
    events = decoder.feed(b"".join(seconds))
    assert sum(type(event).__name__ == "Info" for event in events) == 1000


@pytest.mark.parametrize("body", [struct.pack("<BH", 0x05, 0), struct.pack("<BHB", 0x07, 0, 1), struct.pack("<BH18I", 0x06, 0, *range(18))])
def test_a_frame_of_another_length_is_passed_over(body):
    decoder = StreamDecoder()
    events = decoder.feed(b"".join(frame_list(*sent(50))) + frame(body) + b"".join(frame_list(*sent(50))[:0]))
    assert decoder.garbage == decoder.crc_errors == 0
    assert {type(event) for event in events} <= {SampleChunk}


def test_a_log_keeps_them_as_comments(tmp_path):
    rows, decoder, logs = frame_list(*sent(300)), StreamDecoder(), LogWriter(tmp_path)
    data = b"".join([HELLO, board_frame(), faults_frame(), *rows[:150], faults_frame(hang=1, lost=12), *rows[150:]])
    logs.write(decoder.feed(data) + decoder.finish())
    logs.close()
    comments = [line for line in logs.paths[0].read_text().splitlines() if line.startswith("#")]
    assert comments[1:] == [
        f"# board source=sensor firmware=1.2.3 who_am_i=0x6B freq_fine=-4 registers={REGISTERS.hex()}",
        "# faults hang=1 lost=12",
    ]


def heard(*data: bytes) -> list[str]:
    words = BoardReporter()
    return [
        line
        for event in StreamDecoder().feed(HELLO + b"".join(data))
        for line in (words.hear(event) if not isinstance(event, Info) else [])
    ]


def test_a_fault_is_said_with_what_it_cost_and_what_to_do():
    (said,) = heard(faults_frame(), faults_frame(hang=1, lost=12))
    assert "hung (1×): 12 samples lost" in said
    assert "wires" in said
    (said,) = heard(faults_frame(crowded_out=5), faults_frame(crowded_out=5))
    assert said.startswith("before this recording")
    assert "5 samples lost" in said
    assert "--baud" in said


def test_counts_that_fall_are_a_board_that_was_switched_on_again():
    assert FaultCounts((0,) * 17).since(FaultCounts((5,) * 17)) == {}
    assert FaultCounts((1, *(0,) * 16)).since(FaultCounts((5,) * 17)) == {"overrun": 1}


def test_a_loose_wire_does_not_say_it_for_ever():
    assert len(heard(*(faults_frame(parity=n) for n in range(200)))) == MOST_SAID + 1


def test_a_stand_in_is_said():
    assert heard(board_frame(source=0, who=0), board_frame(source=0, who=0, baud=1)) == [NO_SENSOR]
    assert heard(board_frame(source=1)) == []


def test_settling_filters_and_a_watchdogs_reset_are_said_once():
    assert heard(board_frame(state=7), board_frame(state=7), board_frame(state=3)) == [SETTLES]
    assert heard(board_frame(state=11), board_frame(state=11)) == [BY_WATCHDOG]
    event = StreamDecoder().feed(HELLO + board_frame(state=12))[1]
    assert (event.streams, event.runs, event.settles, event.by_watchdog) == (False, False, True, True)
    assert event.text.endswith(" reset=watchdog")


@pytest.mark.parametrize(
    ("who", "says"),
    [
        (0x69, "a chip that is no ASM330LHH and no LSM6DSO answers"),
        (0x6C, "a sensor answers on its bus"),
        (0x6B, "a sensor answers on its bus, but did not start"),
    ],
)
def test_a_stand_in_beside_a_chip_that_answers_says_which(who, says):
    (words,) = heard(board_frame(source=0, who=who))
    assert words.startswith(NO_SENSOR)
    assert f"{says}" in words
    assert words.endswith(f"WHO_AM_I 0x{who:02X}")


def said(odr_hz: float, serial: str = "0") -> Info:
    return replace(INFO, odr_hz=odr_hz, serial=serial)


def test_a_board_without_a_serial_number_is_another_where_its_rate_is_another():
    same = SensorIdentity()
    same.require(said(421.06))
    same.require(said(432.4))  # within a connection nobody swaps a board: it has measured better
    same.new_connection()
    same.require(said(433.0))
    same.new_connection()
    with pytest.raises(OtherSensor, match="it has no serial number"):
        same.require(said(433.0 * 1.027))
    with pytest.raises(OtherSensor):  # it stays another's
        same.require(said(433.0 * 1.027))
    same.new_connection()
    same.require(said(433.0))


def test_a_serial_number_is_another_boards():
    same = SensorIdentity()
    same.require(said(421.06, "77"))
    same.require(said(421.06, "0"))
    with pytest.raises(OtherSensor, match="serial=78"):
        same.require(said(421.06, "78"))


def test_what_a_fault_cost_is_said_once_the_sensor_is_back_and_what_a_setting_cost_is_not():
    away, back = heard(faults_frame(), faults_frame(hang=1), faults_frame(hang=1, starts=1, lost=40))
    assert "no sample lost so far" in away
    assert back == "the sensor is back: 40 samples lost"
    assert heard(faults_frame(), faults_frame(starts=1), faults_frame(starts=1, lost=400)) == []
