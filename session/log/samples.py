"""Samples: the plain record that everything else works on, and the compact store behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np

from session.base.numeric import data_frame, fewest_decimals, in_decimals
from session.base.units import NS
from session.log.stamps import GAP_PERIODS, Pace, not_caught_up, pace_of

# Readings of a whole log in as few bytes as they were written with, converted to SI and float64 on access.
#
# A day at 208 Hz is 18 million rows: 24 bytes each as float64, a sixth of that as a sensor's registers.  Decimals are kept as whole numbers
# of a power of ten where that gives back the very same float64; else as they are.

#: from (K, …) as written to (K, …) in SI, each row by itself; something that can be pickled
Step = Callable[[np.ndarray], np.ndarray]
#: rows that are converted to float64 at once where all are read
TOGETHER = 1 << 17
#: rows of a log that is read into plain arrays: four minutes at 208 Hz, 3 MB
SHORT = 50_000
#: rows of one access beyond which it is converted part by part, so that no step holds two copies of it
AT_ONCE = 1 << 20


class PackedReadings(np.lib.mixins.NDArrayOperatorsMixin):
    """Acts as the float64 array (N,) or (N, C) that it stands for: rows, columns and operators give plain arrays.

    Access to the whole array converts all of it to float64; long logs are read through ``pieces``.
    """

    def __init__(self, packed: np.ndarray, divisor: float, steps: tuple[Step, ...] = ()):
        """packed (N, …) / divisor is what was written; steps from there to SI."""
        self._packed, self._divisor, self._steps = packed, divisor, steps

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the array that it stands for."""
        return self._packed.shape

    @property
    def ndim(self) -> int:
        """1 or 2."""
        return self._packed.ndim

    @property
    def size(self) -> int:
        """How many numbers."""
        return self._packed.size

    @property
    def dtype(self) -> np.dtype:
        """float64, whatever it is kept as."""
        return np.dtype(float)

    @property
    def nbytes(self) -> int:
        """As it is kept."""
        return self._packed.nbytes

    @property
    def T(self) -> np.ndarray:
        """All of it, transposed."""
        return self[:].T

    def __len__(self) -> int:
        return len(self._packed)

    def __iter__(self) -> Iterator[Any]:
        return iter(self[:])

    def __getitem__(self, which: Any) -> Any:
        rows, *columns = which if isinstance(which, tuple) else (which,)
        one = isinstance(rows, int | np.integer)
        some: Any = slice(rows, rows + 1 if rows != -1 else None) if one else rows
        each = columns and all(isinstance(step, partial) for step in self._steps)  # of each number by itself
        packed = self._packed[(some, *columns)] if each else self._packed[some]
        if len(packed) <= AT_ONCE:
            found = self._converted(packed)
        else:
            found = np.empty(packed.shape)
            for start in range(0, len(packed), AT_ONCE):
                found[start : start + AT_ONCE] = self._converted(packed[start : start + AT_ONCE])
        if columns and not each:
            found = found[(slice(None), *columns)] if found.ndim == self.ndim else found[(..., *columns)]
        return found[0] if one else found

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError("readings are kept in another form, and have to be converted")
        return self[:].astype(dtype or float, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        return getattr(ufunc, method)(*(np.asarray(each) if isinstance(each, PackedReadings) else each for each in inputs), **more)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self[:], name)

    def mapped(self, step: Step) -> PackedReadings:
        """The same with one more step, which is applied on access."""
        return PackedReadings(self._packed, self._divisor, (*self._steps, step))

    def pick(self, which: slice | np.ndarray) -> PackedReadings:
        """Some of the rows, kept as they are."""
        return PackedReadings(self._packed[which], self._divisor, self._steps)

    def _converted(self, packed: np.ndarray) -> np.ndarray:
        """Of some rows as they are kept, in SI."""
        found = packed / self._divisor if self._divisor != 1 else packed.astype(float)
        for step in self._steps:
            found = step(found)
        return found


def times(factor: float) -> Step:
    """Multiplies."""
    return partial(np.multiply, factor)


def mapped(values: np.ndarray, step: Step) -> np.ndarray:
    """``step`` of each row: of ``PackedReadings`` on access, of an array at once."""
    return cast(np.ndarray, values.mapped(step)) if isinstance(values, PackedReadings) else step(values)


def pick(values: np.ndarray, which: slice | np.ndarray) -> np.ndarray:
    """Some of the rows, kept as they are kept."""
    return cast(np.ndarray, values.pick(which)) if isinstance(values, PackedReadings) else values[which]


def replaced(values: np.ndarray, rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """With other values (K, …) in rows (K,), as a plain array."""
    values = np.array(values)
    values[rows] = others
    return values


def inserted(values: np.ndarray, at: np.ndarray, others: np.ndarray) -> np.ndarray:
    """``np.insert`` of rows, as a plain array."""
    return np.insert(np.asarray(values), at, others, axis=0)


def pieces(values: np.ndarray, overlap: int = 0) -> Iterator[tuple[int, np.ndarray]]:
    """(row of the first, rows as float64) of consecutive parts of ``TOGETHER`` rows; each goes on for ``overlap`` rows into the next."""
    for start in range(0, max(len(values) - overlap, 1), TOGETHER):
        yield start, values[start : start + TOGETHER + overlap]


def extremes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest (C,) of each column of (N, C)."""
    parts = [(part.min(axis=0), part.max(axis=0)) for _, part in pieces(values)]
    return np.min([low for low, _ in parts], axis=0), np.max([high for _, high in parts], axis=0)


class Growing:
    """Rows (N, …) that are added piece by piece, in one array that grows where it lies: never all of them twice.  most: how many there may
    be, where that is known: the array lies once where it has room."""

    def __init__(self, most: int = 0) -> None:
        self._most, self._rows, self._table = most, 0, np.zeros(0)

    def add(self, rows: np.ndarray) -> None:
        """The next rows; of a wider type than those before, all are of that type."""
        if not self._rows:
            self._table = np.empty((self._most, *rows.shape[1:]), dtype=rows.dtype)
        elif (kind := np.result_type(self._table, rows)) != self._table.dtype:
            table, self._table = self._table, np.empty(self._table.shape, dtype=kind)
            self._table[: self._rows] = table[: self._rows]  # and not the room, which holds anything
        end = self._rows + len(rows)
        if end > len(self._table):
            self._table.resize((end + end // 8, *rows.shape[1:]), refcheck=False)
        self._table[self._rows : end] = rows
        self._rows = end

    def change(self, work: Callable[[np.ndarray], np.ndarray | None]) -> bool:
        """Put what ``work`` makes of all rows so far in their place; False, and as they were, where it makes None of them."""
        changed = work(self._table[: self._rows])
        if changed is not None:
            self._table = changed
        return changed is not None

    def rows(self) -> np.ndarray:
        """All of them; nothing can be added then."""
        table, self._table = self._table, np.zeros(0)
        table.resize((self._rows, *table.shape[1:]), refcheck=False)
        return table


class Packer:
    """Takes tables (K, C) of numbers as they were written, piece by piece, and keeps them in as few bytes as give them back."""

    def __init__(self) -> None:
        self._kept = Growing()
        self._decimals: int | None = 0  # None: no power of ten gives them back

    def add(self, table: np.ndarray) -> None:
        """The next rows."""
        while self._decimals is not None:
            found = fewest_decimals(table, self._decimals)
            if found is not None and (found[0] == self._decimals or self._rescaled(found[0])):
                self._kept.add(found[1])
                return
            divisor, self._decimals = 10.0**self._decimals, None
            self._kept.change(lambda kept, divisor=divisor: kept / divisor)  # type: ignore[misc]
        self._kept.add(np.array(table, dtype=float))

    def readings(self, step: Step, short: int = SHORT) -> np.ndarray:
        """All rows, in SI by a step of each; those of a log that is not short are kept as they were written, and converted on access."""
        found = PackedReadings(self._kept.rows(), 10.0 ** (self._decimals or 0), (step,))
        return cast(np.ndarray, found if len(found) > short else found[:])

    def _rescaled(self, decimals: int) -> bool:
        """Whether those before can have more decimals, too; then they have."""
        assert self._decimals is not None
        divisor = 10.0**self._decimals
        if not self._kept.change(lambda kept: in_decimals(kept / divisor, decimals)):
            return False
        self._decimals = decimals
        return True


# The plain record that everything else works on.  Simulated and recorded samples have the same form.


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive readings of one log, in the order of time.

    t_ns (N,) int64, device time, increasing; gyro (N, 3) rad/s, measured rate m; accel (N, 3) m/s^2, specific force as
    measured or, after ``with_accel``, as pre-calibrated; temp_c (N,) degC, or None where the log has none.  Of a long file the last three
    are ``PackedReadings``, which act as such arrays: what is done to a whole log goes through their ``pieces``.
    """

    t_ns: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp_c: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"<Samples {len(self)}, {self.duration_s:.1f} s>"

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def dt_s(self) -> np.ndarray:
        """(N-1,) s between neighbouring samples."""
        return np.diff(self.t_ns) * NS

    @property
    def t_s(self) -> np.ndarray:
        """(N,) s since the first sample."""
        return (self.t_ns - self.t_ns[0]) * NS if len(self) else np.zeros(0)

    def at_s(self, row: int) -> float:
        """``t_s`` of one sample, without those of all others."""
        return float(self.t_ns[row] - self.t_ns[0]) * NS

    @cached_property
    def pace(self) -> Pace:
        """The true time between two samples, and whether the stamps are too coarse to show a missing one; computed once."""
        return pace_of(self.t_ns)

    @cached_property
    def period_s(self) -> float:
        """The true time between two samples, s: time over samples, in which gaps count with what they lack."""
        return self.pace.period_s

    @cached_property
    def gaps(self) -> np.ndarray:
        """(G,) rows after which samples are missing for longer than ``GAP_PERIODS``: a stamp that came late is none.  Computed once."""
        rows = np.flatnonzero(self.dt_s > GAP_PERIODS * self.period_s)
        return rows[not_caught_up(self.t_ns, rows, self.period_s)] if len(rows) else rows

    @property
    def duration_s(self) -> float:
        """From the first sample to the last, s."""
        return float(self.t_ns[-1] - self.t_ns[0]) * NS if len(self) else 0.0

    @cached_property
    def found(self) -> dict[Any, Any]:
        """What ``once`` has found of the stamps and the rates."""
        return {}

    def with_accel(self, accel: np.ndarray) -> Samples:
        """The same samples with another specific force (N, 3): what is known of their stamps and rates stays known."""
        other, known = replace(self, accel=accel), {"found": self.found}
        vars(other).update(known | vars(self) | {"accel": accel})
        return other

    def to_frame(self) -> Any:
        """A pandas DataFrame of N rows with the columns of a log in SI: ``t_ns``, ``gx_rps``, …, ``ax_mps2``, …, and ``temp_c``.

        Raises CalibrationError where pandas is not installed.
        """
        columns = {"t_ns": self.t_ns}
        columns |= {f"g{axis}_rps": self.gyro[:, number] for number, axis in enumerate("xyz")}
        columns |= {f"a{axis}_mps2": self.accel[:, number] for number, axis in enumerate("xyz")}
        return data_frame(columns if self.temp_c is None else columns | {"temp_c": self.temp_c[:]})

    def between(self, start: int, stop: int) -> Samples:
        """Samples start <= i < stop."""
        part = slice(start, stop)
        return Samples(self.t_ns[part], self.gyro[part], self.accel[part], None if self.temp_c is None else self.temp_c[part])

    def pick(self, which: np.ndarray) -> Samples:
        """Some of them, by mask or index, kept as they are kept."""
        temp_c = None if self.temp_c is None else pick(self.temp_c, which)
        return Samples(self.t_ns[which], pick(self.gyro, which), pick(self.accel, which), temp_c)


P = ParamSpec("P")
Found = TypeVar("Found")


def once(work: Callable[Concatenate[Samples, P], Found]) -> Callable[Concatenate[Samples, P], Found]:
    """Computes what depends on the stamps and rates of samples only once, whatever the specific force with them."""

    @wraps(work)
    def known(samples: Samples, *more: P.args, **named: P.kwargs) -> Found:
        key = (work.__qualname__, more, *named.items())
        if key not in samples.found:
            samples.found[key] = work(samples, *more, **named)
        return cast(Found, samples.found[key])

    return known


def start_times(logs: Iterable[Samples]) -> np.ndarray:
    """(L + 1,) s of the session at which each log begins, laid one after the other, and at which the last one ends."""
    return np.cumsum([0.0] + [samples.duration_s for samples in logs])


def joined(parts: list[Samples]) -> Samples:
    """Parts of one log, in their order, as one."""
    temps = [part.temp_c for part in parts if part.temp_c is not None]
    temp_c = np.concatenate(temps) if len(temps) == len(parts) else None
    t_ns, gyro, accel = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t_ns", "gyro", "accel"))
    return Samples(t_ns, gyro, accel, temp_c)
