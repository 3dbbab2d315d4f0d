"""What was received is on disk, whatever happens, and its raw bytes replay to the same logs: the port, raw.bin, raw.times, the logs."""

import errno
import fcntl
import multiprocessing
import os
import shutil
import signal
import termios
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import serial
from processes import PATIENCE_S, until
from recording_wires import caught_up, make_wire, record, replayed, send
from streams import INFO, decode, frame_list, line_list, samples, sent

from session.base.errors import DeviceError, FormatError, StorageError
from session.bench import frames, rawfile
from session.bench.events import TROUBLES, Event, SampleChunk
from session.bench.logwriter import LogWriter
from session.bench.port import Port, known_ports, lock_of, only_candidate
from session.bench.rawfile import (
    _RESCUED,
    GrowingFile,
    Mark,
    RawFile,
    cut_words,
    decision_of,
    is_locked,
    name_kept,
    raw_event,
    read_events,
)
from session.bench.recorder import BLOCK, Recorder
from tinygc.simulation.terminal import Terminal

wire = pytest.fixture(make_wire, name="wire")


@pytest.fixture(autouse=True)
def _in_no_time(monkeypatch):
    """Nobody waits for long: for bytes, for a port that is not there, and to look whether the files still exist."""
    for name, seconds in (("port.READ_S", 0.02), ("port.RETRY_S", 0.01), ("rawfile.CHECK_S", 0.02)):
        monkeypatch.setattr(f"session.bench.{name}", seconds)


def frames_of(count, *more):
    return b"".join(frame_list(*sent(count, *more)))


@pytest.mark.parametrize("encode", [frame_list, line_list])
def test_a_recording_is_a_log_and_replays_bit_for_bit(encode, wire, tmp_path):
    master, name = wire
    t_us, registers = sent(3000)
    recorder, folder = Recorder(tmp_path / "s", name), tmp_path / "s"
    data = b"".join(encode(t_us, registers)) + frames.encode_info(3000, INFO) * (encode is frame_list)
    events = record(recorder, master, data)
    recorder.close()
    assert (folder / "raw.bin").read_bytes() == data
    table = np.loadtxt(folder / "log0001.csv", delimiter=",", comments="#", skiprows=1, dtype=np.int64)
    assert np.array_equal(table, np.column_stack([t_us, registers]))
    assert len(samples(events)[0]) >= 2999  # the last line counts when the next has come, or at the end
    assert replayed(folder / "raw.bin", tmp_path / "again") == [(folder / "log0001.csv").read_bytes()]


def test_a_reset_begins_a_new_log_and_comments_are_kept(tmp_path):
    logs = LogWriter(tmp_path)
    chunk = SampleChunk(*sent(3))
    lost, reset = Event("implausible", 2, 5), Event("reset")
    logs.write([Event("comment", text="first words"), chunk, INFO, INFO, lost, reset, chunk, Event("reconnect"), chunk])
    logs.begin("closure")
    logs.write([Event("comment", text=INFO.text), INFO, chunk])
    logs.close()
    assert [path.name for path in logs.paths] == ["log0001.csv", "log0002.csv", "log0003.csv", "closure0001.csv"]
    lines = logs.paths[0].read_text().split("\n")
    assert lines[:2] == ["# first words", "t_us,gx,gy,gz,ax,ay,az,temp"]
    assert lines[5] == f"# {INFO.text}" == "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=1666.5000 serial=77"
    assert lines[6] == "# left out as implausible: 2 (t_us 5)"
    assert logs.paths[3].read_text().count(INFO.text) == 1


def test_a_board_that_resets_every_few_frames_does_not_fill_the_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("session.bench.logwriter.MOST_LOGS", 20)
    logs = LogWriter(tmp_path)
    for start in range(20):
        logs.write([SampleChunk(*sent(100, 1000 * start)), Event("reset")])
    with pytest.raises(FormatError, match="20 logs: the board resets again and again"):
        logs.write([SampleChunk(*sent(100, 7))])
    logs.close()
    assert [path.read_text().count("\n") - 1 for path in logs.paths] == [100] * 20


other_wire = pytest.fixture(make_wire, name="other_wire")


# Decisions.


BEGIN, KEEP, PAUSE = Event("begin", text="unclosed"), Event("keep", text="closure"), Event("pause")


def parts(count=6, size=300):
    t_us, registers = sent(count * size)
    frames = frame_list(t_us, registers)
    return t_us, [b"".join(frames[i * size : (i + 1) * size]) for i in range(count)]


def logs_of(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.csv")}


def stamps(text):
    return [int(line.split(b",")[0]) for line in text.splitlines() if line[:1].isdigit()]


def test_pause_keeps_bytes_and_no_log_and_a_whole_run_gets_its_name(wire, tmp_path):
    master, name = wire
    t_us, data = parts()
    recorder = Recorder(tmp_path / "s", name)
    decisions = [PAUSE, Event("begin", text="log"), BEGIN, BEGIN, KEEP]
    for bytes_, decision in zip(data, [*decisions, None], strict=True):
        record(recorder, master, bytes_)
        if decision:
            recorder.decide(decision)
    recorder.close()
    there = logs_of(tmp_path / "s")
    assert sorted(there) == ["closure0001.csv", "log0001.csv", "log0002.csv", "unclosed0001.csv"]
    for log, part in (("log0001", 0), ("log0002", 2), ("unclosed0001", 3), ("closure0001", 4)):
        assert stamps(there[f"{log}.csv"]) == t_us[300 * part : 300 * (part + 1)].tolist()
    assert (tmp_path / "s" / "raw.bin").read_bytes() == b"".join(data)  # what was paused, and what came behind the run, as well
    replayed(tmp_path / "s" / "raw.bin", tmp_path / "again")
    assert logs_of(tmp_path / "again") == there


def test_resumed_it_goes_on_with_the_same_files_and_tells_the_decisions(wire, tmp_path):
    master, name = wire
    t_us, data = parts(4)
    recorder = Recorder(tmp_path / "s", name)
    for bytes_, decision in zip(data[:3], [Event("drop", text="123456"), BEGIN, KEEP], strict=True):
        record(recorder, master, bytes_)
        recorder.decide(decision)
    recorder.decide(Event("note", text="a, b; c=d"))
    recorder.close()
    before = logs_of(tmp_path / "s")
    again = Recorder(tmp_path / "s", name)
    told = [event for event in caught_up(again) if event.kind in ("drop", "begin", "keep", "note")]
    assert [raw_event(decision) for decision in told] == ["drop 123456", "begin unclosed", "keep closure", "note a, b; c=d"]
    again.decide(Event("begin", text="log"))
    record(again, master, data[3])
    again.close()
    after = logs_of(tmp_path / "s")
    assert {name: after[name] for name in before} == before
    assert stamps(after["log0002.csv"]) == t_us[900:].tolist()


def test_marks_that_make_no_sense_decide_nothing():
    for event in ("", "open then /dev/x", "close gone", "begin", "begin ../x", "keep a b", "drop -3", "drop x", "pauses", "unknown"):
        assert decision_of(Mark(0, 0, event)) is None
    assert decision_of(Mark(0, 0, "pause")) == PAUSE
    marks = [
        Mark(0, i, event) for i, event in enumerate(["begin a", "open x", "keep closure", "begin b", "note n", "keep closure", "begin c"])
    ]
    assert [name_kept(marks, i) for i in (0, 3, 6)] == [None, "closure", None]


# A log only grows.


TEXT = "".join(f"{i},a line of it\n" for i in range(2000))


def written(path, text, portions=(1, 50, 10_000)):
    file, start, k = GrowingFile(path), 0, 0
    while start < len(text):
        file.write(text[start : start + portions[k % len(portions)]])
        file.flush()
        start, k = start + portions[k % len(portions)], k + 1
    file.close()
    return file


@pytest.mark.parametrize("there", [0, 51, len(TEXT) - 1])
def test_it_goes_on_where_it_ended(tmp_path, there):
    path = tmp_path / "log0001.csv"
    path.write_text(TEXT[:there])
    assert written(path, TEXT).aside is None
    assert path.read_text() == TEXT
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("at", [0, 20_000, len(TEXT) - 2])
def test_what_somebody_changed_is_kept_beside_it(tmp_path, at):
    path, changed = tmp_path / "log0001.csv", TEXT[:at] + "#" + TEXT[at + 1 :]
    for number in (1, 2):
        path.write_text(changed)
        file = written(path, TEXT)
        assert path.read_text() == TEXT
        assert file.aside == tmp_path / f"log0001.csv.changed{number}"
        assert file.aside.read_text() == changed


# The port.


def test_a_pulled_cable_and_the_next_connection(tmp_path):
    folder = tmp_path / "s"
    with Terminal(tmp_path / "port") as terminal:
        recorder, events = Recorder(folder, str(terminal.name)), []
        poll = lambda: events.extend(recorder.poll(0.02))  # noqa: E731
        until(lambda: recorder.connected, poll)
        assert terminal.write(frames_of(400) + frames_of(1)[:9])
        until(lambda: recorder.decoder.samples == 400, poll)
        terminal.unplug()
        until(lambda: not recorder.connected, poll)
        assert recorder.why
        terminal.plug()
        until(lambda: recorder.connected, poll)
        assert terminal.write(frames_of(400, 0, 1))
        until(lambda: recorder.decoder.samples == 800, poll)
        recorder.close()
    assert [event.kind for event in events if event.kind in TROUBLES] == ["garbage", "reconnect"]
    there = [path.read_bytes() for path in sorted(folder.glob("log*.csv"))]
    assert [text.count(b"\n") for text in there] == [401, 401]
    assert replayed(folder / "raw.bin", tmp_path / "again") == there
    assert [mark.event.split()[0] for mark in read_events(folder / "raw.bin")] == ["open", "close", "open"]


@pytest.mark.parametrize("error", [OSError(errno.EIO, "x"), serial.SerialException("not ready"), termios.error(errno.EIO, "x")])
def test_whatever_pyserial_raises_is_a_pulled_cable(error, wire, monkeypatch):
    raised = iter([error])

    def in_waiting(self):
        for problem in raised:
            raise problem
        return 0

    monkeypatch.setattr(serial.Serial, "in_waiting", property(in_waiting))
    port = Port(wire[1])
    items = [port.items.get(timeout=PATIENCE_S)[1] for _ in range(3)]
    port.close()
    assert [item.kind for item in items] == ["open", "close", "open"]
    assert items[1].text in ("Input/output error", "not ready", "x")


def test_a_port_that_is_not_there_or_taken(wire, tmp_path):
    with pytest.raises(DeviceError, match=r"No such file or directory; see record --port list") as said:
        Port(str(tmp_path / "nothing"))
    assert said.value.exit_code == 3
    port = Port(wire[1])
    for again in (lambda: Port(wire[1]), lambda: Recorder(tmp_path / "s", wire[1])):
        with pytest.raises(DeviceError, match="another program has it open"):
            again()
    port.close()


def test_a_port_that_cannot_be_opened_leaves_no_folder_behind_and_what_was_there_alone(tmp_path):
    there = {"raw.bin": b"0,1,2,3,4,5,6,7\n", "raw.times": b"host_ns,bytes,event\n"}
    for folder in (tmp_path / "data" / "session1", tmp_path / "mine"):
        with pytest.raises(DeviceError):
            Recorder(folder, str(tmp_path / "nothing"))
        assert list(tmp_path.iterdir()) == [folder] * (folder.name == "mine")
        if folder.name == "session1":
            (tmp_path / "mine").mkdir()
            for name, data in there.items():
                (tmp_path / "mine" / name).write_bytes(data)
    assert {name: (folder / name).read_bytes() for name in there} == there


def listed(device, vid=None, pid=None, serial_number=None, product=None):
    """A port as pyserial lists it."""
    more = {"manufacturer": None, "description": product or "n/a"}
    return SimpleNamespace(device=device, vid=vid, pid=pid, serial_number=serial_number, product=product, **more)


def test_ports_say_what_they_know(monkeypatch):
    built_in, st_link = listed("/dev/ttyS0"), listed("/dev/ttyACM0", 0x0483, 0x374B, "066D", "STM32 STLink")
    there = [built_in, listed("/dev/ttyUSB0", 0x10C4, 0xEA60, None, "CP2102"), st_link]
    monkeypatch.setattr("session.bench.port.list_ports.comports", lambda: there)
    monkeypatch.setattr("session.bench.port.virtual_boards", lambda: [])
    ports = known_ports()
    assert [(port.name, port.is_candidate) for port in ports] == [("/dev/ttyACM0", True), ("/dev/ttyUSB0", True), ("/dev/ttyS0", False)]
    assert ports[0].what == "ST board: ST-LINK/V2-1"
    assert only_candidate().name == "/dev/ttyACM0"
    there.append(listed("/dev/ttyACM1", 0x0483, 0x5740, "X", "STM32 Virtual ComPort"))
    for left, says in ((there, r"ttyACM0, /dev/ttyACM1.*--port"), ([built_in], "no serial port with a board")):
        there[:] = left
        with pytest.raises(DeviceError, match=says):
            only_candidate()


def test_a_board_that_comes_back_under_another_name_is_known_by_its_serial_number(tmp_path, monkeypatch):
    with Terminal(tmp_path / "ttyACM0") as first, Terminal(tmp_path / "ttyACM1") as second:
        there = [listed(str(first.name), 0x0483, 0x374B, "066D")]
        monkeypatch.setattr("session.bench.port.list_ports.comports", lambda: there)
        port = Port(str(first.name))
        assert port.items.get(timeout=PATIENCE_S)[1].kind == "open"
        there[:] = [listed("/dev/ttyACM2", 0x0483, 0x374B, "066E"), listed(str(second.name), 0x0483, 0x374B, "066D")]
        first.unplug()
        assert port.items.get(timeout=PATIENCE_S)[1].kind == "close"
        assert port.items.get(timeout=PATIENCE_S)[1].text == str(second.name)
        port.close()


def test_a_link_that_a_killed_board_left_is_not_followed(wire, tmp_path, monkeypatch):
    """By now it may lead to another user's terminal, which opening alone would take away from them."""
    link, opened = tmp_path / "port", []
    link.symlink_to(wire[1])
    lock_of(link).write_text("")
    monkeypatch.setattr(serial, "Serial", lambda *words, **more: opened.append(words))
    for following in (lambda: Port(str(link)), lambda: Recorder(tmp_path / "s", str(link))):
        with pytest.raises(DeviceError, match="runs no more"):
            following()
    assert (opened, (tmp_path / "s").exists()) == ([], False)


# What is removed, killed, full.


REMOVED = {
    "the folder": lambda folder: shutil.rmtree(folder),
    "raw.times": lambda folder: (folder / "raw.times").unlink(),
    "a copy is in its place": lambda folder: (shutil.copy(folder / "raw.bin", folder / "x"), os.replace(folder / "x", folder / "raw.bin")),
}


@pytest.mark.parametrize("what", REMOVED)
def test_what_is_removed_under_a_recording_is_noticed_and_saved(what, wire, tmp_path):
    """All of it: what came before, what came before anybody noticed, and what came while it was being said."""
    master, name = wire
    folder = tmp_path / "data" / "s"
    data = frames_of(3000)
    recorder = Recorder(folder, name)
    record(recorder, master, data[:50_000])
    REMOVED[what](folder)
    send(master, data[50_000:53_000])
    until(lambda: recorder.raw.trouble)
    with pytest.raises(StorageError, match=r"was removed, moved or replaced while") as said:
        recorder.poll()
    assert str(folder) in str(said.value)
    send(master, data[53_000:60_000])
    until(lambda: recorder.raw.size == 60_000)
    recorder.close()
    saved = recorder.raw.saved
    assert saved.parent == folder.parent
    assert saved.name.startswith(f"s{_RESCUED}")
    assert f"is saved in {saved}; go on with record --resume" in str(recorder.raw.trouble)
    assert (saved / "raw.bin").read_bytes() == data[:60_000]
    assert [mark.event.split()[0] for mark in read_events(saved / "raw.bin")] == ["open"]


def test_two_recordings_in_one_folder(wire, other_wire, tmp_path):
    folder = tmp_path / "s"
    first = Recorder(folder, wire[1])
    for data in (b"", frames_of(400)):  # the second takes nothing away, though nothing was received yet
        record(first, wire[0], data)
        before = sorted(folder.iterdir())
        with pytest.raises(StorageError, match="another record is writing there now"):
            Recorder(folder, other_wire[1])
        assert sorted(folder.iterdir()) == before
    first.close()
    assert (folder / "raw.bin").read_bytes() == frames_of(400)
    second = Recorder(folder, other_wire[1])
    caught_up(second)
    assert second.samples == 400
    second.close()


class FullDisk:
    """``os``, with a disk on which the raw file may grow by ``room`` bytes."""

    def __init__(self, room):
        self.room = room

    def __getattr__(self, name):
        return getattr(os, name)

    def write(self, file, data):
        """As ``os.write``, while there is room."""
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = os.write(file, data[: self.room])
        self.room -= written
        return written


def _record_for_ever(folder, name):
    parent, recorder = os.getppid(), Recorder(folder, name)
    while os.getppid() == parent:  # else the test has been killed
        recorder.poll(0.01)
    os._exit(0)


def test_killed_at_a_random_moment(tmp_path, wire):
    """Every byte that was read is in the file, and it replays to what was sent."""
    master, name = wire
    data = frames_of(10_000)
    child = multiprocessing.get_context("fork").Process(target=_record_for_ever, args=(tmp_path / "s", name), daemon=True)
    child.start()
    raw = tmp_path / "s" / "raw.bin"
    until(lambda: raw.exists() and read_events(raw))
    assert is_locked(raw)
    send(master, data[:100_003])
    until(lambda: raw.stat().st_size >= 100_003 and raw.with_name("log0001.csv").exists())
    sender = threading.Thread(target=lambda: [os.write(master, data[k : k + 500]) for k in range(100_003, 104_000, 500)], daemon=True)
    sender.start()
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    sender.join()
    assert not is_locked(raw)
    kept = raw.read_bytes()
    assert kept == data[: len(kept)]
    assert np.array_equal(samples(decode(kept)[1])[1], sent(10_000)[1][: len(kept) // 25])
    [log] = replayed(raw, tmp_path / "again")
    assert log.startswith((tmp_path / "s" / "log0001.csv").read_bytes())


def test_a_full_disk_keeps_what_was_received_and_says_so(wire, tmp_path, monkeypatch):
    master, name = wire
    data = frames_of(3000)
    monkeypatch.setattr(rawfile, "os", FullDisk(40_000))
    recorder = Recorder(tmp_path / "s", name)
    with pytest.raises(StorageError, match=r"No space left on device; [0-9]+ bytes received before are safe in .*--resume") as said:
        record(recorder, master, data)
    recorder.close()
    kept = (tmp_path / "s" / "raw.bin").read_bytes()
    assert 38_000 < len(kept) == int(str(said.value).split("device; ")[1].split()[0])
    assert kept == data[: len(kept)]
    assert said.value.exit_code == 2


def test_a_raw_file_that_was_cut_is_noticed_and_what_is_gone_decides_nothing(tmp_path, wire):
    """Once, in a line; what was decided behind the cut is void, also in every replay to come."""
    raw = RawFile(tmp_path)
    lines = line_list(*sent(3000))
    for number, event in ((1000, "begin log0001"), (2000, "pause"), (3000, "note later")):
        raw.append(number, b"".join(lines[number - 1000 : number]))
        raw.mark(number, event)
    raw.close()
    whole = raw.path.stat().st_size
    assert not cut_words(raw.path)
    kept = len(b"".join(lines[:1500]))
    os.truncate(raw.path, kept)
    recorder = Recorder(tmp_path, wire[1])
    words = recorder.raw.cut
    caught_up(recorder)
    recorder.close()
    assert f"{whole - kept} bytes are missing from its end: it holds {kept}" in words
    assert "\n" not in words
    assert [mark.event for mark in read_events(raw.path) if not mark.event.startswith(("open", "close"))] == ["begin log0001"]
    assert not cut_words(raw.path)


def test_a_recording_that_noted_another_boards_samples_is_refused(tmp_path):
    """By what once sorted them out; a note behind a cut is void."""
    (tmp_path / "raw.bin").write_bytes(b"#\n")
    times = "host_ns,bytes,event\n1,0,open A\n2,9,foreign 1\n"
    (tmp_path / "raw.times").write_text(times)
    with pytest.raises(FormatError, match=r"raw\.times: notes \(\"foreign\"\).*another board.*into another folder"):
        read_events(tmp_path / "raw.bin")
    (tmp_path / "raw.times").write_text(times + "3,2,cut\n")
    assert [mark.event for mark in read_events(tmp_path / "raw.bin")] == ["open A"]


def test_a_disk_that_fails_is_said_and_one_without_locks_records(tmp_path, monkeypatch):
    """Full from the start it leaves no folder behind; or it says only when the bytes are forced to it that it cannot keep them."""

    def fails(number):
        def fail(*_):
            raise OSError(number, os.strerror(number))

        return fail

    with monkeypatch.context() as full:
        full.setattr(os, "write", fails(errno.ENOSPC))
        with pytest.raises(StorageError, match="No space left"):
            RawFile(tmp_path / "s")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(fcntl, "flock", fails(errno.ENOLCK))
    raw = RawFile(tmp_path / "s")
    raw.append(1, b"abc")
    monkeypatch.setattr(os, "fsync", fails(errno.EIO))
    raw.close()
    assert "may not be on the disk" in str(raw.trouble)
    assert raw.path.read_bytes() == b"abc"


# Somebody stops.


def test_a_recording_that_is_resumed_is_caught_up_in_slices(wire, tmp_path):
    """Between two it is asked whether to stop; stopped, it leaves logs that the next time only grow."""
    data, folder = frames.encode_info(0, INFO) + frames_of(12_000), tmp_path / "s"
    folder.mkdir()
    (folder / "raw.bin").write_bytes(data)
    recorder = Recorder(folder, wire[1])
    slices = recorder.catch_up()
    for _ in range(2):
        next(slices)
    slices.close()
    assert recorder.decoder.taken <= 3 * BLOCK
    recorder.close()
    assert recorder.undecoded >= len(data) - 3 * BLOCK
    again = Recorder(folder, wire[1])
    caught_up(again)
    again.close()
    assert (again.logs.put_aside, again.undecoded) == ([], 0)
    assert [path.read_bytes() for path in again.logs.paths] == replayed(folder / "raw.bin", tmp_path / "again")
