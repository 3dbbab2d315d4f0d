"""Options of a fit that a lot adds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, option


@dataclass(frozen=True)
class LotOptions(Record):
    """The lot that the unit is of."""

    lot: Path | None = option(None, "prior from a production lot (lot.json), of least squares alone: fewer turns are enough")
