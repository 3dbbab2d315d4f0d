"""Where a watched sensor's samples come from: a log, a log that grows, standard input, UDP, a port; in SI, with what went wrong on the way.

Bytes of a stream go through the decoder of ``record``: frames or lines, with damage, losses and restarts.  A log is a standard
one, read as ``apply`` does.
"""

from __future__ import annotations

import os
import queue
import select
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError, DataError, DeviceError, FormatError
from session.base.files import open_file, require_file
from session.bench.decoder import StreamDecoder
from session.bench.events import AnyEvent, Event, Info, SampleChunk, starts_log
from session.bench.port import Port
from session.log.lines import STANDARD
from session.log.registers import DEFAULT, RegisterUnits
from tinygc.deploy.apply import Applicable, LogSource
from tinygc.deploy.calibration import Surroundings
from tinygc.features.unit.options import SourceOptions

UDP = "udp:"
#: bytes at a time; s without any after which a source reports it, and the watch looks about
BLOCK, IDLE_S = 1 << 16, 0.2
#: s without a sample that are reported, and after which another sender of datagrams is followed
SILENT_S = 10.0
#: bytes of a stream in which a sample must have come
BARREN = 1 << 20
#: ends of the names of files: what has one is no port, also where it is not there
LOG_SUFFIXES = (".csv", ".gz", ".txt", ".log", ".tsv", ".dat", ".bin", ".npz", ".json", ".jsonl", ".ulg", ".bag", ".mcap")


RESTART = "restart"


@dataclass(frozen=True)
class Remark:
    """Something that went wrong: kind, by which repetitions are counted, and words.

    Behind a ``RESTART`` nothing continues what came before; switched_on: whether the sensor may have been off.
    """

    kind: str
    words: str
    count: int = 1
    switched_on: bool = True


#: samples, their force calibrated, and what went wrong
Item = Applicable | Remark


def require_source(source: str) -> None:
    """Raise FormatError for what is neither a log nor a port, as a named pipe or a log that is not there, before anything waits for it."""
    path = Path(source)
    if path.is_dir():
        raise FormatError(f"{source}: a folder; watch a log, a port, udp:HOST:PORT, or - for standard input")
    named_as_log = path.suffix.lower() in LOG_SUFFIXES and not source.startswith("/dev/")
    if source != STANDARD and (named_as_log or (path.exists() and not path.is_char_device())):
        require_file(path)


def items_of(source: str, options: SourceOptions, known: Surroundings) -> Iterator[Item | None]:
    """Samples of a source and what goes wrong, in order; None whenever nothing has come for ``IDLE_S``.

    source: a file, ``-``, ``udp:HOST:PORT``, or a port.  known: full scales and the accelerometer's calibration.
    Raises FormatError for what is no log, DataError for a stream without samples, DeviceError for a port that cannot be opened.
    """
    path = Path(source)
    if source == STANDARD:
        return _decoded(_standard_input(), options, known, "standard input")
    if source.startswith(UDP):
        return _decoded(_datagrams(source), options, known, source)
    if not path.is_file():
        return _decoded(_from_port(source, options.baud), options, known, source)
    return _decoded(_growing(path), options, known, source) if options.follow else LogSource(path, known, gyro_alone=False).pieces()


# Bytes of a stream, as they come: b"" where none have for a while, a remark where it was interrupted.

Bytes = Iterator[bytes | Remark]


def _standard_input() -> Bytes:
    number = sys.stdin.fileno()
    while True:
        if os.name == "posix" and not select.select([number], [], [], IDLE_S)[0]:
            yield b""
            continue
        data = os.read(number, BLOCK)
        if not data:
            return
        yield data


def _datagrams(source: str) -> Bytes:
    """Datagrams of one sender: another one with it would look like a sensor that jumps.

    A sender is an address, since a board that restarts sends from another port.  Behind its silence another one is followed.
    """
    host, _, port = source.removeprefix(UDP).rpartition(":")
    if not (port.isascii() and port.isdigit() and len(port) <= 5 and 0 < int(port) < 65536):
        raise CalibrationError(f"{source}: expected {UDP}HOST:PORT, such as {UDP}0.0.0.0:9000")
    try:
        family, kind, _, _, address = socket.getaddrinfo(host.strip("[]") or "0.0.0.0", int(port), type=socket.SOCK_DGRAM)[0]
        connection = socket.socket(family, kind)
        connection.bind(address)
    except OSError as error:
        raise DeviceError(f"{source}: cannot be opened ({error.strerror or error}); is another program listening there?") from None
    followed, heard_s = "", 0.0
    with connection:
        connection.settimeout(IDLE_S)
        while True:
            try:
                data, (sender, *_) = connection.recvfrom(BLOCK)
            except TimeoutError:
                yield b""
                continue
            if not data:
                continue
            if sender != followed and followed and time.monotonic() - heard_s < SILENT_S:
                yield Remark("stranger", f"{source}: datagrams came from another sender than {followed}: left out")
                continue
            if sender != followed and followed:
                yield Remark(RESTART, f"{source}: nothing has come from {followed} for {SILENT_S:.0f} s; {sender} is followed from here on")
            followed = sender
            yield data if data[-1] in (0, 10) else data + b"\n"
            heard_s = time.monotonic()  # whoever takes the data may be slow


def _growing(path: Path) -> Bytes:
    """A file that another program writes: from its beginning, then as it grows; read again where it was cut or replaced."""
    while True:
        with open_file(path) as file:
            status = os.fstat(file.fileno())
            while True:
                if data := file.read(BLOCK):
                    yield data
                    continue
                yield b""
                time.sleep(IDLE_S)
                try:
                    now = path.stat()
                except OSError:
                    continue  # removed, or on its way to another place; what is open goes on
                if (now.st_dev, now.st_ino) != (status.st_dev, status.st_ino) or now.st_size < file.tell():
                    break
        yield Remark(RESTART, f"{path.name} was cut or replaced")


def _from_port(name: str, baud: int) -> Bytes:
    port = Port(name, baud)
    opened = False
    try:
        while True:
            try:
                _, item = port.items.get(timeout=IDLE_S)
            except queue.Empty:
                yield b""
                continue
            if isinstance(item, Exception):
                raise item
            if isinstance(item, bytes):
                opened = True
                yield item
            elif item.kind == "close":
                yield Remark(RESTART, f"{name}: {item.text}")
            elif opened:
                yield b""
    finally:
        port.close()


# From bytes to samples.


def _decoded(pieces: Bytes, options: SourceOptions, known: Surroundings, name: str) -> Iterator[Item | None]:
    decoder, info = StreamDecoder(options.header), None

    def items(events: list[AnyEvent]) -> Iterator[Item]:
        nonlocal info
        for event in events:
            if isinstance(event, Info):
                info = event
            elif isinstance(event, SampleChunk) and len(event):
                yield _readings(event, info, known, name)
            elif starts_log(event):
                yield Remark(RESTART, "the device's clock began again: it was switched on again, or has reset itself")
            elif isinstance(event, Event) and event.kind in TROUBLES:
                yield Remark(event.kind, TROUBLES[event.kind], event.count)

    for piece in pieces:
        if isinstance(piece, Remark):
            if piece.kind == RESTART:
                yield from items(decoder.finish())
            yield piece
            continue
        if not piece:
            yield None
            continue
        yield from items(decoder.feed(piece))
        if not decoder.samples and decoder.taken > BARREN:
            raise _no_samples(name)
    yield from items(decoder.finish())
    if not decoder.samples:
        raise _no_samples(name)


def _no_samples(name: str) -> DataError:
    return DataError(
        f"{name}: no sample in what came; expected the project's frames or lines (docs/stream.md); give --header LINE for lines without one"
    )


#: kind of a trouble -> its words
TROUBLES = {
    "lost": "samples are missing, by their numbers or stamps",
    "crc": "frames failed their check",
    "garbage": "bytes were neither frame nor line",
    "implausible": "samples cannot follow those around them: left out",
}


def _readings(chunk: SampleChunk, info: Info | None, known: Surroundings, name: str) -> Applicable:
    """Registers or physical units as SI: what they mean is stated by the board (``info``), or by the model, in this order.

    FormatError for registers of unknown full scale.
    """
    own = known.sensor

    def units() -> RegisterUnits:
        gyro_fs = (info.gyro_fs_dps if info else None) or own.gyro_fs_dps
        accel_fs = (info.accel_fs_g if info else None) or own.accel_fs_g
        if gyro_fs is None or accel_fs is None:
            raise FormatError(f"{name} sends registers of unknown full scale; give --session DIR")
        model = (info.sensor if info else None) or own.model or DEFAULT
        return RegisterUnits(model, gyro_fs, accel_fs, **(own.own_units if model == own.model else {}))

    gyro, force, temp_c = chunk.in_si(units)
    return Applicable(chunk.t_us * 1000, gyro, force if known.accelerometer is None else known.accelerometer.correct(force), temp_c)
