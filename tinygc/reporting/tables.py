"""Tables in the terminal: the first look, the list of sessions."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base import features
from session.base.names import CLOCKS
from session.base.texts import NONE, command_line
from session.detect.findings import LEVELS, Finding, worst
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.terminal import Group, RenderableType, Text, one_line

if TYPE_CHECKING:
    from session.detect.repair import Repaired
    from tinygc.fitting.listing import ListedSession

# The first look in the terminal: the verdict, then what is not ok, the worst first, then the next step.

#: prefix of findings on the units of an array
UNIT = re.compile(r"unit [0-9]+(?=:|$)")
LEVEL_STYLES = {"ok": "green", "note": "cyan", "warning": "yellow", "error": "bold red"}


def finding_lines(findings: list[Finding], everything: bool = False) -> Group:
    """Each finding that is not ok, or every one, the worst first, those of one level in their order; below it what to do."""
    parts: list[RenderableType] = []
    for finding in sorted(findings, key=lambda finding: -LEVELS.index(finding.level)):
        if finding.level == "ok" and not everything:
            continue
        text = f"{finding.where}: {finding.what}: {finding.description}"
        parts.append(Text.assemble((finding.level, LEVEL_STYLES[finding.level]), "  ", one_line(text)))
        if finding.do:
            parts.append(Text.assemble("    do: ", one_line(finding.do), style="dim"))
    return Group(*parts)


def next_line(folder: Path, findings: list[Finding]) -> Text:
    """Suggest the next step."""
    by_arrivals = f"--clock {CLOCKS[1]}"  # where it was taken, or is advised
    again = by_arrivals.split() if not unit_lines(findings) and any(by_arrivals in finding.line for finding in findings) else []
    if worst(findings) != "error":
        of_rests = "noise"  # of a feature
        turned = any(folder.glob("log*.csv*")) or not any(folder.glob("rest*.csv*")) or of_rests not in features.names("commands")
        return one_line(f"next: {command_line('fit', folder, *again) if turned else command_line(of_rests, folder)}")
    from session.detect.repair import can_be_repaired  # late: only errors are repaired

    if can_be_repaired(findings) and not unit_lines(findings):
        return one_line(f"next: {command_line('check', folder, '--repair', 'OUT')} writes a corrected copy")
    return one_line(f"next: correct the errors, then {command_line('check', folder, *again)}")


def repair_report(done: Repaired, before: dict[str, Any], after: dict[str, Any]) -> Group:
    """What was corrected in a copy of a session, and what the recording closes to before and after."""
    from tinygc.estimation.options import METHODS

    parts: list[Part] = []
    for change in done.changes:
        changed = ", ".join([*change.files, *(f"sensor.{key} = {value:g}" for key, value in change.cause.settings)])
        parts.append(one_line(f"corrected: {change.cause.description} ({changed})"))
    both = (before, after)
    runs = [{run["file"]: run["rmse_deg"] for run in each["runs"]} for each in both]
    rows = [["turns that can be used", *(None if each["why"] else each["turns"] for each in both)]]
    for name in ("raw_bias_removed", "least_squares"):
        held_out = (degrees_text((each["holdout_tilt_rms_deg"] or {}).get(name)) for each in both)
        rows.append([f"{METHODS[name].title}, tilt held out", *held_out])
    for file in runs[1] or runs[0]:
        for name in ("raw_bias_removed", "least_squares"):
            rows.append([f"{file}, {METHODS[name].title}, RMSE", *(degrees_text(each.get(file, {}).get(name)) for each in runs)])
    scales = (" ".join(f"{value:.3f}" for value in each["scale"] or ()) or None for each in both)
    rows.append(["least squares multiplies the rates by", *scales])
    parts.append(Table("Closure of the recording itself, degrees", ("", "before", "after"), rows))
    parts += [one_line(f"{when}: {each['why']}") for when, each in zip(("before", "after"), both, strict=True) if each["why"]]
    folder = done.folder
    parts.append(one_line(f"written: {folder} (repaired.json names the files)"))
    return screen([verdict_line(list(done.findings)), *parts, next_line(folder, list(done.findings))])


def unit_lines(findings: list[Finding]) -> list[Text]:
    """Verdict for each unit of an array, the worst first; an empty list for a single session."""
    units: dict[str, list[Finding]] = {}
    for finding in findings:
        if unit := UNIT.match(finding.where):
            units.setdefault(unit[0], []).append(finding)
    ranked = sorted(units.items(), key=lambda item: -LEVELS.index(worst(item[1])))
    return [one_line(f"{unit}: {verdict_line(mine)}", LEVEL_STYLES[worst(mine)]) for unit, mine in ranked]


def verdict_line(findings: list[Finding], with_worst: bool = True) -> Text:
    """Whether it can be fitted, the count of findings by level, and the worst in full, unless it stands below."""
    counts = [(sum(finding.level == level for finding in findings), level) for level in reversed(LEVELS)]
    counted = ", ".join(f"{n} {level if n == 1 or level == 'ok' else level + 's'}" for n, level in counts if n)
    level = worst(findings)
    number = sum(finding.level == level for finding in findings)
    words = {
        "error": f"FAIL: fix {number} error{'s' * (number > 1)} before fitting",
        "warning": f"READY, but {number} warning{'s cost' if number > 1 else ' costs'} accuracy",
        "note": "READY",
        "ok": "READY",
    }
    first = next((finding.line for finding in findings if finding.level == level), "")
    more = f": {first}" if level in ("error", "warning") and with_worst else ""
    return one_line(f"{words[level]} ({counted or 'nothing was checked'}){more}", LEVEL_STYLES[level])


# List of sessions in the terminal.

COLUMNS = ("session", "recorded", "sensor", "logs", "segments", "held out", "floor", "closure runs", "use", "explain")


def sessions_table(folder: Path, sessions: list[ListedSession]) -> list[Part]:
    """How many sessions there are, their table, one row each, and the errors of those that cannot be read."""
    if not sessions:
        return [f"{folder}: no session here (folders with session.toml); {command_line('record')} or import makes one"]
    rows = []
    for each in sessions:
        name = each.folder.relative_to(folder) if each.folder != folder else each.folder
        sensor = (f"{each.units} × " if each.units else "") + " ".join(filter(None, (each.model, each.serial)))
        recorded = (each.date or NONE)[:16].replace("T", " ") + (" (file)" if each.date_from == "file" else "")
        logs = None if each.logs is None else f"{each.logs}" + (f" + {each.closures}" if each.closures else "")
        figures = [degrees_text(each.held_out_deg), degrees_text(each.floor_deg), ", ".join(map(degrees_text, each.runs_deg)) or None]
        answer = Text("cannot be read", "red") if each.problem else each.verdict and each.verdict.replace("_", " ")
        rows.append([name, recorded, sensor or None, logs, each.segments or None, *figures, each.method, answer])
    problems = [one_line(f"{each.folder}: {each.problem}", "red") for each in sessions if each.problem]
    fitted, unread = sum(each.held_out_deg is not None for each in sessions), len(problems)
    counted = f"{len(sessions)} session{'s' * (len(sessions) > 1)}, {fitted} fitted" + (f", {unread} cannot be read" if unread else "")
    caption = "closure in degrees: held-out tilt rms; RMSE of each closure run"
    return [counted, Table("", COLUMNS, rows, caption, (0, 1, 2, 8, 9), minor=(2, 3, 4, 6, 7, 8)), *problems]


def degrees_text(value_deg: float | None) -> str:
    """Angle in degrees to four decimals; a dash where there is none."""
    return NONE if value_deg is None else f"{value_deg:.4f}"


def outcomes_table(rows: list[tuple[str, str, str, str, str]]) -> Table:
    """Result of one command for several folders: folder, held out, floor, closure runs, statement; all text."""
    caption = "degrees: held-out tilt rms, that of noise alone, RMSE of each closure run"
    return Table("", ("", "held out", "floor", "closure runs", "result"), rows, caption, left=(0, 4), minor=(2, 3))
