"""Many sessions in one table, and a lot of sensors as the prior of one unit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.features import Feature
from session.base.options import Record, option

# Options of a fit that a lot adds.


@dataclass(frozen=True)
class LotOptions(Record):
    """The lot that the unit is of."""

    lot: Path | None = option(None, "prior from a production lot (lot.json), of least squares alone: fewer turns are enough")


FEATURE = Feature(
    commands={
        "fleet": ("command", "check, fit and explain thousands of sessions, each once, into one table and one page"),
    },
    public={"fleet": "library", "lot": "library"},
    serves={
        "options of a fit": "feature:LotOptions",
        "spread of a production lot": "points:spread",
        "prior of a fit": "points:prior",
        "fitted sessions of a table": "points:fitted_sessions",
    },
)
