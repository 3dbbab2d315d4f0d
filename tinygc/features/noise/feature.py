"""The noise of a sensor at rest, from milliseconds to hours; what a filter makes of it."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "noise": ("command", "the noise of a sensor at rest, term by term", "lab"),
        "noise record": ("record_command", "record a rest log until its noise is known", "lab"),
    },
    public={"estimate_noise": "library"},
)
