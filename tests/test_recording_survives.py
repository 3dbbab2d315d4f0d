"""What was received is on disk, whatever happens: kill, full disk, read-only folder."""

from __future__ import annotations

import contextlib
import errno
import multiprocessing
import os
import select
import signal
from pathlib import Path

import numpy as np
import pytest
from conftest import broad
from processes import PATIENCE_S, until
from recording_wires import caught_up, make_wire, record, replayed
from streams import decode, frame_list, line_list, samples, sent

from session.bench import rawfile
from session.bench.events import SampleChunk
from session.bench.logwriter import LogWriter
from session.bench.rawfile import RawFile, read_events, read_marks, said_cut
from session.bench.recorder import Recorder
from session.io.errors import StorageError
from session.replay.raw import convert_raw

wire = pytest.fixture(make_wire, name="wire")
other_wire = pytest.fixture(make_wire, name="other_wire")


LAST_WORD = b"no frame has these words in it"


class FullDisk:
    """``os``, with a disk on which the raw file may grow by ``room`` bytes."""

    def __init__(self, room: int):
        self.room = room

    def __getattr__(self, name: str) -> object:
        return getattr(os, name)

    def write(self, file: int, data: bytes) -> int:
        """As ``os.write``, while there is room."""
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = os.write(file, data[: self.room])
        self.room -= written
        return written


def _record_for_ever(folder: Path, name: str) -> None:
    parent, recorder = os.getppid(), Recorder(folder, name)
    while os.getppid() == parent:  # else the test has been killed
        recorder.poll(0.01)
    os._exit(0)


@pytest.mark.parametrize("seed", [*range(3), *map(broad, range(3, 20))])
def test_killed_at_a_random_moment(seed, tmp_path, wire):
    """Every byte that left the terminal is in the file, but for what one read had just taken; it replays to what was sent."""
    master, name = wire
    rng = np.random.default_rng(seed)
    t_us, registers = sent(40_000)
    data = memoryview(b"".join(frame_list(t_us, registers)))
    enough = rng.uniform(0, 0.5) * len(data)  # how far it then is, is chance
    child = multiprocessing.get_context("fork").Process(target=_record_for_ever, args=(tmp_path / "s", name), daemon=True)
    child.start()
    until(lambda: (tmp_path / "s" / "raw.times").exists() and list(read_marks(tmp_path / "s" / "raw.bin")))
    os.set_blocking(master, False)
    written, raw = 0, tmp_path / "s" / "raw.bin"
    try:
        while written < enough or raw.stat().st_size < 25:
            assert select.select([], [master], [], PATIENCE_S)[1], "nobody reads"
            with contextlib.suppress(BlockingIOError):
                written += os.write(master, data[written : written + int(rng.integers(1, 2000))])
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.join()
    left = _left_in(master, name)
    kept = (tmp_path / "s" / "raw.bin").read_bytes()
    assert kept == bytes(data[: len(kept)])
    assert 0 <= written - len(kept) - left <= 4096
    _, events = decode(kept)
    got_us, got = samples(events)
    assert len(got_us) == len(kept) // 25 > 0
    assert np.array_equal(got, registers[: len(got)])
    [log] = replayed(tmp_path / "s" / "raw.bin", tmp_path / "again")
    assert log.startswith((tmp_path / "s" / "log0001.csv").read_bytes() if (tmp_path / "s" / "log0001.csv").exists() else b"")


def _left_in(master: int, name: str) -> int:
    """Bytes that nobody has read: those before a word that is sent now."""
    slave = os.open(name, os.O_RDONLY | os.O_NOCTTY)
    left, to_send = b"", LAST_WORD
    while not left.endswith(LAST_WORD):
        if to_send:
            with contextlib.suppress(BlockingIOError):
                to_send = to_send[os.write(master, to_send) :]
        assert select.select([slave], [], [], PATIENCE_S)[0], "the word has not come through"
        left += os.read(slave, 65536)
    os.close(slave)
    return len(left) - len(LAST_WORD)


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
    assert len(samples(caught_up(recorder))[0]) == 499
    record(recorder, master, b"".join(frame_list(*second)))
    recorder.close()
    there = [path.read_bytes() for path in sorted(folder.glob("log*.csv"))]
    assert [text.count(b"\n") for text in there] == [500, 501]
    assert replayed(folder / "raw.bin", tmp_path / "again") == there
    assert recorder.decoder.samples == 999


def test_a_full_disk_keeps_what_was_received_and_says_so(wire, other_wire, tmp_path, monkeypatch):
    master, name = wire
    t_us, registers = sent(3000)
    data = b"".join(frame_list(t_us, registers))
    monkeypatch.setattr(rawfile, "os", FullDisk(40_000))
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
    assert len(samples(caught_up(recorder))[0]) == len(kept) // 25
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
        logs.write([SampleChunk(*sent(20_000))])
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
    assert [(mark.host_ns, mark.offset, mark.event) for mark in sorted(read_marks(tmp_path / "raw.bin"), key=lambda mark: mark.offset)] == [
        (10, 3, ""),
        (30_000_000, 4, "close it, here"),
        (20_000_000, 6, ""),
        (99, 6, "open"),
    ]


def test_a_raw_file_that_was_cut_is_noticed_and_what_is_gone_decides_nothing(tmp_path, wire):
    """Once, in a line; what was decided behind the cut is void, also in every replay to come."""
    raw = RawFile(tmp_path)
    lines = line_list(*sent(3000))
    for number, event in ((1000, "begin log0001"), (2000, "pause"), (3000, "note later")):
        raw.append(number, b"".join(lines[number - 1000 : number]))
        raw.mark(number, event)
    raw.close()
    whole = raw.path.stat().st_size
    assert not said_cut(raw.path)
    kept = len(b"".join(lines[:1500]))
    os.truncate(raw.path, kept)
    notes = convert_raw(raw.path, tmp_path / "replayed", 208.0, 500.0, 4.0, "ASM330LHH").notes
    recorder = Recorder(tmp_path, wire[1])
    words = recorder.raw.cut
    caught_up(recorder)
    recorder.close()
    assert words in notes
    assert f"{whole - kept} bytes are missing from its end: it holds {kept}" in words
    assert "\n" not in words
    assert [mark.event for mark in read_events(raw.path) if not mark.event.startswith(("open", "close"))] == ["begin log0001"]
    assert not said_cut(raw.path)
