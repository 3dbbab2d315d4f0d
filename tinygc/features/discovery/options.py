"""Options of a search beyond the catalogue."""

from __future__ import annotations

from dataclasses import dataclass

from session.base.options import Record, option


@dataclass(frozen=True)
class SearchOptions(Record):
    """Options of ``explain``."""

    discover: bool = option(
        False, "search for the equation that no catalogue has, write it as an effect file, and prove it (docs/discover.md); takes longer"
    )
