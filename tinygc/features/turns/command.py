"""``fit`` of a folder whose reference is turns of known angle, of a gyroscope alone."""

from __future__ import annotations

from typing import Any

from session.base.errors import CalibrationError
from session.base.options import given, part
from tinygc.cli.results import Done, inside, output, try_destinations
from tinygc.estimation.options import FitOptions
from tinygc.features.turns.names import is_gyroscope_alone


def fit(args: Any) -> Done | None:
    """Fit scale and bias by the known turns; None of a folder whose reference is another."""
    if not is_gyroscope_alone(args.folder):
        return None
    from tinygc.features.turns.library import fit_turns
    from tinygc.features.turns.output import MODEL
    from tinygc.reporting.terminal import progress_bar

    more = ["--strict"] if args.strict else []
    limit = ["--limit"] if args.limit is not None and args.defaults is None else []
    if idle := [*given(part(args, FitOptions)), *limit, *more]:
        raise CalibrationError(
            f"{', '.join(idle)}: of no use for a gyroscope alone, which has no closure; leave {'it' if len(idle) == 1 else 'them'} out"
        )
    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        result = fit_turns(args.folder, progress=progress)
    folder = result.save(args.out)
    output(args).print(result.page)
    output(args).print(f"model: {folder / MODEL}", soft_wrap=True)
    used = int(result.estimate.used.sum())
    return Done(0, result.to_json(), f"a gyroscope alone, {used} of {len(result.angles)} turns: {MODEL}")
