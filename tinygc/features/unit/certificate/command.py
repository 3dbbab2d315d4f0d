"""``report --certificate`` and ``--dcc``: the certificate next to the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.options import record_in
from tinygc.cli.arguments import OWN_PLACE
from tinygc.cli.results import complain, output, try_file
from tinygc.features.unit.options import CertificateOptions

if TYPE_CHECKING:
    from tinygc.library.reports import Report


def after_report(args: Any) -> Callable[[Report], dict] | None:
    """Refuse, before the work, what cannot be written.  Return what writes a report's certificate, and returns its key of the JSON.

    None where no certificate is requested.  Raises CalibrationError.
    """
    own = record_in(args.of_features, CertificateOptions)
    if args.more and own.certificate not in (None, OWN_PLACE):
        raise CalibrationError("--certificate FILE names one file; of several folders each gets its certificate.html in it: leave FILE out")
    for option, path in (("--dcc", own.dcc), ("--as-found", own.as_found)):
        if args.more and path is not None:
            raise CalibrationError(f"{option} names one file, and there are several folders; report them one by one")
    form = args.folder / "certificate.html" if own.certificate is OWN_PLACE else own.certificate
    if form is None and own.dcc is None:
        if own.as_found is not None:
            raise CalibrationError("--as-found is stated on a certificate: add --certificate, or leave it out")
        return None
    if args.more:
        return None
    from tinygc.features.unit.certificate.content import certificate, check_before

    check_before(args.folder, form, own.dcc, own.as_found)
    for path in (form, own.dcc):
        if path is not None:
            try_file(path, args.json)

    def write(report: Report) -> dict:
        made = certificate(report, own.as_found)
        files = [] if form is None else made.save(form, pdf=args.pdf)
        if made.line:
            complain(made.line)
        if own.dcc is not None:
            files.append(made.save_dcc(own.dcc))
        output(args).print(f"written: {', '.join(map(str, files))}")
        return {"certificate": made.to_json()}

    return write
