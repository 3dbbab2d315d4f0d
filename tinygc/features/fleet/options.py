"""Options of a fit that a lot adds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class LotOptions:
    """lot: file of a production lot, the prior of least squares."""

    lot: Path | None = None
