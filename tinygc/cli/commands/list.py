"""``list``: list the sessions of a folder, with the last result of each."""

from __future__ import annotations

import argparse
from pathlib import Path

from session.base.options import path_read
from session.base.records import plain
from tinygc.cli.results import output, write_json

SUMMARY = "list the sessions of a folder: date, sensor, closure, verdict"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, nargs="?", default=Path("."), help="where to look, three folders deep (this one)")


def run(args: argparse.Namespace) -> int:
    """List the sessions of a folder; one that cannot be read is listed with the reason."""
    from tinygc.library.known import list_sessions
    from tinygc.reporting.tables import sessions_table

    sessions = list_sessions(args.folder)
    output(args).print(sessions_table(args.folder, sessions))
    write_json(args.json, {"schema": "tinygc-list/1", "sessions": plain(sessions)})
    return 0
