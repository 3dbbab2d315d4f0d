"""What was received is on disk, whatever happens: kill, full disk, pulled cable; and it replays to the same log."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import pty
import signal
import termios
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest
import serial
from streams import INFO, decode, frame_list, line_list, samples, sent

import calibrate
from session.common.errors import DeviceError, StorageError
from session.log.config import read_config
from session.log.folder import read_session
from session.recording import rawfile
from session.recording.clock import ComparisonOfClocks
from session.recording.decoding import stream
from session.recording.logwriter import LogWriter
from session.recording.port import Closed, Opened, Port, Received
from session.recording.ports import known_ports, only_candidate
from session.recording.rawfile import RawFile, read_marks
from session.recording.recorder import Recorder
from session.stream import frames
from session.stream.decoder import StreamDecoder
from session.stream.events import Chunk, Comment, Info, Trouble
from tinygc.simulation.board.terminal import Terminal

PATIENCE_S = 10.0
CONFIG = """schema = "tinygc-session/1"
[sensor]
odr_hz = 1667
gyro_fs_dps = 500
accel_fs_g = 4
"""


def _wire():
    """A pseudo-terminal: the master's file, the slave's name; the slave is kept open."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for file in (master, slave):
        os.close(file)


wire = pytest.fixture(_wire, name="wire")
other_wire = pytest.fixture(_wire, name="other_wire")


def until(condition, poll=lambda: time.sleep(0.005)) -> None:
    """Wait for something that must happen."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        poll()


def send(file: int, data: bytes) -> None:
    """All of it, however slowly it is read."""
    for start in range(0, len(data), 512):
        os.write(file, data[start : start + 512])


def record(recorder: Recorder, file: int, data: bytes) -> list:
    """Send and take in until all of it is decoded; returns the events."""
    sender, events = threading.Thread(target=send, args=(file, data), daemon=True), []
    wanted = recorder.raw.size + len(data)
    sender.start()
    until(lambda: recorder._decoded >= wanted, lambda: events.extend(recorder.poll(0.02)))
    sender.join()
    return events


def replayed(raw_path: Path, folder: Path) -> list[bytes]:
    """The logs that a raw file makes."""
    folder.mkdir()
    decoder, logs = StreamDecoder(), LogWriter(folder)
    for _ in stream(raw_path, decoder, logs):
        pass
    logs.write(decoder.finish())
    logs.close()
    return [path.read_bytes() for path in logs.paths]


# The recorder


@pytest.mark.parametrize("encode", [frame_list, line_list])
def test_a_recording_is_a_log_and_replays_bit_for_bit(encode, wire, tmp_path):
    master, name = wire
    t_us, registers = sent(3000)
    recorder = Recorder(tmp_path / "s", name)
    data = b"".join(encode(t_us, registers)) + frames.encode_info(3000, INFO) * (encode is frame_list)
    events = record(recorder, master, data)
    recorder.close()
    assert (tmp_path / "s" / "raw.bin").read_bytes() == data
    table = np.loadtxt(tmp_path / "s" / "log0001.csv", delimiter=",", comments="#", skiprows=1, dtype=np.int64)
    assert np.array_equal(table, np.column_stack([t_us, registers]))
    assert len(samples(events)[0]) >= 2999  # the last line counts when the next has come, or at the end
    assert replayed(tmp_path / "s" / "raw.bin", tmp_path / "again") == [(tmp_path / "s" / "log0001.csv").read_bytes()]


def test_replay_makes_a_session_folder(wire, tmp_path, capsys):
    """With the session.toml that lies beside the raw file, or what the board says, or what it must be told."""
    master, name = wire
    recorder = Recorder(tmp_path / "s", name)
    t_us, registers = sent(3000)
    record(recorder, master, frames.encode_info(0, INFO) + b"".join(frame_list(t_us, registers, first=1)))
    recorder.close()
    raw = str(tmp_path / "s" / "raw.bin")
    assert calibrate.main(["replay", raw, "--out", str(tmp_path / "a"), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["samples"] == 3000
    assert (tmp_path / "a" / "log0001.csv").read_bytes() == (tmp_path / "s" / "log0001.csv").read_bytes()
    sensor = read_session(tmp_path / "a").config.sensor
    assert (sensor.odr_hz, sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.serial) == (1667.0, 500, 4, "77")
    (tmp_path / "s" / "session.toml").write_text(CONFIG)
    assert calibrate.main(["replay", raw, "--out", str(tmp_path / "b")]) == 0
    assert (tmp_path / "b" / "session.toml").read_text() == CONFIG
    assert calibrate.main(["replay", raw, "--out", str(tmp_path / "b")]) == 2
    assert "give --out a new folder" in capsys.readouterr().err
    capture = tmp_path / "capture.bin"  # of any other program
    capture.write_bytes(b"".join(line_list(t_us, registers)))
    assert calibrate.main(["replay", str(capture), "--out", str(tmp_path / "c" / "d")]) == 2
    assert "--gyro-fs DPS --accel-fs G" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
    assert calibrate.main(["replay", str(capture), "--out", str(tmp_path / "c"), "--gyro-fs", "500", "--accel-fs", "4"]) == 0
    assert read_config(tmp_path / "c" / "session.toml").sensor.odr_hz == 1667.0
    capture.write_bytes(np.random.default_rng(0).bytes(5000))
    assert calibrate.main(["replay", str(capture), "--out", str(tmp_path / "e")]) == 2
    assert "no samples" in capsys.readouterr().err
    assert not (tmp_path / "e").exists()


def test_a_reset_begins_a_new_log_and_comments_are_kept(tmp_path):
    logs = LogWriter(tmp_path)
    chunk = Chunk(*sent(3))
    logs.write(
        [Comment("first words"), chunk, INFO, INFO, Trouble("implausible", 2, 5), Trouble("reset"), chunk, Trouble("reconnect"), chunk]
    )
    logs.begin("closure")
    logs.write([Comment(INFO.text), INFO, chunk])
    logs.close()
    assert [path.name for path in logs.paths] == ["log0001.csv", "log0002.csv", "log0003.csv", "closure0001.csv"]
    lines = logs.paths[0].read_text().split("\n")
    assert lines[:2] == ["# first words", "t_us,gx,gy,gz,ax,ay,az,temp"]
    assert lines[5] == f"# {INFO.text}" == "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=1666.5000 serial=77"
    assert lines[6] == "# left out as implausible: 2 (t_us 5)"
    assert logs.paths[3].read_text().count(INFO.text) == 1
    (tmp_path / "session.toml").write_text(CONFIG)
    session = read_session(tmp_path)
    assert [len(log.samples) for log in session.logs] == [3, 3, 3]
    assert session.logs[0].comments["odr_hz"] == "1666.5000"


def test_where_a_closure_run_begins_replays_too(wire, tmp_path):
    master, name = wire
    recorder = Recorder(tmp_path / "s", name)
    messages = frame_list(*sent(2000))
    record(recorder, master, b"".join(messages[:1000]) + messages[1000][:11])
    recorder.begin("closure")
    record(recorder, master, messages[1000][11:] + b"".join(messages[1001:]))
    recorder.close()
    there = [(tmp_path / "s" / name).read_bytes() for name in ("log0001.csv", "closure0001.csv")]
    assert [text.count(b"\n") for text in there] == [1001, 1001]
    assert replayed(tmp_path / "s" / "raw.bin", tmp_path / "again") == there


# Kill, full disk, read-only folder


def _record_for_ever(folder: Path, name: str) -> None:
    recorder = Recorder(folder, name)
    while True:
        recorder.poll(0.01)


@pytest.mark.parametrize("seed", range(20))
def test_killed_at_a_random_moment(seed, tmp_path, wire):
    """Every byte that left the terminal is in the file, but for what one read had just taken; it replays to what was sent."""
    master, name = wire
    rng = np.random.default_rng(seed)
    t_us, registers = sent(40_000)
    data = memoryview(b"".join(frame_list(t_us, registers)))
    child = multiprocessing.get_context("fork").Process(target=_record_for_ever, args=(tmp_path / "s", name), daemon=True)
    child.start()
    until(lambda: (tmp_path / "s" / "raw.times").exists() and read_marks(tmp_path / "s" / "raw.bin"))
    os.set_blocking(master, False)
    written, deadline = 0, time.monotonic() + 30
    begun = False
    while time.monotonic() < deadline:
        if not begun and (tmp_path / "s" / "raw.bin").stat().st_size:
            begun, deadline = True, time.monotonic() + rng.uniform(0.0, 0.13)
        try:
            written += os.write(master, data[written : written + int(rng.integers(1, 2000))])
        except BlockingIOError:
            time.sleep(0.001)
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    left = _left_in(name)
    kept = (tmp_path / "s" / "raw.bin").read_bytes()
    assert kept == bytes(data[: len(kept)])
    assert 0 <= written - len(kept) - left <= 4096
    _, events = decode(kept)
    got_us, got = samples(events)
    assert len(got_us) == len(kept) // 25 > 0
    assert np.array_equal(got, registers[: len(got)])
    [log] = replayed(tmp_path / "s" / "raw.bin", tmp_path / "again")
    assert log.startswith((tmp_path / "s" / "log0001.csv").read_bytes() if (tmp_path / "s" / "log0001.csv").exists() else b"")


def _left_in(name: str) -> int:
    """Bytes that nobody has read."""
    slave = os.open(name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    total = quiet = 0
    while quiet < 3:
        try:
            got = len(os.read(slave, 65536))
        except BlockingIOError:
            got = 0
        total += got
        quiet = 0 if got else quiet + 1
        time.sleep(0.0 if got else 0.005)
    os.close(slave)
    return total


def test_resumed_after_a_kill(wire, tmp_path):
    """The log is made again from the raw bytes, torn lines and all, and a new one follows."""
    master, name = wire
    first, second = sent(500), sent(500, 90_000_000, seed=1)
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "raw.bin").write_bytes(b"".join(frame_list(*first))[:-3])
    (folder / "raw.times").write_text("host_ns,bytes,event\n5,0,open then /dev/x\n9,100,\n12,2")
    (folder / "log0001.csv").write_text("t_us,gx,gy,gz,ax,ay,az,temp\n1,2,3")
    recorder = Recorder(folder, name)
    assert len(samples(recorder.resumed)[0]) == 499
    record(recorder, master, b"".join(frame_list(*second)))
    recorder.close()
    there = [path.read_bytes() for path in sorted(folder.glob("log*.csv"))]
    assert [text.count(b"\n") for text in there] == [500, 501]
    assert replayed(folder / "raw.bin", tmp_path / "again") == there
    assert recorder.decoder.samples == 999


class _FullDisk:
    """``os``, with a disk that holds ``room`` bytes of raw file."""

    def __init__(self, room: int):
        self.room = room

    def __getattr__(self, name):
        return getattr(os, name)

    def write(self, file: int, data: bytes) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = os.write(file, data[: self.room])
        self.room -= written
        return written


def test_a_full_disk_keeps_what_was_received_and_says_so(wire, other_wire, tmp_path, monkeypatch):
    master, name = wire
    t_us, registers = sent(3000)
    data = b"".join(frame_list(t_us, registers))
    monkeypatch.setattr(rawfile, "os", _FullDisk(40_000))
    recorder = Recorder(tmp_path / "s", name)
    with pytest.raises(StorageError, match=r"No space left on device; [0-9]+ bytes received before are safe in .*--resume") as said:
        record(recorder, master, data)
    recorder.close()
    kept = (tmp_path / "s" / "raw.bin").read_bytes()
    assert 38_000 < len(kept) == int(str(said.value).split("device; ")[1].split()[0])
    assert kept == data[: len(kept)]
    assert said.value.exit_code == 2
    monkeypatch.undo()
    recorder = Recorder(tmp_path / "s", other_wire[1])
    assert len(samples(recorder.resumed)[0]) == len(kept) // 25
    record(recorder, other_wire[0], b"".join(frame_list(*sent(100, 5))))
    recorder.close()
    assert recorder.decoder.samples == len(kept) // 25 + 100


def test_a_full_device(tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    (tmp_path / "raw.bin").symlink_to("/dev/full")
    raw = RawFile(tmp_path)
    for _ in range(2):
        with pytest.raises(StorageError, match="No space left"):
            raw.append(1, b"x")
    raw.close()
    logs = LogWriter(tmp_path)
    (tmp_path / "log0001.csv").symlink_to("/dev/full")
    with pytest.raises(StorageError, match="No space left"):
        logs.write([Chunk(*sent(20_000))])
    with pytest.raises(StorageError, match="No space left"):
        logs.close()
    logs.close()


def test_a_folder_that_cannot_be_written(tmp_path, wire):
    (tmp_path / "file").write_text("")
    folders = [tmp_path / "file" / "s"]
    if os.geteuid():  # the superuser may write anywhere
        (tmp_path / "locked").mkdir(mode=0o500)
        folders.append(tmp_path / "locked" / "s")
    for folder in folders:
        with pytest.raises(StorageError, match="give --out another folder"):
            Recorder(folder, wire[1])


def test_marks_survive_a_torn_line(tmp_path):
    raw = RawFile(tmp_path)
    raw.append(10, b"abc")
    raw.append(11, b"de")  # within the time step
    raw.append(20_000_000, b"f")
    raw.mark(30_000_000, "close it,\nhere", 4)
    raw.close()
    raw.close()
    with (tmp_path / "raw.times").open("a") as file:
        file.write("12,34")
    again = RawFile(tmp_path)
    assert again.size == 6
    again.mark(99, "open")
    again.close()
    assert [(mark.host_ns, mark.offset, mark.event) for mark in read_marks(tmp_path / "raw.bin")] == [
        (10, 3, ""),
        (30_000_000, 4, "close it, here"),
        (20_000_000, 6, ""),
        (99, 6, "open"),
    ]


# The port


def test_a_pulled_cable_and_the_next_connection(tmp_path):
    first, second = sent(400), sent(400, 0, seed=1)
    with Terminal(tmp_path / "port") as terminal:
        recorder, events = Recorder(tmp_path / "s", str(terminal.name)), []
        poll = lambda: events.extend(recorder.poll(0.02))  # noqa: E731
        until(lambda: recorder.connected, poll)
        assert terminal.write(b"".join(frame_list(*first)) + frame_list(*first)[0][:9])
        until(lambda: recorder.decoder.samples == 400, poll)
        terminal.unplug()
        until(lambda: not recorder.connected, poll)
        assert recorder.why
        time.sleep(0.4)
        terminal.plug()
        until(lambda: recorder.connected, poll)
        assert terminal.write(b"".join(frame_list(*second)))
        until(lambda: recorder.decoder.samples == 800, poll)
        recorder.close()
    assert [event.kind for event in events if isinstance(event, Trouble)] == ["garbage", "reconnect"]
    there = [path.read_bytes() for path in sorted((tmp_path / "s").glob("log*.csv"))]
    assert [text.count(b"\n") for text in there] == [401, 401]
    assert replayed(tmp_path / "s" / "raw.bin", tmp_path / "again") == there
    assert [mark.event.split()[0] for mark in read_marks(tmp_path / "s" / "raw.bin") if mark.event] == ["open", "close", "open"]


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (OSError(errno.EIO, "x"), "Input/output error"),
        (serial.SerialException("device reports readiness"), "device reports readiness"),
        (termios.error(errno.EIO, "Input/output error"), "Input/output error"),
    ],
)
def test_whatever_pyserial_raises_is_a_pulled_cable(error, says, wire, monkeypatch):
    port = Port(wire[1])
    assert isinstance(port.items.get(timeout=PATIENCE_S), Opened)
    fails = iter([error])

    def in_waiting(self):
        for problem in fails:
            raise problem
        return 0

    monkeypatch.setattr(serial.Serial, "in_waiting", property(in_waiting))
    closed, opened = port.items.get(timeout=PATIENCE_S), port.items.get(timeout=PATIENCE_S)
    assert isinstance(closed, Closed)
    assert closed.why == says
    assert isinstance(opened, Opened)
    os.write(wire[0], b"hello")
    received = port.items.get(timeout=PATIENCE_S)
    assert isinstance(received, Received)
    port.close()


def test_a_port_that_is_not_there_or_taken(wire, tmp_path):
    with pytest.raises(DeviceError, match=r"No such file or directory.*calibrate.py ports") as said:
        Port(str(tmp_path / "nothing"))
    assert said.value.exit_code == 3
    port = Port(wire[1])
    with pytest.raises(DeviceError, match="another program has it open"):
        Port(wire[1])
    with pytest.raises(DeviceError, match="another program has it open"):
        Recorder(tmp_path / "s", wire[1])
    port.close()


def test_a_port_that_cannot_be_opened_leaves_no_folder_behind(tmp_path):
    def refused(folder):
        with pytest.raises(DeviceError):
            Recorder(folder, str(tmp_path / "nothing"))

    refused(tmp_path / "data" / "session1")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    refused(tmp_path / "mine")
    assert list((tmp_path / "mine").iterdir()) == []
    (tmp_path / "mine" / "raw.bin").write_bytes(b"")
    refused(tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["raw.bin"]
    (tmp_path / "mine" / "raw.bin").write_bytes(b"0,1,2,3,4,5,6,7\n")
    (tmp_path / "mine" / "raw.times").write_text("host_ns,bytes,event\n")
    refused(tmp_path / "mine")
    assert (tmp_path / "mine" / "raw.bin").read_bytes() == b"0,1,2,3,4,5,6,7\n"
    assert (tmp_path / "mine" / "raw.times").exists()


def test_a_disk_that_is_full_from_the_start_leaves_no_folder_behind(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(StorageError, match="No space left"):
        RawFile(tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


class _Listed:
    def __init__(self, device, vid=None, pid=None, serial_number=None, product=None):
        self.device, self.vid, self.pid, self.serial_number, self.product = device, vid, pid, serial_number, product
        self.manufacturer, self.description = None, product or "n/a"


ST_LINK = _Listed("/dev/ttyACM0", 0x0483, 0x374B, "066D", "STM32 STLink")
OTHER = _Listed("/dev/ttyUSB0", 0x10C4, 0xEA60, None, "CP2102")
BUILT_IN = _Listed("/dev/ttyS0")


def test_ports_say_what_they_know(monkeypatch):
    listed = [BUILT_IN, OTHER, ST_LINK]
    monkeypatch.setattr("session.recording.ports.list_ports.comports", lambda: listed)
    monkeypatch.setattr("session.recording.ports.virtual_boards", lambda: [])
    ports = known_ports()
    assert [port.name for port in ports] == ["/dev/ttyACM0", "/dev/ttyUSB0", "/dev/ttyS0"]
    assert ports[0].what == "ST board: ST-LINK/V2-1"
    assert [port.is_candidate for port in ports] == [True, True, False]
    assert only_candidate().name == "/dev/ttyACM0"
    listed.append(_Listed("/dev/ttyACM1", 0x0483, 0x5740, "X", "STM32 Virtual ComPort"))
    with pytest.raises(DeviceError, match=r"ttyACM0, /dev/ttyACM1.*--port"):
        only_candidate()
    listed[:] = [BUILT_IN]
    with pytest.raises(DeviceError, match="no serial port with a board"):
        only_candidate()


def test_a_board_that_comes_back_under_another_name(tmp_path, monkeypatch):
    """By its serial number."""
    with Terminal(tmp_path / "ttyACM0") as first, Terminal(tmp_path / "ttyACM1") as second:
        listed = [_Listed(str(first.name), 0x0483, 0x374B, "066D")]
        monkeypatch.setattr("session.recording.ports.list_ports.comports", lambda: listed)
        port = Port(str(first.name))
        assert isinstance(port.items.get(timeout=PATIENCE_S), Opened)
        listed[:] = [_Listed(str(second.name), 0x0483, 0x374B, "066D")]
        first.unplug()
        assert isinstance(port.items.get(timeout=PATIENCE_S), Closed)
        assert port.items.get(timeout=PATIENCE_S).name == str(second.name)
        port.close()


# The clock


def test_the_devices_clock_is_compared_with_the_hosts():
    """0.3 % fast, arrivals late by up to 20 ms."""
    rng, clock = np.random.default_rng(0), ComparisonOfClocks()
    for k in range(2000):
        host_s = 0.01 * k
        clock.add(round((host_s + rng.exponential(0.005)) * 1e9), round(1.003 * host_s * 1e6))
        if k == 100:
            assert clock.device_seconds_per_second is None
    assert clock.device_seconds_per_second == pytest.approx(1.003, abs=1e-4)


def test_info_is_an_event_of_its_own(wire, tmp_path):
    recorder = Recorder(tmp_path / "s", wire[1])
    events = record(recorder, wire[0], b"".join(frame_list(*sent(100))) + frames.encode_info(100, INFO))
    assert [event for event in events if isinstance(event, Info)] == [INFO]
    assert recorder.odr_hz == INFO.odr_hz
    recorder.close()
