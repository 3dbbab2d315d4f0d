"""``apply``: write a log with calibrated rates and specific force."""

from __future__ import annotations

import argparse
from pathlib import Path

from session.base.options import log_written, path_read
from tinygc.cli.arguments import STANDARD, filled, is_standard_output
from tinygc.cli.results import beside_log, write_json

SUMMARY = "calibrate the rates and the specific force of a log"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("model", type=path_read, help="model file, or the folder of a session: the model that its fit recommends")
    command.add_argument(
        "log", type=path_read, help="a standard log, as in a session folder; -: standard input; of an array's model the array's folder"
    )
    command.add_argument(
        "-o", "--out", type=log_written, required=True, metavar="CSV", help="to write (.csv or .csv.gz); -: standard output"
    )
    command.add_argument("--unit", choices=("rps", "dps"), default="rps", help="of the rates (%(default)s: rad/s)")
    command.add_argument(
        "--session",
        type=path_read,
        metavar="DIR",
        help="where session.toml is (beside the log); its [accelerometer] then holds, not the model's",
    )
    command.add_argument("--which", type=filled, metavar="LOG", help="of an array's folder with several logs: log0002")


def run(args: argparse.Namespace) -> int:
    """Write a log with calibrated rates and specific force."""
    from session.base.errors import CalibrationError
    from tinygc.library.applied import apply
    from tinygc.reporting.terminal import progress_bar

    to_stdout = is_standard_output(args.out)
    if to_stdout and is_standard_output(args.json):
        raise CalibrationError("-o - and --json - both want standard output; give one of them a file")
    out = Path(STANDARD) if to_stdout else args.out
    if not to_stdout and out.is_file() and not args.force:
        raise CalibrationError(f"{args.out}: exists; give -o another file, or --force")
    try:
        with progress_bar(args.quiet) as progress:
            done = apply(args.model, args.log, out, unit=args.unit, session=args.session, which=args.which, progress=progress)
    except BrokenPipeError:  # whoever read the log has enough of it, and nothing else was asked for
        return 0
    beside_log(args, [done.line, *(f"  {note}" for note in done.notes)], to_stdout)
    write_json(args.json, done.to_json())
    return 0
