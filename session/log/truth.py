"""A truth file: attitudes that something better than gravity saw, at some moments of a log (``reference = "truth"``).

A motion capture, a total station, a rate table's encoder: whatever gives three angles.  Beside ``log0001.csv`` lies ``truth0001.csv``,
CSV or CSV.gz, with the header ``t_us`` (or ``t_ns``, ``t_s``) ``,qw,qx,qy,qz`` (or ``,qx,qy,qz,qw``) and, optionally, ``,window``: time on
the log's own clock, ``q_nb``, body to north-east-down (turned about the vertical by any constant heading), unless ``[truth]`` of
session.toml says otherwise (``truth_reading.py``).  Rows of one window, a whole number, bound one segment each; without windows the
moments are taken one after the other.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.common.units import NS_PER_S
from session.dialects.units import STAMP_NS
from session.log.rows_of_text import rows_of
from session.log.truth_reading import TruthReading

#: a quaternion whose length is further from 1 than this was not one
UNIT_WITHIN = 0.01
#: a day at 208 Hz, and some room
MOST_MOMENTS = 20_000_000


@dataclass(frozen=True, eq=False)
class Truth:
    """K moments of one log: t_ns (K,) device time, increasing; q_nb (K, 4) unit; window (K,) its number, or None."""

    path: Path
    t_ns: np.ndarray
    q_nb: np.ndarray
    window: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.t_ns)

    def reread(self, before: TruthReading, after: TruthReading) -> Truth:
        """The same file, read in another way than it was."""
        shift_ns = round((after.offset_s - before.offset_s) * NS_PER_S)
        return replace(self, t_ns=self.t_ns + shift_ns, q_nb=after.read(before.written(self.q_nb)))


def truth_path(log: Path) -> Path:
    """Where the truth of a log lies: ``log0001.csv.gz`` → ``truth0001.csv`` or ``truth0001.csv.gz``.  FormatError if nowhere."""
    stem = "truth" + log.name.removesuffix(".gz").removesuffix(".csv").removeprefix("log")
    for suffix in (".csv", ".csv.gz"):
        if (path := log.parent / f"{stem}{suffix}").exists():
            return path
    raise FormatError(
        f'{log.parent / stem}.csv: not found, but protocol.reference is "truth"; expected t_us,qw,qx,qy,qz for the moments of {log.name}'
    )


def of_length_1(q: np.ndarray) -> np.ndarray:
    """Which rows (K,) of q (K, 4) are quaternions of length 1, finite or not; the square of a large number may be no number."""
    return np.asarray(abs(np.linalg.norm(np.clip(q, -2, 2), axis=1) - 1) < UNIT_WITHIN)


#: columns of a quaternion, as the header may order them
SCALAR_FIRST, SCALAR_LAST = ["qw", "qx", "qy", "qz"], ["qx", "qy", "qz", "qw"]


def read_truth(path: Path, reading: TruthReading | None = None) -> Truth:
    """Read a truth file, as the contract has it or as a reading says.  FormatError names the line that is at fault."""
    lines = rows_of(path)
    names = [cell.strip() for cell in next(lines, (0, ""))[1].split(",")]
    if names[0] not in STAMP_NS or names[1:5] not in (SCALAR_FIRST, SCALAR_LAST) or names[5:] not in ([], ["window"]):
        raise FormatError(f"{path.name}: the header must be t_us,qw,qx,qy,qz (or t_ns, t_s; optionally ,window)")
    # Numbers side by side take a tenth of what a list of lists takes.
    t_ns, rows, window = array("q"), array("d"), array("q")
    for number, line in lines:
        cells = line.split(",")
        try:
            stamp = round(float(cells[0]) * NS_PER_S) if names[0] == "t_s" else int(cells[0]) * STAMP_NS[names[0]]
            row = [float(cell) for cell in cells[1:5]]
            group = int(cells[5]) if names[5:] else 0
        except (ValueError, IndexError, OverflowError):
            raise FormatError(f"{path.name} line {number}: {line[:60]!r}, expected {','.join(names)}") from None
        if len(row) != 4 or not abs(math.hypot(*row) - 1) < UNIT_WITHIN:
            raise FormatError(f"{path.name} line {number}: {line[:60]!r} has no quaternion of length 1")
        if not abs(group) < 2**62:
            raise FormatError(f"{path.name} line {number}: the window {cells[5][:20]} is no number that counts windows")
        if not abs(stamp) < 2**62 or (t_ns and stamp <= t_ns[-1]):
            raise FormatError(f"{path.name} line {number}: the time {cells[0][:20]} does not go on from the line before")
        t_ns.append(stamp)
        window.append(group)
        rows.extend(row)
        if len(t_ns) > MOST_MOMENTS:
            raise FormatError(f"{path.name}: more than {MOST_MOMENTS} moments; thin it out")
    if len(t_ns) < 2:
        raise FormatError(f"{path.name}: {len(t_ns)} moments; a segment needs two")
    wxyz = np.array(rows).reshape(-1, 4)
    wxyz = np.roll(wxyz, 1, axis=1) if names[1:5] == SCALAR_LAST else wxyz
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    found = Truth(path, np.array(t_ns, dtype=np.int64), wxyz, np.array(window) if names[5:] else None)
    return found if reading is None else found.reread(TruthReading(), reading)
