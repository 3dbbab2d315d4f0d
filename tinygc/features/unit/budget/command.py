"""``budget``: the uncertainty of a calibration by source, of each parameter and of the attitude after a motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, folder_written, option, part
from tinygc.cli.options import LARGEST_SEED, Command
from tinygc.cli.results import output, try_destinations, write_json
from tinygc.estimation.options import FitOptions
from tinygc.features.unit.budget.options import Use

SUMMARY = "the uncertainty by source: of each parameter, and of the attitude after a motion"
#: exit code by what the draws say
EXIT = {"agrees": 0, "differs": 1, "undecided": 5}


@dataclass(frozen=True)
class Options(Use, FitOptions, Command):
    """Options of ``budget``."""

    folder: Path = argument("session folder; its least squares is fitted, as fit does")
    of: tuple[str, ...] = option(
        (),
        "print the whole table of one quantity: bias_x, scale_factor_error_y, E_xy, attitude_total; may be repeated",
        metavar="NAME",
        read=str,
        repeated=True,
    )
    out: Path | None = option(None, "where budget.json and budget.html go", metavar="DIR", read=folder_written)
    monte_carlo: int = option(
        0,
        "draw all errors anew, at most so often, fit each time, and compare (JCGM 101); exit 1 if they differ, 5 if so few do not decide",
        least=0,
    )
    methods: tuple[str, ...] = option(("least_squares",), "the fit whose budget it is", some=("least_squares",), cli=False)
    seed: int = option(0, "of the draws", least=0, most=LARGEST_SEED)


def run(args: Options) -> int:
    """Fit the session, and print the budget of what is asked for."""
    from tinygc.features.unit.budget.library import FILE, PAGE, budget_of_folder
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out, args.json)
    with progress_bar(args.quiet) as progress:
        found = budget_of_folder(args.folder, part(args, FitOptions), part(args, Use), args.of, progress, args.monte_carlo, args.seed)
    output(args).print(found.page)
    if args.out is not None:
        found.save(args.out)
        output(args).print(f"written: {args.out / FILE}, {args.out / PAGE}", soft_wrap=True, markup=False)
    write_json(args.json, found.to_json())
    return 0 if found.drawn is None else EXIT[found.drawn.answer]
