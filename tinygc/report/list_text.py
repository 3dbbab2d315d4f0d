"""Sessions as a table in the terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from session.common.console import one_line
from session.common.texts import printable
from tinygc.fitting.listing import ListedSession

NONE = "–"
COLUMNS = ("session", "recorded", "sensor", "logs", "segments", "held out", "floor", "closure runs", "use", "explain")
NUMBERS = ("logs", "segments", "held out", "floor", "closure runs")


def sessions_table(folder: Path, sessions: list[ListedSession]) -> RenderableType:
    """A row each; what is wrong with one stands in its row."""
    if not sessions:
        return one_line(f"{folder}: no session here (folders with session.toml); calibrate.py record or replay makes one")
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in COLUMNS:
        table.add_column(column, justify="right" if column in NUMBERS else "left")
    table.caption, table.caption_justify = "closure in degrees: held-out tilt rms; RMSE of each closure run", "left"
    for each in sessions:
        name = each.folder.relative_to(folder) if each.folder != folder else each.folder
        sensor = (f"{each.units} × " if each.units else "") + " ".join(filter(None, (each.model, each.serial)))
        recorded = (each.date or NONE)[:16].replace("T", " ") + (" (file)" if each.date_from == "file" else "")
        logs = NONE if each.logs is None else f"{each.logs}" + (f" + {each.closures}" if each.closures else "")
        figures = [_figure(each.held_out_deg), _figure(each.floor_deg), ", ".join(map(_figure, each.runs_deg)) or NONE]
        said = Text(f"! {each.problem}", "red") if each.problem else Text((each.verdict or NONE).replace("_", " "))
        use = each.method or NONE
        table.add_row(printable(str(name)), recorded, printable(sensor) or NONE, logs, str(each.segments or NONE), *figures, use, said)
    return table


def _figure(value_deg: float | None) -> str:
    return NONE if value_deg is None else f"{value_deg:.4f}"
