"""Options of ``report`` for a certificate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, file_written, option
from tinygc.cli.arguments import OWN_PLACE


@dataclass(frozen=True)
class CertificateOptions(Record):
    """Options of ``report``."""

    certificate: Path | None = option(
        None,
        "write the certificate as well, the form that a laboratory signs (certificate.html in the session folder)",
        read=file_written,
        alone=OWN_PLACE,
    )
    dcc: Path | None = option(None, "write the certificate as a Digital Calibration Certificate, XML", read=file_written)
    as_found: Path | None = option(None, "the model in use until now: the certificate states its errors as found")
