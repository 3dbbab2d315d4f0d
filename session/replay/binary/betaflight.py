"""Betaflight's blackbox logs (``.bbl``, ``.bfl``), decoded by orangebox.

orangebox is GPL-3.0, so it is an extra of its own that a person installs knowingly; nothing of it is in this project.  Each arming of the
board begins a log of its own in the file.
"""

from __future__ import annotations

import contextlib
import logging
import math
import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from session.base.budget import RECORD, current
from session.base.errors import FormatError
from session.base.files import read_bytes, require_file
from session.base.numeric import running_sum
from session.replay.binary.source import Messages, Part, Rows, Stream, begins, library, one_line, reason

PACKAGE = "orangebox"
MAGIC = b"H Product:Blackbox"
#: what Betaflight's drivers set gyroscopes to, whatever the sensor
ASSUMED_FS_DPS = 2000.0
#: gyroADC is in tenths of its scale with ``blackbox_high_resolution``
FINER = 10
#: loops between two whole frames: Betaflight has 32 to 1024
MOST_INTERVAL = 65_536
#: the counter of us comes round
WRAP_US = 2**32
#: bytes of a line of a header, and fields of a frame: Betaflight has some 1000 and 100
MOST_LINE, MOST_FIELDS = 1 << 16, 256
#: bytes that a field counts; a frame counts as so many fields more, and an event, or bytes between frames, twice as many: they are rare;
#: fields a byte that count nothing: Betaflight's smallest frame, of rates alone and at rest, has five fields in as many bytes
FIELD, FRAME, A_BYTE = 48, 16, 5
#: bytes that begin a frame
KINDS = re.compile(rb"[EGHIPS]")
#: predictor of a counter: orangebox counts through the loops without a frame, four of which are as much work as a field
COUNTER = 6
FIELDS = {"gyro": "gyroADC[{}]", "unfiltered": "gyroUnfilt[{}]", "accel": "accSmooth[{}]"}


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """orangebox logs each damaged frame; nothing here reads that."""
    logger = logging.getLogger("orangebox")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _read(path: Path, names: Sequence[str]) -> list[Stream]:
    """A stream of each log in the file, ``log1``, and one more of its unfiltered rates where they are there."""
    orangebox = library(path, "a blackbox log", "orangebox", PACKAGE, "betaflight")
    require_file(path)
    size = path.stat().st_size
    current().take(path, 3 * size)  # orangebox holds all of it
    held: list[Stream] = []
    problems: list[str] = []
    with one_line(path, "a blackbox log"), _silent():
        _set_defaults(orangebox)
        reader = orangebox.reader.Reader(str(path), allow_invalid_header=True)
        _require_headers(path, read_bytes(path, size), reader.log_pointers)
        for number in range(1, reader.log_count + 1):
            try:
                held += _log(path, number, orangebox)
            except FormatError:
                raise
            except Exception as error:
                problems.append(f"log{number} cannot be read ({reason(error)})")
    if not held:
        why = f" ({'; '.join(problems)[:200]})" if problems else ""
        raise FormatError(
            f"{path}: a blackbox log without gyroADC and accSmooth{why}; log them (blackbox_disable_gyro = OFF), or give another file"
        )
    return held


def _set_defaults(orangebox: Any) -> None:
    """What orangebox takes for a line that a header does not have: class properties up to its 0.4.0, which Python 3.13 has no more."""
    defaults = orangebox.reader.HeaderDefaults
    for name in dir(defaults):
        made = getattr(getattr(defaults, name), "__func__", None)
        if isinstance(made, property) and made.fget:
            setattr(defaults, name, made.fget(defaults))


def _require_headers(path: Path, data: bytes, begins: Sequence[int]) -> None:
    """FormatError for headers with which orangebox would be busy for minutes: it adds each byte to a copy of the line."""
    for begin in begins:
        end = begin
        while data[end : end + 1] == b"H" and (line := data.find(b"\n", end, end + MOST_LINE)) >= 0:
            end = line + 1
        if data[end : end + 1] != b"I" and len(data) - end > MOST_LINE and b"\n" not in data[end : end + MOST_LINE]:
            raise FormatError(f"{path}: a blackbox log with a header's line of more than {MOST_LINE} bytes; is it whole? copy it again")
        # orangebox looks through the whole file for each log, and reads a header byte by byte, up to the first frame
        current().unpack(path, len(data) // 4 + (end - begin) * RECORD // 2)


def _log(path: Path, number: int, orangebox: Any) -> list[Stream]:
    """The streams of one log.  Raises whatever orangebox raises for a header that it cannot read."""
    reader = orangebox.reader.Reader(str(path), number, allow_invalid_header=True)
    # ValueError for intervals of frames with which orangebox would count for ever
    whole = reader.headers.get("I interval", 1)
    share = reader.headers.get("P interval", "1/1")
    above, below = map(int, share.split("/")) if isinstance(share, str) else (1, int(share))
    if not (1 <= int(whole) <= MOST_INTERVAL and above >= 1 and below >= 1):
        raise ValueError(f"intervals of frames {whole} and {share}")
    if max(map(len, reader.field_defs.values()), default=0) > MOST_FIELDS:
        raise ValueError(f"more than {MOST_FIELDS} fields")
    reader.__class__ = type("Counted", (type(reader),), {"__iter__": lambda self: _steps(path, self, min(int(whole), below))})
    parser = orangebox.Parser(reader)
    columns = tuple(parser.field_names)
    places = {what: [columns.index(name.format(i)) for i in range(3)] for what, name in FIELDS.items() if name.format(2) in columns}
    if "time" not in columns or not places:
        return []
    wanted = [place for triad in places.values() for place in triad]
    time = columns.index("time")
    name = f"log{number}"
    rows = Rows(path, len(wanted))
    gyro_unit, accel_unit, accel_fs_g, notes = _header(reader.headers)
    ended = False
    try:
        for frame in parser.frames():
            values = [float(frame.data[place]) for place in wanted]
            rows.add(int(frame.data[time]), values)
        ended = True
    except FormatError:
        raise
    except Exception as error:
        # orangebox runs out of bytes where a log has no end mark, and nothing shows whether frames are missing behind the last one
        notes.append(
            f"{name} has no end mark: it is read up to byte {reader.tell()} of its {len(reader)} ({len(rows)} frames; {reason(error)})"
        )
    if ended and (bad := parser._ctx.invalid_frame_count):
        notes.append(f"{bad} damaged frames of {name} are left out")
    if not len(rows):
        return []
    steps = np.diff(rows.t_ns)
    t_ns = (rows.t_ns + WRAP_US * running_sum(steps < -WRAP_US // 2)) * 1000
    parts = {}
    for place, what in enumerate(places):
        unit, full_scale = (accel_unit, accel_fs_g) if what == "accel" else (gyro_unit, ASSUMED_FS_DPS)
        names = tuple(FIELDS[what].format(i) for i in range(3))
        parts[what] = Part(rows.values[:, 3 * place : 3 * place + 3], unit, names, full_scale)
    streams = []
    for what, called in (("gyro", name), ("unfiltered", f"{name}.unfiltered")):
        if what in parts or (what == "gyro" and "accel" in parts):
            mine = {kind: parts[own] for kind, own in (("gyro", what), ("accel", "accel")) if own in parts}
            streams.append(Stream(called, t_ns, mine, frame="forward, left, up", notes=tuple(notes), columns=columns))
    return streams


def _steps(path: Path, reader: Any, loops: int) -> Iterator[int | None]:
    """The bytes that orangebox takes for the kind of a frame, None behind the last one.  Each counts before the frame is decoded: a field
    may take no byte, so a byte may be a frame of many.  loops: from one frame to the next, at most.
    """
    work = {
        ord(kind.value): FRAME + sum(1 + (loops // 4 if field.predictor == COUNTER else 0) for field in fields)
        for kind, fields in reader.field_defs.items()
    }
    budget, before = current(), 0
    while True:
        byte = next(reader)
        stored, before = max(reader.tell() - before, 0), reader.tell()
        budget.unpack(path, max(work.get(byte, 2 * FRAME) - A_BYTE * stored, 0) * FIELD)
        yield byte
        if byte is not None and not KINDS.match(bytes([byte])):
            # orangebox goes back once for bytes between two frames, and passes over the others one by one
            found = KINDS.search(reader._frame_data, reader.tell())
            reader.seek(found.start() if found else len(reader))


class _Header(NamedTuple):
    """What a log's header states: units of one count, full scale of the accelerometer in g, and notes."""

    gyro_unit: str
    accel_unit: str
    accel_fs_g: float | None
    notes: list[str]


def _header(headers: dict[str, Any]) -> _Header:
    """Read a log's header.

    ``gyro_scale`` is the bits of a float, dps per count; ``acc_1G`` is counts per g.
    """
    notes = [f"the gyroscope's full scale of {ASSUMED_FS_DPS:g} dps is assumed: Betaflight's drivers set it, and no header states it"]
    scale, one_g = headers.get("gyro_scale", headers.get("gyro.scale")), headers.get("acc_1G")
    gyro_unit, accel_unit, accel_fs_g = "", "", None
    if scale is not None:
        dps = struct.unpack("<f", struct.pack("<I", scale))[0] if isinstance(scale, int) and scale >= 2**23 else float(scale)
        finer = FINER if headers.get("blackbox_high_resolution") in (1, "1") else 1
        if math.isfinite(dps) and dps > 0:
            gyro_unit = f"{float(str(np.float32(dps))) / finer!r}dps"  # the number that became these bits
    if isinstance(one_g, (int, float)) and one_g > 0:
        accel_unit, accel_fs_g = f"g/{one_g:g}", 32768 / one_g
    if "Firmware revision" in headers:
        notes.append(f"firmware: {str(headers['Firmware revision'])[:60]}")
    return _Header(gyro_unit, accel_unit, accel_fs_g, notes)


FORMAT = Messages(
    "Betaflight blackbox",
    "a blackbox log",
    PACKAGE,
    "betaflight",
    "GPL-3.0-or-later",
    "Betaflight's LOG00001.BFL or btfl_001.bbl, with gyroADC and accSmooth; streams are log1, log2, …",
    begins(MAGIC),
    _read,
)
