"""The equation that no catalogue has."""

from __future__ import annotations

from dataclasses import dataclass

from session.base.features import Feature
from session.base.options import Record, option

# Options of a search beyond the catalogue.


@dataclass(frozen=True)
class SearchOptions(Record):
    """Options of ``explain``."""

    discover: bool = option(
        False, "search for the equation that no catalogue has, write it as an effect file, and prove it (discover.md); takes longer"
    )


FEATURE = Feature(
    serves={
        "options of explain": "feature:SearchOptions",
        "explanation of a folder": "points:before",
        "search beyond the catalogue": "points:search",
        "report beyond the catalogue": "points:report",
        "report section": "report_section",
        "earlier results of a report": "report_section:searched",
    },
)
