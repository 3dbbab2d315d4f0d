"""ULog, the logs of PX4 (https://docs.px4.io/main/en/dev_log/ulog_file_format.html), read by pyulog.

A file defines its messages, then holds them one after the other with stamps in us.  pyulog searches for the next whole message where bytes
are damaged; what it found is read here, and the note states that it searched.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from session.base.budget import PACKED, current, stored
from session.base.errors import FormatError
from session.base.units import DEG, G
from session.replay.binary.source import Messages, Part, Source, Stream, begins, library, microseconds, one_line

PACKAGE = "pyulog"
MAGIC = b"ULog\x01\x12\x35"
#: messages that hold an IMU, and the fields by which they are known
MESSAGES = {
    "sensor_combined": ("gyro_rad[0]", "accelerometer_m_s2[0]"),
    "vehicle_imu": ("delta_angle[0]", "delta_velocity[0]"),
    "sensor_gyro": ("x", "y", "z"),
    "sensor_accel": ("x", "y", "z"),
    "sensor_gyro_fifo": ("x[0]", "dt", "scale", "samples"),
    "sensor_accel_fifo": ("x[0]", "dt", "scale", "samples"),
}
FRAME = "forward, right, down"
CALIBRATED = "PX4 has applied its own calibration and thermal correction; sensor_gyro and sensor_accel hold what the sensor reported"
#: numbers of one message when nested types are written out: a message has 65 535 bytes
MOST_FIELDS = 65_535
#: bytes that may be read of a file of no length: pyulog steps back in damaged bytes, a message at a time
LEAST_BUDGET = 1 << 20


def _read(path: Path, names: Sequence[str]) -> list[Stream]:
    """The streams of the IMU messages with their instances, ``sensor_combined[0]``, by their names at least.

    FormatError for a file that pyulog cannot read, or without one of them.
    """
    data, notes = _load(path, tuple({name.partition("[")[0] for name in names} & set(MESSAGES) or MESSAGES))
    return [replace(_stream(path, one.name, f"{one.name}[{one.multi_id}]", one.data, list(notes)), columns=tuple(one.data)) for one in data]


def _load(path: Path, messages: tuple[str, ...]) -> tuple[list[Any], list[str]]:
    """pyulog's datasets of these messages, and notes on dropouts and damage.  FormatError where there is none."""
    pyulog = library(path, "a ULog", "pyulog", PACKAGE)
    notes: list[str] = []
    with (
        one_line(path, "a ULog"),
        contextlib.redirect_stdout(io.StringIO()),  # pyulog prints its warnings
        Source(path, strict=False, budget=_budget(path)) as head,
        _Last(path, strict=False, budget=_budget(path)) as source,
    ):
        _require_fields(path, pyulog.ULog(head, parse_header_only=True).message_formats)
        log = pyulog.ULog(source, list(messages))
        if source.ended_short:
            notes.append(f"the file is cut: it ends at byte {source.size} within a message")
        if source.exhausted:
            notes.append(f"the file is damaged: after byte {source.furthest} no further message was found")
        elif log.file_corruption:
            notes.append("the file is damaged: what stood between whole messages was passed over")
        if log.dropouts:
            durations = [dropout.duration for dropout in log.dropouts]
            notes.append(f"{len(durations)} dropouts of the logger, {sum(durations)} ms in all, the longest {max(durations)} ms")
    data = [one for one in log.data_list if all(field in one.data for field in (*MESSAGES[one.name], "timestamp"))]
    if not data:
        cut = f" ({notes[0]})" if notes else ""
        raise FormatError(f"{path}: a ULog without {', '.join(messages)}{cut}; log one of them (SDLOG_PROFILE), or give another file")
    return sorted(data, key=lambda one: (list(MESSAGES).index(one.name), one.multi_id)), notes


class _Last(Source):
    """Remembers how the file ended when pyulog closes it."""

    ended_short = exhausted = False
    furthest = 0

    def close(self) -> None:
        if not self.closed:
            self.exhausted = self.budget is not None and self.budget <= 0
            self.furthest, self.ended_short = self.tell(), self.short and not self.exhausted
        super().close()


def _budget(path: Path) -> int:
    return min(LEAST_BUDGET + PACKED * stored(path), current().unpackable - 1)


def _require_fields(path: Path, formats: dict[str, Any]) -> None:
    """FormatError for nested types that unfold to more than a message can hold, before pyulog unfolds them."""
    sizes: dict[str, int] = {}

    def size(name: str, above: tuple[str, ...]) -> int:
        if name not in formats or name in sizes:
            return sizes.get(name, 1)
        if name in above:
            raise FormatError(f"{path}: a ULog whose message {name} holds itself; the file is damaged, copy it again")
        sizes[name] = sum(max(count, 1) * size(kind, (*above, name)) for kind, count, _ in formats[name].fields)
        return sizes[name]

    for name in formats:
        if size(name, ()) > MOST_FIELDS:
            raise FormatError(
                f"{path}: a ULog whose message {name} has more fields than a message has bytes; the file is damaged, copy it again"
            )


# From PX4's messages to streams.


def _stream(path: Path, message: str, name: str, fields: dict[str, np.ndarray], notes: list[str]) -> Stream:
    if message.endswith("_fifo"):
        return _batches(path, message, name, fields, notes)
    stamps = fields.get("timestamp_sample", fields["timestamp"])
    current().numbers(path, len(stamps) * (7 if message in ("sensor_combined", "vehicle_imu") else 5))
    t_ns, kept = microseconds(stamps if stamps.any() else fields["timestamp"], notes)
    fields = {key: values[kept] for key, values in fields.items()}
    if message == "sensor_combined":
        late = fields.get("accelerometer_timestamp_relative")
        if late is not None and len(late) and abs(np.median(late)) > 0:
            notes.append(f"the accelerometer's samples are {np.median(late):+g} us from the gyroscope's (median), and have its stamps here")
        parts = {"gyro": _three(fields, "gyro_rad[{}]", "rad/s"), "accel": _three(fields, "accelerometer_m_s2[{}]", "m/s2")}
        return Stream(name, t_ns, parts, frame=FRAME, notes=(*notes, CALIBRATED))
    if message == "vehicle_imu":
        notes += ["rates and forces are PX4's increments over their intervals, and end at the stamp", CALIBRATED]
        parts = {}
        for kind, what, unit in (("gyro", "delta_angle", "rad/s"), ("accel", "delta_velocity", "m/s2")):
            part = _three(fields, f"{what}[{{}}]", unit)
            with np.errstate(divide="ignore", invalid="ignore"):
                parts[kind] = replace(part, values=part.values / (fields[f"{what}_dt"].astype(float)[:, None] * 1e-6))
        return Stream(name, t_ns, parts, frame=FRAME, notes=tuple(notes))
    kind = message.split("_")[1]
    unit, si = SENSORS[kind]
    span = f"range_{unit.replace('/', '_')}"  # before PX4 1.11
    parts = {
        kind: replace(_three(fields, "{}", unit, "xyz"), full_scale=float(fields[span][0]) / si if span in fields and len(t_ns) else None)
    }
    if "temperature" in fields and np.isfinite(fields["temperature"]).any():
        parts["temp"] = Part(fields["temperature"].astype(float), "degc")
    return Stream(name, t_ns, parts, frame=FRAME, notes=tuple(notes))


#: of messages of one sensor: its quantity, unit, and SI per unit of its full scale
SENSORS = {"gyro": ("rad/s", DEG), "accel": ("m/s2", G)}


def _batches(path: Path, message: str, name: str, fields: dict[str, np.ndarray], notes: list[str]) -> Stream:
    """Registers of a FIFO: up to 32 samples in a message, dt us apart, the last one at its stamp."""
    t_ns, kept = microseconds(fields.get("timestamp_sample", fields["timestamp"]), notes)
    fields = {key: values[kept] for key, values in fields.items()}
    places = sum(1 for key in fields if key.startswith("x["))
    counts = np.minimum(fields["samples"].astype(int), places)
    current().numbers(path, 5 * len(counts) * places)
    filled = np.arange(places) < counts[:, None]
    values = np.column_stack([np.column_stack([fields[f"{axis}[{i}]"] for i in range(places)])[filled] for axis in "xyz"]).astype(float)
    dt_ns = fields["dt"].astype(float) * 1e3
    with np.errstate(invalid="ignore"):
        before = np.rint((counts[:, None] - 1 - np.arange(places)) * dt_ns[:, None])
    before = np.where(np.isfinite(before) & (abs(before) < 1e12), before, 0).astype(np.int64)
    scales = fields["scale"].astype(float)
    scale = float(scales[0]) if len(scales) else 1.0
    kind = message.split("_")[1]
    unit, si = SENSORS[kind]
    stamps = (t_ns[:, None] - before)[filled]
    notes.append("stamps within a FIFO's batch are counted back from its last sample")
    odr_hz = float(1e9 / np.median(dt_ns)) if len(dt_ns) and np.median(dt_ns) > 0 else None
    if (scales == scale).all() and scale > 0:
        part = Part(values, f"{scale!r}{unit}", full_scale=32768 * scale / si)
    else:
        part = Part(values * np.repeat(scales, counts)[:, None], unit)
    return Stream(name, stamps, {kind: part}, odr_hz, "the sensor's own axes", tuple(notes))


def _three(fields: dict[str, np.ndarray], pattern: str, unit: str, axes: str = "012") -> Part:
    names = tuple(map(pattern.format, axes))
    return Part(np.column_stack([fields[name] for name in names]).astype(float), unit, names)


FORMAT = Messages(
    "ULog",
    "a ULog",
    PACKAGE,
    "logs",
    "BSD-3-Clause",
    "PX4's log/2026-11-26/10_15_02.ulg, with sensor_combined, vehicle_imu, sensor_gyro or sensor_gyro_fifo",
    begins(MAGIC),
    _read,
)
