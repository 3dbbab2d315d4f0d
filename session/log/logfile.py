"""Read one log: CSV or CSV.gz, raw registers or physical units, with comments and further columns (FORMATS)."""

from __future__ import annotations

import gzip
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.common import registers
from session.common.counter import comes_round
from session.common.errors import DataError, FormatError
from session.common.plausible import beyond_any_sensor, complaint
from session.log.config import Sensor
from session.log.header import TIME_NS, Header, parse_header
from session.log.samples import Samples

#: a u32 microsecond counter wraps after 71.6 minutes
WRAP_NS = 2**32 * 1000
#: stamps up to here, 146 years, can be told apart in ns without overflow
LAST_NS = 2**62
#: whole numbers that a column can hold
INT64 = (-(2**63), 2**63 - 1)


@dataclass(frozen=True, eq=False)
class Log:
    """One file's samples, and what else it said.

    samples with the specific force as measured; comments: ``key=value`` pairs of its # lines; notes: what was mended
    or left out while reading; raw: whether it held registers; in_memory: arrays that were never a file, path being but a name.
    """

    path: Path
    samples: Samples
    comments: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    raw: bool = True
    in_memory: bool = False


def read_log(path: Path, sensor: Sensor) -> Log:
    """Read one log file.

    Raises FormatError (what cannot be read: line and column are named) or DataError (stamps that go backward).
    A last line that was cut off is left out and noted.
    """
    text, notes = _read_text(path)
    comments = _comments(text)
    offset, line_number = _skip_comments(text)
    header_end = text.find("\n", offset)
    if not text[offset:].strip():
        raise FormatError(f"{path.name}: empty; expected a header line and samples; was the recording stopped before it began?")
    header_line = text[offset:] if header_end < 0 else text[offset:header_end]
    header = parse_header(header_line, f"{path.name} line {line_number}")
    body = "" if header_end < 0 else text[header_end + 1 :]
    table, more = _parse_body(body, header, path.name, line_number + 1)
    if len(table) == 0:
        raise FormatError(f"{path.name}: a header but no samples; was the recording stopped before it began?")
    notes += more
    samples, more = _to_si(table, header, sensor, path.name, body, line_number + 1)
    raw = header.gyro_scale is None or header.accel_scale is None
    return Log(path=path, samples=samples, comments=comments, notes=tuple(notes + more), raw=raw)


def _read_text(path: Path) -> tuple[str, list[str]]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from None
    notes = []
    if path.suffix == ".gz" and data:
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error):
            # A copy that broke off: what there is before the break is good.
            data = _decompress_what_there_is(data)
            if not data:
                raise FormatError(f"{path.name}: not a gzip file; unpack it or give it its right name") from None
            notes.append("the compressed file breaks off: the part before is used")
    if b"\0" in data[:1000]:  # further on it is a line that broke, and named as such
        raise FormatError(f"{path.name}: not a text log (UTF-16 or binary); expected CSV in UTF-8")
    return data.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n"), notes


def _decompress_what_there_is(data: bytes) -> bytes:
    inflate = zlib.decompressobj(wbits=31)
    pieces = []
    try:
        for start in range(0, len(data), 4096):
            pieces.append(inflate.decompress(data[start : start + 4096]))
    except zlib.error:
        pass
    return b"".join(pieces)


def _skip_comments(text: str) -> tuple[int, int]:
    """Offset and number of the first line that is neither blank nor a comment."""
    offset, number = 0, 1
    while offset < len(text):
        end = text.find("\n", offset)
        end = len(text) if end < 0 else end
        line = text[offset:end].strip()
        if line and not line.startswith("#"):
            break
        offset, number = end + 1, number + 1
    return min(offset, len(text)), number


def _comments(text: str) -> dict[str, str]:
    """``key=value`` words of all comment lines; a later one replaces an earlier one."""
    if "#" not in text:
        return {}
    return dict(pair for line in re.findall(r"^\s*#(.*)$", text, re.M) for pair in re.findall(r"(\w+)=(\S+)", line))


def _parse_body(body: str, header: Header, name: str, first_line: int) -> tuple[np.ndarray, list[str]]:
    """Rows as a structured array, columns c0, c1, … in the order of ``header.used``."""
    if not body.strip():
        return np.zeros(0), []
    try:
        return _load(body, header), []
    except ValueError:
        # Only now, since it is slow: look for the line that is at fault.
        number, problem, is_last = _first_fault(body, header, first_line)
    if not is_last:
        raise FormatError(f"{name} line {number}: {problem}; mend or remove that line")
    body = body[: body.rstrip("\n").rfind("\n") + 1]
    table = _load(body, header) if body.strip() else np.zeros(0)
    return table, [f"line {number}, the last, is cut off ({problem}): left out"]


def _load(body: str, header: Header) -> np.ndarray:
    """Rows as columns c0, c1, …; ValueError where a line is at fault.  One type for all columns is twice as fast as a type for each."""
    whole = [header.is_integer(column) for column in header.used]
    names = [(f"c{i}", np.int64 if w else np.float64) for i, w in enumerate(whole)]
    # Stamps in ns do not fit a float64: beside physical units each column keeps its own type.
    kind = np.int64 if all(whole) else np.float64 if header.time_name != "t_ns" else names
    rows = np.loadtxt(body.split("\n"), dtype=kind, delimiter=",", comments="#", usecols=header.used, ndmin=1 if kind is names else 2)
    if kind is names:
        return rows
    table = np.empty(len(rows), dtype=names)
    for i, w in enumerate(whole):
        if w and kind is np.float64 and ((rows[:, i] % 1).any() or not (np.abs(rows[:, i]) < LAST_NS).all()):
            raise ValueError("a fraction, or more than 64 bits, where a whole number belongs")
        table[f"c{i}"] = rows[:, i]
    return table


def _first_fault(body: str, header: Header, first_line: int) -> tuple[int, str, bool]:
    lines = body.rstrip("\n").split("\n")
    for i, line in enumerate(lines):
        row = line.split("#")[0]
        if row.strip() and (problem := _fault(row, header)):
            return first_line + i, problem, i == len(lines) - 1
    # No rule of ours: numpy itself says which is the first line that it cannot take.
    good, bad = 0, len(lines)
    while bad - good > 1:
        middle = (good + bad) // 2
        try:
            _load("\n".join(lines[good:middle]), header)
            good = middle
        except ValueError:
            bad = middle
    return first_line + good, f"{lines[good][:40]!r} cannot be read as numbers", good == len(lines) - 1


def _fault(row: str, header: Header) -> str | None:
    cells = row.split(",")
    if len(cells) <= max(header.used):
        return f"{len(cells)} columns, expected {header.width}"
    for column in header.used:
        whole, cell = header.is_integer(column), cells[column].strip()
        says = f"{header.names[column]} is {cell[:20]!r}"
        if whole and re.fullmatch(r"[-+]?[0-9]+", cell):
            if len(cell) > 1000 or not INT64[0] <= int(cell) <= INT64[1]:
                return f"{says}{'…' if len(cell) > 20 else ''}, a number too long for any register or stamp"
            continue
        try:
            if whole or "_" in cell:  # Python reads 1_000, and numpy does not
                raise ValueError
            float(cell)
        except ValueError:
            return f"{says}, expected {'a whole number' if whole else 'a number'}"
    return None


def _to_si(table, header: Header, sensor: Sensor, name: str, body: str, first_line: int) -> tuple[Samples, list[str]]:
    def fail(row: int, complaint: str):
        lines = [i for i, line in enumerate(body.split("\n")) if line.split("#")[0].strip()]
        raise FormatError(f"{name} line {first_line + lines[row]}: {complaint}")

    columns = [table[f"c{i}"] for i in range(len(header.used))]
    for column, values in zip(header.used, columns, strict=True):
        if values.dtype == np.float64 and not (fine := np.isfinite(values)).all():
            row = int(np.argmin(fine))
            fail(row, f"{header.names[column]} is {values[row]}, expected a finite number; remove that line")
        if values.dtype == np.int64 and column != header.time and not (fine := np.abs(values + 0.5) < 32768).all():
            row = int(np.argmin(fine))
            fail(row, f"{header.names[column]} is {values[row]}, no 16-bit register value; units belong in the header (gx_dps, ax_g)")
    scales = {"gyro": header.gyro_scale, "accel": header.accel_scale, "temp": header.temp_scale}
    for column, values, kind in zip(header.used[1:], columns[1:], ["gyro"] * 3 + ["accel"] * 3 + ["temp"], strict=False):
        if scales[kind] is not None and (far := beyond_any_sensor(values, scales[kind], kind)).any():
            row = int(np.argmax(far))
            fail(row, complaint(header.names[column], values[row], kind))
    time = columns[0]
    last = LAST_NS // TIME_NS[header.time_name]
    if not (fine := (time > -last) & (time < last)).all():
        row = int(np.argmin(fine))
        fail(row, f"{header.time_name} is {time[row]}, which is no time of this era; mend or remove that line")
    t_ns = np.rint(time * 1e9).astype(np.int64) if header.time_name == "t_s" else time * TIME_NS[header.time_name]
    gyro_scale = registers.gyro_rps_per_lsb(sensor.gyro_fs_dps) if header.gyro_scale is None else header.gyro_scale
    accel_scale = registers.accel_mps2_per_lsb(sensor.accel_fs_g) if header.accel_scale is None else header.accel_scale
    gyro = np.stack(columns[1:4], axis=-1) * gyro_scale
    accel = np.stack(columns[4:7], axis=-1) * accel_scale
    temp_c = None
    if header.temp is not None:
        temp_c = registers.temperature_c(columns[7]) if header.temp_scale is None else columns[7] * header.temp_scale
    t_ns, notes = _unroll(t_ns, header, fail)
    fresh = np.concatenate([[True], np.diff(t_ns) > 0])
    if not fresh.all():
        notes.append(f"{np.count_nonzero(~fresh)} rows repeat the stamp before them: left out")
        t_ns, gyro, accel, temp_c = t_ns[fresh], gyro[fresh], accel[fresh], None if temp_c is None else temp_c[fresh]
    if len(t_ns) < 2:
        raise DataError(f"{name}: a single sample; expected a recording of some seconds")
    return Samples(t_ns, gyro, accel, temp_c), notes


def _unroll(t_ns: np.ndarray, header: Header, fail) -> tuple[np.ndarray, list[str]]:
    """Unroll a wrapped 32-bit counter; complain of any other backward step."""
    steps = np.diff(t_ns)
    if not len(steps) or steps.min() >= 0:
        return t_ns, []
    counts = header.time_name == "t_us"
    wraps = comes_round(steps, int(t_ns.min()), int(t_ns.max()), WRAP_NS) if counts else np.zeros(len(steps), dtype=bool)
    backward = (steps < 0) & ~wraps
    if backward.any():
        row = int(np.argmax(backward)) + 1
        fail(row, f"{header.time_name} goes backward by {-steps[row - 1] * 1e-9:g} s; split the log there or mend the stamps")
    unrolled = t_ns + WRAP_NS * np.concatenate([[0], np.cumsum(wraps)])
    return unrolled, [f"the 32-bit time counter wrapped {np.count_nonzero(wraps)}x: unrolled"]
