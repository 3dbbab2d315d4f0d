"""``plan``: recommend what to record next."""

from __future__ import annotations

import argparse

from session.base.options import path_read
from tinygc.cli.arguments import count
from tinygc.cli.results import output, write_json

SUMMARY = "say which movements to record next"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder")
    command.add_argument("--count", type=count(1), default=5, help="movements at most (%(default)s)")


def run(args: argparse.Namespace) -> int:
    """Recommend what to record next."""
    from tinygc.library.sessions import plan

    found = plan(args.folder, count=args.count)
    for line in found.lines:
        output(args).print(line)
    write_json(args.json, found.to_json())
    return 0
