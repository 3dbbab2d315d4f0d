"""``fit``: from a session to models and closure figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base import features
from session.base.errors import DataError
from session.base.options import argument, folder_written, option, part
from session.base.texts import command_line
from session.replay.options import GROUP, Answers, Place
from tinygc.cli.defaults import defaults_json, limit_text
from tinygc.cli.logs import of_session
from tinygc.cli.options import Command, UsesEffects, VerdictOptions
from tinygc.cli.results import Done, complain, inside, output, run_each, try_destinations, write_json
from tinygc.estimation.options import ACCELEROMETERS, OF_ACCELEROMETER, FitOptions


@dataclass(frozen=True)
class Options(FitOptions, Answers, Place, VerdictOptions, Command, UsesEffects):
    """Options of ``fit``."""

    RARE = GROUP

    folder: Path = argument("session folder, or a log; several folders are fitted one by one, several logs are one recording's")
    more: tuple[Path, ...] = argument("further folders, or the accelerometer's log", ())
    accelerometer: str = option(
        "auto",
        f"{OF_ACCELEROMETER}; alone: nothing else is fitted, of the stills, and a copy of the session gets it (--out, FOLDER_calibrated)",
        choices=(*ACCELEROMETERS, "alone"),
    )
    out: Path | None = option(None, "where the models go (fit/ in the session folder)", metavar="DIR", read=folder_written)
    verbose: bool = option(False, "print all methods, noise components, alternatives and remarks")


def run(args: Options) -> int:
    """Fit models to a session and report closure figures; several sessions are fitted separately."""
    given = args.folder
    args, read_as = of_session(args)
    if args.more:
        return run_each(args, _fit, "tinygc-fits/1", "fitted", lambda folders: f"next: {command_line('report', *folders)}")
    try:
        done = _fit(args, read_as)
    except DataError as error:
        raise DataError(str(error).replace("log0001.csv:", f"{given.name}:") if given.is_file() else str(error)) from None
    write_json(args.json, done.table)
    return done.code


def _fit(args: Options, read_as: str = "") -> Done:
    """Fit one session, or what a feature takes for a recording of its own.  read_as: how its log was read."""
    if args.accelerometer == "alone":
        return _accelerometer(args)
    if (done := features.first("fit of a folder", args)) is not None:
        return done
    from tinygc.library.fits import fit
    from tinygc.reporting.fit_screen import correction, files_line, fit_screen, next_line, verdict_lines
    from tinygc.reporting.fit_text import fit_report
    from tinygc.reporting.terminal import progress_bar

    _require_known(args.physics)
    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        result = fit(args.folder, part(args, FitOptions), progress=progress)
    decision, use = result.verdict(args.limit_deg), result.result.use
    table = result.to_json(args.limit_deg) | defaults_json(args)
    # Save the results first: a failing terminal must not lose them.
    folder = result.save(args.out, args.limit_deg)
    console = output(args)
    if args.verbose:
        console.print(*verdict_lines(decision, reasons=True), sep="\n")
        console.print(fit_report(result.result))
        console.print(correction(result.result))
    else:
        console.print(fit_screen(result.result, decision))
    if read_as:
        console.print(read_as)
    console.print(files_line(result.result, folder, decision))
    console.print(next_line(result.result, decision, args.effects))
    if console.quiet and not decision.passed:  # else the screen begins with it
        limit = f" ({limit_text(args)})" if args.limit_deg is not None else ""
        failed = "; ".join([decision.headline, *decision.further])
        complain(result.result.against_raw.words if result.result.against_raw.failed else f"{failed}{limit}")
    code = 1 if not decision.passed or (args.strict and decision.answer != "pass") else 0
    return _done(code, table, use.method or use.best, decision.word)


def _accelerometer(args: Options) -> Done:
    """Estimate nine parameters of the accelerometer, or as many as the attitudes determine, and write a copy of the session with them."""
    args.refuse_with("--accelerometer alone", "accelerometer", "out")
    from tinygc.library.sessions import accelerometer

    found = accelerometer(args.folder)
    out = args.out or args.folder.resolve().with_name(args.folder.resolve().name + "_calibrated")
    found.save(out)
    output(args).print(found.page)
    output(args).print(f"calibrated copy: {out}")
    return Done(0, found.to_json(), "the accelerometer alone")


def _done(code: int, table: dict, method: str | None, words: str) -> Done:
    """Return the result with the figures of one method."""
    if method is None:
        return Done(code, table, words)
    runs = tuple(run[method]["rmse_deg"] for run in table["closure_runs"] if method in run)
    held_out, floor = table["methods"][method]["holdout"]["tilt_rms_deg"], table["noise"]["closure_floor_rms_deg"]
    return Done(code, table, words, held_out, floor, runs)


def _require_known(ids: tuple[str, ...] | None) -> None:
    """Raise FitError for an effect that is none, before anything is read."""
    from session.base.errors import FitError
    from tinygc.effects import catalogue

    if ids not in (None, ("auto",)) and (unknown := [name for name in ids or () if name not in catalogue()]):
        raise FitError(
            f"--physics: {unknown[0]!r} is no effect; give auto, or of {', '.join(catalogue())}, or its folder with --effects DIR"
        )
