"""``challenge``: blind test of the tool."""

from __future__ import annotations

import argparse

from session.base.options import path_read
from tinygc.cli.arguments import count
from tinygc.cli.results import output, try_json, write_json

SUMMARY = "examine explain on sessions that conceal one to three effects, blind"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    command.add_argument("--on", type=path_read, metavar="DIR", help="conceal them in copies of this recording, not in simulated sessions")
    command.add_argument("--cases", type=count(1), default=20, metavar="N", help="number of sessions (%(default)s)")


def run(args: argparse.Namespace) -> int:
    """Run the blind test and print its table."""
    from session.base.records import table_of
    from tinygc.features.challenge.examination import examine, page
    from tinygc.reporting.terminal import progress_bar

    try_json(args.json)
    with progress_bar(args.quiet) as progress:
        result = examine(args.cases, args.seed, args.on, progress=progress)
    output(args).print(page(result))
    write_json(args.json, table_of(result))
    return 0
