"""A table in memory as a log: a DataFrame of any library, a dict of arrays, an array with or without named columns.

It is written as text and read as any program's log, so that names, units and messages are those of files.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import DataError
from session.base.files import created
from session.base.numeric import formatted_rows

#: columns of a recording at least: two sensors of three axes
FEWEST = 6


def is_table(value: Any) -> bool:
    """Whether a value may be a table: by a DataFrame's ``columns`` and ``to_numpy``, as a mapping, or as an array of columns."""
    if isinstance(value, np.ndarray):
        return value.dtype.names is not None or (value.ndim == 2 and value.shape[1] >= FEWEST)
    return isinstance(value, Mapping) or (hasattr(value, "columns") and hasattr(value, "to_numpy"))


def write_table(value: Any, path: Path) -> None:
    """Write a table as text.  Raises DataError for columns of several lengths and for what is no number and no time."""
    columns: list[tuple[str, np.ndarray]] = []
    for name, array in _columns(value):
        if array.ndim == 2 and array.shape[1] == 3:
            columns += [(f"{name}_{axis}", array[:, place]) for place, axis in enumerate("xyz")]
        elif array.ndim == 1:
            columns.append((name, array))
        else:
            raise DataError(f"{name} has shape {array.shape}, expected (N,) or (N, 3)")
    if len({len(array) for _, array in columns}) != 1:
        lengths = ", ".join(f"{name} {len(array)}" for name, array in columns[:8])
        raise DataError(f"its columns have different lengths ({lengths}); expected one" if columns else "it has no columns")
    names, arrays = [], []
    for name, array in columns:
        stamps = array.dtype.kind in "mM"  # a time, or one since a beginning
        if array.dtype.kind == "c":
            raise DataError(f"{name} holds complex numbers, expected real ones")
        try:
            kept = array.dtype.kind in "iu"
            arrays.append(array.astype(f"{array.dtype.kind}8[ns]").astype(np.int64) if stamps else array if kept else array.astype(float))
        except (TypeError, ValueError):
            raise DataError(f"{name} is not made of numbers") from None
        names.append(f"{name} [ns]" if stamps else name)
    formats = ["%d" if array.dtype.kind in "iu" else "%r" for array in arrays]
    with created(path) as file:
        if any(names):
            file.write((",".join(f'"{name}"' for name in names) + "\n").encode())
        file.writelines(formatted_rows(arrays, formats))


def _columns(value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Name and values of each column; no names of a bare array's."""
    if isinstance(value, np.ndarray) and value.dtype.names is None:
        yield from (("", _unmasked(column)) for column in value.T)
        return
    if (index := getattr(value, "index", None)) is not None and not callable(index):
        stamps = np.asarray(index)
        if stamps.dtype.kind in "mM" or getattr(index, "name", None) is not None:
            yield str(getattr(index, "name", None) or "time"), stamps
    names = value.dtype.names if isinstance(value, np.ndarray) else value.columns if hasattr(value, "columns") else value
    for name in names:
        yield " ".join(map(str, name)) if isinstance(name, tuple) else str(name), _unmasked(value[name])


def _unmasked(values: Any) -> np.ndarray:
    """As an array; what is masked is no number, whatever stands below the mask."""
    if np.ma.is_masked(values) and values.dtype.kind in "iuf":
        return np.asarray(values.astype(float).filled(np.nan))
    return np.asarray(values)
