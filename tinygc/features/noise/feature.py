"""The noise of a sensor at rest, from milliseconds to hours; what a filter makes of it."""

from session.base.features import Feature

FEATURE = Feature(
    commands={"noise": "command", "noise record": "record_command"},
    public={"estimate_noise": "library"},
)
