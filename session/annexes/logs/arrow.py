"""Parquet and Feather tables by pyarrow: columns of any name, and columns of three numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from session.annexes.logs.arrays import Array, streams_of, topics_of
from session.annexes.logs.source import library, one_line
from session.io.errors import FormatError
from session.io.files import require_file
from session.io.streams import Stream, Topic

NAME = "Arrow"
PACKAGE, EXTRA, LICENCE = "pyarrow", "logs", "Apache-2.0"
EXAMPLE = "df.to_parquet('log.parquet') or df.to_feather('log.feather') with t_s, gyro_x, …, acc_z"
PARQUET, FEATHER, FEATHER_1 = b"PAR1", b"ARROW1\0\0", b"FEA1"


def is_mine(path: Path, head: bytes) -> bool:
    """By the bytes that Parquet and Arrow files begin with."""
    return head.startswith((PARQUET, FEATHER, FEATHER_1))


def topics(path: Path, columns: str | None) -> list[Topic]:
    """The streams that the columns make; FormatError lists the columns where that is not clear."""
    with one_line(path, "a table of Arrow"):
        return topics_of(path, "a table of Arrow", _Table(path).arrays, columns)


def read(path: Path, names: Sequence[str], columns: str | None) -> list[Stream]:
    """The streams of these names; only their columns are read."""
    with one_line(path, "a table of Arrow"):
        table = _Table(path)
        return streams_of(path, "a table of Arrow", table.arrays, table.values, names, columns)


class _Table:
    """Columns of a file, none of which is read before it is asked for."""

    def __init__(self, path: Path) -> None:
        self._path = path
        require_file(path)
        library(path, "a table of Arrow", "pyarrow", PACKAGE)
        with path.open("rb") as file:
            self._is_parquet = file.read(4) == PARQUET
        if self._is_parquet:
            whole = library(path, "a Parquet file", "pyarrow.parquet", PACKAGE).ParquetFile(path)
            schema, rows = whole.schema_arrow, whole.metadata.num_rows
        else:
            whole = self._feather(None)
            schema, rows = whole.schema, whole.num_rows
        self.arrays = [array for field in schema if (array := _array(field, rows)) is not None]

    def _feather(self, columns: list[str] | None) -> Any:
        return library(self._path, "a Feather file", "pyarrow.feather", PACKAGE).read_table(self._path, columns=columns, memory_map=True)

    def values(self, name: str) -> np.ndarray:
        """A column (N,) or (N, 3).  FormatError for one with gaps in its lists; missing numbers become NaN."""
        if self._is_parquet:
            table = library(self._path, "a Parquet file", "pyarrow.parquet", PACKAGE).read_table(self._path, columns=[name])
        else:
            table = self._feather([name])
        column = table.column(name).combine_chunks()
        if not _is_list(column.type):
            return np.asarray(column.to_numpy(zero_copy_only=False))
        flat = np.asarray(column.flatten().to_numpy(zero_copy_only=False))
        if column.null_count or len(flat) != 3 * len(column):
            raise FormatError(f"{self._path}: {name} does not hold three numbers in each row; give its columns apart")
        return flat.reshape(-1, 3)


def _is_list(kind: Any) -> bool:
    import pyarrow.types as types

    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _array(field: Any, rows: int) -> Array | None:
    """What a column of the schema is; None where it holds no numbers and no times.  Its unit may stand in its metadata."""
    kind = field.type.value_type if _is_list(field.type) else field.type
    try:
        dtype = np.dtype(kind.to_pandas_dtype())
    except (NotImplementedError, TypeError):
        dtype = np.dtype("M8[ns]") if str(kind).startswith("timestamp") else np.dtype(object)
    said = field.metadata or {}
    unit = next((said[key] for key in (b"units", b"unit") if key in said), b"").decode("utf-8", "replace")
    return None if dtype.kind not in "iufM" else Array(field.name, (rows, 3) if _is_list(field.type) else (rows,), dtype, unit)
