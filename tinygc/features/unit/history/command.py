"""``history``: one unit over its sessions: scatter, drift, shocks, and when to calibrate next."""

from __future__ import annotations

import argparse

from session.base.options import folder_written, path_read
from tinygc.cli.results import output, try_destinations, verdict, write_json

SUMMARY = "one unit over its sessions: scatter between switch-ons, drift a year, shocks, when to calibrate next"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    what = "fitted session folders of a unit, folders that hold such, or a fleet's folder"
    command.add_argument("sessions", type=path_read, nargs="+", metavar="DIR|FLEET", help=what)
    command.add_argument("--serial", default="", metavar="TEXT", help="only this unit, where there are several")
    what = "a CSV of session,date, for sessions that do not say their date"
    command.add_argument("--dates", type=path_read, metavar="FILE", help=what)
    command.add_argument(
        "--accuracy", default="", metavar="DEG/S", help="until when the attitude after this time at rest is within this: 1deg/60s"
    )
    what = "until when each of these numbers is within a limit of the last calibration: 'bias 50 mdps'; may be repeated"
    command.add_argument("--require", action="append", default=[], metavar="LIMIT", help=what)
    command.add_argument("--today", type=_day, metavar="DATE", help="the day to answer for (today)")
    command.add_argument("--all", action="store_true", help="show the accelerometer's numbers, and the values of each session")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where history.json, history.html and history.png go")
    command.add_argument("--no-pictures", action="store_true", help="write no picture")


def run(args: argparse.Namespace) -> int:
    """Estimate the history of each unit, print it, and write history.json, history.html and history.png."""
    from tinygc.features.unit.history.library import history_of_paths, read_dates, requirements_of
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out, args.json)
    requirements = requirements_of(args.accuracy, args.require)
    dates = {} if args.dates is None else read_dates(args.dates)
    with progress_bar(args.quiet) as progress:
        found = history_of_paths(args.sessions, dates, requirements, args.serial, args.today, progress)
    output(args).print(found.screen(args.all))
    verdict(args, found.verdict_line)
    if args.out is not None:
        written = found.save(args.out, pictures=not args.no_pictures)
        output(args).print(f"written: {', '.join(map(str, written))}", soft_wrap=True, markup=False)
    elif args.json is None:
        output(args).print("nothing is written; --out DIR keeps history.json, history.html and history.png", soft_wrap=True)
    write_json(args.json, found.to_json())
    return found.exit_code


def _day(text: str) -> object:
    from datetime import UTC, datetime

    found = datetime.fromisoformat(text)
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found


_day.__name__ = "date"
