"""``apply``: write a log with calibrated rates and specific force."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, log_written, option
from tinygc.cli.arguments import STANDARD, is_standard_output
from tinygc.cli.logs import log_of
from tinygc.cli.options import Command, Force, UsesEffects
from tinygc.cli.results import print_with_log, write_json
from tinygc.deploy import LogSession


@dataclass(frozen=True)
class Options(LogSession, Command, UsesEffects, Force):
    """Options of ``apply``."""

    model: Path = argument("model file, or the folder of a session: the model that its fit recommends")
    log: Path = argument("log, or session folder with one; -: standard input")
    more: tuple[Path, ...] = argument("the accelerometer's log", ())
    out: Path = option(..., "to write (.csv or .csv.gz); -: standard output", metavar="CSV", flags=("-o", "--out"), read=log_written)
    unit: str = option("rps", "of the rates; rps: rad/s", choices=("rps", "dps"))


def run(args: Options) -> int:
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
    log, read_as = log_of((args.log, *args.more), args.quiet)
    try:
        with progress_bar(args.quiet) as progress:
            done = apply(args.model, log, out, unit=args.unit, session=args.session, progress=progress, **args.further)
    except BrokenPipeError:  # the reader of the log has enough of it, and nothing else was requested
        return 0
    print_with_log(args, [done.line, *(f"  {note}" for note in (*done.notes, *filter(None, [read_as])))], to_stdout)
    write_json(args.json, done.to_json())
    return 0
