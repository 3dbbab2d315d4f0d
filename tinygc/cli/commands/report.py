"""``report``: write the calibration as one HTML file."""

from __future__ import annotations

import argparse

from session.base import features
from session.base.errors import CalibrationError
from tinygc.cli.arguments import OWN_PLACE, file_written, path_read, positive
from tinygc.cli.defaults import defaults_json, limit_text
from tinygc.cli.options import add_fit_arguments, fit_options
from tinygc.cli.results import Done, complain, output, run_each, try_file, verdict, write_json

SUMMARY = "the calibration report: one HTML file that needs nothing else"
USES_EFFECTS = True
DEFAULTS = {"limit": "limits.closure_deg"}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    limit = "pass only if the held-out tilt of the segments and each closure run's RMSE are at most this; exit 1 if not"
    command.add_argument("folder", type=path_read, help="session folder; of several, each gets a report of its own")
    command.add_argument("more", type=path_read, nargs="*", metavar="folder", help="further folders")
    command.add_argument("--out", type=file_written, metavar="FILE", help="the report (report.html in the session folder)")
    command.add_argument("--pdf", action="store_true", help="print it as well, to a PDF beside it; needs Chromium")
    command.add_argument("--limit", type=positive, metavar="DEG", help=limit)
    command.add_argument("--strict", action="store_true", help="exit 1 for all but PASS without doubts")
    command.add_argument("--no-explain", action="store_true", help="do not ask why recording and simulation differ")
    what = "write the certificate as well, the form that a laboratory signs (certificate.html in the session folder)"
    command.add_argument("--certificate", type=file_written, nargs="?", const=OWN_PLACE, metavar="FILE", help=what)
    what = "write the certificate as a Digital Calibration Certificate, XML"
    command.add_argument("--dcc", type=file_written, metavar="FILE", help=what)
    what = "the model in use until now: the certificate states its errors as found"
    command.add_argument("--as-found", type=path_read, metavar="FILE", help=what)
    add_fit_arguments(command)


def run(args: argparse.Namespace) -> int:
    """Write the calibration as one HTML file, for several sessions one each."""
    if not args.more:
        done = _report(args)
        write_json(args.json, done.table)
        return done.code
    if args.certificate is not None and args.certificate is not OWN_PLACE:
        raise CalibrationError("--certificate FILE names one file; of several folders each gets its certificate.html in it: leave FILE out")
    if args.dcc is not None or args.as_found is not None:
        option = "--dcc" if args.dcc is not None else "--as-found"
        raise CalibrationError(f"{option} names one file, and there are several folders; report them one by one")
    if args.out is not None:
        raise CalibrationError("--out names one file; of several folders each gets its report.html in it: leave --out out")
    return run_each(args, _report, "tinygc-reports/1", "Reports, degrees: held-out tilt rms, RMSE of each closure run")


def _report(args: argparse.Namespace) -> Done:
    from session.base.units import DEG
    from tinygc.estimation.bias import tilt_rms
    from tinygc.library.reports import report
    from tinygc.reporting.html.paper import require_browser
    from tinygc.reporting.terminal import progress_bar

    path = args.out or args.folder / "report.html"
    try_file(args, path)
    form = None if args.certificate is None else args.folder / "certificate.html" if args.certificate is OWN_PLACE else args.certificate
    certified = form is not None or args.dcc is not None
    if args.as_found is not None and not certified:
        raise CalibrationError("--as-found is stated on a certificate: add --certificate, or leave it out")
    if certified:
        for certificate in features.each("certificate of a report"):
            certificate.check_before(args.folder, form, args.dcc)
    for each in (form, args.dcc):
        if each is not None:
            try_file(args, each)
    if args.pdf:
        require_browser()
        try_file(args, path.with_suffix(".pdf"))
    with progress_bar(args.quiet) as progress:
        made = report(args.folder, options=fit_options(args), explain=not args.no_explain, limit_deg=args.limit, progress=progress)
    certificate = made.certificate(args.as_found) if certified else None
    files = made.save(path, pdf=args.pdf)
    if certificate is not None and form is not None:
        files += certificate.save(form, pdf=args.pdf)
    decision, evidence = made.verdict, made.data
    for line, style in made.lines:
        output(args).print(line, style=style)
    output(args).print(f"written: {', '.join(map(str, files))}", soft_wrap=True)
    if certificate is not None and certificate.line:
        complain(certificate.line)
    verdict(args, decision.headline)
    if certificate is not None and args.dcc is not None:
        output(args).print(f"written: {certificate.save_dcc(args.dcc)}", soft_wrap=True)
    table, code = made.to_json() | defaults_json(args), 0
    table |= {} if certificate is None else {"certificate": certificate.to_json()}
    if args.limit is not None and not decision.passed:
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
