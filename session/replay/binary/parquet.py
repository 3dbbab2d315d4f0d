"""Parquet tables by pyarrow: columns of any name, and columns of three numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from session.base.budget import current
from session.base.errors import FormatError
from session.base.files import require_file
from session.replay.binary.arrays import Array, Opened, Tables
from session.replay.binary.source import begins, library

PACKAGE = "pyarrow"


@contextmanager
def _opened(path: Path) -> Iterator[Opened]:
    require_file(path)
    file = library(path, "a Parquet file", "pyarrow.parquet", PACKAGE).ParquetFile(path)
    groups = [file.metadata.row_group(number) for number in range(file.metadata.num_row_groups)]
    rows = file.metadata.num_rows

    def value(name: str) -> np.ndarray:
        """A column (N,) or (N, 3); missing numbers become NaN."""
        parts = [group.column(place) for group in groups for place in range(group.num_columns)]
        own = [part for part in parts if f"{part.path_in_schema}.".startswith(f"{name}.")]
        current().need(path, sum(8 * part.num_values + part.total_uncompressed_size for part in own))
        column = file.read([name], use_threads=False).column(0)
        if not _is_list(column.type):
            return np.asarray(column.to_numpy())
        flat = np.concatenate([chunk.flatten().to_numpy(zero_copy_only=False) for chunk in column.chunks])
        if column.null_count or len(flat) != 3 * len(column):
            raise FormatError(f"{path}: {name} does not hold three numbers in each row; give its columns apart")
        return flat.reshape(-1, 3)

    yield Opened([array for field in file.schema_arrow if (array := _array(field, rows)) is not None], lambda names: value)


def _is_list(kind: Any) -> bool:
    return "list<" in str(kind)


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
    "Parquet",
    "a Parquet file",
    PACKAGE,
    "logs",
    "Apache-2.0",
    "df.to_parquet('log.parquet') with t_s, gyro_x, …, acc_z",
    begins(b"PAR1"),
    _opened,
)
