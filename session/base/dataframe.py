"""Records as a pandas DataFrame, where pandas is installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from session.base.errors import CalibrationError


def data_frame(columns: Mapping[str, Any], index: Sequence[str] | None = None) -> Any:
    """Return a DataFrame of columns by name, its rows named by ``index``.  CalibrationError where pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise CalibrationError("to_frame needs pandas: python -m pip install pandas") from None
    return pandas.DataFrame(dict(columns), index=None if index is None else list(index))
