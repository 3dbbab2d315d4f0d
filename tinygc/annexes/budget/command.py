"""``budget``: the uncertainty of a calibration by source, of each parameter and of the attitude after a motion."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import path_read, positive
from tinygc.cli.options import add_fit_arguments, fit_options
from tinygc.cli.results import output, try_json, write_json

SUMMARY = "the uncertainty by source: of each parameter, and of the attitude after a motion"
USES_EFFECTS = False


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder; its least squares is fitted, as fit does")
    of = "print the whole table of one quantity: bias_x, scale_factor_error_y, E_xy, attitude_total; may be repeated"
    command.add_argument("--of", action="append", default=[], metavar="NAME", help=of)
    use = command.add_argument_group("the use whose attitude error is asked for")
    motion = "rest, a session folder, or a log: the motion of the use (the session's own beginning)"
    use.add_argument("--motion", metavar="rest|DIR|LOG", help=motion)
    use.add_argument("--seconds", type=positive, default=60.0, metavar="S", help="how long (%(default)g s)")
    elapsed = "the use is so long after the session and the sensor was not switched off since; else it is another switch-on"
    use.add_argument("--elapsed", type=positive, metavar="S", help=elapsed)
    use.add_argument("--warmer", type=float, metavar="K", help="how much warmer the sensor is in use than in the session")
    add_fit_arguments(command)
    command.set_defaults(methods=["least_squares"])


def run(args: argparse.Namespace) -> int:
    """Fit the session, and print the budget of what is asked for."""
    from tinygc.annexes.budget.library import budget_of_folder
    from tinygc.annexes.budget.use import Use
    from tinygc.reporting.terminal import progress_bar

    try_json(args.json)
    use = Use(args.motion, args.seconds, args.elapsed, args.warmer)
    with progress_bar(args.quiet) as progress:
        found = budget_of_folder(args.folder, fit_options(args), use, tuple(args.of), progress)
    output(args).print(found.page)
    write_json(args.json, found.to_json())
    return 0
