"""``fit``: from a session to models and closure figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import argument, folder_written, given, option, part
from tinygc.cli.arguments import three
from tinygc.cli.defaults import defaults_json, limit_text
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import Done, complain, inside, output, run_each, try_destinations, write_json
from tinygc.estimation.options import BIASES, FitOptions

#: options of a fit that also apply when the bias is re-estimated
HONOURED = ("exclude", "earth", "bias")
#: sources of a re-estimated bias of a stored calibration
OF_DAY = ("start", "gravity", "given")
SUMMARY = "fit the calibration, compare the methods, print the closure errors"


@dataclass(frozen=True)
class Options(FitOptions, Command, UsesEffects):
    """Options of ``fit``."""

    folder: Path = argument("session folder; several are fitted one by one")
    more: tuple[Path, ...] = argument("further folders", ())
    bias: str = option(
        "auto",
        "from the ends of the turns, from the stills around each, or whichever closes held-out segments better (auto); "
        "with --model, of the day: the first still, gravity over the run, --bias-dps",
        choices=(*BIASES, *OF_DAY),
    )
    model: Path | None = option(None, "a stored calibration, whose bias alone is taken anew (--bias)")
    bias_dps: tuple[float, ...] | None = option(
        None, "what the sensor reads at rest, for --bias given", unit="dps", metavar="X,Y,Z", read=three
    )
    out: Path | None = option(None, "where the models go (fit/ in the session folder)", metavar="DIR", read=folder_written)
    limit: float | None = option(
        None,
        "pass only if the held-out tilt of the segments and each closure run's RMSE are at most this",
        unit="deg",
        above=0,
        default_key="limits.closure_deg",
    )
    strict: bool = option(False, "exit 1 for all but PASS without doubts")
    verbose: bool = option(False, "print all methods, noise components, alternatives and remarks")


def run(args: Options) -> int:
    """Fit models to a session and report closure figures; several sessions are fitted separately."""
    if args.more:
        return run_each(args, _fit, "tinygc-fits/1", "Fits, degrees: held-out tilt rms, RMSE of each closure run")
    done = _fit(args)
    write_json(args.json, done.table)
    return done.code


def _fit(args: Options) -> Done:
    """Fit one session, or what a feature takes for a recording of its own."""
    if (done := features.first("fit of a folder", args)) is not None:
        return done
    if args.bias in OF_DAY or args.model or args.bias_dps:
        return _rebias(args)
    from tinygc.library.fits import fit
    from tinygc.reporting.fit_screen import COLUMNS, files_line, fit_screen, next_line, verdict_text
    from tinygc.reporting.fit_text import fit_report
    from tinygc.reporting.terminal import progress_bar

    _require_known(args.physics)
    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        result = fit(args.folder, part(args, FitOptions), progress=progress)
    decision, use = result.verdict(args.limit), result.result.use
    table = result.to_json(args.limit) | defaults_json(args)
    # Save the results first: a failing terminal must not lose them.
    folder = result.save(args.out, args.limit)
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


def _require_known(ids: tuple[str, ...] | None) -> None:
    """Raise FitError for an effect that is none, before anything is read."""
    from session.base.errors import FitError
    from tinygc.effects import catalogue

    if ids not in (None, ("auto",)) and (unknown := [name for name in ids or () if name not in catalogue()]):
        raise FitError(
            f"--physics: {unknown[0]!r} is no effect; give auto, or of {', '.join(catalogue())}, or its folder with --effects DIR"
        )


def _rebias(args: Options) -> Done:
    """Re-estimate the bias of a stored calibration."""
    if args.model is None or args.bias not in OF_DAY or (args.bias == "given") != (args.bias_dps is not None):
        raise CalibrationError(
            "a bias of the day needs the stored calibration and its source: --model FILE --bias start, or --bias gravity, "
            "or --bias given --bias-dps X,Y,Z"
        )
    if idle := given(part(args, FitOptions, bias="auto"), HONOURED):
        raise CalibrationError(
            f"{', '.join(idle)}: of no use with --model and --bias, which fit nothing and take only the bias anew; "
            f"leave {'it' if len(idle) == 1 else 'them'} out"
        )
    from tinygc.fitting.bias_of_day import MODEL
    from tinygc.library.biases import rebias
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        result = rebias(
            args.folder, args.model, args.bias, bias_dps=args.bias_dps, use_earth=args.earth, exclude=args.exclude, progress=progress
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
    from tinygc.verdict.requirements import simply_accepted

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
