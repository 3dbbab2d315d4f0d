"""Truth files: attitudes from elsewhere, how they are written, and how they are read (docs/formats.md)."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import DataError, FormatError
from session.base.records import ROTATION
from session.base.results import Number, Text
from session.base.rotation import conjugate, from_matrix, multiply, unit_vectors
from session.base.units import NS_PER_S, STAMP_NS
from session.log.arrays import array_of, stamps_of
from session.log.config import Config
from session.log.folder import Session
from session.log.logfile import rows_of

# How the attitudes of a truth file are to be read: which way they turn, which way is up, whose axes, whose clock.
#
# Any file comes to ``q_nb`` (docs/formats.md) by the same four steps, each of which can be undone:
#
#     q_nb(t + offset_s) = frame * (as written at t, its cells put in order, inverted if it takes the world to the body) * mounting

#: of a quaternion's cells under the header qw,qx,qy,qz
ORDERS = ("wxyz", "xyzw")
#: what the quaternion takes to what
SENSES = ("body_to_world", "world_to_body")
_HALF = np.sqrt(0.5)
#: (4,) of the turn that takes the file's world to one with z down; about the file's x axis, which keeps its heading, or else about y
FRAMES = {
    "ned": np.array([1.0, 0.0, 0.0, 0.0]),
    "enu": np.array([0.0, 1.0, 0.0, 0.0]),
    "y_down": np.array([_HALF, _HALF, 0.0, 0.0]),
    "y_up": np.array([_HALF, -_HALF, 0.0, 0.0]),
    "x_down": np.array([_HALF, 0.0, -_HALF, 0.0]),
    "x_up": np.array([_HALF, 0.0, _HALF, 0.0]),
}
#: other names of the same: only which way is down matters
SAME_FRAME = {"z_down": "ned", "z_up": "enu", "nwu": "enu", "nue": "y_up"}


class _Frame(Text):
    """A frame by any of its names."""

    def made(self, value: str) -> str:
        """Its own name."""
        return SAME_FRAME.get(value, value)


@dataclass(frozen=True, eq=False)
class TruthGiven:
    """``[truth]`` of session.toml; None: to be estimated.  mounting (3, 3): from the IMU's axes to the truth's body."""

    section: ClassVar[str] = "truth"
    #: none of these five: found out from the recording. What is added to a truth file's stamps to give the log's clock, s: the attitude
    #: stamped t is the one of t + offset_s. Negative where the truth is late
    offset_s: Annotated[float | None, Number(-3600, 3600)] = None
    #: which way is up in the truth's world. Only that matters: any heading will do
    frame: Annotated[str | None, _Frame((*FRAMES, *SAME_FRAME))] = None
    #: what the quaternions take to what
    sense: Annotated[str | None, Text(SENSES)] = None
    #: the order of the four numbers, whatever the header calls them
    order: Annotated[str | None, Text(ORDERS)] = None
    #: takes vectors from the IMU's axes to those of the truth's body: v_truth = mounting v_imu
    mounting: Annotated[np.ndarray | None, ROTATION] = None


def given_in(config: Config) -> TruthGiven:
    """``[truth]`` of a configuration."""
    found: TruthGiven = config.sections.get(TruthGiven.section, TruthGiven())
    return found


@dataclass(frozen=True, eq=False)
class TruthReading:
    """A convention of a truth file; the default is that of docs/formats.md.

    order: one of ``ORDERS``; sense: one of ``SENSES``; frame: one of ``FRAMES``; mounting (3, 3): takes vectors from the IMU's axes to
    those of the truth's body; offset_s: added to the truth's stamps it gives the log's clock.
    """

    order: str = ORDERS[0]
    sense: str = SENSES[0]
    frame: str = "ned"
    mounting: np.ndarray = field(default_factory=lambda: np.eye(3))
    offset_s: float = 0.0

    @classmethod
    def of(cls, given: TruthGiven) -> TruthReading:
        """What is given, and the default elsewhere."""
        return cls(**{name: value for name, value in vars(given).items() if value is not None})

    def read(self, q: np.ndarray) -> np.ndarray:
        """``q_nb`` (K, 4) of what is written, (K, 4)."""
        q = np.roll(q, 1, axis=1) if self.order == "xyzw" else q
        q = conjugate(q) if self.sense == "world_to_body" else q
        return multiply(multiply(FRAMES[self.frame], q), from_matrix(self.mounting))

    def written(self, q_nb: np.ndarray) -> np.ndarray:
        """What is written, (K, 4), where this reading gives ``q_nb`` (K, 4)."""
        q = multiply(multiply(conjugate(FRAMES[self.frame]), q_nb), conjugate(from_matrix(self.mounting)))
        q = conjugate(q) if self.sense == "world_to_body" else q
        return np.roll(q, -1, axis=1) if self.order == "xyzw" else q


def down_of(frame: str) -> np.ndarray:
    """(3,): where down is in the file's world."""
    w, x, y, z = FRAMES[frame]
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


#: where each part of a reading is from
GIVEN, FOUND, ASSUMED = "given", "found", "assumed"


@dataclass(frozen=True, eq=False)
class TruthAlignment:
    """How a session's truth files are read, and the alignment that the recording shows.

    reading: as they are read; source: of each of its parts, ``given``, ``found`` in the recording, or ``assumed`` (the contract's own).
    offset_s, offset_sigma_s: of the truth's clock, as the recording shows it, whatever is given or used; nan where it does not.  turned,
    turned_sigma (3,) rad: likewise the rotation from the gyro's axes to the truth's body.  up (3,): the mean specific force in the
    file's world over its mean length, where there is one, else None; explained: share of the truth's rotations that the gyro explains.
    """

    reading: TruthReading
    source: dict[str, str]
    offset_s: float
    offset_sigma_s: float
    turned: np.ndarray
    turned_sigma: np.ndarray
    up: np.ndarray | None
    explained: float


# What the first look reports of truth files.

CLOCK, FRAME, ATTITUDE, MOUNTING = "truth's clock", "truth's frame", "truth's attitudes", "truth's mounting"
OUTAGE = "truth's outages"
#: what fit and explain report as well, where it is more than ok
REPORTED = (CLOCK, FRAME, ATTITUDE, MOUNTING, OUTAGE)

# A truth file: attitudes that something better than gravity saw, at some moments of a log (``reference = "truth"``).
#
# A motion capture, a total station, a rate table's encoder: whatever gives three angles.  Next to ``log0001.csv`` lies ``truth0001.csv``,
# CSV or CSV.gz, with the header ``t_us`` (or ``t_ns``, ``t_s``) ``,qw,qx,qy,qz`` (or ``,qx,qy,qz,qw``) and, optionally, ``,window``: time
# on the log's own clock, ``q_nb``, body to north-east-down (turned about the vertical by any constant heading), unless ``[truth]`` of
# session.toml has it otherwise.  Rows of one window, a whole number, bound one segment each; without windows the
# moments are taken one after the other.

#: a quaternion whose length is further from 1 than this was not one
UNIT_WITHIN = 0.01
#: a day at 208 Hz, and some room
MOST_MOMENTS = 20_000_000


@dataclass(frozen=True)
class TruthOutage:
    """A span in which a truth and the gyro part: first, last moment; from_s, to_s since the log's first sample; size_rps, rms; times_usual,
    the most in units of what is usual, of ``spans`` spans of the log; sure: whether it is the truth that is wrong, or may be the gyro."""

    first: int
    last: int
    from_s: float
    to_s: float
    size_rps: float
    times_usual: float
    spans: int
    sure: bool


@dataclass(frozen=True, eq=False)
class Truth:
    """K moments of one log: t_ns (K,) device time, increasing; q_nb (K, 4) unit; window (K,) its number, or None; outages, in order."""

    path: Path
    t_ns: np.ndarray
    q_nb: np.ndarray
    window: np.ndarray | None = None
    outages: tuple[TruthOutage, ...] = ()

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def sound(self) -> np.ndarray:
        """(K,) bool: moments outside all outages."""
        found = np.ones(len(self), dtype=bool)
        for outage in self.outages:
            found[outage.first : outage.last + 1] = False
        return found

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
    """Read a truth file, as the contract has it or as a reading has it.  FormatError names the line that is at fault."""
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


#: of a truth in memory
TRUTH_ARRAYS = "(t_s, q_nb) or (t_s, q_nb, window)"


def truths_of_arrays(session: str, given: Sequence[Sequence[ArrayLike]]) -> tuple[Truth, ...]:
    """Truths of a session of this name.

    Each is one of ``TRUTH_ARRAYS``: t_s (K,) s on its log's clock, increasing; q_nb (K, 4), body to north-east-down, scalar first, of
    length 1; window (K,) whole numbers.  Raises DataError, which names the array."""
    truths = []
    for number, arrays in enumerate(given):
        if not isinstance(arrays, tuple | list) or len(arrays) not in (2, 3):
            raise DataError(f"each of truth is {TRUTH_ARRAYS}; truth[{number}] is not")
        where = f"truth[{number}]: "
        time = array_of(f"{where}t_s", arrays[0], (None,))
        if len(time) < 2:
            raise DataError(f"{where}t_s has {len(time)} moments, expected at least 2")
        q = array_of(f"{where}q_nb", arrays[1], (len(time), 4))
        if not (sound := of_length_1(q)).all():
            row = int(np.argmin(sound))
            raise DataError(f"{where}q_nb[{row}] has length {np.linalg.norm(q[row]):.4g}, expected a quaternion of length 1, scalar first")
        window = None
        if len(arrays) == 3:
            window = array_of(f"{where}window", arrays[2], (len(time),))
            if not (window == np.rint(window)).all():
                raise DataError(f"{where}window[{int(np.argmax(window != np.rint(window)))}] is no whole number")
            window = window.astype(np.int64)
        truths.append(Truth(Path(f"{session}.truth{number + 1}"), stamps_of(where, time), unit_vectors(q), window))
    return tuple(truths)


def truth_text(truth: Truth) -> str:
    """A truth file of moments as the contract has them: body to north-east-down, scalar first, on the log's clock."""
    columns = [truth.t_ns.tolist(), *truth.q_nb.T.tolist(), *([] if truth.window is None else [truth.window.tolist()])]
    header = "t_ns,qw,qx,qy,qz" + ("" if truth.window is None else ",window")
    return "\n".join([header, *(",".join(map(repr, row)) for row in zip(*columns, strict=True))]) + "\n"


def changed(session: Session, **to: Any) -> Session:
    """The session with its truths or their alignment replaced."""
    return replace(session, reference=replace(session.reference, **to))
