"""Pseudo-terminals to record from, and what the tests of recording do with them."""

import contextlib
import os
import pty
import threading
import tty

from processes import CALIBRATE, DEVNULL, PIPE, heard, started, until

from session.bench.decoder import StreamDecoder
from session.bench.logwriter import LogWriter
from session.bench.recorder import stream

LEAD_S = 3  #: of the virtual boards
#: of a board whose reader may be late by any time
MEMORY = 10**9
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


@contextlib.contextmanager
def virtual_boards(folder):
    """Starts boards: ``start("--frames", name="port")`` gives the port; its session.toml is ``folder/bench.toml``."""
    with contextlib.ExitStack() as running:

        def start(*words, name="port"):
            port = folder / name
            more = [*words, *(() if "--lead" in words else ("--lead", LEAD_S)), "--memory", MEMORY]
            command = [*CALIBRATE, "board", "--link", port, "--config", folder / "bench.toml", *more]
            process = running.enter_context(started(command, text=True, stdout=PIPE, stderr=DEVNULL))
            assert heard(process.stdout, lambda line: True) == [f"{port}\n"]
            return port

        yield start


def send(file, data):
    """All of it, however slowly it is read."""
    for start in range(0, len(data), 512):
        os.write(file, data[start : start + 512])


def _send_while_open(file, data):
    with contextlib.suppress(OSError):  # a test may end before all of it is read
        send(file, data)


def record(recorder, file, data):
    """Send and take in until all of it is decoded; returns the events."""
    sender, events = threading.Thread(target=_send_while_open, args=(file, data), daemon=True), []
    wanted = recorder.raw.size + len(data)
    sender.start()
    until(lambda: recorder._decoded >= wanted, lambda: events.extend(recorder.poll(0.02)))
    sender.join()
    return events


def caught_up(recorder):
    """Events of what the folder's raw file held before."""
    return [event for events in recorder.catch_up() for event in events]


def replayed(raw_path, folder):
    """The logs that a raw file makes."""
    folder.mkdir()
    decoder, logs = StreamDecoder(), LogWriter(folder)
    for _ in stream(raw_path, decoder, logs):
        pass
    logs.write(decoder.finish())
    logs.close()
    return [path.read_bytes() for path in logs.paths]
