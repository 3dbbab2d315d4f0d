"""``list``: the sessions of a folder, and what was last said of each."""

from __future__ import annotations

import argparse
from pathlib import Path

from session.common.errors import CalibrationError
from tinygc.cli.commands._results import output, write_json
from tinygc.cli.paths import path_read

SUMMARY = "list the sessions of a folder: date, sensor, closure, verdict"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("folder", type=path_read, nargs="?", default=Path("."), help="where to look, three folders deep (this one)")


def run(args: argparse.Namespace) -> int:
    """The sessions of a folder; one that cannot be read is listed with the reason."""
    from tinygc.fitting.listing import list_sessions
    from tinygc.report.list_text import sessions_table

    if not args.folder.is_dir():
        raise CalibrationError(f"{args.folder}: no folder; give one with session folders in it")
    sessions = list_sessions(args.folder)
    output(args).print(sessions_table(args.folder, sessions))
    write_json(args.json, {"schema": "tinygc-list/1", "sessions": [session.to_json() for session in sessions]})
    return 0
