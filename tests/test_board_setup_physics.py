"""A board that takes commands is set, and set again; what it says of itself is read back from session.toml, or refused and not written."""

import struct
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from configurations import CONFIGS, difference
from hypothesis import given, settings
from hypothesis import strategies as st
from processes import PATIENCE_S, wait
from streams import INFO, frame_list, line_list, sent
from test_stream_physics import board_frame, done_frame

from session.base.errors import DeviceError
from session.bench import frames, port
from session.bench.decoder import StreamDecoder
from session.bench.events import Info
from session.bench.port import BoardSetup, Port
from session.bench.session_file import NAME, SessionFile, toml_text
from session.log.config import Accelerometer, BoardGiven, Config, Protocol, Sensor, Site, read_config, sections
from tinygc import CalibrationError, read_session


class Wire:
    """A board at the other end: ``results`` by command, 0 where not given; deaf: it answers nothing."""

    def __init__(self, results=None, speaks=True, deaf=False, odr_hz=417.0, baud=921600, heard_at=None):
        self.results, self.speaks, self.deaf, self.odr_hz, self.baud = results or {}, speaks, deaf, odr_hz, baud
        self.baudrate, self.asked, self.heard_at = 921600, [], heard_at
        self._samples = frame_list(*sent(2_000))
        self._out = b""
        self._turn, self._next_baud = 0, None

    in_waiting = 4096

    def _say(self):
        return frames.encode_info(0, INFO) + (board_frame(odr_hz=self.odr_hz, baud=self.baud) if self.speaks else b"")

    def read(self, count):
        self._turn += 1
        wait()
        status = self._say() if self._turn % 4 == 1 else b""
        out, self._out = self._out + self._samples[self._turn % 2_000] + status, b""
        out = out if self.baudrate == self.baud else bytes(byte ^ 0x55 or 1 for byte in out)
        self.baud, self._next_baud = self._next_baud or self.baud, None  # answered at the old rate
        return out

    def write(self, data):
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
    board = BoardSetup({"odr_hz": 833.0, "gyro_fs_dps": 2000.0, "accel_fs_g": None})
    assert board(wire) == b""
    assert wire.asked == [(0x11, struct.pack("<f", 833.0)), (0x12, struct.pack("<HH", 2000, int(INFO.accel_fs_g)))]
    same = Wire()
    BoardSetup({"odr_hz": 416.0, "gyro_fs_dps": INFO.gyro_fs_dps, "accel_fs_g": INFO.accel_fs_g})(same)
    assert same.asked == []  # what is so already is not asked for
    assert board.applied == ["data rate 833 Hz", f"ranges 2000 dps, {INFO.accel_fs_g:g} g"]


def test_6667_hz_needs_a_faster_port(monkeypatch):
    monkeypatch.setattr(port, "SPEAKS_S", 0.3)
    wire = Wire()
    board = BoardSetup({"odr_hz": 6667.0})
    board(wire)
    assert [kind for kind, _ in wire.asked] == [0x18, 0x17, 0x11]
    assert wire.baudrate == wire.baud == 2_000_000
    again = BoardSetup({"odr_hz": 6667.0})
    wire.baudrate, wire.odr_hz = 921600, 6667.0  # opened again, as the board was left
    again(wire)
    assert wire.baudrate == 2_000_000


@pytest.mark.parametrize(
    ("result", "says"),
    [(2, "no such value; the data rates are 12.5"), (4, "too slow"), (9, "result 9")],
)
def test_a_refusal_is_one_line(result, says):
    with pytest.raises(CalibrationError, match=says) as raised:
        BoardSetup({"odr_hz": 900.0})(Wire({0x11: result}))
    assert "\n" not in str(raised.value)


def test_a_board_that_does_not_answer_is_waited_for_no_longer_than_it_takes(monkeypatch):
    monkeypatch.setattr(port, "ANSWER_S", 0.01)
    with pytest.raises(DeviceError, match="does not answer"):
        BoardSetup({"odr_hz": 833.0})(Wire(deaf=True))
    with pytest.raises(DeviceError, match="2000000 baud"):
        BoardSetup({"odr_hz": 6667.0})(Wire(heard_at=115200))


def test_of_a_board_that_takes_no_commands_every_byte_is_kept_and_nothing_is_sent():
    wire, reference = Wire(speaks=False), Wire(speaks=False)
    heard = BoardSetup({"odr_hz": 833.0})(wire)
    assert wire.asked == []
    assert heard
    assert b"".join(reference.read(1) for _ in range(wire._turn)) == heard


def test_a_resumed_recording_sets_the_board_as_its_session_toml_says(tmp_path):
    asked = SessionFile(tmp_path, None, 1667.0, 500, 4)
    board = StreamDecoder().feed(frames.encode_info(0, INFO) + board_frame(odr_hz=1667.0))[1]
    said = replace(INFO, gyro_fs_dps=500.0, accel_fs_g=4.0)
    assert asked.configure(said) is not None
    assert read_config(asked.path).board == BoardGiven()
    asked.configure(said, board=board)
    assert read_config(asked.path).board == BoardGiven("sensor", "1.2.3", 0x6B, -4, board.registers.hex(), 1667)
    assert "# 107 is 0x6B: an ASM330LHH, or a sibling of it (" in asked.path.read_text(encoding="utf-8")
    assert SessionFile(tmp_path, None, None, None, None).wanted() == {"odr_hz": 1667, "gyro_fs_dps": 500, "accel_fs_g": 4}


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


OTHER = frames.encode_info(0, INFO)  # 500 dps, 4 g: what the board is switched on with


WANTED = {"odr_hz": 833.0, "gyro_fs_dps": 2000.0}


@pytest.fixture
def set_board(monkeypatch):
    """A setting that has just set a board, long enough ago to be sure of it."""
    made = BoardSetup(WANTED)
    assert made(Wire()) == b""
    monkeypatch.setattr(port, "MEANS_IT_S", 0.0)
    return made


def as_set():
    return frames.encode_info(7, type(INFO)(2000.0, INFO.accel_fs_g, 833.0 * 1.013, INFO.serial))


class Restarting(Wire):
    """Switched on again after so many reads: it says first what it is, as it was made."""

    def __init__(self, after):
        super().__init__()
        self._after, self.asked_before, self.is_set = after, 0, False

    def read(self, count):
        if self.is_set and not self.asked_before and self._turn > self._after:
            self.asked_before, self.is_set = len(self.asked), False
            return OTHER + board_frame() + self._samples[0]
        return super().read(count)

    def write(self, data):
        super().write(data)
        self.is_set = {0x11, 0x12} <= {kind for kind, _ in self.asked[self.asked_before :]}

    def _say(self):
        return as_set() + board_frame(odr_hz=833.0) if self.is_set else super()._say()

    def close(self):
        """As a port's."""


def test_the_port_sets_it_again_and_begins_another_connection(monkeypatch):
    wire = Restarting(60)
    monkeypatch.setattr(port, "MEANS_IT_S", 0.0)
    monkeypatch.setattr(port.serial, "Serial", lambda *args, **how: wire)
    made = BoardSetup(WANTED)
    opened = Port("wire", setup=made)
    items = []
    while sum(not isinstance(item, bytes) for item in items) < 3:
        items.append(opened.items.get(timeout=PATIENCE_S)[1])
    opened.close()
    states = [item for item in items if not isinstance(item, bytes)]
    assert [state.kind for state in states] == ["open", "close", "open"]
    assert "switched on again" in states[1].text
    assert OTHER not in b"".join(item for item in items if isinstance(item, bytes))
    again = [kind for kind, _ in wire.asked[wire.asked_before :]]
    assert again == [0x11, 0x12]


def test_what_is_as_it_was_set_or_said_at_once_or_by_a_board_without_commands_is_left_alone(set_board):
    assert set_board.forgotten(as_set() + b"".join(frame_list(*sent(100))) + board_frame() + as_set()) is None
    listens = BoardSetup(WANTED)
    listens(Wire(speaks=False))
    assert listens.forgotten(OTHER) is None


def test_a_board_that_says_so_right_after_it_was_set_means_it():
    made = BoardSetup(WANTED)
    made(Wire())
    assert made.forgotten(OTHER) is None


numbers = st.one_of(
    st.sampled_from([500.0, 4.0, 416.0, 1666.5, 1.0, 2000.0, 1e-9, 1e9, 0.1, 333.3333333, 65535.0]),
    st.floats(min_value=1e-6, max_value=1e6, exclude_min=True, exclude_max=True),
)


ODD = ["", "77", "ASM330LHH", "MPU-9250", "nobody's", "\U0001f600", 'S/N "7"\\', "#", "a\x85b", "\udc80", " "]


words = st.one_of(st.sampled_from(ODD), st.text(max_size=30))


infos = st.builds(Info, *(st.one_of(st.just(usual), numbers) for usual in (500.0, 4.0, 416.0)), words, words)


def file_of(folder):
    return SessionFile(folder, None, None, None, None)


FEW = settings(max_examples=25)


@FEW
@given(infos, st.booleans())
def test_whatever_a_board_says_is_read_again_or_refused(info, physical):
    """A session.toml that is written is read as what was meant, and the same board goes on with it."""
    with tempfile.TemporaryDirectory() as parent:
        folder, refused, config = Path(parent) / "s", "", None
        try:
            config = file_of(folder).configure(info, 0.0, physical)
        except CalibrationError as error:
            refused = str(error)
        assert (config is None) == bool(refused)
        if config is None:
            assert refused.isprintable()
            assert list(folder.iterdir()) == []
            return
        read = read_config(folder / "session.toml")
        assert read.sensor == config.sensor
        assert toml_text(read) == (folder / "session.toml").read_text("utf-8")
        assert [path.name for path in folder.iterdir()] == ["session.toml"]
        assert file_of(folder).configure(info, 0.0, physical).sensor == read.sensor  # the same board, resumed
        if not physical:
            assert read.sensor.register_units.gyro_rps > 0
            (folder / "log0001.csv").write_bytes(b"t_us,gx,gy,gz,ax,ay,az,temp\n" + b"".join(line_list(*sent(200))))
            assert len(read_session(folder).logs[0].samples) == 200


@pytest.mark.parametrize(
    ("info", "says"),
    [
        (Info(500.0, 4.0, 9e4, "7"), "sensor.odr_hz is 90000.0, expected a number from 0.1 to 50000"),
        (Info(500.0, 5e4, 416.0, "7"), "sensor.accel_fs_g is 50000, expected"),
        (Info(1.0, 4.0, 416.0, "7"), "gyro_fs_dps = 1 is no ASM330LHH full scale"),
        (Info(500.0, 4.0, 416.0, "7", "nobody's"), "its registers are not known"),
    ],
)
def test_what_no_sensor_has_is_refused_before_it_is_written(info, says, tmp_path):
    with pytest.raises(CalibrationError, match=r"session\.toml: not written: ") as said:
        file_of(tmp_path).configure(info)
    assert says in str(said.value)
    assert "--odr, --gyro-fs, --accel-fs, --sensor" in str(said.value)
    assert list(tmp_path.iterdir()) == []
    right = SessionFile(tmp_path, None, 416.0, 500.0, 4.0, "ASM330LHH")
    assert right.configure(None).sensor.odr_hz == 416.0


def written(text):
    """What is read of a session.toml."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / NAME
        path.write_text(text, encoding="utf-8")
        return read_config(path)


@FEW
@given(CONFIGS)
def test_any_configuration_that_is_written_is_read_as_it_was(config):
    assert difference(config, written(toml_text(config, but=()))) == []


def test_sections_of_features_and_limits_are_written_with_a_saved_session(tmp_path):
    """What a section holds beyond its defaults, tables and lists of tables within it, too."""
    limits = "[requirements.closure_deg]\nupper = 1.0\n"
    text = toml_text(Config(Sensor("ASM330LHH", "7", 208.0, 500.0, 4.0), Accelerometer(), Site(), Protocol()))
    names = {"certificate": '[certificate]\nlaboratory = "A"\n[[certificate.equipment]]\nname = "table"\ndue = 2027-01-01\n'}
    given = written("\n".join([text, limits, *(names[name] for name in names if name in sections())]))
    again = written(toml_text(given, but=()))
    assert (again.requirements.limits, again.sections) == ({"closure_deg": (-np.inf, 1.0)}, given.sections)
