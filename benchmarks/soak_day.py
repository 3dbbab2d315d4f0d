"""A day of samples through recorder and decoder, on a clock that is simulated: what was sent, kept and lost, and whether memory grows."""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import progress

from session.bench import frames
from session.bench import recorder as recorder_module
from session.bench.events import Info, SampleChunk
from session.bench.port import Opened, Received
from session.bench.rawfile import RAW
from session.bench.recorder import Recorder

RATE_HZ = 1667.0
READ_S = 0.1  #: from one read of the port to the next
BLOCK_S = 60  #: made at once
SWING = 2000 * np.sin(2 * np.pi * np.arange(100_020)[:, None] / np.array([1500.3, 1667.0, 2222.7, 5001.0, 3334.0, 10002.0, 100020.0]))
NOISE = np.random.default_rng(0).integers(-6, 7, SWING.shape)
REGISTERS = np.rint(SWING + NOISE).astype(np.int16)
INFO = Info(500.0, 4.0, RATE_HZ, "7")
LOG_KEPT = 1 << 22  #: bytes of a log and a raw file that stay on the disk, once they were looked at


class VirtualPort:
    """Stands for a port: what is put into ``items`` has arrived."""

    def __init__(self, name: str, baudrate: int, *prepare: object):
        self.name, self.items = name, queue.SimpleQueue()

    def close(self) -> None:
        """Nothing waits."""


def day(form: str, hours: float, seed: int, parent: Path, stop: Callable[[], bool] = lambda: False) -> list[tuple[str, str]]:
    """Rows of a table: what came of so many hours, or of those until somebody wants to stop."""
    recorder_module.Port, port = VirtualPort, recorder_module.Port  # type: ignore[misc]
    try:
        return _day(form, hours, seed, parent / f"day-{form}", stop)
    finally:
        recorder_module.Port = port  # type: ignore[misc]


def _day(form: str, hours: float, seed: int, folder: Path, stop: Callable[[], bool]) -> list[tuple[str, str]]:
    recorder = Recorder(folder, "virtual")
    began, offset = time.process_time(), int(np.random.default_rng(seed).integers(1 << 31))
    kept, log = _Kept(folder / RAW), _Kept(folder / "log0001.csv")
    _arrive(recorder, Opened(0, "virtual"))
    sent = received = bytes_sent = rows_wrong = 0
    memory: list[int] = []
    last_us = -1
    blocks = max(1, round(hours * 3600 / BLOCK_S))
    block = 0
    while block < blocks and not stop():
        progress(f"{form}: {block * BLOCK_S / 3600:.1f} of {hours:g} h")
        count = round((block + 1) * BLOCK_S * RATE_HZ) - sent
        index = sent + np.arange(count)
        t_us, registers = _stamps(index) + offset, _registers(index)
        reads = _reads(form, index, t_us, registers, block)
        got: list[SampleChunk] = []
        for number, data in enumerate(reads):
            _arrive(recorder, Received(int((block * BLOCK_S + (number + 1) * READ_S) * 1e9), data))
            got += [event for event in recorder.poll(0) if isinstance(event, SampleChunk)]
        sent += count
        whole = b"".join(reads)
        bytes_sent += len(whole)
        kept.check(whole)
        # A line counts when the next has come: of text one sample is behind.
        behind = int(form == "text")
        expected = _registers(np.arange(max(0, sent - count - behind), sent - behind))
        found = np.concatenate([chunk.registers for chunk in got])
        rows_wrong += (
            count - behind * (block == 0) - len(found) if len(found) != len(expected) else int((found != expected).any(axis=1).sum())
        )
        received += len(found)
        last_us = int(got[-1].t_us[-1])
        log.forget()
        memory.append(_resident_mb())
        block += 1
    recorder.close()
    hour = max(1, min(len(memory) // 2, 3600 // BLOCK_S))
    rows = [
        (f"{form}, {RATE_HZ:g} Hz", f"{block * BLOCK_S / 3600:.4g} h simulated, {time.process_time() - began:.0f} s of CPU"),
        ("bytes received", f"{bytes_sent}"),
        ("bytes kept", f"{kept.bytes}, of them wrong: {kept.wrong}"),
        ("bytes lost", f"{bytes_sent - (folder / RAW).stat().st_size}"),
        ("samples sent", f"{sent}"),
        ("samples decoded", f"{recorder.decoder.samples}, of them wrong: {rows_wrong}"),
        ("samples lost, implausible, resets", f"{recorder.decoder.lost}, {recorder.decoder.implausible}, {recorder.decoder.resets}"),
        ("last stamp", f"{last_us} us, {last_us - int(_stamps(np.array([sent - 1 - behind]))[0]) - offset} us off"),
        ("log", f"{log.lines_of_all} lines"),
        (
            "memory",
            f"{max(memory[:hour])} MB at most in the first {hour * BLOCK_S / 60:g} min, {max(memory[-hour:])} MB in the last",
        ),
    ]
    assert (recorder.decoder.samples, recorder.decoder.lost, rows_wrong, kept.wrong) == (sent, 0, 0, 0)
    assert kept.bytes == bytes_sent
    return rows


def _stamps(index: np.ndarray) -> np.ndarray:
    """us, as whole numbers."""
    return np.rint(index * (1e6 / RATE_HZ)).astype(np.int64)


def _registers(index: np.ndarray) -> np.ndarray:
    return REGISTERS[index % len(REGISTERS)]


def _reads(form: str, index: np.ndarray, t_us: np.ndarray, registers: np.ndarray, block: int) -> list[bytes]:
    """What the port gives, read by read; the board says what it is once a block."""
    cuts = np.arange(0, len(index), round(READ_S * RATE_HZ))[1:]
    if form == "frames":
        numbers = index + 1 + block  # one counter for both kinds of frames
        parts = [part.tobytes() for part in np.split(frames.encode_samples(numbers, t_us, registers), cuts)]
        return [frames.encode_info(int(index[0]) + block, INFO) + parts[0], *parts[1:]]
    table = np.column_stack([t_us % 2**32, registers])
    row = ",".join(["%d"] * 8) + "\n"
    parts = [(row * len(part) % tuple(part.ravel().tolist())).encode() for part in np.split(table, cuts)]
    return [f"# {INFO.text}\n".encode() + parts[0], *parts[1:]]


def _arrive(recorder: Recorder, item: Opened | Received) -> None:
    recorder._keep(item)
    recorder.port.items.put(item)


class _Kept:
    """A file that grows: what is new is looked at, and its place on the disk given back."""

    def __init__(self, path: Path):
        self.path, self.bytes, self.wrong, self.lines_of_all, self._seen = path, 0, 0, 0, 0

    def check(self, expected: bytes) -> None:
        """What was added is this."""
        added = self._added()
        self.wrong += len(expected) if len(added) != len(expected) else int(np.count_nonzero(_codes(added) != _codes(expected)))
        self.bytes += len(added)

    def forget(self) -> None:
        """Count the lines that were added."""
        self.lines_of_all += self._added().count(b"\n")

    def _added(self) -> bytes:
        with self.path.open("rb") as file:
            file.seek(self._seen)
            added = file.read()
        self._seen += len(added)
        _give_back(self.path, self._seen - LOG_KEPT)
        return added


def _codes(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint8)


def _give_back(path: Path, size: int) -> None:
    """Make a hole of the first bytes, where the system can: a day of them fits no small disk."""
    import ctypes

    if size > 0:
        with path.open("r+b") as file:
            keep_size_punch_hole = 0x01 | 0x02
            ctypes.CDLL(None).fallocate(file.fileno(), keep_size_punch_hole, ctypes.c_int64(0), ctypes.c_int64(size))


def _resident_mb() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") >> 20
