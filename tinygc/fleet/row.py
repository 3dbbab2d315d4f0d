"""A row of the table: what one session gave.  Numbers of people's units have them in their names; values and sigmas are SI."""

from __future__ import annotations

from typing import Any

import numpy as np

from tinygc.lot.unit_result import NAMES

#: of a row: it came to its end; a step of it refused; the process that computed it ended, twice
DONE, FAILED, DIED = "done", "failed", "died"
TEXT, INTEGER, REAL, BLOB = "TEXT", "INTEGER", "REAL", "BLOB"
#: SQL name -> type, beside the key and the 42 columns of parameters (docs/formats.md, table of a fleet)
FIGURES = {
    "status": TEXT,
    "step": TEXT,
    "error": TEXT,
    "model": TEXT,
    "serial": TEXT,
    "recorded": TEXT,
    "operator": TEXT,
    "station": TEXT,
    "first_look": TEXT,
    "segments": INTEGER,
    "held_out_deg": REAL,
    "floor_deg": REAL,
    "run_rmse_deg": REAL,
    "use": TEXT,
    "verdict": TEXT,
    "p_value": REAL,
}
#: the same of what is long, which stands at the end of a row: who asks for a figure need not read past it
LONG = {"effects": TEXT, "findings": TEXT, "covariance": BLOB, "weighed": TEXT}
#: names of parameters as columns, and of their sigmas
VALUES = NAMES
SIGMAS = tuple(f"sigma_{name}" for name in NAMES)
#: all columns but the key, in their order
COLUMNS = {**FIGURES, **dict.fromkeys((*VALUES, *SIGMAS), REAL), **LONG}
COUNT = len(NAMES)
TRIANGLE = np.triu_indices(COUNT)

Row = dict[str, Any]


def empty() -> Row:
    """With nothing known."""
    return dict.fromkeys(COLUMNS)


def packed(covariance: np.ndarray) -> bytes:
    """The upper triangle of (21, 21), row by row, little-endian float64; NaN where the session did not tell."""
    return np.ascontiguousarray(covariance[TRIANGLE], dtype="<f8").tobytes()


def unpacked(blob: bytes | None) -> np.ndarray:
    """(21, 21); of nothing, NaN."""
    covariance = np.full((COUNT, COUNT), np.nan)
    if blob is not None:
        covariance[TRIANGLE] = np.frombuffer(blob, dtype="<f8")
        covariance.T[TRIANGLE] = covariance[TRIANGLE]
    return covariance


def number(value: float | None) -> float | None:
    """As SQLite keeps it: NaN, of which it makes NULL by itself, is None already here, so that rows compare."""
    return None if value is None or not np.isfinite(value) else float(value)
