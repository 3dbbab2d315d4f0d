"""``budget``: the uncertainty of a calibration by source, of each parameter and of the attitude after a motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, folder_written, option, values
from tinygc.cli.options import Command
from tinygc.cli.results import output, try_destinations, write_json
from tinygc.estimation.options import FitOptions
from tinygc.features.unit.options import BudgetOptions


@dataclass(frozen=True)
class Options(BudgetOptions, FitOptions, Command):
    """Options of ``budget``."""

    folder: Path = argument("session folder; its least squares is fitted, as fit does")
    out: Path | None = option(None, "where budget.json and budget.html go", metavar="DIR", read=folder_written)
    methods: tuple[str, ...] = option(("least_squares",), "the fit whose budget it is", some=("least_squares",), cli=False)


def run(args: Options) -> int:
    """Fit the session, and print the budget of its quantities."""
    from tinygc.features.unit.budget.library import FILE, PAGE, budget
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out, args.json)
    with progress_bar(args.quiet) as progress:
        found = budget(args.folder, progress=progress, **values(args, BudgetOptions, FitOptions))
    output(args).print(found.page)
    if args.out is not None:
        found.save(args.out)
        output(args).print(f"written: {args.out / FILE}, {args.out / PAGE}")
    write_json(args.json, found.to_json())
    return 0
