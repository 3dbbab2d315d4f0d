"""Several session folders for one command: each is done by itself, one that fails does not stop the others, and a table ends it all."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from session.common.errors import CalibrationError
from session.common.texts import printable
from tinygc.cli.commands._results import complain, write_json


@dataclass(frozen=True)
class Done:
    """code: for the exit; table: the command's JSON; says: its verdict in a few words; held_out, floor, runs: of the calibration that it
    is about, degrees, None and none where there is no such figure."""

    code: int
    table: dict
    says: str = ""
    held_out_deg: float | None = None
    floor_deg: float | None = None
    runs_deg: tuple[float, ...] = ()


def folders_of(args: argparse.Namespace) -> list[Path]:
    """Each once, in the order of the command line."""
    return list(dict.fromkeys([args.folder, *args.more]))


def run_each(args: argparse.Namespace, one: Callable[[argparse.Namespace], Done], schema: str, title: str) -> int:
    """``one`` for each folder, with ``--out DIR`` as DIR/NAME; the exit code is the worst of them.

    CalibrationError, before any work, where two results would have one place.
    """
    folders, entries, rows, worst = folders_of(args), [], [], 0
    places = _places(args, folders)
    for folder in folders:
        each = argparse.Namespace(**{**vars(args), "folder": folder, "more": [], "out": places.get(folder), "of_several": True})
        try:
            done = one(each)
        except (CalibrationError, OSError) as error:
            said = str(error) if isinstance(error, CalibrationError) else f"{error.filename or folder}: {error.strerror or error}"
            code = error.exit_code if isinstance(error, CalibrationError) else 2
            complain(said if str(folder) in said else f"{folder}: {said}")
            entries.append({"folder": str(folder), "exit_code": code, "error": printable(said), "result": None})
            rows.append((str(folder), "–", "–", "–", "FAILED: as said above"))
        else:
            code = done.code
            entries.append({"folder": str(folder), "exit_code": code, "error": None, "result": done.table})
            runs = ", ".join(f"{run:.4f}" for run in done.runs_deg)
            rows.append((str(folder), _figure(done.held_out_deg), _figure(done.floor_deg), runs or "–", done.says))
        worst = max(worst, code)
    _print(args, title, rows)
    write_json(args.json, {"schema": schema, "sessions": entries})
    return worst


def _places(args: argparse.Namespace, folders: list[Path]) -> dict[Path, Path]:
    if args.out is None:
        return {}
    places = {folder: args.out / folder.resolve().name for folder in folders}
    taken: dict[Path, Path] = {}
    for folder, place in places.items():
        if place in taken:
            raise CalibrationError(f"--out {args.out}: {taken[place]} and {folder} would both go to {place}; rename one, or run them apart")
        taken[place] = folder
    return places


def _figure(value_deg: float | None) -> str:
    return "–" if value_deg is None else f"{value_deg:.4f}"


def _print(args: argparse.Namespace, title: str, rows: list[tuple[str, str, str, str, str]]) -> None:
    from rich.table import Table

    from tinygc.cli import console
    from tinygc.cli.paths import is_standard_output

    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in ("", "held out", "floor", "closure runs", "it says"):
        table.add_column(column, justify="left" if column in ("", "it says") else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(printable, row))
    console.output(is_standard_output(args.json)).print(table)  # the verdict, with --quiet too
