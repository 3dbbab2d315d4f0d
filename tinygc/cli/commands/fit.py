"""``fit``: from a session to models and closure figures."""

from __future__ import annotations

import argparse
from dataclasses import replace

from session.base import features
from session.base.errors import CalibrationError
from tinygc.cli.arguments import folder_written, path_read, positive, three
from tinygc.cli.defaults import defaults_json, limit_text
from tinygc.cli.options import add_fit_arguments, fit_options, given
from tinygc.cli.results import Done, complain, output, run_each, try_destinations, write_json

#: arguments of a fit that also apply when the bias is re-estimated
HONOURED = ("exclude", "no_earth", "bias")
#: sources of a re-estimated bias of a stored calibration
OF_DAY = ("start", "gravity", "given")
SUMMARY = "fit the calibration, compare the methods, print the closure errors"
USES_EFFECTS = True
DEFAULTS = {"limit": "limits.closure_deg"}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    limit = "pass only if the held-out tilt of the segments and each closure run's RMSE are at most this"
    command.add_argument("folder", type=path_read, help="session folder; several are fitted one by one")
    command.add_argument("more", type=path_read, nargs="*", metavar="folder", help="further folders")
    add_fit_arguments(command, OF_DAY)
    command.add_argument("--resume", action="store_true", help="go on with a training --as-in-paper that was interrupted")
    command.add_argument("--physics", metavar="auto|IDS", help="fit what explain names as well (auto), or effects by id, with commas")
    command.add_argument("--model", type=path_read, metavar="FILE", help="a stored calibration, whose bias alone is taken anew (--bias)")
    command.add_argument("--bias-dps", type=three, metavar="X,Y,Z", help="what the sensor reads at rest, for --bias given")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where the models go (fit/ in the session folder)")
    command.add_argument("--limit", type=positive, metavar="DEG", help=limit)
    command.add_argument("--strict", action="store_true", help="exit 1 for all but PASS without doubts")
    command.add_argument("--verbose", action="store_true", help="print all methods, noise components, alternatives and remarks")


def run(args: argparse.Namespace) -> int:
    """Fit models to a session and report closure figures; several sessions are fitted separately."""
    if (done := features.first("fit of folders", args)) is not None:
        pass
    elif args.more:
        return run_each(args, _fit, "tinygc-fits/1", "Fits, degrees: held-out tilt rms, RMSE of each closure run")
    else:
        done = _fit(args)
    write_json(args.json, done.table)
    return done.code


def _fit(args: argparse.Namespace) -> Done:
    """Fit one session, or what a feature takes for a recording of its own."""
    if (done := features.first("fit of a folder", args)) is not None:
        return done
    if args.bias in OF_DAY or args.model or args.bias_dps:
        return _rebias(args)
    if args.resume and not fit_options(args).by_torch:
        raise CalibrationError(
            "--resume goes on with a training as in the paper, and this fit has none; add --as-in-paper and a method that is trained "
            "(tinygc or tinygc_denoised), or leave --resume out"
        )
    from tinygc.estimation.options import forget
    from tinygc.library.fits import fit
    from tinygc.reporting.fit_screen import COLUMNS, files_line, fit_screen, next_line, verdict_text
    from tinygc.reporting.fit_text import fit_report
    from tinygc.reporting.terminal import progress_bar

    physics = None if args.physics is None else _physics(args.physics)
    checkpoints = args.out or args.folder / "fit"
    options = replace(fit_options(args), physics=physics, checkpoints=checkpoints, resume=args.resume)
    try_destinations(args, "fit")
    with progress_bar(args.quiet) as progress:
        result = fit(args.folder, options, progress=progress)
    decision, use = result.verdict(args.limit), result.result.use
    table = result.to_json(args.limit) | defaults_json(args)
    # Save the results first: a failing terminal must not lose them.
    folder = result.save(args.out, args.limit)
    forget(checkpoints)
    console = output(args)
    if args.verbose:
        console.print(verdict_text(decision))
        console.print(fit_report(result.result))
    else:
        console.print(fit_screen(result.result, decision), width=COLUMNS)
    console.print(files_line(result.result, folder, decision), soft_wrap=True)
    console.print(next_line(result.result, decision, args.effects), soft_wrap=True)
    if result.result.against_raw.failed:
        complain(result.result.against_raw.words)
    elif not decision.passed:
        missed = "; ".join(text for met, text in decision.reasons if met is False)
        complain(f"above {limit_text(args)}: {missed}" if args.limit is not None else decision.headline)
    code = 1 if not decision.passed or (args.strict and decision.answer != "pass") else 0
    return _done(code, table, use.method or use.best, decision.word)


def _done(code: int, table: dict, method: str | None, says: str) -> Done:
    """Return the result with the figures of one method."""
    if method is None:
        return Done(code, table, says)
    runs = tuple(run[method]["rmse_deg"] for run in table["closure_runs"] if method in run)
    held_out, floor = table["methods"][method]["holdout"]["tilt_rms_deg"], table["noise"]["closure_floor_rms_deg"]
    return Done(code, table, says, held_out, floor, runs)


def _physics(words: str) -> tuple[str, ...]:
    """Parse effect ids or ``auto``; unknown ids are reported before anything is read."""
    from session.base.errors import FitError
    from tinygc.effects import catalogue

    ids = tuple(dict.fromkeys(name.strip() for name in words.split(",")))
    if unknown := [name for name in ids if name not in catalogue() and ids != ("auto",)]:
        raise FitError(
            f"--physics: {unknown[0]!r} is no effect; give auto, or of {', '.join(catalogue())}, or its folder with --effects DIR"
        )
    return ids


def _rebias(args: argparse.Namespace) -> Done:
    """Re-estimate the bias of a stored calibration."""
    if args.model is None or args.bias not in OF_DAY or (args.bias == "given") != (args.bias_dps is not None):
        raise CalibrationError(
            "a bias of the day needs the stored calibration and its source: --model FILE --bias start, or --bias gravity, "
            "or --bias given --bias-dps X,Y,Z"
        )
    if idle := given(args, HONOURED):
        raise CalibrationError(
            f"{', '.join(idle)}: of no use with --model and --bias, which fit nothing and take only the bias anew; "
            f"leave {'it' if len(idle) == 1 else 'them'} out"
        )
    from tinygc.estimation.bias_of_day import MODEL
    from tinygc.library.biases import rebias
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args, "fit")
    with progress_bar(args.quiet) as progress:
        exclude = tuple(dict.fromkeys(args.exclude))
        result = rebias(
            args.folder, args.model, args.bias, bias_dps=args.bias_dps, use_earth=not args.no_earth, exclude=exclude, progress=progress
        )
    table = result.to_json() | defaults_json(args)
    folder = result.save(args.out)
    output(args).print(result.page)
    output(args).print(f"model: {folder / MODEL}", soft_wrap=True)
    chosen = f"stored_{args.bias}"
    only = {
        "methods": {chosen: table["methods"][chosen]},
        "closure_runs": [{"file": run["file"], chosen: run[chosen]} for run in table["closure_runs"]],
    }
    above = [] if args.limit is None else _above(only, args.limit)
    if above:
        complain(f"above {limit_text(args)}: {'; '.join(above)}")
    return _done(1 if above else 0, table, chosen, f"bias of the day: {args.bias}")


def _above(table: dict, limit_deg: float) -> list[str]:
    """Return the figures of a fit above ``--limit``: the best held-out tilt, and each closure run's best RMSE."""
    from tinygc.estimation.requirements import simply_accepted

    tilts = {name: method["holdout"]["tilt_rms_deg"] for name, method in table["methods"].items()}
    figures = [("the best held-out tilt", tilts)]
    for run in table["closure_runs"]:
        figures.append((f"{run['file']}'s best RMSE", {name: run[name]["rmse_deg"] for name in tilts if name in run}))
    said = []
    for what, by_method in figures:
        best = min(by_method, key=by_method.__getitem__)
        if not simply_accepted(by_method[best], (0.0, limit_deg)):
            said.append(f"{what} is {by_method[best]:.4g} deg ({best})")
    return said
