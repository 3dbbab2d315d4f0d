"""A fleet's table for the terminal: what it holds, in a few lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from session.common.texts import printable

if TYPE_CHECKING:
    from tinygc.fleet.run import Tally
    from tinygc.fleet.summary import Summary

MOST_SHOWN = 8  #: of each list: the page has more


def fleet_page(summary: Summary, tally: Tally | None) -> Group:
    """For rich."""
    lines = [] if tally is None else [f"this run: {tally.done} done, {tally.failed} failed, {tally.reused} known before"]
    failed = summary.failed + summary.died + summary.unreadable
    lines.append(
        f"the table: {summary.folders} folders, {summary.sessions} different sessions of {summary.units} serial numbers; "
        f"{summary.done} done, {failed} failed"
    )
    if summary.passed + summary.missed:
        rule = "closes better than the raw rates" if summary.limit_deg is None else f"closes within {summary.limit_deg:g}°"
        lines.append(f"of {summary.passed + summary.missed} that were fitted, {summary.passed} pass: {rule}")
    for what, counts in (("first look", summary.first_look), ("explain", summary.verdicts), ("named", summary.effects)):
        if counts:
            shown = ", ".join(f"{name} {count}" for name, count in list(counts.items())[:MOST_SHOWN])
            lines.append(f"{what}: {shown}" + (" …" if len(counts) > MOST_SHOWN else ""))
    parts: list[Text | Table] = [Text(printable(line)) for line in lines]
    if summary.reasons:
        parts.append(_reasons(summary))
    return Group(*parts)


def _reasons(summary: Summary) -> Table:
    table = Table(title="Failures by reason", title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("sessions", justify="right")
    table.add_column("in")
    table.add_column("because", overflow="fold")
    for step, reason, count in summary.reasons[:MOST_SHOWN]:
        table.add_row(str(count), step, printable(reason))
    return table
