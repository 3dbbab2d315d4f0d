"""One unit over its life: whether a calibration holds, what its numbers do, what they are worth."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "verify": "verification.command",
        "watch": "watch.command",
        "history": "history.command",
        "budget": "budget.command",
    },
    public={
        "certificate": "certificate.library",
        "verify": "verification.library",
        "watch": "watch.library",
        "history": "history.library",
        "budget": "budget.library",
    },
    serves={
        "section of session.toml": "certificate.given:CertificateGiven",
        "report section": ("budget.report_section", "history.report_section"),
        "options of report": "options:CertificateOptions",
        "beside a report": "certificate.command:beside_report",
    },
)
