"""What the core asks of a search beyond the catalogue."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tinygc.explanation.engine import Explanation
    from tinygc.features.discovery.report import DiscoveryReport
    from tinygc.features.discovery.search_state import Discovery


def discover(explanation: Explanation, **how: Any) -> Discovery:
    """Search for the missing equation."""
    from tinygc.features.discovery.engine import discover

    return discover(explanation, **how)


def report(explanation: Explanation, discovery: Discovery) -> DiscoveryReport:
    """Return the report of an explanation with what was found beyond it."""
    from tinygc.features.discovery.report import DiscoveryReport

    return DiscoveryReport(explanation, discovery)
