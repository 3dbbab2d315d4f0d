"""The first look in the terminal: the worst first, and at the end, where the eye is, the verdict and what to do next."""

from __future__ import annotations

import re
from pathlib import Path

from rich.table import Table
from rich.text import Text

from session.checks.findings import LEVELS, Finding, worst
from session.common.console import one_line
from session.common.texts import shell_word

#: how the findings of an array's units begin
UNIT = re.compile(r"unit [0-9]+(?=:|$)")
LEVEL_STYLES = {"ok": "green", "note": "cyan", "warning": "yellow", "error": "bold red"}


def findings_table(findings: list[Finding]) -> Table:
    """One row a check, the worst first; of one level, in the order in which they were looked for."""
    table = Table(title="First look", title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in ("", "where", "what", "it says", "do"):
        table.add_column(column)
    for finding in sorted(findings, key=lambda finding: -LEVELS.index(finding.level)):
        table.add_row(Text(finding.level, LEVEL_STYLES[finding.level]), finding.where, finding.what, finding.says, finding.do)
    return table


def next_line(folder: Path, findings: list[Finding]) -> Text:
    """What to do next."""
    word = shell_word(folder)
    said = f"mend it, then calibrate.py check {word}" if worst(findings) == "error" else f"calibrate.py fit {word}"
    return one_line(f"next: {said}")


def unit_lines(findings: list[Finding]) -> list[Text]:
    """A verdict for each unit of an array, the worst first; none for a single session."""
    units: dict[str, list[Finding]] = {}
    for finding in findings:
        if unit := UNIT.match(finding.where):
            units.setdefault(unit[0], []).append(finding)
    ranked = sorted(units.items(), key=lambda item: -LEVELS.index(worst(item[1])))
    return [one_line(f"{unit}: {verdict_line(mine)}", LEVEL_STYLES[worst(mine)]) for unit, mine in ranked]


def verdict_line(findings: list[Finding]) -> Text:
    """How many of each level, and the worst in full."""
    counts = [(sum(finding.level == level for finding in findings), level) for level in reversed(LEVELS)]
    counted = ", ".join(f"{n} {level if n == 1 or level == 'ok' else level + 's'}" for n, level in counts if n)
    level = worst(findings)
    words = {
        "error": "FAIL: nothing can be fitted before this is mended",
        "warning": "Pass, with warnings: it costs accuracy",
        "note": "Pass",
        "ok": "Pass",
    }
    first = next((finding.line for finding in findings if finding.level == level), "")
    more = f": {first}" if level in ("error", "warning") else ""
    return one_line(f"{words[level]} ({counted or 'nothing was looked at'}){more}", LEVEL_STYLES[level])
