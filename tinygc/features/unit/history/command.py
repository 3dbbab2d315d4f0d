"""``history``: one unit over its sessions: scatter, drift, shocks, and when to calibrate next."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.options import argument, folder_written, option, values
from tinygc.cli.options import Command, Pictures, UsesEffects
from tinygc.cli.results import output, try_destinations, verdict, write_json
from tinygc.features.unit.options import HistoryOptions


@dataclass(frozen=True)
class Options(HistoryOptions, Pictures, Command, UsesEffects):
    """Options of ``history``."""

    sessions: tuple[Path, ...] = argument(
        "fitted session folders of a unit, folders that hold such, or a fleet's folder", metavar="DIR|FLEET"
    )
    compare: bool = option(False, "only whether the calibrations of these sessions agree in E, exit 1 if not (p < 0.01)")
    bias: bool = option(False, "with --compare: in B, too, of a sensor that was never switched off in between", rare=True)
    dates: Path | None = option(None, "a CSV of session,date, for sessions without a date", rare=True)
    all: bool = option(False, "show the accelerometer's numbers, and the values of each session")
    out: Path | None = option(None, "where history.json, history.html and history.svg go", metavar="DIR", read=folder_written)


def run(args: Options) -> int:
    """Estimate the history of each unit, print it, and write history.json, history.html and history.svg."""
    if args.bias and not args.compare:
        raise CalibrationError("--bias goes with --compare; add it, or leave --bias out")
    if args.compare:
        return _compare(args)
    from tinygc.features.unit.history.library import history
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out, args.json)
    with progress_bar(args.quiet) as progress:
        found = history(args.sessions, dates=args.dates, progress=progress, **values(args, HistoryOptions))
    output(args).print(found.screen(args.all))
    verdict(args, found.verdict_line)
    if args.out is not None:
        written = found.save(args.out, pictures=args.pictures)
        output(args).print(f"written: {', '.join(map(str, written))}")
    elif args.json is None:
        output(args).print(f"next: {'' if args.all else '--all shows every number; '}--out DIR keeps them, with pictures")
    write_json(args.json, found.to_json())
    return found.exit_code


def _compare(args: Options) -> int:
    """Compare the calibrations of several sessions."""
    args.refuse_with("--compare", "compare", "bias", "all")
    from tinygc.features.unit.history.comparison import compare, verdict_line

    found = compare(args.sessions, bias=args.bias)
    output(args).print(found.screen(args.all))
    verdict(args, verdict_line(found))
    write_json(args.json, found.to_json())
    return 0 if found.agree else 1
