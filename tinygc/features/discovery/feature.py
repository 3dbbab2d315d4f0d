"""The equation that no catalogue has."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.features import Feature
from session.base.options import Record, option, record_in
from session.base.progress import Progress

if TYPE_CHECKING:
    from tinygc.explanation.engine import Explanation
    from tinygc.features.discovery.report import DiscoveryReport
    from tinygc.features.discovery.search_state import Discovery

# Options of a search beyond the catalogue.


@dataclass(frozen=True)
class SearchOptions(Record):
    """Options of ``explain``."""

    discover: bool = option(
        False,
        "search for the equation that no catalogue has, write it as an effect file, and prove it (docs/features/discovery/discover.md); "
        "takes longer",
    )


# What the core asks of a search beyond the catalogue.


def before(args: Any) -> None:
    """Fail before the explanation if the laws' files could not be written."""
    if not record_in(args.of_features, SearchOptions).discover:
        return
    folder: Path = (args.out or args.folder / "explain") / "effects"
    if os.path.lexists(folder) and not folder.is_dir():
        raise CalibrationError(f"{folder}: that is no folder, and the laws that are found go into one; move it away, or give --out another")
    if folder.is_dir() and not os.access(folder, os.W_OK | os.X_OK):
        raise CalibrationError(f"{folder}: nothing can be written there, and the laws that are found go there; give --out another folder")


def search(explanation: Explanation, further: Sequence[Any], *, seed: int, progress: Progress) -> Discovery | None:
    """Search for the missing equation, on request."""
    if not record_in(further, SearchOptions).discover:
        return None
    from tinygc.features.discovery.engine import discover

    return discover(explanation, seed=seed, progress=progress)


def report(explanation: Explanation, found: Discovery) -> DiscoveryReport:
    """Return the report of an explanation with what was found beyond it."""
    from tinygc.features.discovery.report import DiscoveryReport

    return DiscoveryReport(explanation, found)


FEATURE = Feature(
    serves={
        "options of explain": "feature:SearchOptions",
        "explanation of a folder": "feature:before",
        "search beyond the catalogue": "feature:search",
        "report beyond the catalogue": "feature:report",
        "report section": "report_section",
        "earlier results of a report": "report_section:searched",
    },
)
