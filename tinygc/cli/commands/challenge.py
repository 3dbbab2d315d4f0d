"""``challenge``: the tool's own blind examination."""

from __future__ import annotations

import argparse
from pathlib import Path

from tinygc.cli.arguments import count
from tinygc.cli.commands._results import output, write_json

SUMMARY = "examine explain on simulated sessions that hide something, blind"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("--cases", type=count(1), default=40, metavar="N", help="sessions (%(default)s)")
    command.add_argument("--out", type=Path, metavar="DIR", help="new folder for the truth and what was said (a temporary one)")
    command.add_argument("--keep", action="store_true", help="keep the sessions, too")


def run(args: argparse.Namespace) -> int:
    """The tool's own blind examination."""
    import tempfile

    from tinygc.challenge.examine import examine, to_json, without_sessions
    from tinygc.challenge.table import challenge_tables
    from tinygc.cli.console import progress_bar

    folder = args.out or Path(tempfile.mkdtemp(prefix="tinygc-challenge-"))
    with progress_bar(args.quiet) as progress:
        announce = lambda text: output(args).print(text, soft_wrap=True)  # noqa: E731
        result = examine(folder, args.cases, args.seed, announce=announce, progress=progress)
    output(args).print(challenge_tables(result))
    if not args.keep:
        without_sessions(folder, everything=args.out is None)
    if args.keep or args.out:
        output(args).print(f"written: {folder}", soft_wrap=True)
    write_json(args.json, to_json(result))
    return 0
