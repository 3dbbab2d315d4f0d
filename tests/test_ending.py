"""How what runs at a port ends: by any signal like by Ctrl-C, however it was started; and what is said where the recording was removed."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import shutil
import signal
from pathlib import Path

import pytest
from conftest import broad
from processes import CALIBRATE, PIPE, started, until
from recording_wires import make_wire
from streams import INFO, frame_list, sent

from session.bench import frames
from session.bench.rawfile import is_locked, read_marks
from tinygc.cli.results import Interruption, ended_by_signals

wire = pytest.fixture(make_wire, name="wire")
other_wire = pytest.fixture(make_wire, name="other_wire")
DATA = frames.encode_info(0, INFO) + b"".join(frame_list(*sent(3000)))
ENDS = {"SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM, "SIGHUP": signal.SIGHUP}


def _ignoring(*numbers):
    """As a shell starts a process in the background (SIGINT), and ``nohup`` (SIGHUP)."""

    def ignore():
        for number in ENDS.values():
            signal.signal(number, signal.SIG_IGN if number in numbers else signal.SIG_DFL)

    return ignore


def begun(*words, ignored=(), **how):
    """The command in a process of its own, which ends with the test."""
    usual = {"stdout": PIPE, "stderr": PIPE, "text": True, "preexec_fn": _ignoring(*ignored)}
    return started([*CALIBRATE, *words], **usual | how)


def ended(process) -> tuple[int, str, str]:
    out, err = process.communicate()
    assert "Traceback" not in (err or "")
    return process.returncode, out, err


def opened(folder: Path) -> bool:
    """Whether a recorder has the port; what was sent before is lost."""
    return any(mark.event for mark in read_marks(folder / "raw.bin"))


@contextlib.contextmanager
def recording(wire, folder, *words, data=DATA, **more):
    """``record``, with those bytes on the disk."""
    with begun("record", "--no-coach", "--port", wire[1], "--out", folder, *words, **more) as process:
        sent_so_far = 0
        os.set_blocking(wire[0], False)

        def push():
            nonlocal sent_so_far
            with contextlib.suppress(BlockingIOError):
                sent_so_far += os.write(wire[0], data[sent_so_far : sent_so_far + 500])
            select.select([], [wire[0]], [], 0.01)

        until(lambda: opened(folder))
        until(lambda: (folder / "raw.bin").stat().st_size == len(data), push)
        until(lambda: (folder / "session.toml").exists())
        yield process


@pytest.mark.parametrize(
    ("how", "ignored"),
    [
        ("SIGTERM", ()),
        broad("SIGINT", (signal.SIGINT,)),  # behind an &
        ("SIGHUP", (signal.SIGINT, signal.SIGHUP)),  # behind nohup and an &
        broad("SIGINT", ()),
        broad("SIGHUP", ()),
        broad("SIGTERM", (signal.SIGINT,)),
        broad("SIGHUP", (signal.SIGINT,)),
        broad("SIGINT", (signal.SIGINT, signal.SIGHUP)),
    ],
)
def test_every_signal_ends_a_recording_like_ctrl_c(how, ignored, wire, tmp_path):
    with recording(wire, tmp_path / "s", ignored=ignored) as process:
        process.send_signal(ENDS[how])
        if how == "SIGHUP" and signal.SIGHUP in ignored:  # what nohup is for
            assert process.poll() is None
            process.send_signal(signal.SIGTERM)
        code, out, said = ended(process)
    assert code == 130
    assert "3000 samples" in out
    assert "interrupted; everything received is kept" in said
    assert (tmp_path / "s" / "raw.bin").read_bytes() == DATA


@pytest.mark.parametrize(("how", "ignored"), [("SIGINT", (signal.SIGINT,)), broad("SIGINT", ()), broad("SIGTERM", ()), broad("SIGHUP", ())])
def test_every_signal_ends_a_virtual_board_like_ctrl_c(how, ignored, tmp_path):
    with begun("board", "--segments", 1, "--link", tmp_path / "port", "--json", tmp_path / "j", ignored=ignored) as process:
        assert process.stdout.readline() == f"{tmp_path / 'port'}\n"
        process.send_signal(ENDS[how])
        code, _, said = ended(process)
    assert code == 130
    assert "interrupted" in said
    assert json.loads((tmp_path / "j").read_text())["schema"] == "tinygc-board/1"
    assert not (tmp_path / "port").is_symlink()
    assert not (tmp_path / "port.lock").exists()


@pytest.mark.broad
def test_a_terminal_that_goes_ends_a_recording_and_it_is_kept(wire, tmp_path):
    """The window is closed: standard input, output and error are gone with it."""
    master, slave = pty.openpty()

    def its_terminal():
        import fcntl
        import termios

        fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

    folder, written = tmp_path / "s", 0
    raw = folder / "raw.bin"
    os.set_blocking(master, False)
    os.set_blocking(wire[0], False)

    def push():
        nonlocal written
        with contextlib.suppress(BlockingIOError):
            os.read(master, 65536)
        with contextlib.suppress(BlockingIOError):
            if opened(folder):
                written += os.write(wire[0], DATA[written : written + 500])
        select.select([], [wire[0]], [], 0.01)

    words = ("record", "--no-coach", "--port", wire[1], "--out", folder)
    with begun(*words, stdin=slave, stdout=slave, stderr=slave, preexec_fn=its_terminal) as process:
        os.close(slave)
        until(lambda: raw.exists() and raw.stat().st_size == len(DATA), push)
        until(lambda: (folder / "log0001.csv").exists(), push)
        os.close(master)
        until(lambda: process.poll() is not None)
    assert process.returncode == 130
    assert raw.read_bytes() == DATA
    assert (tmp_path / "s" / "log0001.csv").read_bytes().count(b"\n") == 3002  # an info, a header
    assert not is_locked(raw)


def test_the_signals_are_what_they_were_afterwards():
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    found = [signal.getsignal(number) for number in numbers]
    for number, usual in zip(numbers, [signal.default_int_handler, signal.SIG_DFL, signal.SIG_DFL], strict=True):
        signal.signal(number, usual)  # one that is ignored, as behind nohup, stays so
    try:
        _ask_three_times(numbers)
    finally:
        for number, handler in zip(numbers, found, strict=True):
            signal.signal(number, handler)


def _ask_three_times(numbers):
    before = [signal.getsignal(number) for number in numbers]
    with ended_by_signals(ignored_interrupt=True), Interruption() as wanted:
        assert not wanted()
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        assert wanted()
        with pytest.raises(KeyboardInterrupt):  # who asks three times is obeyed at once
            signal.raise_signal(signal.SIGINT)
    assert [signal.getsignal(number) for number in numbers] == before


@pytest.mark.parametrize("how", [broad(""), broad("SIGINT")], ids=["noticed", "ended before it is noticed"])
def test_a_folder_that_is_removed_under_a_recording(how, wire, other_wire, tmp_path):
    """It is said, nobody says that everything is kept, and the recording goes on where it is saved, with its session.toml."""
    folder = tmp_path / "s"
    with recording(wire, folder, "--note", "operator=Mara") as process:
        until(lambda: "Mara" in (folder / "session.toml").read_text())
        configuration = (folder / "session.toml").read_text()
        shutil.rmtree(folder)
        if how:
            process.send_signal(ENDS[how])
        code, out, said = ended(process)
    assert code == 2
    (last,) = [line for line in said.splitlines() if line.startswith("calibrate: ")]
    assert "raw.bin: was removed, moved or replaced while it was being recorded" in last
    assert "everything received is kept" not in said
    assert "next:" not in out
    saved = tmp_path / "s_rescued"
    assert f"go on with record --resume --out {saved}" in last
    assert (saved / "raw.bin").read_bytes() == DATA
    assert (saved / "session.toml").read_text() == configuration
    with begun("record", "--no-coach", "--port", other_wire[1], "--out", saved, "--resume") as process:
        log = saved / "log0001.csv"
        until(lambda: log.exists() and log.read_bytes().count(b"\n") == 3002 and is_locked(saved / "raw.bin"))
        process.send_signal(signal.SIGTERM)
        assert ended(process)[0] == 130
