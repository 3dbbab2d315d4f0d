"""What the core asks of a machine that turned a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tinygc.explanation.engine import Explanation
    from tinygc.features.tables.explanation import TableExplanation


def explained(explanation: Explanation, seed: int) -> TableExplanation | None:
    """Explain the table's own errors; None where no machine turned it."""
    if explanation.session.in_memory or not (explanation.session.folder / "table.csv").exists():
        return None
    from tinygc.features.tables.explanation import explain_table

    return explain_table(explanation.problem, seed)
