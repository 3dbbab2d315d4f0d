"""What the core asks of a search beyond the catalogue."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.options import record_in
from session.base.progress import Progress
from tinygc.features.discovery.feature import SearchOptions

if TYPE_CHECKING:
    from tinygc.explanation.engine import Explanation
    from tinygc.features.discovery.report import DiscoveryReport
    from tinygc.features.discovery.search_state import Discovery


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
    """Search for the missing equation, where that is asked for."""
    if not record_in(further, SearchOptions).discover:
        return None
    from tinygc.features.discovery.engine import discover

    return discover(explanation, seed=seed, progress=progress)


def report(explanation: Explanation, found: Discovery) -> DiscoveryReport:
    """Return the report of an explanation with what was found beyond it."""
    from tinygc.features.discovery.report import DiscoveryReport

    return DiscoveryReport(explanation, found)
