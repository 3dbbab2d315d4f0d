"""``report``: write the calibration as one HTML file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import argument, file_written, option, part, values
from tinygc.cli.defaults import defaults_json, limit_text
from tinygc.cli.logs import of_session
from tinygc.cli.options import Command, Force, UsesEffects, VerdictOptions
from tinygc.cli.results import Done, complain, output, run_each, try_file, verdict, write_json
from tinygc.estimation.options import FitOptions
from tinygc.reporting import ReportOptions


@dataclass(frozen=True)
class Options(ReportOptions, FitOptions, VerdictOptions, Command, UsesEffects, Force):
    """Options of ``report``."""

    folder: Path = argument("session folder; of several, each gets a report of its own")
    more: tuple[Path, ...] = argument("further folders", ())
    out: Path | None = option(None, "the report (report.html in the session folder)", read=file_written)


def run(args: Options) -> int:
    """Write the calibration as one HTML file, for several sessions one each."""
    args, _ = of_session(args)
    if not args.more:
        done = _report(args)
        write_json(args.json, done.table)
        return done.code
    for ask in features.each("after a report"):
        ask(args)
    if args.out is not None:
        raise CalibrationError("--out names one file; of several folders each gets its report.html in it: leave --out out")
    return run_each(args, _report, "tinygc-reports/1", "reported", lambda _: "written: report.html in each folder")


def _report(args: Options) -> Done:
    from session.base.units import DEG
    from tinygc.estimation.bias import tilt_rms
    from tinygc.library.reports import report
    from tinygc.reporting.fit_screen import next_line
    from tinygc.reporting.html.paper import require_browser
    from tinygc.reporting.terminal import progress_bar

    path = args.out or args.folder / "report.html"
    if args.folder.is_dir():  # else the reading of the session reports it
        try_file(path, args.json)
    writers = [write for ask in features.each("after a report") if (write := ask(args)) is not None]
    if args.pdf:
        require_browser()
        try_file(path.with_suffix(".pdf"), args.json)
    with progress_bar(args.quiet) as progress:
        made = report(args.folder, options=part(args, FitOptions), progress=progress, **values(args, ReportOptions))
    files = made.save(path, pdf=args.pdf)
    decision, evidence = made.verdict, made.data
    output(args).print(made.page)
    output(args).print(f"written: {', '.join(map(str, files))}")
    output(args).print(next_line(evidence.fit, decision, args.effects, reported=True))
    verdict(args, decision.headline)
    table, code = made.to_json() | defaults_json(args), 0
    for write in writers:
        table |= write(made)
    if args.limit_deg is not None and not decision.passed:
        complain(f"above {limit_text(args)}: {'; '.join(text for met, text in decision.reasons if met is False)}")
        code = 1
    elif evidence.fit.against_raw.condemns(tilt_rms(evidence.adopted.angles) / DEG):
        complain("the calibration closes held-out segments worse than the raw rates do: do not apply it")
        code = 1
    elif not decision.passed or (args.strict and decision.answer != "pass"):
        complain(decision.headline)
        code = 1
    figures, word = table["closure"], decision.word
    runs = tuple(run["rmse_deg"] for run in figures["runs"])
    return Done(code, table, word, figures["holdout_tilt_rms_deg"], figures["floor_rms_deg"], runs)
