"""One log from one file, or from one for the gyroscope and one for the accelerometer, joined on time."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from session.base.budget import current
from session.base.errors import DataError, FormatError
from session.base.numeric import later_row, median_length
from session.base.units import G
from session.detect.stamp_errors import stamp_errors
from session.log.config import Protocol
from session.log.reader import Piece
from session.log.samples import Growing, Samples
from session.log.stamps import COARSE, TWICE, UNCOUNTED, along_line, counted, evenly, fresh, pace_of, written_once
from session.log.thermometer import Sound
from session.replay.dialects import TableLayout
from session.replay.sources import Source, StreamSource

#: beyond this many of its own periods a second file's neighbours are too far apart to read between them
WIDEST = 3.5
#: of g, the least median length of readings that gravity is in: half, whatever the scale's error
LEAST_GRAVITY = 0.5
#: of notes on stamps that are none
COUNTED = "samples were counted at"


class MissingSensorError(FormatError):
    """No file holds one of the two sensors."""


@dataclass(frozen=True, eq=False)
class Joined:
    """t_ns (N,); gyro, accel (N, 3) and temp (N,) as written, each with the layout of the file it is from (temp may be None); counted:
    whether there were no stamps, or none to go by, so that samples were counted at a rate that was given; even_sigma_ppm: of the rate of
    samples that were counted along their stamps."""

    t_ns: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp: np.ndarray | None
    gyro_layout: TableLayout
    accel_layout: TableLayout
    temp_layout: TableLayout | None
    notes: tuple[str, ...]
    counted: bool = False
    even_sigma_ppm: float | None = None


def rates_of(source: Source, odr_hz: float | None) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Of a gyroscope alone: stamps (N,) ns as they are, rates (N, 3) as written, and notes.  Raises what ``join`` does.

    Stamps of bursts stay: who integrates them evens them between their gaps.
    """
    notes: list[str] = []
    piece = _whole(source, odr_hz, notes, [], bursts=True)
    if piece.gyro is None or piece.t_ns is None:
        raise FormatError(f"{source.path.name}: no gyroscope in it; give the logs of one")
    return piece.t_ns, piece.gyro, notes


def join(sources: Sequence[Source], odr_hz: float | None, even: bool = False) -> Joined:
    """even: count samples along their stamps.

    Raises FormatError where the files do not hold one gyroscope and one accelerometer, DataError where their times do not meet.
    """
    notes: list[str] = []
    sigmas: list[float] = []
    whole = [(source, _whole(source, odr_hz, notes, sigmas, even=even)) for source in sources]
    whole = _showing_gravity(whole, notes)
    gyro_source, gyro = _only(whole, "gyro", "gyroscope")
    accel_source, accel = _only(whole, "accel", "accelerometer")
    gyro_ns, accel_ns, rate, force = gyro.t_ns, accel.t_ns, gyro.gyro, accel.accel
    assert gyro_ns is not None and accel_ns is not None  # noqa: PT018  # ``_whole`` gives stamps to what has none
    assert rate is not None and force is not None  # noqa: PT018  # ``_only`` has looked
    keep = np.ones(len(gyro_ns), dtype=bool)
    if accel_source is not gyro_source:
        force, keep = _at(gyro_ns, accel_ns, force)
        notes.append(_joined_note(gyro_ns, accel_ns, keep, accel_source.path != gyro_source.path))
        if not keep.any():
            raise DataError(f"{gyro_source.path.name} and {accel_source.path.name} share no time; are they of one recording, on one clock?")
    temps = [(source, piece) for source, piece in whole if piece.temp is not None]
    # The gyro's own temperature before any other's.
    temp_source, temp = next((entry for entry in temps if entry[0] is gyro_source), temps[0] if temps else (None, None))
    values = None if temp is None else temp.temp
    if temp is not None and values is not None and temp.t_ns is not None and temp_source is not gyro_source:
        # Between a reading that failed and its neighbours a line would make many.
        unit = None if temp_source is None else temp_source.layout.temp_unit
        if unit is not None and unit.si is not None:
            sound = Sound()
            values = sound(values * unit.si, values)
            assert values is not None  # of readings
            notes += sound.notes
        values = np.interp(gyro_ns, temp.t_ns, values)
    if not keep.all():
        gyro_ns, rate, force = gyro_ns[keep], rate[keep], force[keep]
        values = None if values is None else values[keep]
    return Joined(
        gyro_ns,
        rate,
        force,
        values,
        gyro_source.layout,
        accel_source.layout,
        None if temp_source is None else temp_source.layout,
        tuple(dict.fromkeys(notes)),
        any(COUNTED in note for note in notes),
        max(sigmas, default=None),
    )


#: of a piece
PARTS = ("t_ns", "gyro", "accel", "temp")


def _whole(source: Source, odr_hz: float | None, notes: list[str], sigmas: list[float], bursts: bool = False, even: bool = False) -> Piece:
    """All rows of a source; sigmas: where samples are counted along their stamps, that of the rate, ppm, is added; bursts: whether stamps
    that come in bursts stay as they are; even: whether samples are counted along stamps that scatter."""
    name, rows = source.path.name, 0
    growing: dict[str, Growing] = {}
    most = len(source.stream) if isinstance(source, StreamSource) else 0
    for piece in source.pieces(as_written=True):
        for part in PARTS:
            if (values := getattr(piece, part)) is not None:
                growing.setdefault(part, Growing(most)).add(values)
                if not most:  # of a stream its reader has taken it
                    current().numbers(source.path, values.size)
        rows += len(next(part for part in (piece.gyro, piece.accel, piece.temp) if part is not None))
    notes += [f"{name}: {note}" for note in source.notes]
    before = len(source.notes)
    if not rows and getattr(source, "picks_rows", False):
        raise FormatError(f"{name}: no samples among the rows that --rows, --where and --lines leave; give others")
    if not rows:
        raise FormatError(f"{name}: a header but no samples; was the recording stopped before it began?")
    columns = [growing[part].rows() if part in growing else None for part in PARTS]
    t_ns = columns[0]
    if t_ns is None:
        if odr_hz is None:  # of a file with neither sensor: ``recognise`` requires it of the others
            raise FormatError(f"{name}: it has no time stamps; give the true data rate, --odr HZ")
        notes.append(f"{name}: no stamps: {COUNTED} {odr_hz:g} Hz")
        return Piece(counted(rows, odr_hz), *columns[1:])
    if (again := _repeated_end(t_ns)) is not None:
        notes.append(f"{name}: its last {len(t_ns) - again} rows repeat the time before them, as a program's display does: left out")
        columns = [None if column is None else column[:again] for column in columns]
    stamps = source.unrolled(t_ns[:again])
    notes += [f"{name}: {note}" for note in source.notes[before:]]
    once = written_once(stamps, [column for column in columns[1:] if column is not None])
    if (shared := int(np.count_nonzero(np.diff(stamps) == 0))) > COARSE * len(stamps) and np.count_nonzero(~once) >= TWICE * shared:
        notes.append(f"{name}: {np.count_nonzero(~once)} rows repeat the one before them, stamp and readings: left out")
        stamps, columns, shared = stamps[once], [None if column is None else column[once] for column in columns], 0
    if source.wraps:
        notes.append(f"{name}: the time counter came round {source.wraps}x: unrolled")
    if bursts and shared <= COARSE * len(stamps):
        return Piece(stamps, *columns[1:])
    stamps, note, sigma_ppm = evenly(stamps, odr_hz, name)
    if note:
        notes.append(f"{name}: {note}")
    if even and (note is None or UNCOUNTED in note):
        stamps, note, sigma_ppm = along_line(stamps, name)
        notes.append(f"{name}: {note}")
    elif note is None and source.layout.clock and columns[1] is not None and _taken_evenly(stamps, columns[1]):
        with suppress(DataError):  # samples are missing, or the rate changes: the stamps stay
            stamps, note, sigma_ppm = along_line(stamps, name)
            notes.append(f"{name}: {note}")
    if sigma_ppm is not None:
        sigmas.append(sigma_ppm)
    return Piece(stamps, *columns[1:])


#: of the scatter of stamps: what readings that were taken evenly follow less of, so that counting them is nearer
HALF = 0.5


def _taken_evenly(t_ns: np.ndarray, gyro: np.ndarray) -> bool:
    """Whether rates (N, 3), in any unit, show that samples were taken evenly, and only arrived when their stamps (N,) ns state."""
    later = fresh(t_ns)
    errors = stamp_errors(Samples(t_ns[later], gyro[later], gyro[later]), Protocol().segment_s)
    return errors.resolved and errors.followed < HALF


#: of a log: rows at its end that may repeat what is before them, and how near their last stamp is to the last before them, in periods
MOST_REPEATED, ENDS_WITHIN = 0.3, 5


def _repeated_end(t_ns: np.ndarray) -> int | None:
    """The row from which the last rows cover once more a time that is covered; None where none do: stamps go back once, not before the
    first, and end where they were."""
    back = np.flatnonzero(np.diff(t_ns) < 0)
    if len(back) != 1:
        return None
    row = int(back[0]) + 1
    period = float(np.median(np.diff(t_ns[:row]))) if row > 2 else 0.0
    covered = t_ns[row] > t_ns[0] and abs(t_ns[-1] - t_ns[row - 1]) <= ENDS_WITHIN * period
    return row if covered and len(t_ns) - row <= MOST_REPEATED * len(t_ns) else None


def _only(whole: list[tuple[Source, Piece]], part: str, called: str) -> tuple[Source, Piece]:
    there = [(source, piece) for source, piece in whole if getattr(piece, part) is not None]
    if len(there) == 1:
        return there[0]
    if there:
        raise FormatError(f"{' and '.join(source.path.name for source, _ in there)} both hold a {called}; give the files of one sensor")
    named = ", ".join(dict.fromkeys(source.path.name for source, _ in whole))
    if part == "accel":
        turns = "of a gyroscope alone the turns must be known: --turns FILE"
        raise MissingSensorError(f"{named}: no accelerometer; give its file as well; {turns}")
    raise MissingSensorError(f"{named}: no gyroscope; give its file as well (this log needs the gyroscope's and the accelerometer's)")


def without_gravity(accel: np.ndarray, layout: TableLayout) -> bool:
    """Whether specific force (N, 3), as written, is far too small for gravity to be in it; registers are not looked at."""
    si = None if layout.accel is None else layout.accel.unit.si
    return si is not None and median_length(accel) * si < LEAST_GRAVITY * G


def _showing_gravity(whole: list[tuple[Source, Piece]], notes: list[str]) -> list[tuple[Source, Piece]]:
    """Without the files of an accelerometer that gravity was taken out of, where another one has it."""
    bare = [
        source for source, piece in whole if piece.gyro is None and piece.accel is not None and without_gravity(piece.accel, source.layout)
    ]
    if not bare or not any(piece.accel is not None and source not in bare for source, piece in whole):
        return whole
    notes += [f"{source.path.name}: acceleration without gravity, which is no reference: left out" for source in bare]
    return [(source, piece) for source, piece in whole if source not in bare]


def _at(t_ns: np.ndarray, there_ns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """values (M, 3) at the moments t_ns, straight between neighbours, and where that can be trusted."""
    later = fresh(there_ns)
    there_ns, values = there_ns[later], values[later]
    if len(there_ns) < 2:
        return np.zeros((len(t_ns), 3)), np.zeros(len(t_ns), dtype=bool)
    after = later_row(there_ns, t_ns)
    gap = there_ns[after] - there_ns[after - 1]
    part = ((t_ns - there_ns[after - 1]) / gap)[:, None]
    # On the stamp itself the value must be the value, not nearly.
    between = np.where(
        part >= 1, values[after], np.where(part <= 0, values[after - 1], values[after - 1] * (1 - part) + values[after] * part)
    )
    inside = (t_ns >= there_ns[0]) & (t_ns <= there_ns[-1])
    near = (gap <= WIDEST * np.median(np.diff(there_ns))) | (part[:, 0] == 0) | (part[:, 0] == 1)
    return between, inside & near


def _joined_note(gyro_ns: np.ndarray, accel_ns: np.ndarray, keep: np.ndarray, clocks: bool) -> str:
    """clocks: whether the two may have clocks of their own."""
    gyro_hz, accel_hz = (pace_of(t_ns).rate_hz for t_ns in (gyro_ns, accel_ns))
    text = f"joined on time: gyroscope at {gyro_hz:.4g} Hz, accelerometer at {accel_hz:.4g} Hz"
    if not np.isin(gyro_ns[keep], accel_ns).all():
        text += ", read between its samples" + "; their clocks are not aligned yet: run explain" * clocks
    lost = np.count_nonzero(~keep)
    return text + (f"; {lost} samples of the gyroscope without accelerometer samples are left out" if lost else "")
