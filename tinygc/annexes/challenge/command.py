"""``challenge``: blind test of the tool."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tinygc.cli.arguments import count, folder_written, path_read
from tinygc.cli.results import output, write_json

SUMMARY = "examine explain on simulated sessions that hide something, blind"
USES_EFFECTS = True


#: default number of simulated sessions
CASES = 40


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    kind = command.add_mutually_exclusive_group()
    kind.add_argument(
        "--on", type=path_read, metavar="DIR", help="inject effects into this recording, and find from what size on each is detected"
    )
    kind.add_argument("--discover", action="store_true", help="examine the search for laws outside the catalogue, which the sessions hide")
    command.add_argument("--cases", type=count(1), metavar="N", help=f"sessions ({CASES}; with --on as many as it takes)")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="new folder for the truth and the answers (a temporary one)")
    command.add_argument("--keep", action="store_true", help="keep the sessions, too")


def run(args: argparse.Namespace) -> int:
    """Run the blind test on simulated sessions or on a recording."""
    import shutil
    import tempfile

    from tinygc.annexes.challenge.examination import without_sessions

    folder = args.out or Path(tempfile.mkdtemp(prefix="tinygc-challenge-"))
    try:
        tables, table = _examined(args, folder)
    except BaseException:
        if args.out is None:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    output(args).print(tables)
    if not args.keep:
        without_sessions(folder, everything=args.out is None)
    if args.keep or args.out:
        output(args).print(f"written: {folder}", soft_wrap=True)
    write_json(args.json, table)
    return 0


def _examined(args: argparse.Namespace, folder: Path) -> tuple[Any, dict]:
    """The printed output and the JSON."""
    from tinygc.annexes.challenge import examination, law_examination, recording_examination
    from tinygc.annexes.challenge.examination import challenge_tables
    from tinygc.annexes.challenge.law_examination import law_tables
    from tinygc.annexes.challenge.recording_examination import power_tables
    from tinygc.reporting.terminal import progress_bar

    announce = lambda text: output(args).print(text, soft_wrap=True)  # noqa: E731
    with progress_bar(args.quiet) as progress:
        if args.on is not None:
            told = recording_examination.examine_recording(args.on, folder, args.cases, args.seed, announce=announce, progress=progress)
            return power_tables(told), recording_examination.to_json(told)
        if args.discover:
            laws = law_examination.examine_laws(folder, args.cases or CASES, args.seed, announce=announce, progress=progress)
            return law_tables(laws), law_examination.to_json(laws)
        result = examination.examine(folder, args.cases or CASES, args.seed, announce=announce, progress=progress)
        return challenge_tables(result), examination.to_json(result)
