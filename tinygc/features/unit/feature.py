"""One unit over its life: whether a calibration holds, what its numbers do, what they are worth."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "verify": ("verification.command", "whether a calibration still holds, by a minute of today", "over time"),
        "watch": ("watch.command", "compare a live stream or a log with its calibration", "over time"),
        "history": ("history.command", "one unit over its sessions, and when to recalibrate", "over time"),
        "budget": ("budget.command", "the uncertainty by source, of parameters and of attitude", "lab"),
    },
    public={
        "certificate": "certificate.content",
        "verify": "verification.verdict",
        "watch": "watch.watch",
        "history": "history.library",
        "compare": "history.comparison",
        "Compared": "history.comparison",
        "budget": "budget.library",
    },
    serves={
        "section of session.toml": "certificate.given:CertificateGiven",
        "report section": ("budget.library", "history.shown"),
        "options of report": "options:CertificateOptions",
        "after a report": "certificate.command:after_report",
    },
)
