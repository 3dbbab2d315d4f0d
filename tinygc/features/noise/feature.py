"""The noise of a sensor at rest, from milliseconds to hours; what a filter makes of it."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "noise": (
            "command",
            "the noise of a sensor at rest, from milliseconds to hours: each term with its sigma, and when the others will be known",
        ),
        "noise record": ("record_command", "record a rest log, and show how long is enough for the noise"),
    },
    public={"estimate_noise": "library"},
)
