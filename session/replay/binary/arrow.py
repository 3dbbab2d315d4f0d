"""Parquet and Feather tables by pyarrow: columns of any name, and columns of three numbers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from session.base.budget import current
from session.base.errors import FormatError
from session.base.files import require_file
from session.log.samples import Growing
from session.replay.binary.arrays import Array, Opened, Tables
from session.replay.binary.source import begins, library

PACKAGE = "pyarrow"
PARQUET, FEATHER, FEATHER_1 = b"PAR1", b"ARROW1\0\0", b"FEA1"
#: rows that are read at once
AT_ONCE = 1 << 16


@contextmanager
def _opened(path: Path) -> Iterator[Opened]:
    table = _Table(path)
    yield Opened(table.arrays, lambda names: table.values)


class _Table:
    """Columns of a file, none of which is read before it is requested, and then some rows at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        require_file(path)
        self._arrow = library(path, "a table of Arrow", "pyarrow", PACKAGE)
        with path.open("rb") as file:
            self._magic = file.read(8)
        if self._magic.startswith(PARQUET):
            schema, rows = self._parquet().schema_arrow, self._parquet().metadata.num_rows
        elif self._magic.startswith(FEATHER_1):
            whole = self._feather_1(None)
            schema, rows = whole.schema, whole.num_rows
        else:
            schema, rows = self._stream(None).schema, _require_bodies(path, self._arrow.ipc, self._messages())
        self.arrays = [array for field in schema if (array := _array(field, rows)) is not None]
        self._rows = rows

    def _parquet(self) -> Any:
        return library(self._path, "a Parquet file", "pyarrow.parquet", PACKAGE).ParquetFile(self._path)

    def _feather_1(self, columns: list[str] | None) -> Any:
        return library(self._path, "a Feather file", "pyarrow.feather", PACKAGE).read_table(self._path, columns=columns, memory_map=True)

    def _messages(self) -> Any:
        """The file behind its first bytes, which is a stream: the table of its end may point elsewhere, and is not read."""
        file = self._arrow.memory_map(str(self._path))
        file.seek(len(FEATHER))
        return file

    def _stream(self, name: str | None) -> Any:
        """Its batches, of this column alone."""
        ipc = self._arrow.ipc
        if name is None:
            return ipc.open_stream(self._messages())
        place = self._stream(None).schema.get_field_index(name)
        return ipc.open_stream(self._messages(), options=ipc.IpcReadOptions(included_fields=[place]))

    def _batches(self, name: str) -> Iterator[Any]:
        """A column, some rows at a time."""
        if self._magic.startswith(PARQUET):
            whole = self._parquet()
            for group in map(whole.metadata.row_group, range(whole.metadata.num_row_groups)):
                parts = [group.column(place) for place in range(group.num_columns)]
                own = [part for part in parts if f"{part.path_in_schema}.".startswith(f"{name}.")]
                current().need(self._path, 8 * sum(part.num_values for part in own))
                current().need(self._path, sum(part.total_uncompressed_size for part in own))
            for batch in whole.iter_batches(AT_ONCE, columns=[name], use_threads=False):
                yield batch.column(0)
        elif self._magic.startswith(FEATHER_1):
            yield from self._feather_1([name]).column(name).chunks
        else:
            for batch in self._stream(name):
                yield batch.column(0)

    def values(self, name: str) -> np.ndarray:
        """A column (N,) or (N, 3).  FormatError for one with gaps in its lists; missing numbers become NaN."""
        values = self._grown(name)
        self._arrow.default_memory_pool().release_unused()
        return values

    def _grown(self, name: str) -> np.ndarray:
        grown, rows = Growing(), 0
        for part in self._batches(name):
            rows += len(part)
            is_list = _is_list(part.type)
            flat = np.asarray((part.flatten() if is_list else part).to_numpy(zero_copy_only=False))
            if is_list and (part.null_count or len(flat) != 3 * len(part)):
                raise FormatError(f"{self._path}: {name} does not hold three numbers in each row; give its columns apart")
            if rows > self._rows:
                raise FormatError(f"{self._path}: {name} has more rows than the file's head states; copy it again")
            grown.add(flat.reshape(-1, 3) if is_list else flat)
        return grown.rows()


def _require_bodies(path: Path, ipc: Any, file: Any) -> int:
    """Rows of a stream, by the heads of its batches.  FormatError for one that unpacks to more than the budget.

    A head is a table of flatbuffers (Arrow's format/Message.fbs and Schema.fbs); each packed buffer begins with its length.
    """
    rows = 0
    for message in ipc.MessageReader.open_stream(file):
        if message.type not in ("record batch", "dictionary"):
            continue
        head, body = bytes(message.metadata), memoryview(message.body)
        batch = _table(head, _field(head, _table(head, 0), 2))
        if message.type == "dictionary":
            batch = _table(head, _field(head, batch, 1))
        elif place := _field(head, batch, 0):
            rows += struct.unpack_from("<q", head, place)[0]
        buffers, is_packed = _table(head, _field(head, batch, 2)), _field(head, batch, 3)
        size = 0
        for number in range(struct.unpack_from("<I", head, buffers)[0]):
            at, length = struct.unpack_from("<qq", head, buffers + 4 + 16 * number)
            size += max(struct.unpack_from("<q", body, at)[0], 0) if is_packed and length >= 8 else 0
        current().need(path, size)
        current().unpack(path, size)
    return rows


def _table(head: bytes, place: int) -> int:
    """Where the table or list is that a place refers to."""
    return place + int(struct.unpack_from("<I", head, place)[0])


def _field(head: bytes, table: int, number: int) -> int:
    """The place of a table's field; 0 where it is left out."""
    sizes = table - struct.unpack_from("<i", head, table)[0]
    at = 4 + 2 * number
    behind = struct.unpack_from("<H", head, sizes + at)[0] if at < struct.unpack_from("<H", head, sizes)[0] else 0
    return table + behind if behind else 0


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
    facts = field.metadata or {}
    unit = next((facts[key] for key in (b"units", b"unit") if key in facts), b"").decode("utf-8", "replace")
    return None if dtype.kind not in "iufM" else Array(field.name, (rows, 3) if _is_list(field.type) else (rows,), dtype, unit)


FORMAT = Tables(
    "Arrow",
    "a table of Arrow",
    PACKAGE,
    "logs",
    "Apache-2.0",
    "df.to_parquet('log.parquet') or df.to_feather('log.feather') with t_s, gyro_x, …, acc_z",
    begins(PARQUET, FEATHER, FEATHER_1),
    _opened,
)
