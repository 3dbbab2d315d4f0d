"""A truth file: attitudes that something better than gravity saw, at some moments of a log (``reference = "truth"``).

A motion capture, a total station, a rate table's encoder: whatever gives three angles.  Beside ``log0001.csv`` lies ``truth0001.csv``,
CSV or CSV.gz, with the header ``t_us`` (or ``t_ns``, ``t_s``) ``,qw,qx,qy,qz`` and, optionally, ``,window``: time on the log's own clock,
``q_nb`` scalar first, body to north-east-down (turned about the vertical by any constant heading).  Rows of one window, a whole number,
bound one segment each; without windows the moments are taken one after the other.
"""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.errors import DataError, FormatError
from session.samples import Samples
from session.segments import LONGEST_TURN_SEGMENTS, Segment, why_broken
from session.units import DEG

STAMPS = {"t_s": 1e9, "t_us": 1e3, "t_ns": 1}
#: a quaternion whose length is further from 1 than this was not one
UNIT_WITHIN = 0.01


@dataclass(frozen=True, eq=False)
class Truth:
    """K moments of one log: t_ns (K,) device time, increasing; q_nb (K, 4) unit; window (K,) its number, or None."""

    path: Path
    t_ns: np.ndarray
    q_nb: np.ndarray
    window: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, eq=False)
class Ends:
    """Attitudes (4,) of a segment at its first and last sample, and the moments of the truth they come from."""

    start: np.ndarray
    end: np.ndarray
    first: int
    last: int


def truth_path(log: Path) -> Path:
    """Where the truth of a log lies: ``log0001.csv.gz`` → ``truth0001.csv`` or ``truth0001.csv.gz``.  FormatError if nowhere."""
    stem = "truth" + log.name.removesuffix(".gz").removesuffix(".csv").removeprefix("log")
    for suffix in (".csv", ".csv.gz"):
        if (path := log.parent / f"{stem}{suffix}").exists():
            return path
    raise FormatError(
        f'{log.parent / stem}.csv: not found, but protocol.reference is "truth"; expected t_us,qw,qx,qy,qz for the moments of {log.name}'
    )


def read_truth(path: Path) -> Truth:
    """Read a truth file.  FormatError names the line that is at fault."""
    lines = [(n, line) for n, line in enumerate(_text(path).splitlines(), start=1) if line.strip() and not line.startswith("#")]
    names = [cell.strip() for cell in lines[0][1].split(",")] if lines else []
    if not names or names[0] not in STAMPS or names[1:5] != ["qw", "qx", "qy", "qz"] or names[5:] not in ([], ["window"]):
        raise FormatError(f"{path.name}: the header must be t_us,qw,qx,qy,qz (or t_ns, t_s; optionally ,window)")
    if len(lines) < 3:
        raise FormatError(f"{path.name}: {len(lines) - 1} moments; a segment needs two")
    t_ns, rows, window = [], [], []
    for number, line in lines[1:]:
        cells = line.split(",")
        try:
            t_ns.append(round(float(cells[0]) * 1e9) if names[0] == "t_s" else int(cells[0]) * STAMPS[names[0]])
            rows.append([float(cell) for cell in cells[1:5]])
            if names[5:]:
                window.append(int(cells[5]))
        except (ValueError, IndexError, OverflowError):
            raise FormatError(f"{path.name} line {number}: {line[:60]!r}, expected {','.join(names)}") from None
        if len(rows[-1]) != 4 or not abs(float(np.linalg.norm(rows[-1])) - 1) < UNIT_WITHIN:
            raise FormatError(f"{path.name} line {number}: {line[:60]!r} has no quaternion of length 1")
        if not abs(t_ns[-1]) < 2**62 or (len(t_ns) > 1 and t_ns[-1] <= t_ns[-2]):
            raise FormatError(f"{path.name} line {number}: the time {cells[0][:20]} does not go on from the line before")
    q = np.array(rows)
    return Truth(path, np.array(t_ns, dtype=np.int64), q / np.linalg.norm(q, axis=1, keepdims=True), np.array(window) if window else None)


def _text(path: Path) -> str:
    try:
        data = path.read_bytes()
        return (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not UTF-8 text; save it as CSV in UTF-8") from None
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise FormatError(f"{path.name}: the compressed file is broken; pack it again") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from None


def cut_at_truth(samples: Samples, truth: Truth, sensor, protocol, *, log: int = 0, number: int = 0) -> list[tuple[Segment, Ends]]:
    """Segments between moments of the truth, accepted or with the reason why not; ``number`` is given to the first.

    Raises DataError where the truth's times are not the log's.
    """
    moments_inside(samples, truth)  # or it is refused
    nearest = _nearest(samples, truth)
    there = np.abs(samples.t_ns[nearest] - truth.t_ns) * 1e-9 < samples.period_s
    q = _at_samples(samples, truth, nearest)
    segments = []
    for first, last in _pairs(truth, protocol.segment_s):
        a, b = int(nearest[first]), int(nearest[last])
        missing = None if there[first] and there[last] else "the log has no sample at one of its moments of truth"
        segment = _segment(samples, a, max(b, a + 1), missing, sensor, protocol, log, number + len(segments))
        segments.append((segment, Ends(q[first], q[last], first, last)))
    return segments


def moments_inside(samples: Samples, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Rows (K,) of the log that are nearest to the moments within it, and ``q_nb`` (K, 4) there.  DataError where there is none."""
    nearest = _nearest(samples, truth)
    inside = np.abs(samples.t_ns[nearest] - truth.t_ns) * 1e-9 < samples.period_s
    if not inside.any():
        raise DataError(f"{truth.path.name}: none of its {len(truth)} moments lies within the log; are its times on the log's clock?")
    return nearest[inside], _at_samples(samples, truth, nearest)[inside]


def _nearest(samples: Samples, truth: Truth) -> np.ndarray:
    """(K,) number of the sample nearest to each moment."""
    after = np.clip(np.searchsorted(samples.t_ns, truth.t_ns), 1, len(samples) - 1)
    return after - (truth.t_ns - samples.t_ns[after - 1] < samples.t_ns[after] - truth.t_ns)


def _at_samples(samples: Samples, truth: Truth, nearest: np.ndarray) -> np.ndarray:
    """(K, 4): the truth carried to its nearest sample, at most half a period, with the rate that is read there."""
    late_s = ((samples.t_ns[nearest] - truth.t_ns) * 1e-9).clip(-samples.period_s, samples.period_s)
    half = samples.gyro[nearest] * late_s[:, None] / 2
    w, v = truth.q_nb[:, :1], truth.q_nb[:, 1:]
    q = np.concatenate([w - np.sum(v * half, axis=1, keepdims=True), v + w * half + np.cross(v, half)], axis=1)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def _pairs(truth: Truth, segment_s: float) -> list[tuple[int, int]]:
    """Moments (first, last) that bound each segment."""
    if truth.window is not None:
        rows = [np.flatnonzero(truth.window == number) for number in dict.fromkeys(truth.window.tolist())]
        return [(int(row[0]), int(row[-1])) for row in rows if len(row) > 1]
    pairs, first = [], 0
    while True:
        # The moment nearest to the protocol's length, but always a later one.
        aim = truth.t_ns[first] + round(segment_s * 1e9)
        last = max(int(np.searchsorted(truth.t_ns, aim)), first + 1)
        if last < len(truth) and last - 1 > first and aim - truth.t_ns[last - 1] < truth.t_ns[last] - aim:
            last -= 1
        if last >= len(truth):
            return pairs or [(0, len(truth) - 1)]
        pairs.append((first, last))
        first = last


def _segment(samples: Samples, start: int, last: int, missing, sensor, protocol, log: int, number: int) -> Segment:
    duration_s = float(samples.t_ns[last] - samples.t_ns[start]) * 1e-9
    long = duration_s > LONGEST_TURN_SEGMENTS * protocol.segment_s
    problem = missing or why_broken(samples, slice(start + 1, last + 1), sensor)
    rate = np.linalg.norm(samples.gyro[start : last + 1] - samples.gyro[start : last + 1].mean(axis=0), axis=1)
    turn_deg = float(np.trapezoid(rate, samples.t_s[start : last + 1])) / DEG
    return Segment(
        number=number,
        log=log,
        first=None,
        last=None,
        start=start,
        stop=last + 1,
        start_s=float(samples.t_ns[start] - samples.t_ns[0]) * 1e-9,
        duration_s=duration_s,
        turn_s=duration_s,
        turn_deg=turn_deg,
        problem=problem or (f"{duration_s:.0f} s between moments of truth: too long for a segment" if long else None),
        breaks_yaw=problem is not None,
    )
