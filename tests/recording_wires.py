"""Pseudo-terminals to record from, and what the tests of recording do with them."""

from __future__ import annotations

import os
import pty
import threading
import time
import tty
from pathlib import Path

from session.recording.decoding import stream
from session.recording.logwriter import LogWriter
from session.recording.recorder import Recorder
from session.stream.decoder import StreamDecoder

PATIENCE_S = 10.0
CONFIG = """schema = "tinygc-session/1"
[sensor]
odr_hz = 1667
gyro_fs_dps = 500
accel_fs_g = 4
"""


def make_wire():
    """A pseudo-terminal: the master's file, the slave's name; the slave is kept open."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for file in (master, slave):
        os.close(file)


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
