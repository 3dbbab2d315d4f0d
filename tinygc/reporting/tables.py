"""Tables in the terminal: the first look, the list of sessions."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.names import CLOCKS
from session.base.texts import NONE, command_line, printable
from session.detect.findings import LEVELS, Finding, worst
from tinygc.reporting.terminal import Group, RenderableType, Table, Text, one_line, plain_table

if TYPE_CHECKING:
    from session.detect.repair import Repaired
    from tinygc.fitting.listing import ListedSession

# The first look in the terminal: the verdict, then what is not ok, the worst first, then the next step.

#: prefix of findings on the units of an array
UNIT = re.compile(r"unit [0-9]+(?=:|$)")
LEVEL_STYLES = {"ok": "green", "note": "cyan", "warning": "yellow", "error": "bold red"}


def findings_table(findings: list[Finding]) -> Table:
    """Table of findings, one row per check, the worst first; findings of one level keep the order of the checks."""
    table = plain_table("First look", "", "where", "what", "it says", "do")
    for finding in sorted(findings, key=lambda finding: -LEVELS.index(finding.level)):
        table.add_row(Text(finding.level, LEVEL_STYLES[finding.level]), finding.where, finding.what, finding.says, finding.do)
    return table


def finding_lines(findings: list[Finding]) -> Group:
    """What is not ok, the worst first: each finding, and below it what to do."""
    parts: list[RenderableType] = []
    for finding in sorted(findings, key=lambda finding: -LEVELS.index(finding.level)):
        if finding.level == "ok":
            continue
        says = f"{finding.where}: {finding.what}: {finding.says}"
        parts.append(Text.assemble((finding.level, LEVEL_STYLES[finding.level]), "  ", one_line(says)))
        if finding.do:
            parts.append(Text.assemble("    do: ", one_line(finding.do), style="dim"))
    return Group(*parts)


def next_line(folder: Path, findings: list[Finding]) -> Text:
    """Suggest the next step."""
    by_arrivals = f"--clock {CLOCKS[1]}"  # where it was taken, or is advised
    again = by_arrivals.split() if not unit_lines(findings) and any(by_arrivals in finding.line for finding in findings) else []
    if worst(findings) == "error":
        from session.detect.repair import can_be_repaired  # late: only errors are repaired

        repaired = command_line("check", folder, "--repair", "OUT")
        by_itself = Text("next: the cause of an error is known; a corrected copy is written by\n").append(one_line(f"  {repaired}"))
        if can_be_repaired(findings) and not unit_lines(findings):
            return by_itself
        return Text("next: correct the errors, then\n").append(one_line(f"  {command_line('check', folder, *again)}"))
    return Text("next:\n").append(one_line(f"  {command_line('fit', folder, *again)}"))


def repair_report(done: Repaired, before: dict[str, Any], after: dict[str, Any]) -> Group:
    """What was corrected in a copy of a session, and what the recording closes to before and after."""
    from tinygc.estimation.options import METHODS

    parts: list[RenderableType] = []
    for change in done.changes:
        said = ", ".join([*change.files, *(f"sensor.{key} = {value:g}" for key, value in change.cause.settings)])
        parts.append(one_line(f"corrected: {change.cause.says} ({said})"))
    table = plain_table("Closure of the recording itself, degrees", "", "before", "after", right=True)

    def row(title: str, values: list[str]) -> None:
        table.add_row(title, *values)

    both = (before, after)
    runs = [{run["file"]: run["rmse_deg"] for run in each["runs"]} for each in both]
    row("turns that can be used", [NONE if each["why"] else str(each["turns"]) for each in both])
    for name in ("raw_bias_removed", "least_squares"):
        row(f"{METHODS[name].title}, tilt held out", [degrees_text((each["holdout_tilt_rms_deg"] or {}).get(name)) for each in both])
    for file in runs[1] or runs[0]:
        for name in ("raw_bias_removed", "least_squares"):
            row(f"{file}, {METHODS[name].title}, RMSE", [degrees_text(each.get(file, {}).get(name)) for each in runs])
    row("least squares multiplies the rates by", [" ".join(f"{value:.3f}" for value in each["scale"] or ()) or NONE for each in both])
    parts.append(table)
    parts += [one_line(f"{when}: {each['why']}") for when, each in zip(("before", "after"), both, strict=True) if each["why"]]
    folder = done.folder
    parts += [one_line(f"written: {folder} (repaired.json says from which files)"), verdict_line(list(done.findings))]
    return Group(*parts, next_line(folder, list(done.findings)))


def unit_lines(findings: list[Finding]) -> list[Text]:
    """Verdict for each unit of an array, the worst first; an empty list for a single session."""
    units: dict[str, list[Finding]] = {}
    for finding in findings:
        if unit := UNIT.match(finding.where):
            units.setdefault(unit[0], []).append(finding)
    ranked = sorted(units.items(), key=lambda item: -LEVELS.index(worst(item[1])))
    return [one_line(f"{unit}: {verdict_line(mine)}", LEVEL_STYLES[worst(mine)]) for unit, mine in ranked]


def verdict_line(findings: list[Finding], with_worst: bool = True) -> Text:
    """Whether it can be fitted, the count of findings by level, and the worst in full, unless it stands below.  Whether the calibration
    passes is for ``fit`` to say."""
    counts = [(sum(finding.level == level for finding in findings), level) for level in reversed(LEVELS)]
    counted = ", ".join(f"{n} {level if n == 1 or level == 'ok' else level + 's'}" for n, level in counts if n)
    level = worst(findings)
    words = {
        "error": "FAIL: fix these errors before fitting",
        "warning": "READY, with warnings: it costs accuracy",
        "note": "READY",
        "ok": "READY",
    }
    first = next((finding.line for finding in findings if finding.level == level), "")
    more = f": {first}" if level in ("error", "warning") and with_worst else ""
    return one_line(f"{words[level]} ({counted or 'nothing was looked at'}){more}", LEVEL_STYLES[level])


# List of sessions in the terminal.

COLUMNS = ("session", "recorded", "sensor", "logs", "segments", "held out", "floor", "closure runs", "use", "explain")
NUMBERS = ("logs", "segments", "held out", "floor", "closure runs")


def sessions_table(folder: Path, sessions: list[ListedSession]) -> RenderableType:
    """Table of sessions, one row each; the row of an unreadable session states the error."""
    if not sessions:
        return one_line(f"{folder}: no session here (folders with session.toml); {command_line('record')} or import makes one")
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in COLUMNS:
        table.add_column(column, justify="right" if column in NUMBERS else "left")
    table.caption, table.caption_justify = "closure in degrees: held-out tilt rms; RMSE of each closure run", "left"
    for each in sessions:
        name = each.folder.relative_to(folder) if each.folder != folder else each.folder
        sensor = (f"{each.units} × " if each.units else "") + " ".join(filter(None, (each.model, each.serial)))
        recorded = (each.date or NONE)[:16].replace("T", " ") + (" (file)" if each.date_from == "file" else "")
        logs = NONE if each.logs is None else f"{each.logs}" + (f" + {each.closures}" if each.closures else "")
        figures = [degrees_text(each.held_out_deg), degrees_text(each.floor_deg), ", ".join(map(degrees_text, each.runs_deg)) or NONE]
        said = Text(f"! {each.problem}", "red") if each.problem else Text((each.verdict or NONE).replace("_", " "))
        use = each.method or NONE
        table.add_row(printable(str(name)), recorded, printable(sensor) or NONE, logs, str(each.segments or NONE), *figures, use, said)
    return table


def degrees_text(value_deg: float | None) -> str:
    """Angle in degrees to four decimals; a dash where there is none."""
    return NONE if value_deg is None else f"{value_deg:.4f}"


def outcomes_table(title: str, rows: list[tuple[str, str, str, str, str]]) -> Table:
    """Result of one command for several folders: folder, held out, floor, closure runs, statement; all text."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in ("", "held out", "floor", "closure runs", "it says"):
        table.add_column(column, justify="left" if column in ("", "it says") else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(printable, row))
    return table
