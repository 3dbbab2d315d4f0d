"""One unit over its life: whether a calibration holds, what its numbers do, what they are worth."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "verify": (
            "verification.command",
            "say whether a calibration still holds by a short recording of today, and if not, why, what it costs, and what to do",
        ),
        "watch": (
            "watch.command",
            "watch a live stream or a log: whether the zero, gravity and the turns still agree with the calibration",
        ),
        "history": (
            "history.command",
            "one unit over its sessions: scatter between switch-ons, drift a year, shocks, when to calibrate next",
        ),
        "budget": ("budget.command", "the uncertainty by source: of each parameter, and of the attitude after a motion"),
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
        "beside a report": "certificate.command:beside_report",
    },
)
