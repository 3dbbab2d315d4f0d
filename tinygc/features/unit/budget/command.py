"""``budget``: the uncertainty of a calibration by source, of each parameter and of the attitude after a motion."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import count, filled, folder_written, path_read, positive, within
from tinygc.cli.options import add_fit_arguments, fit_options
from tinygc.cli.results import output, try_destinations, try_json, write_json

SUMMARY = "the uncertainty by source: of each parameter, and of the attitude after a motion"
#: exit code by what the draws say
EXIT = {"agrees": 0, "differs": 1, "undecided": 5}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder; its least squares is fitted, as fit does")
    of = "print the whole table of one quantity: bias_x, scale_factor_error_y, E_xy, attitude_total; may be repeated"
    command.add_argument("--of", type=filled, action="append", default=[], metavar="NAME", help=of)
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where budget.json and budget.html go")
    use = command.add_argument_group("the use whose attitude error is asked for")
    motion = "rest, a session folder, or a log: the motion of the use (the session's own beginning)"
    use.add_argument("--motion", type=path_read, metavar="rest|DIR|LOG", help=motion)
    use.add_argument("--seconds", type=positive, default=60.0, metavar="S", help="how long (%(default)g s)")
    elapsed = "the use is so long after the session and the sensor was not switched off since; else it is another switch-on"
    use.add_argument("--elapsed", type=positive, metavar="S", help=elapsed)
    use.add_argument(
        "--warmer", type=within(-200, 200, "difference", "K"), metavar="K", help="how much warmer the sensor is in use than in the session"
    )
    check = command.add_argument_group("a check by Monte Carlo (JCGM 101)")
    draws = "draw all errors anew, at most so often, fit each time, and compare; exit 1 if they differ, 5 if so few do not decide"
    check.add_argument("--monte-carlo", type=count(1), default=0, metavar="N", help=draws)
    add_fit_arguments(command, trained=False)
    command.set_defaults(methods=["least_squares"])


def run(args: argparse.Namespace) -> int:
    """Fit the session, and print the budget of what is asked for."""
    from tinygc.features.unit.budget.library import FILE, PAGE, budget_of_folder
    from tinygc.features.unit.budget.use import Use
    from tinygc.reporting.terminal import progress_bar

    if args.out is not None:
        try_destinations(argparse.Namespace(out=args.out, json=args.json), "budget")
    else:
        try_json(args.json)
    use = Use(args.motion, args.seconds, args.elapsed, args.warmer)
    with progress_bar(args.quiet) as progress:
        found = budget_of_folder(args.folder, fit_options(args), use, tuple(args.of), progress, args.monte_carlo, args.seed)
    output(args).print(found.page)
    if args.out is not None:
        found.save(args.out)
        output(args).print(f"written: {args.out / FILE}, {args.out / PAGE}", soft_wrap=True, markup=False)
    write_json(args.json, found.to_json())
    return 0 if found.drawn is None else EXIT[found.drawn.answer]
