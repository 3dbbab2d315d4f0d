"""Readings of a whole log in as few bytes as they were written with, and in SI, float64, where they are asked for.

A day at 208 Hz is 18 million rows: 24 bytes each as float64, a sixth of that as a sensor's registers.  Decimals are kept as whole numbers
of a power of ten where that gives back the very same float64; else as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, cast

import numpy as np

#: from (K, …) as written to (K, …) in SI, each row by itself; something that can be pickled
Step = Callable[[np.ndarray], np.ndarray]
#: decimals that are tried: a register has none, a careful logger nine
MOST_DECIMALS = 9
#: rows that are turned into float64 at once where all are looked at
TOGETHER = 1 << 17


class Readings(np.lib.mixins.NDArrayOperatorsMixin):
    """Acts as the float64 array (N,) or (N, C) that it stands for: rows, columns and operators give plain arrays.

    Whoever asks for all of it at once gets all of it in float64: ``pieces`` is for long logs.
    """

    def __init__(
        self, packed: np.ndarray, divisor: float, steps: tuple[Step, ...] = (), put_in: tuple[np.ndarray, np.ndarray] | None = None
    ):
        """packed (N, …) / divisor is what was written; steps from there to SI; put_in: rows (K,), in order, that nobody has written, and
        what they hold (K, …) in SI."""
        self._packed, self._divisor, self._steps, self._put_in = packed, divisor, steps, put_in

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
        if columns and all(isinstance(step, partial) for step in self._steps):  # of each number by itself
            found = self._written_or_put_in(some, (*columns,))
        else:
            found = self._written_or_put_in(some, ())
            if columns:
                found = found[(slice(None), *columns)] if found.ndim == self.ndim else found[(..., *columns)]
        return found[0] if one else found

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError("readings are kept in another form, and have to be converted")
        return self[:].astype(dtype or float, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        return getattr(ufunc, method)(*(np.asarray(each) if isinstance(each, Readings) else each for each in inputs), **more)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self[:], name)

    def mapped(self, step: Step) -> Readings:
        """The same after one more step, which is taken when rows are asked for."""
        put_in = None if self._put_in is None else (self._put_in[0], step(self._put_in[1]))
        return Readings(self._packed, self._divisor, (*self._steps, step), put_in)

    def pick(self, which: slice | np.ndarray) -> Readings:
        """Some of the rows, kept as they are."""
        put_in = None
        if self._put_in is not None:
            taken = np.arange(len(self))[which]
            mine, place = self._among_put_in(taken)
            put_in = np.flatnonzero(mine), self._put_in[1][place[mine]]
        return Readings(self._packed[which], self._divisor, self._steps, put_in)

    def replaced(self, rows: np.ndarray, values: np.ndarray) -> Readings:
        """With other values (K, …), SI, in rows (K,), in order."""
        old_rows, old_values = (rows[:0], values[:0]) if self._put_in is None else self._put_in
        kept = ~np.isin(old_rows, rows)
        all_rows, all_values = np.concatenate([old_rows[kept], rows]), np.concatenate([old_values[kept], values])
        order = np.argsort(all_rows, kind="stable")
        return Readings(self._packed, self._divisor, self._steps, (all_rows[order], all_values[order]))

    def inserted(self, at: np.ndarray, values: np.ndarray) -> Readings:
        """With values (K, …), SI, before rows (K,), in order, as ``np.insert`` has them."""
        rows = at + np.arange(len(at))
        moved = None
        if self._put_in is not None:
            old = self._put_in[0]
            moved = old + np.searchsorted(at, old, side="right"), self._put_in[1]
        return Readings(np.insert(self._packed, at, 0, axis=0), self._divisor, self._steps, moved).replaced(rows, values)

    def _written_or_put_in(self, rows: Any, columns: tuple[Any, ...]) -> np.ndarray:
        found = self._in_si(self._packed[(rows, *columns)] if columns else self._packed[rows])
        if self._put_in is None or not len(self._put_in[0]):
            return found
        if isinstance(rows, slice) and rows.step in (None, 1):
            start, stop, _ = rows.indices(len(self))
            first, last = np.searchsorted(self._put_in[0], (start, max(start, stop)))
            found[self._put_in[0][first:last] - start] = self._put_in[1][(slice(first, last), *columns)]
            return found
        mine, place = self._among_put_in(np.arange(len(self))[rows])
        found[mine] = self._put_in[1][(place[mine], *columns)]
        return found

    def _among_put_in(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which of rows (…) are none that was written, and where they stand among those."""
        assert self._put_in is not None
        known = self._put_in[0]
        place = np.minimum(np.searchsorted(known, rows), max(len(known) - 1, 0))
        return (known[place] == rows if len(known) else np.zeros(rows.shape, dtype=bool)), place

    def _in_si(self, packed: np.ndarray) -> np.ndarray:
        values = packed / self._divisor if self._divisor != 1 else packed.astype(float)
        for step in self._steps:
            values = step(values)
        return values


def times(factor: float) -> Step:
    """Multiplies."""
    return partial(np.multiply, factor)


def mapped(values: np.ndarray, step: Step) -> np.ndarray:
    """``step`` of each row: of ``Readings`` when rows are asked for, of an array at once."""
    return cast(np.ndarray, values.mapped(step)) if isinstance(values, Readings) else step(values)


def pick(values: np.ndarray, which: slice | np.ndarray) -> np.ndarray:
    """Some of the rows, kept as they are kept."""
    return cast(np.ndarray, values.pick(which)) if isinstance(values, Readings) else values[which]


def replaced(values: np.ndarray, rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """With other values (K, …) in rows (K,), in order."""
    if isinstance(values, Readings):
        return cast(np.ndarray, values.replaced(rows, others))
    values = values.copy()
    values[rows] = others
    return values


def inserted(values: np.ndarray, at: np.ndarray, others: np.ndarray) -> np.ndarray:
    """``np.insert`` of rows."""
    return cast(np.ndarray, values.inserted(at, others)) if isinstance(values, Readings) else np.insert(values, at, others, axis=0)


def pieces(values: np.ndarray, overlap: int = 0) -> Iterator[tuple[int, np.ndarray]]:
    """(row of the first, rows as float64) of consecutive parts of ``TOGETHER`` rows; each goes on for ``overlap`` rows into the next."""
    for start in range(0, max(len(values) - overlap, 1), TOGETHER):
        yield start, values[start : start + TOGETHER + overlap]


class Growing:
    """Rows (N, …) that are added piece by piece, in one array that grows where it lies: never all of them twice."""

    def __init__(self) -> None:
        self._rows, self._table = 0, np.zeros(0)

    def add(self, rows: np.ndarray) -> None:
        """The next rows; of a wider type than those before, all are of that type."""
        if not self._rows:
            self._table = np.empty((0, *rows.shape[1:]), dtype=rows.dtype)
        elif (kind := np.result_type(self._table, rows)) != self._table.dtype:
            self._table = self._table.astype(kind)
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
            tried = range(self._decimals, MOST_DECIMALS + 1)
            found = next(((decimals, whole) for decimals in tried if (whole := _whole(table, decimals)) is not None), None)
            if found is not None and (found[0] == self._decimals or self._rescaled(found[0])):
                self._kept.add(found[1])
                return
            divisor, self._decimals = 10.0**self._decimals, None
            self._kept.change(lambda kept, divisor=divisor: kept / divisor)  # type: ignore[misc]
        self._kept.add(np.array(table, dtype=float))

    def packed(self) -> tuple[np.ndarray, float]:
        """All rows, and what they are to be divided by."""
        return self._kept.rows(), 10.0 ** (self._decimals or 0)

    def _rescaled(self, decimals: int) -> bool:
        """Whether those before can have more decimals, too; then they have."""
        assert self._decimals is not None
        divisor = 10.0**self._decimals
        if not self._kept.change(lambda kept: _whole(kept / divisor, decimals)):
            return False
        self._decimals = decimals
        return True


def _whole(table: np.ndarray, decimals: int) -> np.ndarray | None:
    """Whole numbers of 10^-decimals that give the table back to the last bit, in 16 or 32 bits; None where none do.

    The quotient of two whole numbers that a float64 holds exactly is rounded once, as a decimal that is read is: the same number.
    """
    scaled = np.rint(table * 10.0**decimals) if decimals else table
    size = np.abs(scaled).max(initial=0)
    if not size < 2**31:
        return None
    whole = scaled.astype(np.int16 if size < 2**15 else np.int32)
    same = np.array_equal(np.divide(whole, 10.0**decimals) if decimals else whole, table)
    return whole if same else None
