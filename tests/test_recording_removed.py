"""Files that are removed under a recording, two recordings in one folder: nothing that was received is lost, and nobody says otherwise."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import signal

import pytest
from conftest import broad
from processes import until
from recording_wires import caught_up, make_wire, record, send
from streams import frame_list, sent

from session.bench import rawfile
from session.bench.rawfile import RESCUED, RawFile, is_locked, lock, read_marks
from session.bench.recorder import Recorder
from session.io.errors import StorageError

wire = pytest.fixture(make_wire, name="wire")
other_wire = pytest.fixture(make_wire, name="other_wire")


def frames_of(count, **more) -> bytes:
    return b"".join(frame_list(*sent(count, **more)))


REMOVED = {
    "the folder": lambda folder: shutil.rmtree(folder),
    "raw.bin": lambda folder: (folder / "raw.bin").unlink(),
    "raw.times": lambda folder: (folder / "raw.times").unlink(),
    "the folder, and another is in its place": lambda folder: (shutil.rmtree(folder), folder.mkdir()),
    "raw.bin, and another is in its place": lambda folder: ((folder / "raw.bin").unlink(), (folder / "raw.bin").write_bytes(b"")),
    "a copy is in its place": lambda folder: (shutil.copy(folder / "raw.bin", folder / "x"), os.replace(folder / "x", folder / "raw.bin")),
    "moved": lambda folder: folder.rename(folder.with_name("elsewhere")),
    "its parent": lambda folder: shutil.rmtree(folder.parent),
}
QUICK = ("the folder",)


@pytest.mark.parametrize("what", [what if what in QUICK else broad(what) for what in REMOVED])
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
    with pytest.raises(StorageError, match=r"was removed, moved or replaced while .* is saved in .*--resume") as said:
        recorder.poll()
    assert str(folder) in str(said.value)
    send(master, data[53_000:60_000])
    until(lambda: recorder.raw.size == 60_000)
    recorder.close()
    saved = recorder.raw.saved
    assert saved == folder.with_name(f"s{RESCUED}")
    assert (saved / "raw.bin").read_bytes() == data[:60_000]
    assert [mark.event.split()[0] for mark in read_marks(saved / "raw.bin") if mark.event] == ["open"]


def test_removed_just_before_the_end(wire, tmp_path):
    """Within the last quarter of a second, too."""
    recorder = Recorder(tmp_path / "s", wire[1])
    record(recorder, wire[0], frames_of(1000))
    shutil.rmtree(tmp_path / "s")
    recorder.close()
    assert recorder.raw.trouble is not None
    assert (recorder.raw.saved / "raw.bin").read_bytes() == frames_of(1000)


@pytest.mark.broad
def test_where_nothing_can_be_saved_nobody_says_that_it_is(wire, tmp_path, monkeypatch):
    def full(files, paths):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("session.bench.rawfile.copied", full)
    recorder = Recorder(tmp_path / "s", wire[1])
    record(recorder, wire[0], frames_of(100))
    shutil.rmtree(tmp_path / "s")
    until(lambda: recorder.raw.trouble)
    with pytest.raises(StorageError, match=r"could not be saved in .*No space left"):
        recorder.poll()
    recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_a_file_system_that_numbers_files_anew_has_removed_nothing(tmp_path):
    """Another number, the same size: so does a network's."""
    (tmp_path / "a").write_bytes(b"abc")
    (tmp_path / "b").write_bytes(b"abc")
    (tmp_path / "c").write_bytes(b"ab")
    file = os.open(tmp_path / "a", os.O_RDWR)
    assert [rawfile.is_gone(file, tmp_path / name) for name in "abcd"] == [False, False, True, True]
    os.close(file)


def test_a_disk_that_cannot_keep_what_it_took_is_said(tmp_path, monkeypatch):
    """It may say so only when the bytes are forced to it, which is after the last write."""
    raw = RawFile(tmp_path / "s")
    raw.append(1, b"abc")

    def forced(file):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", forced)
    raw.close()
    assert "may not be on the disk" in str(raw.trouble)


def test_two_recordings_in_one_folder(wire, other_wire, tmp_path):
    first = Recorder(tmp_path / "s", wire[1])
    before = sorted((tmp_path / "s").iterdir())
    with pytest.raises(StorageError, match="another record is writing there now"):
        Recorder(tmp_path / "s", other_wire[1])
    assert sorted((tmp_path / "s").iterdir()) == before  # the second takes nothing away, though nothing was received yet
    record(first, wire[0], frames_of(400))
    with pytest.raises(StorageError, match="another record is writing there now"):
        Recorder(tmp_path / "s", other_wire[1])
    first.close()
    assert (tmp_path / "s" / "raw.bin").read_bytes() == frames_of(400)
    second = Recorder(tmp_path / "s", other_wire[1])
    caught_up(second)
    assert second.samples == 400
    second.close()


def _record_for_ever(folder, name) -> None:
    recorder, parent = Recorder(folder, name), os.getppid()
    while os.getppid() == parent:
        recorder.poll(0.01)
    os._exit(0)


def test_a_killed_recording_leaves_no_lock(wire, other_wire, tmp_path):
    child = multiprocessing.get_context("fork").Process(target=_record_for_ever, args=(tmp_path / "s", wire[1]), daemon=True)
    child.start()
    until(lambda: is_locked(tmp_path / "s" / "raw.bin"))
    with pytest.raises(StorageError, match="another record"):
        Recorder(tmp_path / "s", other_wire[1])
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    assert not is_locked(tmp_path / "s" / "raw.bin")
    Recorder(tmp_path / "s", other_wire[1]).close()


def test_a_recording_that_gives_up_takes_away_no_other_s_file(tmp_path):
    """It opened no port; meanwhile another waits for the folder."""
    raw = RawFile(tmp_path / "s")
    raw.discard()
    assert not (tmp_path / "s").exists()
    raw = RawFile(tmp_path / "s")
    later = os.open(tmp_path / "s" / "raw.bin", os.O_RDWR)  # and is about to lock it
    raw.discard()
    assert lock(later)
    assert rawfile.is_gone(later, tmp_path / "s" / "raw.bin")  # and sees that it has to open it anew
    os.close(later)


def test_a_file_system_without_locks_records(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def none(file, how):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", none)
    raw = RawFile(tmp_path / "s")
    raw.append(1, b"abc")
    raw.close()
    assert (tmp_path / "s" / "raw.bin").read_bytes() == b"abc"
