"""The port: a pulled cable, a port that is not there or taken, a board that comes back under another name."""

from __future__ import annotations

import errno
import os
import termios

import pytest
import serial
from conftest import broad
from processes import PATIENCE_S, until
from recording_wires import make_wire, replayed
from streams import frame_list, sent

from session.bench.events import Trouble
from session.bench.port import Closed, Opened, Port, Received, is_virtual, known_ports, lock_of, only_candidate
from session.bench.rawfile import RawFile, read_marks
from session.bench.recorder import Recorder
from session.io.errors import CalibrationError, DeviceError, StorageError
from tinygc.simulation.terminal import Terminal

wire = pytest.fixture(make_wire, name="wire")


def test_a_pulled_cable_and_the_next_connection(tmp_path, monkeypatch):
    first, second = sent(400), sent(400, 0, seed=1)
    with Terminal(tmp_path / "port") as terminal:
        recorder, events = Recorder(tmp_path / "s", str(terminal.name)), []
        poll = lambda: events.extend(recorder.poll(0.02))  # noqa: E731
        opens, tried = recorder.port._open, []
        monkeypatch.setattr(recorder.port, "_open", lambda: tried.append(True) or opens())
        until(lambda: recorder.connected, poll)
        assert terminal.write(b"".join(frame_list(*first)) + frame_list(*first)[0][:9])
        until(lambda: recorder.decoder.samples == 400, poll)
        terminal.unplug()
        until(lambda: not recorder.connected, poll)
        assert recorder.why
        until(lambda: tried, poll, "a try to open the port that is not there")
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


@pytest.mark.broad
@pytest.mark.parametrize(
    ("error", "says"),
    [
        (OSError(errno.EIO, "x"), "Input/output error"),
        broad(serial.SerialException("device reports readiness"), "device reports readiness"),
        broad(termios.error(errno.EIO, "Input/output error"), "Input/output error"),
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


def _now_in_ticks(folder) -> int:
    """ns, as the system stamps what it makes: in steps of some milliseconds."""
    (folder / "now").write_text("now")
    return (folder / "now").stat().st_ctime_ns


def test_a_pseudo_terminal_of_the_same_number_is_anothers(monkeypatch, tmp_path):
    """Once a virtual board has gone, its number goes to whoever opens a terminal next: a recorder that waits must not read that."""
    monkeypatch.setattr("session.bench.port.RETRY_S", 0.01)
    tries = []
    masters = [os.openpty() for _ in range(2)]
    name = os.ttyname(masters[0][1])
    made = os.stat(name).st_ctime_ns
    port = Port(name)
    assert isinstance(port.items.get(timeout=PATIENCE_S), Opened)
    wait = port._stop.wait
    monkeypatch.setattr(port._stop, "wait", lambda seconds: tries.append(seconds) or wait(seconds))
    for file in masters[0]:
        os.close(file)
    assert isinstance(port.items.get(timeout=PATIENCE_S), Closed)
    until(lambda: _now_in_ticks(tmp_path) > made, what="the next tick of the system's clock, which stamps terminals")
    others = []
    while name not in [os.ttyname(slave) for _, slave in others]:  # as soon as it is free
        others.append(os.openpty())
        assert len(others) < 100, "the number was not given again"
    before = len(tries)
    until(lambda: len(tries) > before + 5 or not port.items.empty(), what="some tries")
    (own,) = [master for master, slave in others if os.ttyname(slave) == name]
    os.write(own, b"a person's keys")
    until(lambda: len(tries) > before + 10 or not port.items.empty(), what="more tries")
    port.close()
    assert port.items.empty()
    for file in (*masters[1], *(file for pair in others for file in pair)):
        os.close(file)


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
    monkeypatch.setattr("session.bench.port.list_ports.comports", lambda: listed)
    monkeypatch.setattr("session.bench.port.virtual_boards", lambda: [])
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


@pytest.mark.broad
def test_a_board_that_comes_back_under_another_name(tmp_path, monkeypatch):
    """By its serial number."""
    with Terminal(tmp_path / "ttyACM0") as first, Terminal(tmp_path / "ttyACM1") as second:
        listed = [_Listed(str(first.name), 0x0483, 0x374B, "066D")]
        monkeypatch.setattr("session.bench.port.list_ports.comports", lambda: listed)
        port = Port(str(first.name))
        assert isinstance(port.items.get(timeout=PATIENCE_S), Opened)
        listed[:] = [_Listed(str(second.name), 0x0483, 0x374B, "066D")]
        first.unplug()
        assert isinstance(port.items.get(timeout=PATIENCE_S), Closed)
        assert port.items.get(timeout=PATIENCE_S).name == str(second.name)
        port.close()


@pytest.mark.parametrize("usual", [True, False])
def test_a_link_that_a_killed_board_left_is_not_followed(usual, wire, tmp_path, monkeypatch):
    """By now it may lead to somebody's terminal, which opening alone would take away from them."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    link = tmp_path / ("tinygc-board" if usual else "port")
    link.symlink_to(wire[1])
    if not usual:
        lock_of(link).write_text("")
    opened = []
    monkeypatch.setattr(serial, "Serial", lambda *words, **more: opened.append(words))
    with pytest.raises(DeviceError, match="runs no more"):
        Port(str(link))
    with pytest.raises(DeviceError, match="runs no more"):
        Recorder(tmp_path / "s", str(link))
    assert opened == []
    assert not (tmp_path / "s").exists()


def test_a_virtual_boards_time_is_not_compared_with_the_hosts(wire, tmp_path):
    """It may be told to hurry, or be late; a link of another program is a board."""
    with Terminal(tmp_path / "port") as terminal:
        assert is_virtual(str(terminal.name))
        recorder = Recorder(tmp_path / "virtual", str(terminal.name))
        terminal.write(b"".join(frame_list(*sent(50))))
        until(lambda: recorder.decoder.samples >= 40, recorder.poll, "40 samples")
        assert recorder.clock.measured is None
        assert not recorder.clock._earliest
        recorder.close()
    assert not is_virtual(str(terminal.name))
    (tmp_path / "vport").symlink_to(wire[1])
    assert not is_virtual(str(tmp_path / "vport"))


def test_a_link_of_another_program_is_opened(wire, tmp_path):
    (tmp_path / "vport").symlink_to(wire[1])
    port = Port(str(tmp_path / "vport"))
    assert isinstance(port.items.get(timeout=PATIENCE_S), Opened)
    port.close()


def test_a_board_takes_no_place_of_a_persons_file(tmp_path):
    (tmp_path / "poetry.lock").write_text("mine")
    with pytest.raises(CalibrationError, match="no lock of a virtual board"):
        Terminal(tmp_path / "poetry")
    assert (tmp_path / "poetry.lock").read_text() == "mine"
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "port").symlink_to(tmp_path / "mine")
    with pytest.raises(CalibrationError, match="File exists"), Terminal(tmp_path / "port"):
        pass
    assert (tmp_path / "port").read_text() == "mine"


def test_a_cable_that_is_pulled_while_the_board_is_set_again(tmp_path):
    tries = []

    class Setup:
        def __call__(self, port) -> bytes:
            tries.append(port)
            if len(tries) == 2:
                raise serial.SerialException("gone")
            return b""

        def forgotten(self, data: bytes) -> int | None:
            return 0 if b"X" in data else None

    with Terminal(tmp_path / "port") as terminal:
        port = Port(str(terminal.name), setup=Setup())
        items = []
        until(lambda: port.items.qsize() > 0)
        assert terminal.write(b"X")
        until(lambda: len(tries) > 2)
        until(lambda: port.items.qsize() > 3)
        port.close()
        while not port.items.empty():
            items.append(type(port.items.get()))
    assert items == [Opened, Closed, Closed, Opened]
