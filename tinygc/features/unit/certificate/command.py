"""``report --certificate``: the certificate next to the report."""

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
    if args.more and own.as_found is not None:
        raise CalibrationError("--as-found names one file, and there are several folders; report them one by one")
    form = args.folder / "certificate.html" if own.certificate is OWN_PLACE else own.certificate
    if form is None:
        if own.as_found is not None:
            raise CalibrationError("--as-found is stated on a certificate: add --certificate, or leave it out")
        return None
    if args.more:
        return None
    from tinygc.features.unit.certificate.content import certificate, check_before

    check_before(args.folder, form, own.as_found)
    try_file(form, args.json)

    def write(report: Report) -> dict:
        made = certificate(report, own.as_found)
        files = made.save(form, pdf=args.pdf)
        if made.line:
            complain(made.line)
        output(args).print(f"written: {', '.join(map(str, files))}")
        return {"certificate": made.to_json()}

    return write
