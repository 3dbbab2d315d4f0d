"""A board that takes commands is set; one that takes none is listened to.  The board here is bytes in and bytes out."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from processes import wait
from streams import INFO, frame_list, sent
from test_stream_physics import board_frame, done_frame

from session.bench import frames, port
from session.bench.decoder import StreamDecoder
from session.bench.port import BoardSetup, RequestedSettings
from session.bench.session_file import SessionFile
from session.io.config import BoardGiven, read_config
from session.io.errors import DeviceError
from tinygc import CalibrationError


class Wire:
    """A board at the other end: ``results`` by command, 0 where not given; deaf: it answers nothing."""

    def __init__(self, results=None, speaks=True, deaf=False, odr_hz=417.0, baud=921600, heard_at=None):
        self.results, self.speaks, self.deaf, self.odr_hz, self.baud = results or {}, speaks, deaf, odr_hz, baud
        self.baudrate, self.asked, self.heard_at = 921600, [], heard_at
        self._samples = frame_list(*sent(20_000))
        self._out = b""
        self._turn, self._next_baud = 0, None

    in_waiting = 4096

    def _say(self) -> bytes:
        return frames.encode_info(0, INFO) + (board_frame(odr_hz=self.odr_hz, baud=self.baud) if self.speaks else b"")

    def read(self, count: int) -> bytes:
        self._turn += 1
        wait()
        status = self._say() if self._turn % 4 == 1 else b""
        out, self._out = self._out + self._samples[self._turn % 20_000] + status, b""
        out = out if self.baudrate == self.baud else bytes(byte ^ 0x55 or 1 for byte in out)
        self.baud, self._next_baud = self._next_baud or self.baud, None  # answered at the old rate
        return out

    def write(self, data: bytes) -> None:
        if self.deaf or self.baudrate != self.baud:
            return
        bodies, good = frames.decode_blocks(np.frombuffer(data.strip(b"\0"), np.uint8)[None])
        assert good.all()
        body = bodies[0].tobytes()
        kind, sequence = struct.unpack_from("<BH", body)
        self.asked.append((kind, body[3:]))
        result = self.results.get(kind, 0)
        self._out += done_frame(sequence, kind, result)
        if kind == 0x18 and not result:
            self._next_baud = struct.unpack("<I", body[3:])[0] if self.heard_at is None else self.heard_at


def test_rate_and_ranges_are_asked_for_and_nothing_of_before_is_kept():
    wire = Wire()
    board = BoardSetup(RequestedSettings(833.0, 2000.0, None))
    assert board(wire) == b""
    assert wire.asked == [(0x11, struct.pack("<f", 833.0)), (0x12, struct.pack("<HH", 2000, int(INFO.accel_fs_g)))]
    assert board.said == ["data rate 833 Hz", f"ranges 2000 dps, {INFO.accel_fs_g:g} g"]


def test_what_is_so_already_is_not_asked_for():
    wire = Wire()
    BoardSetup(RequestedSettings(416.0, INFO.gyro_fs_dps, INFO.accel_fs_g))(wire)
    assert wire.asked == []


@pytest.mark.broad
def test_6667_hz_needs_a_faster_port():
    wire = Wire()
    board = BoardSetup(RequestedSettings(odr_hz=6667.0))
    board(wire)
    assert [kind for kind, _ in wire.asked] == [0x18, 0x17, 0x11]
    assert wire.baudrate == wire.baud == 2_000_000
    again = BoardSetup(RequestedSettings(odr_hz=6667.0))
    wire.baudrate, wire.odr_hz = 921600, 6667.0  # opened again, as the board was left
    again(wire)
    assert wire.baudrate == 2_000_000


@pytest.mark.parametrize(
    ("result", "says"),
    [(2, "no such value; the data rates are 12.5"), (3, "no sensor"), (4, "too slow"), (5, "did not start"), (9, "result 9")],
)
def test_a_refusal_is_one_line(result, says):
    with pytest.raises(CalibrationError, match=says) as raised:
        BoardSetup(RequestedSettings(odr_hz=900.0))(Wire({0x11: result}))
    assert "\n" not in str(raised.value)


def test_a_board_that_does_not_answer_is_waited_for_no_longer_than_it_takes(monkeypatch):
    monkeypatch.setattr(port, "ANSWER_S", 0.01)
    with pytest.raises(DeviceError, match="does not answer"):
        BoardSetup(RequestedSettings(odr_hz=833.0))(Wire(deaf=True))
    with pytest.raises(DeviceError, match="2000000 baud"):
        BoardSetup(RequestedSettings(odr_hz=6667.0))(Wire(heard_at=115200))


def test_of_a_board_that_takes_no_commands_every_byte_is_kept_and_nothing_is_sent():
    wire, reference = Wire(speaks=False), Wire(speaks=False)
    heard = BoardSetup(RequestedSettings(833.0))(wire)
    assert wire.asked == []
    assert heard
    assert b"".join(reference.read(1) for _ in range(wire._turn)) == heard


def test_nothing_wanted_is_nothing_done():
    wire = Wire()
    assert BoardSetup(RequestedSettings())(wire) == b""
    assert wire._turn == 0


def test_a_resumed_recording_sets_the_board_as_its_session_toml_says(tmp_path):
    asked = SessionFile(tmp_path, None, 1667.0, 500, 4)
    board = StreamDecoder().feed(frames.encode_info(0, INFO) + board_frame(odr_hz=1667.0))[1]
    said = replace(INFO, gyro_fs_dps=500.0, accel_fs_g=4.0)
    assert asked.configure(said) is not None
    assert read_config(asked.path).board == BoardGiven()
    asked.configure(said, board=board)
    assert read_config(asked.path).board == BoardGiven("sensor", "1.2.3", 0x6B, -4, board.registers.hex(), 1667)
    assert "# 107 is 0x6B: an ASM330LHH, or a sibling of it (" in asked.path.read_text(encoding="utf-8")
    assert SessionFile(tmp_path, None, None, None, None).wanted() == RequestedSettings(1667, 500, 4)


def test_a_file_of_a_users_own_is_left_as_it_is(tmp_path):
    first = SessionFile(tmp_path, None, 1667.0, 500, 4)
    first.configure(None, 3.0)
    text = first.path.read_bytes()
    board = StreamDecoder().feed(frames.encode_info(0, INFO) + board_frame())[1]
    second = SessionFile(tmp_path, None, None, None, None)
    second.configure(replace(INFO, gyro_fs_dps=500.0, accel_fs_g=4.0), board=board)
    assert first.path.read_bytes() == text
    assert second.wanted() == RequestedSettings()


def test_a_file_waits_for_the_serial_number_of_a_board_that_says_it(tmp_path):
    """All else may be given: without its number another board could take the place of this one."""
    given = SessionFile(tmp_path / "s", None, 1667.0, INFO.gyro_fs_dps, INFO.accel_fs_g)
    assert given.configure(None, 0.5, speaks=True) is None
    board = StreamDecoder().feed(frames.encode_info(0, INFO) + board_frame())[1]
    assert given.configure(INFO, 0.9, speaks=True) is None
    assert given.configure(None, 1.0, board=board, speaks=True).sensor.serial == INFO.serial != ""
    silent = SessionFile(tmp_path / "t", None, 1667.0, 500, 4)
    assert silent.configure(None, 3.1, speaks=True).sensor.serial == ""
    assert SessionFile(tmp_path / "u", None, 1667.0, 500, 4).configure(None, 0.0).sensor.serial == ""


@pytest.mark.parametrize(("who", "given", "model"), [(0x6B, None, "ASM330LHH"), (0x6C, None, "LSM6DSO"), (0x6C, "LSM6DSOX", "LSM6DSOX")])
def test_the_chip_that_answers_names_the_sensor_where_nobody_else_does(tmp_path, who, given, model):
    board = StreamDecoder().feed(frames.encode_info(0, INFO) + board_frame(who=who))[1]
    file = SessionFile(tmp_path, None, None, None, None, sensor=given)
    assert file.configure(INFO, board=board).sensor.model == model
    assert read_config(file.path).sensor.model == model
    assert "LSM6DSO32 as well, but its accelerometer's ranges are twice as wide" in file.path.read_text()
    assert file.assumed == (model == "ASM330LHH")
