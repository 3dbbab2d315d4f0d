"""``verify``: whether a stored calibration still holds, by a short session, with turns or a minute at rest."""

from __future__ import annotations

import argparse

from session.base.options import file_written, path_read
from tinygc.cli.arguments import seconds
from tinygc.cli.results import output, try_file, try_json, verdict, write_json

USES_EFFECTS = True
SUMMARY = "say whether a calibration still holds by a short recording of today, and if not, why, what it costs, and what to do"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    command.add_argument("model", type=path_read, metavar="MODEL", help="a model file, or a fitted session folder")
    command.add_argument("today", type=path_read, metavar="TODAY", help="a session folder: turns and rests, or a minute at rest")
    what = "write the model with B taken anew from today's recording"
    command.add_argument("--write", type=file_written, metavar="FILE", help=what)
    what = "probability of any false alarm, over all questions (%(default)s)"
    command.add_argument("--false-alarm", type=_probability, default=0.05, metavar="P", help=what)
    what = "degrees that a minute of use may miss before a change matters (%(default)s)"
    command.add_argument("--limit", type=_degrees, default=1.0, metavar="DEG", help=what)
    spread = command.add_argument_group("what may have changed without a fault")
    what = "another fitted session of this unit; two or more show how it moves between sessions"
    spread.add_argument("--history", type=path_read, action="append", default=[], metavar="DIR", help=what)
    spread.add_argument("--lot", type=path_read, metavar="FILE", help="a production lot (lot.json) that shows it")
    spread.add_argument("--same-power-on", action="store_true", help="the sensor was not switched off since the calibration")
    spread.add_argument("--elapsed", type=seconds, metavar="S", help="how long ago that was; a day where it is not given")
    spread.add_argument("--noise", type=path_read, metavar="FILE", help="noise figures of the unit (noise.json): its drift in that time")
    command.add_argument("--other-serial", action="store_true", help="go on with a recording of another serial number")
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")


def run(args: argparse.Namespace) -> int:
    """Verify a calibration, print the verdict, and return its exit code."""
    from tinygc.features.unit.verification.library import verify_of
    from tinygc.features.unit.verification.verdict import Options
    from tinygc.reporting.terminal import progress_bar

    if args.write is not None:
        try_file(args.write, args.json)
    try_json(args.json)
    options = Options(
        false_alarm=args.false_alarm,
        limit_deg=args.limit,
        history=tuple(args.history),
        lot=args.lot,
        switched_on=not args.same_power_on,
        elapsed_s=args.elapsed,
        noise=args.noise,
        other_serial=args.other_serial,
        earth=not args.no_earth,
    )
    with progress_bar(args.quiet) as progress:
        found = verify_of(args.model, args.today, options, progress)
    output(args).print(found.page)
    verdict(args, found.verdict_line)
    if args.write is not None:
        found.save_model(args.write)
        output(args).print(f"written: {args.write}", soft_wrap=True, markup=False)
    write_json(args.json, found.to_json())
    return found.exit_code


def _probability(text: str) -> float:
    value = float(text)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{text} is no probability between 0 and 1")
    return value


def _degrees(text: str) -> float:
    value = float(text)
    if not 0 < value < 180:
        raise argparse.ArgumentTypeError(f"{text} is no angle between 0 and 180 degrees")
    return value


_probability.__name__ = _degrees.__name__ = "number"
