"""An array's logs, piece by piece, as the units' readings at the first unit's moments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.common.units import NS
from session.dialects.layout import Answers
from session.dialects.reader import Reader
from session.log.logfile import already_calibrated
from tinygc.array.fused.model import ArrayModel, FusedUnit
from tinygc.array.fused.resample import Resampler
from tinygc.array.places.place import UnitClock
from tinygc.deploy.apply import Applicable, Source
from tinygc.deploy.surroundings import Surroundings
from tinygc.models.accelerometer import KnownSensor


@dataclass(frozen=True, eq=False)
class Moments:
    """t_ns (T,) int64 of the first unit's samples; rate (T, N, 3) rad/s as measured and force (T, N, 3) m/s^2 calibrated, NaN where a unit
    has none."""

    t_ns: np.ndarray
    rate: np.ndarray
    force: np.ndarray


class UnitLog:
    """A unit's log as pieces in SI, and its samples at any moments."""

    def __init__(self, unit: FusedUnit, clock: UnitClock | None, path: Path, answers: Answers):
        """clock: None of a unit whose clock nobody knows, and which so gives nothing; answers: what a person says of all logs.

        Raises FormatError for what is no log of a gyroscope, or is calibrated already.
        """
        self.unit, self.clock, self.reader = unit, clock, Reader(path, answers)
        if self.reader.layout.gyro is None:
            raise FormatError(f"{path.name} holds no gyroscope")
        if already_calibrated(self.reader.comments) is not None:
            raise FormatError(f"{path.name} is calibrated already: give the array's folder with the logs as they were recorded")
        self.has_force = clock is not None and self.reader.layout.accel is not None and unit.accelerometer is not None
        sensor = unit.sensor
        known = KnownSensor() if sensor is None else KnownSensor(sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.model, sensor.own_units)
        answers = replace(
            answers,
            gyro_fs_dps=answers.gyro_fs_dps or known.gyro_fs_dps,
            accel_fs_g=answers.accel_fs_g or known.accel_fs_g,
            sensor=answers.sensor or known.model,
        )
        around = Surroundings(known, unit.accelerometer, "none" if unit.accelerometer is None else "model", "")
        self._pieces = Source(self.reader, answers, around).pieces()
        self._resampler, self._ended = Resampler(6), False

    def pieces(self) -> Iterator[Applicable]:
        """Its own, of the unit whose moments are the array's."""
        return self._pieces

    def at(self, t_s: np.ndarray, begins_ns: int) -> np.ndarray:
        """(T, 6) rate and force at moments (T,) s of the array's clock after begins_ns; each call goes on where the last one ended."""
        if self.clock is None:
            return np.full((len(t_s), 6), np.nan)
        while not self._ended and self._resampler.ends < t_s[-1]:
            piece = next(self._pieces, None)
            if piece is None:
                self._ended = True
            else:
                self._resampler.push(_moments(self.clock, piece.t_ns, begins_ns), as_six(piece, self.has_force))
        found = self._resampler.at(t_s)
        self._resampler.forget(float(t_s[-1]))
        return found


def _moments(clock: UnitClock, t_ns: np.ndarray, begins_ns: int) -> np.ndarray:
    """(K,) s of the array's clock after begins_ns."""
    since = (t_ns - begins_ns) * NS
    return since + clock.offset_s + clock.rate * (since + (begins_ns * NS - clock.about_s))


def as_six(piece: Applicable, with_force: bool) -> np.ndarray:
    """(K, 6): rate and force, the latter NaN where there is none."""
    force = piece.accel if with_force and piece.accel is not None else np.full_like(piece.gyro, np.nan)
    return np.hstack([piece.gyro, force])


class ArrayLogs:
    """All units of one log; ``moments()`` goes through it once, in bounded memory: a piece of each unit's file."""

    def __init__(self, model: ArrayModel, clocks: dict[int, UnitClock], paths: dict[int, Path], answers: Answers):
        """clocks by number; a unit without one gives nothing.  FormatError where a unit of the model has no log."""
        if not set(paths) >= set(model.numbers):
            there, wanted = (", ".join(map(str, sorted(numbers))) for numbers in (paths, model.numbers))
            raise FormatError(f"{next(iter(paths.values())).parent}: logs of units {there}, the model has units {wanted}; give its array")
        self.units = [UnitLog(unit, clocks.get(unit.number), paths[unit.number], answers) for unit in model.units]

    @property
    def progress(self) -> tuple[int, int]:
        """Bytes of the first unit's file that were read, and all."""
        reader = self.units[0].reader
        size = max(reader.path.stat().st_size, 1)
        return min(reader.position, size), size

    @property
    def notes(self) -> list[str]:
        """Of the readers, with their files' names."""
        return [f"{unit.reader.path.name}: {note}" for unit in self.units for note in unit.reader.notes]

    def moments(self) -> Iterator[Moments]:
        """Piece after piece of the first unit's samples, and what the others read then."""
        begins: int | None = None
        first, *others = self.units
        for piece in first.pieces():
            if not len(piece.t_ns):
                continue
            begins = int(piece.t_ns[0]) if begins is None else begins
            t_s = (piece.t_ns - begins) * NS
            values = np.stack([as_six(piece, first.has_force), *(unit.at(t_s, begins) for unit in others)], axis=1)
            yield Moments(piece.t_ns, values[..., :3], values[..., 3:])
