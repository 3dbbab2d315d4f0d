"""What a board says beside its samples: who gives them, which faults there were; fed as bytes."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from streams import INFO, frame_list, sent

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import FAULTS, BoardStatus, CommandResult, FaultCounts, Info, SampleChunk, SelfTestResult, Trouble, starts_log
from session.bench.guided_session import MOST_SAID, NO_SENSOR, RESET_SAYS, SETTLES, BoardReporter, SensorIdentity
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


def test_the_order_of_the_counts_is_that_of_the_firmware():
    """A frame as it goes over the wire, byte for byte: where each count is, by docs/firmware.md.  Overrun is 1, order 2, ..., rate 17."""
    body = bytes.fromhex(
        "06 0000 01000000 02000000 03000000 04000000 05000000 06000000 07000000 08000000 09000000 0a000000 0b000000 0c000000 0d000000"
        "0e000000 0f000000 10000000 11000000"
    )
    (message,) = StreamDecoder().feed(HELLO + frame(body))[-1:]
    assert message.text == (
        "faults overrun=1 order=2 parity=3 tag=4 hang=5 zeros=6 ones=7 reset=8 changed=9 identity=10 silent=11 stamp=12 incomplete=13 "
        "starts=14 lost=15 crowded_out=16 rate=17"
    )


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
    """The lines of the messages and resets in a stream."""
    words, said, decoder = BoardReporter(), [], StreamDecoder()
    for event in decoder.feed(HELLO + b"".join(data)) + decoder.finish():
        if starts_log(event):
            said += words.was_reset()
        elif not isinstance(event, (Info, SampleChunk, Trouble)):
            said += words.hear(event)
    return said


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


def test_what_a_board_has_counted_is_counted_once_over_connections():
    """A cable that was pulled, or --resume: the board goes on counting unless it was switched on again."""
    words, lines = BoardReporter(), []
    for counts in ({"lost": 4, "hang": 1}, {"lost": 163, "hang": 1, "parity": 3, "reset": 1}, None):
        if counts is None:
            words.new_connection()
        else:
            lines += words.hear(FaultCounts(tuple(counts.get(name, 0) for name in FAULTS)))
    whole = {"lost": 159, "parity": 3, "reset": 1}  # none of before the recording
    assert words.counted == whole
    assert words.hear(words.faults) == []
    assert words.counted == whole
    words.new_connection()
    assert len(words.hear(FaultCounts(tuple(int(name == "parity") for name in FAULTS)))) == 1  # they fell: switched on again
    assert words.counted == whole | {"parity": 4}
    assert [line.startswith("before this recording") for line in lines] == [True, False]


def test_a_loose_wire_does_not_say_it_for_ever():
    assert len(heard(*(faults_frame(parity=n) for n in range(200)))) == MOST_SAID + 1


def test_a_stand_in_is_said():
    assert heard(board_frame(source=0, who=0), board_frame(source=0, who=0, baud=1)) == [NO_SENSOR]
    assert heard(board_frame(source=1)) == []


def test_settling_filters_are_said_once():
    assert heard(board_frame(state=7), board_frame(state=7), board_frame(state=3)) == [SETTLES]
    event = StreamDecoder().feed(HELLO + board_frame(state=4))[1]
    assert (event.streams, event.runs, event.settles, event.reset) == (False, False, True, "")


#: states of a board that streams its sensor: as switched on, behind its watchdog's reset, behind a fault of its core
ON, HUNG, ASTRAY = 3, 3 | 8, 3 | 16
WATCHDOG, FAULT = RESET_SAYS["watchdog"], RESET_SAYS["fault"]


@pytest.mark.parametrize(
    ("state", "flags", "comment"),
    [(ON, (False, False), "00200"), (HUNG, (True, False), "watchdog"), (ASTRAY, (False, True), "fault"), (3 | 24, (True, True), "fault")],
)
def test_what_a_reset_came_of_is_in_the_log(state, flags, comment):
    """Of a sensor, and of a stand-in."""
    sensor, standin = (StreamDecoder().feed(HELLO + board_frame(source, state=state))[1] for source in (1, 0))
    assert (sensor.by_watchdog, sensor.by_fault) == flags
    assert sensor.text.endswith(f" reset={comment}" if any(flags) else REGISTERS.hex())
    assert standin.text == "board source=stand-in firmware=1.2.3" + (f" reset={comment}" if any(flags) else "")


def restarted(*states: int) -> list[bytes]:
    """A board that starts again and again, each time with a status before its samples and two among them: their stamps begin anew."""
    rows = b"".join(frame_list(*sent(1200, start_us=5000)))
    return [board_frame(state=state) + rows[: len(rows) // 2] + board_frame(state=state) + rows[len(rows) // 2 :] for state in states]


@pytest.mark.parametrize(
    ("states", "says"),
    [
        ((ON, HUNG, HUNG, HUNG), [WATCHDOG, WATCHDOG, WATCHDOG]),  # the second and the third are said as well
        ((ON, ASTRAY, HUNG, ASTRAY), [FAULT, WATCHDOG, FAULT]),
        ((HUNG,), [WATCHDOG]),  # before this recording
        ((HUNG, HUNG), [WATCHDOG, WATCHDOG]),
        ((ON, HUNG, ON, HUNG), [WATCHDOG, WATCHDOG]),  # somebody pressed its button between them
        ((ON, ON), []),
    ],
)
def test_what_each_reset_came_of_is_said_once(states, says):
    assert heard(*restarted(*states)) == says
    assert "since power-up" in WATCHDOG  # nothing is claimed of this recording


def test_what_a_reset_came_of_is_said_where_its_first_status_was_lost():
    """Then the stamps show the reset first."""
    begun, again = restarted(ON, HUNG)
    cut = again[len(board_frame(state=HUNG)) :]
    assert heard(begun, cut, again) == [WATCHDOG, WATCHDOG]
    assert heard(begun, again, again) == [WATCHDOG, WATCHDOG]


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
